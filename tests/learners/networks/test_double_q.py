"""Many agents' networks and losses in one stack, against each agent alone."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

import openlock_learners.networks.double_q
from openlock_learners.networks.double_q import StackedDoubleQ, StackedMLP, find_device
from openlock_learners.networks.double_q_compiled import CompiledDoubleQ
from openlock_learners.networks.replay_buffer import Batch
from support.minibatches import minibatch
from support.plain_ddqn import distance, plain_network

PAPER_SIZES = [16, 128, 128, 128, 128, 15]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """One thread, as the DDQN has it: matrices this small only make several wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


@pytest.fixture(autouse=True)
def double_precision() -> Iterator[None]:
    """So that rounding hides nothing."""
    torch.set_default_dtype(torch.float64)
    yield
    torch.set_default_dtype(torch.float32)


@pytest.fixture(params=[StackedDoubleQ, CompiledDoubleQ], ids=["torch", "compiled"])
def kind(request: pytest.FixtureRequest) -> type[StackedDoubleQ]:
    """What holds of the one must hold of the other."""
    return request.param


def generators(agents: int, first: int = 0) -> list[np.random.Generator]:
    return [np.random.default_rng(first + agent) for agent in range(agents)]


def double_q(
    sizes: list[int],
    agents: int,
    first: int = 0,
    period: int | None = 7,
    optimizer: Any = "adam",
    kind: type[StackedDoubleQ] = StackedDoubleQ,
) -> StackedDoubleQ:
    rate = 0.1 if optimizer == "sgd" else 1e-3
    return kind(sizes, generators(agents, first), rate, 0.8, period, optimizer=optimizer)


def of(batch: Batch, agent: int) -> Batch:
    """The minibatch of one agent."""
    return Batch(*(part[agent : agent + 1] for part in batch))


def distance_between(one: StackedMLP, other: StackedMLP) -> float:
    return (one.parameters - other.parameters).abs().max().item()


def some_observations(rng: np.random.Generator, rows: int) -> torch.Tensor:
    return torch.from_numpy(rng.integers(0, 2, (rows, 16)).astype(float))


# -- the network ----------------------------------------------------------------------------------


def test_the_network_is_linear_layers_with_relu_between() -> None:
    stack = StackedMLP(PAPER_SIZES, generators(3))
    inputs = torch.randn(3, 5, 16, dtype=torch.float64, generator=torch.manual_seed(0))
    for agent in range(3):
        network = plain_network(stack, agent)
        torch.testing.assert_close(stack(inputs)[agent], network(inputs[agent]))
        torch.testing.assert_close(stack(inputs[0])[agent], network(inputs[0]))
    assert stack(inputs).min() < 0  # no ReLU after the last layer


def test_agents_start_with_weights_of_their_own() -> None:
    together = StackedMLP(PAPER_SIZES, generators(3))
    alone = StackedMLP(PAPER_SIZES, generators(1, first=2))
    parts = zip(together.weights + together.biases, alone.weights + alone.biases, strict=True)
    for several, one in parts:
        assert torch.equal(several[2], one[0])
        assert not torch.equal(several[0], several[1])


# -- the loss -------------------------------------------------------------------------------------


def by_hand(kind: type[StackedDoubleQ], **settings: Any) -> StackedDoubleQ:
    """One linear layer over two one-hot observations: the values are the weights."""
    q = kind([2, 3], generators(1), 0.1, 0.5, None, **settings)
    for network, values in (
        (q.online, [[1.0, 5.0, 2.0], [3.0, 2.0, -1.0]]),
        (q.target, [[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]]),
    ):
        network.weights[0].copy_(torch.tensor([values]))
        network.biases[0].zero_()
    q.observe(torch.eye(2))
    return q


def three_transitions(not_done: float = 1.0) -> Batch:
    return Batch(
        before=torch.tensor([[0, 1, 0]]),
        action=torch.tensor([[1, 0, 2]]),
        reward=torch.tensor([[1.0, 2.0, 2.5]]),
        after=torch.tensor([[1, 0, 1]]),
        not_done=torch.tensor([[not_done, not_done, 0.0]]),
        weight=torch.tensor([[1.0, 0.5, 1.0]]),
        slot=torch.zeros(1, 3, dtype=torch.int64),
    )


