"""The update of fixed shape, which a GPU replays as a graph, run on a CPU against compiled code."""

from __future__ import annotations

import warnings
from collections.abc import Iterator

import numpy as np
import pytest
import torch
from torch import Tensor

import openlock_learners.networks.double_q
from openlock_learners.networks.cuda_graph import Captured
from openlock_learners.networks.double_q import StackedDoubleQ
from openlock_learners.networks.double_q_compiled import CompiledDoubleQ
from openlock_learners.networks.replay_buffer import Batch
from support.minibatches import minibatch

SIZES = [16, 12, 12, 15]


@pytest.fixture(autouse=True)
def one_thread_in_double_precision() -> Iterator[None]:
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)
    torch.set_num_threads(threads)


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop", "sgd"])
@pytest.mark.parametrize(("many", "large"), [(40, 1000), (8, 1000), (8, 100)])
def test_fixed_shapes_give_the_same_numbers(
    optimizer: str, many: int, large: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of a table that is smaller and larger than a minibatch, and too large to be judged whole."""
    monkeypatch.setattr(openlock_learners.networks.double_q, "LARGE_TABLE", large)
    rng = np.random.default_rng(0)
    qs = [
        kind(
            SIZES,
            [np.random.default_rng(agent) for agent in range(3)],
            1e-3,
            0.8,
            7,
            optimizer=optimizer,
        )
        for kind in (CompiledDoubleQ, StackedDoubleQ)
    ]
    start = qs[0].online.parameters.clone()
    table = torch.from_numpy(rng.integers(0, 2, (150, 16)).astype(float))
    for step in range(200):
        if step % 40 == 0:
            rows = 5 + step  # past 64 and past 128, where the padding grows
            for q in qs:
                q.observe(table[: min(rows, 150)])
        batch = minibatch(rng, 3, many, min(rows, 150))
        trains = torch.from_numpy(rng.random(3) < 0.6) if 50 < step < 150 else None
        reference, fixed = (q.update(batch, trains) for q in qs)
        torch.testing.assert_close(fixed, reference)
    for part in ("online", "target"):
        reference, fixed = (getattr(q, part).parameters for q in qs)
        assert (reference - fixed).abs().max() < 1e-9
    assert (start - qs[0].online.parameters).abs().max() > 1e-3


def test_all_shapes_and_addresses_stay_while_the_table_grows_within_its_padding(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    q = StackedDoubleQ(SIZES, [np.random.default_rng(0)], 1e-3, 0.8, 2)
    rng = np.random.default_rng(1)
    seen = set()
    trace = q.online.activations

    def watched(inputs: Tensor) -> list[Tensor]:
        seen.add((inputs.shape, q._table.data_ptr(), q._target_values.data_ptr()))  # type: ignore[union-attr]
        return trace(inputs)

    monkeypatch.setattr(q.online, "activations", watched)
    for rows in (3, 17, 64):
        q.observe(torch.from_numpy(rng.integers(0, 2, (rows, 16)).astype(float)))
        for _ in range(3):
            q.update(minibatch(rng, 1, 40, rows))
    assert len(seen) == 1


def test_a_loaded_checkpoint_is_not_trained_by_steps_captured_before() -> None:
    """They hold the addresses of what the optimizer remembered then."""
    rng = np.random.default_rng(3)
    reference = CompiledDoubleQ(SIZES, [np.random.default_rng(1)], 1e-3, 0.8, 7)
    fixed = StackedDoubleQ(SIZES, [np.random.default_rng(2)], 1e-3, 0.8, 7)
    for q in (reference, fixed):
        q.observe(torch.from_numpy(rng.integers(0, 2, (9, 16)).astype(float)))
        for _ in range(5):
            q.update(minibatch(rng, 1, 8, 9))
    fixed.observe(reference._table)
    assert fixed._captured
    fixed.load_state_dict(reference.state_dict())
    assert not fixed._captured
    for _ in range(20):
        batch = minibatch(rng, 1, 8, 9)
        torch.testing.assert_close(fixed.update(batch), reference.update(batch))


class Pretended(Captured):
    """On a GPU that is none: nothing can be captured there, or a capture calls the step."""

    fails = False

    def __init__(self, *given: object) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self._captures = True

    def _aside(self, *given: Tensor) -> Tensor:
        return self._step(*given)

    def _capture(self, given: tuple[Tensor, ...]) -> None:
        if self.fails:
            raise RuntimeError("operation not permitted when stream is capturing")
        self._given = [tensor.clone() for tensor in given]
        self._returned = torch.zeros(())
        self._replay = lambda: self._returned.copy_(self._step(*self._given)) and None


def test_a_captured_step_is_replayed_on_what_is_given_each_time() -> None:
    total = torch.zeros(())
    step = Pretended(lambda x: total.add_(x).clone(), torch.device("cpu"))
    told = [float(step(torch.tensor(float(x)))) for x in range(8)]
    assert told == np.arange(8).cumsum().tolist()
    assert step._replay is not None


def test_a_step_that_cannot_be_captured_is_called_and_one_warning_says_so(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Pretended, "fails", True)
    total = torch.zeros(())
    step = Pretended(lambda x: total.add_(x).clone(), torch.device("cpu"))
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        told = [float(step(torch.tensor(float(x)))) for x in range(8)]
    assert told == np.arange(8).cumsum().tolist()
    assert ["without a CUDA graph" in str(warning.message) for warning in warned] == [True]


def test_on_a_cpu_nothing_is_captured() -> None:
    step = Captured(lambda x: x + 1, torch.device("cpu"))
    assert [float(step(torch.tensor(float(x)))) for x in range(6)] == [1, 2, 3, 4, 5, 6]
    assert step._replay is None


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
def test_on_a_gpu_the_graph_gives_the_numbers_of_the_reference() -> None:
    rng = np.random.default_rng(2)
    qs = [
        kind(SIZES, [np.random.default_rng(agent) for agent in range(3)], 1e-3, 0.8, 7, device=at)
        for kind, at in ((CompiledDoubleQ, "cpu"), (StackedDoubleQ, "cuda"))
    ]
    table = torch.from_numpy(rng.integers(0, 2, (20, 16)).astype(float))
    for q in qs:
        q.observe(table)
    for _ in range(60):
        batch = minibatch(rng, 3, 40, 20)
        errors = qs[1].update(Batch(*(part.cuda() for part in batch)))
        torch.testing.assert_close(errors.cpu(), qs[0].update(batch))
    assert all(step._replay for step in qs[1]._captured.values())
