"""Many agents' networks, losses and memories in one stack, against each agent alone."""

from __future__ import annotations

import copy
from collections.abc import Iterator

import numpy as np
import pytest
import torch
from checkpoints import same
from plain_ddqn import distance, plain_network
from torch import nn

from learners.replay import ObservationTable, Replay
from learners.stacked import StackedDoubleQ, StackedMLP

PAPER_SIZES = [16, 128, 128, 128, 128, 15]


@pytest.fixture(scope="module", autouse=True)
def one_thread() -> Iterator[None]:
    """One thread, as the DDQN has it: matrices this small only make several wait for each other."""
    threads = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(threads)


def generators(agents: int, first: int = 0) -> list[np.random.Generator]:
    return [np.random.default_rng(first + agent) for agent in range(agents)]


def double_q(
    sizes: list[int], agents: int, first: int = 0, period: int | None = 7
) -> StackedDoubleQ:
    """Agents in double precision, so that rounding hides nothing."""
    q = StackedDoubleQ(sizes, generators(agents, first), 1e-3, 0.8, period)
    q.online.double()
    q.target.double()
    return q


def minibatch(rng: np.random.Generator, agents: int, many: int, rows: int) -> list[torch.Tensor]:
    shape = (agents, many)
    return [
        torch.from_numpy(part)
        for part in (
            rng.integers(0, rows, shape),
            rng.integers(0, 15, shape),
            rng.normal(0, 5, shape),
            rng.integers(0, rows, shape),
            (rng.random(shape) < 0.6).astype(float),
        )
    ]


def some_observations(rng: np.random.Generator, rows: int) -> torch.Tensor:
    return torch.from_numpy(rng.integers(0, 2, (rows, 16)).astype(float))


# -- the network ----------------------------------------------------------------------------------


def test_the_network_is_linear_layers_with_relu_between() -> None:
    stack = StackedMLP(PAPER_SIZES, generators(3)).double()
    inputs = torch.randn(3, 5, 16, dtype=torch.float64, generator=torch.manual_seed(0))
    for agent in range(3):
        network = plain_network(stack, agent)
        torch.testing.assert_close(stack(inputs)[agent], network(inputs[agent]))
        torch.testing.assert_close(stack(inputs[0])[agent], network(inputs[0]))
    assert stack(inputs).min() < 0  # no ReLU after the last layer


def test_agents_start_with_weights_of_their_own() -> None:
    together = StackedMLP(PAPER_SIZES, generators(3))
    alone = StackedMLP(PAPER_SIZES, generators(1, first=2))
    for several, one in zip(together.parameters(), alone.parameters(), strict=True):
        assert torch.equal(several[2], one[0])
        assert not torch.equal(several[0], several[1])


# -- the loss -------------------------------------------------------------------------------------


def by_hand() -> StackedDoubleQ:
    """One linear layer over two one-hot observations: the values are the weights."""
    q = StackedDoubleQ([2, 3], generators(1), 0.1, 0.5, None)
    with torch.no_grad():
        for network, values in (
            (q.online, [[1.0, 5.0, 2.0], [3.0, 2.0, -1.0]]),
            (q.target, [[10.0, 20.0, 30.0], [40.0, 50.0, 60.0]]),
        ):
            network.weights[0].copy_(torch.tensor([values]))
            network.biases[0].zero_()
    q.observe(torch.eye(2))
    return q


def test_the_online_network_chooses_and_the_target_network_judges() -> None:
    losses = by_hand().losses(
        before=torch.tensor([[0, 1, 0]]),
        action=torch.tensor([[1, 0, 2]]),
        reward=torch.tensor([[1.0, 2.0, 2.5]]),
        after=torch.tensor([[1, 0, 1]]),
        goes_on=torch.tensor([[1.0, 1.0, 0.0]]),
    )
    # After the first, action 0 looks best (3) and is judged 40: the target is 1 + .5 * 40 = 21,
    # and the value 5. After the second, action 1 (5), judged 20: 2 + .5 * 20 = 12, the value 3.
    # The third ends: 2.5, the value 2. Huber: |x| - .5 beyond 1, x²/2 within.
    assert losses.item() == pytest.approx(((16 - 0.5) + (9 - 0.5) + 0.5**2 / 2) / 3)