def test_the_online_network_chooses_and_the_target_network_judges(
    kind: type[StackedDoubleQ],
) -> None:
    # After the first, action 0 looks best (3) and is judged 40: the target is 1 + .5 * 40 = 21,
    # and the value 5. After the second, action 1 (5), judged 20: 2 + .5 * 20 = 12, the value 3.
    # The third ends: 2.5, the value 2.
    assert by_hand(kind).update(three_transitions()).tolist() == [[5 - 21, 3 - 12, 2 - 2.5]]
    assert by_hand(kind).update(three_transitions(0.0)).tolist() == [[5 - 1, 3 - 2, 2 - 2.5]]


def test_in_a_dqn_the_target_network_chooses_and_judges(kind: type[StackedDoubleQ]) -> None:
    # It judges the best action 60 after the first, and 30 after the second.
    errors = by_hand(kind, double=False).update(three_transitions())
    assert errors.tolist() == [[5 - (1 + 0.5 * 60), 3 - (2 + 0.5 * 30), 2 - 2.5]]


@pytest.mark.parametrize(
    ("loss", "slopes"), [("huber", [-1, -0.5, -0.5]), ("squared", [-16, -4.5, -0.5])]
)
def test_each_error_pulls_at_the_value_of_its_own_action(
    kind: type[StackedDoubleQ], loss: Any, slopes: list[float]
) -> None:
    q = by_hand(kind, loss=loss, optimizer="sgd")
    before, judged = q.online.weights[0].clone(), q.target.parameters.clone()
    q.update(three_transitions())
    # The slope of the loss at each transition, with its weight, over the three of them; rate .1.
    step = torch.zeros(1, 2, 3)
    step[0, 0, 1], step[0, 1, 0], step[0, 0, 2] = (0.1 * slope / 3 for slope in slopes)
    torch.testing.assert_close(before - q.online.weights[0], step)
    assert torch.equal(q.target.parameters, judged)


