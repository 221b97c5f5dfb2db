"""Networks with a memory, and how a policy gradient trains them."""

import copy

import numpy as np
import pytest
import torch

from openlock_learners.meta import ppo
from openlock_learners.meta.ppo import Rollout, advantages, improve, log_prob, sample_actions
from openlock_learners.meta.training_file import RoomsFile, TrainingFile
from openlock_learners.networks.recurrent_policy import Sizes, make_policy

TINY = Sizes(lever=5, room=6, reader=7)
WIDTH = 16 + 15 + 2 + 4
"""What is perceived in a room of seven positions."""


def rng(seed=0):
    return np.random.default_rng(seed)


def inputs(*shape):
    return torch.from_numpy(rng(6).integers(0, 2, size=(*shape, WIDTH)).astype(float))


def made_network():
    return make_policy(TINY, rng()).double()


def test_to_the_network_of_levers_all_places_are_alike():
    network, seen, never = made_network(), inputs(6, 4), torch.zeros(6, 4, dtype=torch.bool)
    places = rng(3).permutation(7)
    pairs = [places, 7 + places, [14, 15], 16 + places, 23 + places, range(30, WIDTH)]
    order = np.concatenate([np.array(part) for part in pairs])
    actions = np.concatenate([places, 7 + places, [14]])
    state = torch.zeros(4, network.state_size(7)).double()
    logits, values, _ = network(seen, state, never)
    moved_logits, moved_values, _ = network(seen[..., order], state, never)
    assert torch.allclose(moved_logits, logits[..., actions], atol=1e-12)
    assert torch.allclose(moved_values, values, atol=1e-12)
    # And they are not alike because nothing matters.
    assert not torch.allclose(moved_logits, logits, atol=1e-3)


def test_a_walk_is_its_steps_and_a_fresh_one_forgets():
    network, seen = made_network(), inputs(5, 3)
    state = torch.from_numpy(rng(1).normal(size=(3, network.state_size(7))))
    fresh = torch.zeros(5, 3, dtype=torch.bool)
    fresh[2, 1] = True
    logits, values, end = network(seen, state, fresh)
    for step in range(5):
        logit, value, state = network.step(seen[step], torch.where(fresh[step, :, None], 0, state))
        assert torch.allclose(logit, logits[step], atol=1e-12)
        assert torch.allclose(value, values[step], atol=1e-12)
    assert torch.allclose(state, end, atol=1e-12)
    assert not torch.allclose(network(seen, end, fresh)[0], logits, atol=1e-3)


def made_up(steps=6, rooms=4, **parts):
    generator, shape = rng(5), (steps, rooms)
    drawn = {
        "inputs": inputs(*shape),
        "fresh": torch.from_numpy(generator.random(shape) < 0.2),
        "action": torch.from_numpy(generator.integers(15, size=shape)),
        "log_prob": torch.from_numpy(generator.normal(-2.7, 0.1, size=shape)),
        "value": torch.from_numpy(generator.normal(size=shape)),
        "reward": torch.from_numpy(generator.normal(size=shape)),
        "done": torch.from_numpy(generator.random(shape) < 0.2),
        "state": torch.zeros(rooms, 7 * TINY.lever + TINY.room).double(),
        "bootstrap": torch.from_numpy(generator.normal(size=rooms)),
    }
    return Rollout(**drawn | parts)


def test_advantages_on_a_worked_example():
    rollout = made_up(
        value=torch.tensor([[2.0], [4.0], [8.0]]),
        reward=torch.tensor([[1.0], [3.0], [0.0]]),
        done=torch.tensor([[False], [True], [False]]),
        bootstrap=torch.tensor([6.0]),
    )
    last = 0.0 + 0.5 * 6.0 - 8.0
    second = 3.0 - 4.0  # its trial is over
    first = 1.0 + 0.5 * 4.0 - 2.0 + 0.25 * second
    better = advantages(rollout, gamma=0.5, gae_lambda=0.5)[:, 0].tolist()
    assert better == pytest.approx([first, second, last])


def test_actions_are_drawn_by_their_chances():
    logits = torch.tensor([[0.2, 0.5, 0.3]]).log().repeat(7, 1) + 3
    uniform = torch.tensor([0.0, 0.19, 0.21, 0.69, 0.71, 0.99, 1 - 1e-12], dtype=torch.float64)
    actions = sample_actions(logits, uniform)
    assert actions.tolist() == [0, 0, 1, 1, 2, 2, 2]
    expected = np.log([0.2, 0.2, 0.5, 0.5, 0.3, 0.3, 0.3])
    assert log_prob(logits, actions).numpy() == pytest.approx(expected, abs=1e-6)


def test_the_first_step_follows_the_plain_policy_gradient(monkeypatch):
    # Where nothing is clipped yet, PPO's gradient is that of log-chance times advantage.
    monkeypatch.setattr(ppo, "VALUE_WEIGHT", 0.0)
    monkeypatch.setattr(ppo, "MAX_NORM", 1e9)
    settings = TrainingFile(rooms=RoomsFile(rewards=["basic"]), epochs=1, minibatches=1)
    network, rollout = made_network(), made_up()
    with torch.no_grad():
        logits, _, _ = network(rollout.inputs, rollout.state, rollout.fresh)
    rollout = rollout._replace(log_prob=log_prob(logits, rollout.action))
    plain, optimizer = copy.deepcopy(network), torch.optim.SGD(network.parameters(), lr=1.0)
    improve(network, optimizer, rollout, settings, 0.0, rng())

    better = advantages(rollout, settings.gamma, settings.decay)
    better = (better - better.mean()) / (better.std(unbiased=False) + 1e-6)
    logits, _, _ = plain(rollout.inputs, rollout.state, rollout.fresh)
    (log_prob(logits, rollout.action) * better).mean().backward()
    for before, after in zip(plain.parameters(), network.parameters(), strict=True):
        up = torch.zeros_like(before) if before.grad is None else before.grad
        assert torch.allclose(after - before, up, atol=1e-9)
    assert sum(part.grad.norm() for part in plain.parameters() if part.grad is not None) > 0.01
