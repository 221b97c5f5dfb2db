"""Compiled double Q-learning, against torch's over a long course of everything that can happen."""

from __future__ import annotations

import copy
import subprocess
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch

from openlock_learners.ddqn import double_q_class
from openlock_learners.networks import double_q_kernels as kernels
from openlock_learners.networks.denormals import denormals_flushed
from openlock_learners.networks.double_q import StackedDoubleQ
from openlock_learners.networks.double_q_compiled import CompiledDoubleQ
from openlock_learners.networks.replay_buffer import Batch
from support.checkpoints import same

pytestmark = pytest.mark.slow

AGENTS = 4
SIZES = [16, 24, 40, 24, 15]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """One thread, as the DDQN has it: matrices this small only make several wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture
def double_precision() -> Iterator[None]:
    """So that rounding hides nothing."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


def made(kind: type[StackedDoubleQ], agents: Any = range(AGENTS), **settings: Any) -> Any:
    rates = {"sgd": 0.03, "rmsprop": 3e-4}
    rate = rates.get(settings.get("optimizer", "adam"), 1e-3)
    generators = [np.random.default_rng(agent) for agent in agents]
    return kind(SIZES, generators, rate, 0.8, **{"target_period": 7, **settings})


def table(rng: np.random.Generator, rows: int) -> torch.Tensor:
    return torch.from_numpy(rng.integers(0, 2, (rows, 16))).to(torch.get_default_dtype())


def minibatch(rng: np.random.Generator, known: list[int], many: int = 32) -> Batch:
    """Transitions between the first ``known[agent]`` observations of a table for each agent."""
    shape = (len(known), many)

    def real(values: Any) -> torch.Tensor:
        return torch.from_numpy(np.asarray(values)).to(torch.get_default_dtype())

    return Batch(
        before=torch.from_numpy((rng.random(shape) * np.array(known)[:, None]).astype(int)),
        action=torch.from_numpy(rng.integers(0, 15, shape)),
        reward=real(rng.normal(0, 3, shape)),
        after=torch.from_numpy((rng.random(shape) * np.array(known)[:, None]).astype(int)),
        not_done=real(rng.random(shape) < 0.6),
        weight=real(rng.uniform(0.2, 1, shape)),
        slot=torch.zeros(shape, dtype=torch.int64),
    )


def of(batch: Batch, agent: int) -> Batch:
    """The minibatch of one agent."""
    return Batch(*(part[agent : agent + 1] for part in batch))


def distance(one: StackedDoubleQ, other: StackedDoubleQ) -> float:
    """The largest difference between their networks."""
    pairs = (
        (one.online.parameters, other.online.parameters),
        (one.target.parameters, other.target.parameters),
    )
    return max(float((mine - its).abs().max()) for mine, its in pairs)


# -- against torch --------------------------------------------------------------------------------


@pytest.mark.usefixtures("double_precision")
@pytest.mark.parametrize(
    ("optimizer", "loss", "period", "double"),
    [
        *[("adam", loss, period, True) for loss in ("huber", "squared") for period in (1, 7, None)],
        *[("rmsprop", "huber", 7, True), ("rmsprop", "squared", None, True)],
        ("sgd", "huber", 7, True),  # the squares of such errors would run away from it
        *[("adam", "huber", period, False) for period in (7, None)],
    ],
)
def test_it_follows_torch_through_all_that_can_happen(
    optimizer: Any, loss: Any, period: int | None, double: bool
) -> None:
    """Tables that grow, agents that pause, and minibatches of few and of many observations."""
    rng = np.random.default_rng(0)
    settings = {
        "loss": loss,
        "optimizer": optimizer,
        "target_period": period,
        "double": double,
    }
    torchs, ours = (made(kind, **settings) for kind in (StackedDoubleQ, CompiledDoubleQ))
    start = ours.online.copy()
    observations = table(rng, 90)
    for step in range(150):
        if step % 30 == 0:
            rows = 10 + step // 2
            torchs.observe(observations[:rows])
            ours.observe(observations[:rows])
        batch = minibatch(rng, [1, 5, rows, rows])
        trains = torch.from_numpy(rng.random(AGENTS) < 0.7) if 45 < step < 125 else None
        torch.testing.assert_close(ours.update(batch, trains), torchs.update(batch, trains))
        seen = table(rng, AGENTS).numpy()
        assert (ours.greedy(seen) == torchs.greedy(seen)).all()
    assert distance(torchs, ours) < 1e-9
    assert float((start.parameters - ours.online.parameters).abs().max()) > 0.01


def test_in_single_precision_it_follows_torch_but_for_rounding() -> None:
    rng = np.random.default_rng(1)
    torchs, ours = made(StackedDoubleQ), made(CompiledDoubleQ)
    observations = table(rng, 30)
    for q in (torchs, ours):
        q.observe(observations)
    for _ in range(300):
        batch = minibatch(rng, [30, 12, 3, 1])
        errors = ours.update(batch)
        assert errors.dtype == torch.float32
        torch.testing.assert_close(errors, torchs.update(batch), atol=2e-3, rtol=1e-3)
    assert distance(torchs, ours) < 2e-3