def test_no_gradient_flows_through_the_target() -> None:
    q = by_hand()
    q.losses(*(torch.tensor([[x]]) for x in (0, 1, 1.0, 1, 1.0))).sum().backward()
    gradient = q.online.weights[0].grad
    assert gradient is not None
    assert gradient.tolist() == [[[0.0, -1.0, 0.0], [0.0, 0.0, 0.0]]]
    assert all(parameter.grad is None for parameter in q.target.parameters())


def test_evaluating_distinct_observations_once_changes_no_loss_and_no_gradient() -> None:
    rng = np.random.default_rng(0)
    q = double_q(PAPER_SIZES, 3)
    with torch.no_grad():
        for parameter in q.target.parameters():
            parameter.mul_(1.1)
    for rows in (1, 4, 40, 400):
        table = some_observations(rng, rows)
        q.observe(table)
        batch = minibatch(rng, 3, 64, rows)
        losses = q.losses(*batch)
        q.online.zero_grad()
        losses.sum().backward()
        before, action, reward, after, goes_on = batch
        for agent in range(3):
            online, target = plain_network(q.online, agent), plain_network(q.target, agent)
            with torch.no_grad():
                best = online(table[after[agent]]).argmax(1, keepdim=True)
                judged = target(table[after[agent]]).gather(1, best)[:, 0]
                goal = reward[agent] + 0.8 * goes_on[agent] * judged
            chosen = online(table[before[agent]]).gather(1, action[agent, :, None])[:, 0]
            error = (chosen - goal).abs()
            loss = torch.where(error < 1, error**2 / 2, error - 0.5).mean()
            loss.backward()
            assert losses[agent].item() == pytest.approx(loss.item(), abs=1e-10)
            linears = [layer for layer in online if isinstance(layer, nn.Linear)]
            for linear, weight, bias in zip(
                linears, q.online.weights, q.online.biases, strict=True
            ):
                assert (linear.weight.grad.T - weight.grad[agent]).abs().max() < 1e-10
                assert (linear.bias.grad - bias.grad[agent, 0]).abs().max() < 1e-10


# -- many agents at once --------------------------------------------------------------------------


def test_agents_trained_together_are_the_agents_trained_alone() -> None:
    rng = np.random.default_rng(1)
    table = some_observations(rng, 30)
    sizes = [16, 32, 32, 15]
    together = double_q(sizes, 4)
    alone = [double_q(sizes, 1, first=agent) for agent in range(4)]
    for q in (together, *alone):
        q.observe(table)
    start = copy.deepcopy(together.online)
    for _ in range(300):
        batch = minibatch(rng, 4, 16, 30)
        losses = together.update(*batch)
        for agent, q in enumerate(alone):
            loss = q.update(*(part[agent : agent + 1] for part in batch))
            assert loss.item() == pytest.approx(losses[agent].item(), rel=1e-6)
    for agent, q in enumerate(alone):
        assert distance(plain_network(q.online, 0), together.online, agent) < 1e-7
        assert distance(plain_network(q.target, 0), together.target, agent) < 1e-7
        assert distance(plain_network(start, agent), together.online, agent) > 0.03


def test_an_agent_that_does_not_train_stays_as_it_is() -> None:
    rng = np.random.default_rng(2)
    q, undisturbed = double_q([16, 8, 15], 3), double_q([16, 8, 15], 3)
    table = some_observations(rng, 9)
    trains = torch.tensor([True, False, True])
    for step in range(40):
        for each in (q, undisturbed):
            each.observe(table)
        if step == 20:  # by then, momentum would carry it on
            kept = plain_network(q.online, 1)
        batch = minibatch(rng, 3, 8, 9)
        q.update(*batch, trains if step >= 20 else None)
        undisturbed.update(*batch)
    assert distance(kept, q.online, 1) == 0.0
    assert distance(plain_network(undisturbed.online, 1), q.online, 1) > 1e-3
    for agent in (0, 2):
        assert distance(plain_network(undisturbed.online, agent), q.online, agent) == 0.0