@pytest.mark.parametrize("loss", ["huber", "squared"])
@pytest.mark.parametrize("large", [False, True])
@pytest.mark.parametrize("double", [True, False])
def test_the_gradient_is_the_one_that_autograd_finds(
    loss: Any, large: bool, double: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every transition by itself, in networks as users of torch write them."""
    if large:
        monkeypatch.setattr(openlock_learners.networks.double_q, "LARGE_TABLE", 0)
    rng = np.random.default_rng(0)
    q = StackedDoubleQ(PAPER_SIZES, generators(3), 1e-3, 0.8, None, loss, double=double)
    q.target.parameters.mul_(1.1)
    for rows in (1, 4, 40, 400):
        table = some_observations(rng, rows)
        q.observe(table)
        batch = minibatch(rng, 3, 64, rows, spread=5)
        online = [plain_network(q.online, agent) for agent in range(3)]
        errors = q.update(batch)
        weights, biases = q.online.layers_of(q.online.parameters.grad)
        for agent, network in enumerate(online):
            mine, target = of(batch, agent), plain_network(q.target, agent)
            with torch.no_grad():
                judged = target(table[mine.after[0]])
                if double:
                    best = network(table[mine.after[0]]).argmax(1, keepdim=True)
                    judged = judged.gather(1, best)
                judged = judged.amax(1)
                goal = mine.reward[0] + 0.8 * mine.not_done[0] * judged
            error = network(table[mine.before[0]]).gather(1, mine.action[0, :, None])[:, 0] - goal
            torch.testing.assert_close(errors[agent], error.detach(), atol=1e-10, rtol=0)
            each = error**2 / 2
            if loss == "huber":
                each = torch.where(error.abs() < 1, each, error.abs() - 0.5)
            (mine.weight[0] * each).mean().backward()
            linears = [layer for layer in network if isinstance(layer, nn.Linear)]
            for linear, weight, bias in zip(linears, weights, biases, strict=True):
                assert (linear.weight.grad.T - weight[agent]).abs().max() < 1e-10
                assert (linear.bias.grad - bias[agent, 0]).abs().max() < 1e-10


# -- many agents at once --------------------------------------------------------------------------


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop", "sgd"])
def test_agents_trained_together_are_the_agents_trained_alone(
    kind: type[StackedDoubleQ], optimizer: Any
) -> None:
    rng = np.random.default_rng(1)
    table = some_observations(rng, 30)
    sizes = [16, 32, 32, 15]
    together = double_q(sizes, 4, optimizer=optimizer, kind=kind)
    alone = [double_q(sizes, 1, agent, optimizer=optimizer, kind=kind) for agent in range(4)]
    for q in (together, *alone):
        q.observe(table)
    start = together.online.copy()
    for _ in range(300):
        batch = minibatch(rng, 4, 16, 30, spread=5)
        errors = together.update(batch)
        for agent, q in enumerate(alone):
            torch.testing.assert_close(q.update(of(batch, agent))[0], errors[agent])
    for agent, q in enumerate(alone):
        assert distance(plain_network(q.online, 0), together.online, agent) < 1e-7
        assert distance(plain_network(q.target, 0), together.target, agent) < 1e-7
        assert distance(plain_network(start, agent), together.online, agent) > 0.03


@pytest.mark.parametrize("optimizer", ["adam", "rmsprop", "sgd"])
def test_an_agent_that_does_not_train_stays_as_it_is(
    kind: type[StackedDoubleQ], optimizer: Any
) -> None:
    rng = np.random.default_rng(2)
    q, undisturbed = (double_q([16, 8, 15], 3, optimizer=optimizer, kind=kind) for _ in range(2))
    table = some_observations(rng, 9)
    trains = torch.tensor([True, False, True])
    for step in range(40):
        for each in (q, undisturbed):
            each.observe(table)
        if step == 20:  # by then, momentum would carry it on
            kept = plain_network(q.online, 1)
        batch = minibatch(rng, 3, 8, 9, spread=5)
        broken = batch._replace(weight=batch.weight.clone())
        broken.weight[1] = float("nan")  # as an empty memory may give
        q.update(broken, trains) if step >= 20 else q.update(batch)
        undisturbed.update(batch)
    assert distance(kept, q.online, 1) == 0.0
    assert distance(plain_network(undisturbed.online, 1), q.online, 1) > 1e-3
    for agent in (0, 2):
        assert distance(plain_network(undisturbed.online, agent), q.online, agent) == 0.0


def test_the_target_network_is_updated_at_exactly_its_period(kind: type[StackedDoubleQ]) -> None:
    rng = np.random.default_rng(3)
    for period in (5, 1, None):
        q = double_q([16, 8, 15], 2, period=period, kind=kind)
        start = q.target.copy()
        q.observe(some_observations(rng, 9))
        for update in range(1, 21):
            before = q.target.copy()
            q.update(minibatch(rng, 2, 8, 9, spread=5))
            if period and update % period == 0:
                assert distance_between(q.target, q.online) == 0.0
                assert distance_between(q.target, before) > 0.0
            else:
                assert distance_between(q.target, before) == 0.0
        assert (distance_between(q.target, start) == 0.0) == (period is None)


def test_loaded_networks_replace_all_that_was_known_of_the_old_ones(
    kind: type[StackedDoubleQ],
) -> None:
    rng = np.random.default_rng(4)
    batch = minibatch(rng, 2, 8, 9, spread=5)
    table = some_observations(rng, 9)
    q, other = (double_q([16, 8, 15], 2, first, kind=kind) for first in (0, 10))
    for each in (q, other):
        each.observe(table)
        each.update(batch)
    q.load_state_dict(other.state_dict())
    for _ in range(20):
        assert torch.equal(q.update(batch), other.update(batch))


def test_the_device_is_found_by_name() -> None:
    assert find_device("cpu").type == "cpu"
    assert find_device("auto").type == ("cuda" if torch.cuda.is_available() else "cpu")
