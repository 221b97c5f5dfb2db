"""Networks with a memory, and how a policy gradient trains them."""

import copy

import numpy as np
import pytest
import torch

from openlock_learners.networks.ppo import (
    PPO,
    PPOSettings,
    Rollout,
    advantages,
    log_prob,
    sample_actions,
)
from openlock_learners.networks.recurrent_policy import make_policy
from support.small_policies import TINY, WIDTH, random_inputs, rng, weights_of


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


def network_of(kind, networks=1):
    return make_policy(
        TINY.model_copy(update={"kind": kind}), 7, [rng(n) for n in range(networks)]
    ).double()


# -- networks -------------------------------------------------------------------------------------


def test_to_the_network_of_levers_all_places_are_alike():
    network = network_of("levers")
    places = rng(3).permutation(7)
    pairs = [places, 7 + places, [14, 15], 16 + places, 23 + places, range(30, WIDTH)]
    order = np.concatenate([np.array(part) for part in pairs])
    actions = np.concatenate([places, 7 + places, [14]])
    inputs, state = random_inputs(1, 6, 4), torch.zeros(1, 4, network.state_size(7)).double()
    logits, values, _ = network(inputs, state)
    moved_logits, moved_values, _ = network(inputs[..., order], state)
    assert torch.allclose(moved_logits, logits[..., actions], atol=1e-12)
    assert torch.allclose(moved_values, values, atol=1e-12)
    # And they are not alike because nothing matters.
    assert not torch.allclose(moved_logits, logits, atol=1e-3)


@pytest.mark.parametrize("kind", ["levers", "flat"])
def test_a_walk_is_its_steps_and_a_fresh_one_forgets(kind):
    network = network_of(kind)
    inputs = random_inputs(1, 5, 3)
    state = torch.from_numpy(rng(1).normal(size=(1, 3, network.state_size(7))))
    fresh = torch.zeros(1, 5, 3, dtype=torch.bool)
    fresh[0, 2, 1] = True
    logits, values, end = network(inputs, state, fresh)
    for step in range(5):
        state = torch.where(fresh[:, step, :, None], 0.0, state)
        one, value, state = network(inputs[:, step : step + 1], state)
        assert torch.allclose(one[:, 0], logits[:, step], atol=1e-12)
        assert torch.allclose(value[:, 0], values[:, step], atol=1e-12)
    assert torch.allclose(state, end, atol=1e-12)
    assert not torch.allclose(network(inputs, end)[0], logits, atol=1e-3)


# -- policy gradient ------------------------------------------------------------------------------


def test_advantages_on_a_worked_example():
    def row(*values):
        return torch.tensor(values)[None, :, None]

    rollout = Rollout(
        inputs=torch.zeros(1, 4, 1, 1),
        state=torch.zeros(1, 1, 1),
        fresh=row(False, False, False, False),
        action=row(0, 0, 0, 0),
        log_prob=row(0.0, 0.0, 0.0, 0.0),
        value=row(2.0, 9.0, 4.0, 8.0),
        reward=row(1.0, 5.0, 3.0, 0.0),
        done=row(False, False, True, False),
        mask=row(True, False, True, True),
        bootstrap=torch.tensor([[6.0]]),
    )
    better = advantages(rollout, gamma=0.5, gae_lambda=0.5)[0, :, 0].tolist()
    last = 0.0 + 0.5 * 6.0 - 8.0
    third = 3.0 - 4.0  # its trial is over
    first = 1.0 + 0.5 * 4.0 - 2.0 + 0.25 * third  # the second did not happen
    assert better == pytest.approx([first, 0.0, third, last])


def test_actions_are_drawn_by_their_chances():
    logits = np.log(np.array([[0.2, 0.5, 0.3]], dtype=np.float32)).repeat(7, axis=0)
    uniform = np.array([0.0, 0.19, 0.21, 0.69, 0.71, 0.99, 1 - 1e-12])
    actions = sample_actions(logits + 3, uniform)
    assert actions.tolist() == [0, 0, 1, 1, 2, 2, 2]
    expected = np.log([0.2, 0.2, 0.5, 0.5, 0.3, 0.3, 0.3])
    assert log_prob(logits + 3, actions) == pytest.approx(expected, abs=1e-6)


def made_up(networks, steps=6, rooms=4):
    generator, shape = rng(5), (networks, steps, rooms)
    return Rollout(
        inputs=random_inputs(*shape, seed=6),
        state=torch.zeros(networks, rooms, 7 * TINY.lever + TINY.room).double(),
        fresh=torch.from_numpy(generator.random(shape) < 0.2),
        action=torch.from_numpy(generator.integers(15, size=shape)),
        log_prob=torch.from_numpy(generator.normal(-2.7, 0.1, size=shape)),
        value=torch.from_numpy(generator.normal(size=shape)),
        reward=torch.from_numpy(generator.normal(size=shape)),
        done=torch.from_numpy(generator.random(shape) < 0.2),
        mask=torch.from_numpy(generator.random(shape) < 0.7),
        bootstrap=torch.from_numpy(generator.normal(size=(networks, rooms))),
    )


def test_the_first_step_follows_the_plain_policy_gradient():
    # Where nothing is clipped yet, PPO's gradient is that of log-chance times advantage.
    settings = PPOSettings(epochs=1, minibatches=1, value_weight=0.0, max_grad_norm=1e9)
    network, rollout = network_of("levers"), made_up(1)
    with torch.no_grad():
        logits, _, _ = network(rollout.inputs, rollout.state, rollout.fresh)
    now = torch.log_softmax(logits, -1).gather(-1, rollout.action[..., None]).squeeze(-1)
    rollout = rollout._replace(log_prob=now)
    trainer = PPO(network, settings)
    trainer.optimizer = torch.optim.SGD(network.parameters(), lr=1.0)
    before = weights_of(network, 0)
    plain = copy.deepcopy(network)
    trainer.update(rollout, entropy_weight=0.0)

    better, counts = advantages(rollout, settings.gamma, settings.gae_lambda), rollout.mask
    known = better[counts]
    better = (better - known.mean()) / (known.std(unbiased=False) + 1e-6)
    logits, _, _ = plain(rollout.inputs, rollout.state, rollout.fresh)
    chances = torch.log_softmax(logits, -1).gather(-1, rollout.action[..., None]).squeeze(-1)
    (chances * better)[counts].mean().backward()
    up = torch.cat([p.grad.flatten() for p in plain.parameters() if p.grad is not None])
    assert up.norm() > 0.01
    assert torch.allclose(weights_of(network, 0) - before, up, atol=1e-9)


def test_what_did_not_happen_teaches_nothing_and_networks_learn_alone():
    rollout = made_up(2)
    settings = PPOSettings(minibatches=2)
    both = network_of("levers", networks=2)
    start = weights_of(both, 1)
    for _ in range(20):
        trainer = PPO(both, settings)
        trainer.update(rollout, 0.01)
    garbled = rollout._replace(
        reward=torch.where(rollout.mask, rollout.reward, 99.0),
        action=torch.where(rollout.mask, rollout.action, 3),
    )
    alone = make_policy(TINY, 7, [rng(1)]).double()
    for _ in range(20):
        trainer = PPO(alone, settings)
        trainer.update(Rollout(*(tensor[1:] for tensor in garbled)), 0.01)
    assert torch.allclose(weights_of(both, 1), weights_of(alone, 0), atol=1e-9)
    assert (weights_of(both, 1) - start).norm() > 0.1
