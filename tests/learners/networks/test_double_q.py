"""Stacked double Q-learning: its losses by hand, and each agent as it is alone.

The compiled one is compared with plain torch in the course of a DDQN (tests/learners/test_ddqn.py).
"""

import pickle
import subprocess
import sys

import numpy as np
import pytest
import torch

from openlock_learners.ddqn import double_q_class
from openlock_learners.networks.double_q import StackedDoubleQ, find_device
from openlock_learners.networks.double_q_compiled import CompiledDoubleQ
from openlock_learners.networks.replay_buffer import Batch

pytestmark = pytest.mark.slow

SIZES = [16, 24, 40, 24, 15]
AGENTS = 4


@pytest.fixture(autouse=True)
def one_thread_in_double_precision():
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)
    torch.set_num_threads(threads)


@pytest.fixture(params=[StackedDoubleQ, CompiledDoubleQ], ids=["torch", "compiled"])
def kind(request):
    """What holds of the one must hold of the other."""
    return request.param


def made(kind, agents=range(AGENTS), rate=1e-3, **settings):
    generators = [np.random.default_rng(agent) for agent in agents]
    return kind(SIZES, generators, rate, 0.8, **{"target_period": 7, **settings})


def table(rng, rows):
    return torch.from_numpy(rng.integers(0, 2, (rows, 16)).astype(float))


def minibatch(rng, known, many=32):
    """Transitions between the first ``known[agent]`` observations of a table for each agent."""
    shape = (len(known), many)
    which = [(rng.random(shape) * np.array(known)[:, None]).astype(int) for _ in range(2)]
    return Batch(
        before=torch.from_numpy(which[0]),
        action=torch.from_numpy(rng.integers(0, 15, shape)),
        reward=torch.from_numpy(rng.normal(0, 3, shape)),
        after=torch.from_numpy(which[1]),
        not_done=torch.from_numpy((rng.random(shape) < 0.6).astype(float)),
        weight=torch.from_numpy(rng.uniform(0.2, 1, shape)),
        slot=torch.zeros(shape, dtype=torch.int64),
    )


def by_hand(kind, **settings):
    """One linear layer over two one-hot observations: the values are the weights."""
    q = kind([2, 3], [np.random.default_rng(0)], 0.1, 0.5, None, **settings)
    for network, values in (
        (q.online, [[1.0, 5.0, 2.0], [3.0, 2.0, -1.0]]),
        (q.target, [[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]]),
    ):
        network.weights[0].copy_(torch.tensor([values]))
        network.biases[0].zero_()
    q.observe(torch.eye(2))
    return q


def three_transitions(not_done=1.0):
    return Batch(
        before=torch.tensor([[0, 1, 0]]),
        action=torch.tensor([[1, 0, 2]]),
        reward=torch.tensor([[1.0, 2.0, 2.5]]),
        after=torch.tensor([[1, 0, 1]]),
        not_done=torch.tensor([[not_done, not_done, 0.0]]),
        weight=torch.tensor([[1.0, 0.5, 1.0]]),
        slot=torch.zeros(1, 3, dtype=torch.int64),
    )


def test_the_online_network_chooses_and_the_target_network_judges(kind):
    # After the first, action 0 looks best (3) and is judged 40: the target is 1 + .5 * 40 = 21,
    # and the value 5. After the second, action 1 (5), judged 20: 2 + .5 * 20 = 12, the value 3.
    # The third ends: 2.5, the value 2.
    assert by_hand(kind).update(three_transitions()).tolist() == [[5 - 21, 3 - 12, 2 - 2.5]]
    assert by_hand(kind).update(three_transitions(0.0)).tolist() == [[5 - 1, 3 - 2, 2 - 2.5]]
    # In a DQN the target network judges the best action 60 after the first, 30 after the second.
    errors = by_hand(kind, double=False).update(three_transitions())
    assert errors.tolist() == [[5 - (1 + 0.5 * 60), 3 - (2 + 0.5 * 30), 2 - 2.5]]


@pytest.mark.parametrize(
    ("loss", "slopes"), [("huber", [-1, -0.5, -0.5]), ("squared", [-16, -4.5, -0.5])]
)
def test_each_error_pulls_at_the_value_of_its_own_action(kind, loss, slopes):
    q = by_hand(kind, loss=loss, optimizer="sgd")
    before, judged = q.online.weights[0].clone(), q.target.parameters.clone()
    q.update(three_transitions())
    # The slope of the loss at each transition, with its weight, over the three of them; rate .1.
    step = torch.zeros(1, 2, 3)
    step[0, 0, 1], step[0, 1, 0], step[0, 0, 2] = (0.1 * slope / 3 for slope in slopes)
    torch.testing.assert_close(before - q.online.weights[0], step)
    assert torch.equal(q.target.parameters, judged)