def test_agents_trained_together_are_exactly_the_agents_trained_alone() -> None:
    rng = np.random.default_rng(2)
    together = made(CompiledDoubleQ)
    alone = [made(CompiledDoubleQ, [agent]) for agent in range(AGENTS)]
    observations = table(rng, 30)
    for q in (together, *alone):
        q.observe(observations)
    for _ in range(200):
        batch = minibatch(rng, [30, 12, 3, 1])
        errors = together.update(batch)
        for agent, q in enumerate(alone):
            assert torch.equal(q.update(of(batch, agent))[0], errors[agent])
    for agent, q in enumerate(alone):
        for mine, its in zip(together.online.weights, q.online.weights, strict=True):
            assert torch.equal(mine[agent], its[0])


def test_what_an_observation_is_worth_does_not_depend_on_what_is_evaluated_with_it() -> None:
    rng = np.random.default_rng(4)
    q = made(CompiledDoubleQ, [0])
    observations = table(rng, 40)
    q.observe(observations)
    alone = [
        kernels.evaluate(q._networks[0], 0, row[None], q._scratch)[0].copy()
        for row in observations.numpy()
    ]
    scratch = q._scratch_for(40)
    for many in range(2, 41):
        which = rng.choice(40, many, replace=False)
        inputs = np.ascontiguousarray(observations.numpy()[which])
        values = kernels.evaluate(q._networks[0], 0, inputs, scratch)
        assert (values == np.array(alone)[which]).all()


def test_the_same_seed_gives_the_same_numbers() -> None:
    rng = np.random.default_rng(3)
    batches = [minibatch(rng, [9] * AGENTS) for _ in range(50)]
    observations = table(rng, 9)
    states = []
    for _ in range(2):
        q = made(CompiledDoubleQ)
        q.observe(observations)
        for batch in batches:
            q.update(batch)
        states.append(q.state_dict())
    assert same(*states)


# -- checkpoints ----------------------------------------------------------------------------------


@pytest.mark.usefixtures("double_precision")
@pytest.mark.parametrize("optimizer", ["adam", "rmsprop", "sgd"])
@pytest.mark.parametrize(
    "kinds", [(StackedDoubleQ, CompiledDoubleQ), (CompiledDoubleQ, StackedDoubleQ)]
)
@pytest.mark.parametrize("before", [0, 30])
def test_the_one_goes_on_from_the_other_s_checkpoint(
    optimizer: Any, kinds: tuple[type[StackedDoubleQ], ...], before: int
) -> None:
    rng = np.random.default_rng(4)
    first, second = (made(kind, optimizer=optimizer) for kind in kinds)
    observations = table(rng, 20)
    for q in (first, second):
        q.observe(observations)
        for _ in range(3 if q is second else 0):  # what it had learned is gone with the loading
            q.update(minibatch(rng, [20] * AGENTS))
    for _ in range(before):
        first.update(minibatch(rng, [20] * AGENTS))
    kept = first.state_dict()
    untouched = copy.deepcopy(kept)
    second.load_state_dict(kept)
    for _ in range(60):
        batch = minibatch(rng, [20] * AGENTS)
        torch.testing.assert_close(first.update(batch), second.update(batch))
    assert first.updates == second.updates == before + 60
    assert distance(first, second) < 1e-9
    assert same(kept, untouched)
    held = [q.state_dict()["optimiser"]["state"] for q in (first, second)]
    assert list(held[0].get(0, {})) == list(held[1].get(0, {}))


# -- what could go wrong unseen -------------------------------------------------------------------


def test_a_copy_learns_like_what_it_is_a_copy_of() -> None:
    rng = np.random.default_rng(0)
    q = made(CompiledDoubleQ)
    q.observe(table(rng, 20))
    q.update(minibatch(rng, [20] * AGENTS))
    twin = copy.deepcopy(q)
    assert distance(twin, q) == 0
    batch = minibatch(rng, [20] * AGENTS)
    before = q.online.parameters.clone()
    for one in (q, twin):
        one.update(batch)
        assert not torch.equal(one.online.parameters, before)
    assert distance(twin, q) == 0


def test_denormal_numbers_are_flushed_in_compiled_code_too() -> None:
    """Torch sets a register of the processor's, by thread, that all arithmetic goes by."""

    def moment_after(steps: int) -> float:
        q = made(CompiledDoubleQ, [0])
        rng = np.random.default_rng(5)
        q.observe(table(rng, 3))
        batch = minibatch(rng, [3])
        q.update(batch)
        moments = q._state["exp_avg"]
        moments.fill_(2e-38)
        nothing = batch._replace(weight=torch.zeros_like(batch.weight))
        for _ in range(steps):  # each takes a tenth
            q.update(nothing)
        return float(moments.double().abs().max())

    assert 0 < moment_after(20) < torch.finfo(torch.float32).tiny
    with denormals_flushed():
        assert moment_after(20) == 0.0


def test_what_is_not_a_number_is_not_hidden() -> None:
    q = made(CompiledDoubleQ)
    rng = np.random.default_rng(6)
    q.observe(table(rng, 9))
    batch = minibatch(rng, [9] * AGENTS)
    batch.reward[1, 3] = float("nan")
    errors = q.update(batch)
    assert torch.isnan(errors).sum() == 1
    for weight in q.online.weights:
        assert torch.isnan(weight).flatten(1).any(dim=1).tolist() == [False, True, False, False]


def test_a_cpu_is_given_compiled_code_and_a_gpu_torch() -> None:
    assert double_q_class(torch.device("cpu")) is CompiledDoubleQ
    assert double_q_class(torch.device("cuda")) is StackedDoubleQ


def test_numba_is_imported_only_when_a_learner_begins() -> None:
    code = (
        "import sys, openlock_learners.ddqn; print({'numba', 'torch', 'scipy'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