def test_the_target_network_is_updated_at_exactly_its_period() -> None:
    rng = np.random.default_rng(3)
    for period in (5, 1, None):
        q = double_q([16, 8, 15], 2, period=period)
        start = copy.deepcopy(q.target.state_dict())
        q.observe(some_observations(rng, 9))
        for update in range(1, 21):
            before = copy.deepcopy(q.target.state_dict())
            q.update(*minibatch(rng, 2, 8, 9))
            if period and update % period == 0:
                assert same(q.target.state_dict(), q.online.state_dict())
                assert not same(q.target.state_dict(), before)
            else:
                assert same(q.target.state_dict(), before)
        assert same(q.target.state_dict(), start) == (period is None)


def test_loaded_networks_replace_all_that_was_known_of_the_old_ones() -> None:
    rng = np.random.default_rng(4)
    batch = minibatch(rng, 2, 8, 9)
    table = some_observations(rng, 9)
    q, other = double_q([16, 8, 15], 2), double_q([16, 8, 15], 2, first=10)
    for each in (q, other):
        each.observe(table)
        each.losses(*batch)
    q.load_state_dict(other.state_dict())
    assert torch.equal(q.losses(*batch), other.losses(*batch))


# -- memory ---------------------------------------------------------------------------------------


def filled(subjects: int, capacity: int, many: int) -> Replay:
    """Transition *t* of subject *s* is marked 100 s + t in every column."""
    replay = Replay(subjects, capacity)
    who = np.arange(subjects)
    for t in range(many):
        mark = 100 * who + t
        replay.add(who, mark, mark, mark.astype(float), mark, np.full(subjects, t % 2 == 0))
    return replay


def test_a_full_ring_overwrites_its_oldest_transition() -> None:
    replay = filled(2, capacity=5, many=3)
    assert replay.length.tolist() == [3, 3]
    replay = filled(2, capacity=5, many=12)
    assert replay.length.tolist() == [5, 5]
    assert sorted(replay.before[1]) == [107, 108, 109, 110, 111]
    for column in (replay.action, replay.reward, replay.after):
        assert np.array_equal(column, replay.before)
    assert np.array_equal(replay.goes_on, replay.before % 2 == 0)


def test_rings_fill_each_at_its_own_pace() -> None:
    replay = Replay(3, 4)
    for t in range(6):
        who = np.array([0, 2]) if t < 3 else np.array([2])
        replay.add(who, who * 10 + t, who, who.astype(float), who, who > 0)
    assert replay.length.tolist() == [3, 0, 4]
    assert replay.before.tolist() == [[0, 1, 2, 0], [0, 0, 0, 0], [24, 25, 22, 23]]
    late = replay.sample(np.full((3, 1), 0.99))[0]
    assert late[:, 0].tolist() == [2, 0, 23]


def test_samples_are_uniform_and_from_the_subject_s_own_ring() -> None:
    replay = filled(3, capacity=8, many=5)
    luck = np.random.default_rng(0).random((3, 20_000))
    before, action, reward, after, goes_on = replay.sample(luck)
    for subject in range(3):
        marks, counts = np.unique(before[subject], return_counts=True)
        assert marks.tolist() == [100 * subject + t for t in range(5)]
        assert ((counts - 4000) ** 2 / 4000).sum() < 18.5  # chi-square of 4 degrees: p = .001
    for column in (action, reward, after):
        assert np.array_equal(column, before)
    assert np.array_equal(goes_on, before % 2 == 0)
    edge = replay.sample(np.full((3, 1), np.nextafter(1.0, 0.0)))[0]
    assert edge[:, 0].tolist() == [4, 104, 204]


def test_the_table_numbers_observations_in_order_of_appearance() -> None:
    table = ObservationTable(4)
    a, b, c = np.array([[0, 0, 0, 0], [1, 0, 0, 1], [1, 0, 0, 0]], dtype=np.int8)
    assert table.number(np.stack([b, a, b])).tolist() == [0, 1, 0]
    assert table.number(np.stack([a, c, c, b])).tolist() == [1, 2, 2, 0]
    assert table.number(np.zeros((0, 4), dtype=np.int8)).tolist() == []
    assert table.rows.tolist() == [b.tolist(), a.tolist(), c.tolist()]
    kept = copy.deepcopy(table.state_dict())
    other = ObservationTable(4)
    other.load_state_dict(table.state_dict())
    assert other.number(np.stack([c, a ^ 1])).tolist() == [2, 3]
    assert same(table.state_dict(), kept)