@pytest.mark.parametrize(
    ("optimizer", "loss", "rate"),
    [("adam", "huber", 1e-3), ("rmsprop", "squared", 3e-4), ("sgd", "huber", 0.03)],
)
def test_torch_follows_compiled_code_through_all_that_can_happen(optimizer, loss, rate):
    """Tables that grow, agents that pause, minibatches of few and of many, and a checkpoint."""
    rng = np.random.default_rng(0)
    given = {"loss": loss, "optimizer": optimizer, "rate": rate}
    torchs, ours = (made(kind, **given) for kind in (StackedDoubleQ, CompiledDoubleQ))
    start = ours.online.copy()
    observations = table(rng, 90)
    for step in range(150):
        if step % 30 == 0:
            rows = 10 + step // 2
            for q in (torchs, ours):
                q.observe(observations[:rows])
        if step == 75:
            torchs, ours = pickle.loads(pickle.dumps((torchs, ours)))
        batch = minibatch(rng, [1, 5, rows, rows])
        trains = torch.from_numpy(rng.random(AGENTS) < 0.7) if 45 < step < 125 else None
        torch.testing.assert_close(ours.update(batch, trains), torchs.update(batch, trains))
        seen = table(rng, AGENTS).numpy()
        assert (ours.greedy(seen) == torchs.greedy(seen)).all()
    for part in ("online", "target"):
        mine, its = (getattr(q, part).parameters for q in (torchs, ours))
        assert float((mine - its).abs().max()) < 1e-9
    assert float((start.parameters - ours.online.parameters).abs().max()) > 0.01


def test_agents_trained_together_are_exactly_the_agents_trained_alone():
    torch.set_default_dtype(torch.float32)  # whose rounding would show
    rng = np.random.default_rng(2)
    together = made(CompiledDoubleQ)
    alone = [made(CompiledDoubleQ, [agent]) for agent in range(AGENTS)]
    observations = table(rng, 30).float()
    for q in (together, *alone):
        q.observe(observations)
    for _ in range(100):
        batch = minibatch(rng, [30, 12, 3, 1])
        batch = Batch(*(part.float() if part.is_floating_point() else part for part in batch))
        errors = together.update(batch)
        for agent, q in enumerate(alone):
            mine = q.update(Batch(*(part[agent : agent + 1] for part in batch)))
            assert torch.equal(mine[0], errors[agent])
    for agent, q in enumerate(alone):
        for mine, its in zip(together.online.weights, q.online.weights, strict=True):
            assert torch.equal(mine[agent], its[0])
    # What does not train stays as it is, whatever stands in its place, and momentum is at rest.
    batch.reward[1] = float("nan")
    together.update(batch, torch.tensor([True, False, True, True]))
    for mine, its in zip(together.online.weights, alone[1].online.weights, strict=True):
        assert torch.equal(mine[1], its[0])
        assert not torch.isnan(mine).any()
        assert not torch.equal(mine[0], its[0])
    batch.reward[1] = 0.0
    batch.reward[2, 3] = float("nan")
    assert torch.isnan(together.update(batch)).nonzero().tolist() == [[2, 3]]


def test_the_target_network_is_updated_at_exactly_its_period(kind):
    rng = np.random.default_rng(3)
    for period in (5, 1, None):
        q = made(kind, [0, 1], target_period=period)
        q.observe(table(rng, 9))
        for update in range(1, 16):
            before = q.target.parameters.clone()
            q.update(minibatch(rng, [9, 9]))
            due = bool(period) and update % period == 0
            assert torch.equal(q.target.parameters, q.online.parameters) == due
            assert torch.equal(q.target.parameters, before) != due


def test_a_cpu_is_given_compiled_code_and_a_gpu_torch():
    assert double_q_class(find_device("cpu")) is CompiledDoubleQ
    assert double_q_class(torch.device("cuda")) is StackedDoubleQ
    assert find_device("auto").type == ("cuda" if torch.cuda.is_available() else "cpu")


def test_numba_and_torch_are_imported_only_when_a_learner_begins():
    code = (
        "import sys, openlock_learners.ddqn; print({'numba', 'torch', 'scipy'} & set(sys.modules))"
    )
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.strip() == "set()"
