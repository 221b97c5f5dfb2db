"""The update in torch, which a GPU runs, on a CPU against compiled code while the table grows."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest
import torch

import openlock_learners.networks.double_q
from openlock_learners.networks.double_q import StackedDoubleQ
from openlock_learners.networks.double_q_compiled import CompiledDoubleQ
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
def test_a_padded_table_gives_the_same_numbers(
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


def test_a_loaded_checkpoint_is_trained_from_where_it_was() -> None:
    rng = np.random.default_rng(3)
    reference = CompiledDoubleQ(SIZES, [np.random.default_rng(1)], 1e-3, 0.8, 7)
    fixed = StackedDoubleQ(SIZES, [np.random.default_rng(2)], 1e-3, 0.8, 7)
    for q in (reference, fixed):
        q.observe(torch.from_numpy(rng.integers(0, 2, (9, 16)).astype(float)))
        for _ in range(5):
            q.update(minibatch(rng, 1, 8, 9))
    fixed.observe(reference._table)
    fixed.load_state_dict(reference.state_dict())
    for _ in range(20):
        batch = minibatch(rng, 1, 8, 9)
        torch.testing.assert_close(fixed.update(batch), reference.update(batch))
