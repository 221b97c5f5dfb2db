"""The compiled lever policy against the plain one, whose gradients are autograd's."""

from typing import NamedTuple

import pytest
import torch

from openlock_learners.networks.lever_policy_compiled import CompiledLeverPolicy, CompiledPPO
from openlock_learners.networks.lever_policy_kernels import ROOMS
from openlock_learners.networks.ppo import PPO, PPOSettings, Rollout, advantages
from openlock_learners.networks.recurrent_policy import LeverPolicy, Sizes
from support.small_policies import TINY, rng

pytestmark = pytest.mark.slow

TOLERANCE = 1e-5
"""Of single precision: the difference as a share of the largest number, or of a gradient's norm.

Of half a million units that read a lever, one may be as near to 0 as sums are rounded, and its
gradient is then either there or not, a thousandth of all: so there are few rooms here.
"""


@pytest.fixture(autouse=True)
def one_thread():
    torch.set_num_threads(1)


class Given(NamedTuple):
    inputs: torch.Tensor
    state: torch.Tensor
    fresh: torch.Tensor


def given(positions, steps, rooms, state, seed=0):
    """Rooms of which some begin anew; in every third all levers are alike at first.

    Levers that are alike are all at the maximum. They begin alike: where they became alike only
    to the last digits, it would be chance which of them takes the gradient.
    """
    generator, shape = rng(seed), (1, steps, rooms)
    inputs = generator.integers(0, 2, (*shape, 4 * positions + 9))
    inputs[..., 2 * positions + 2 : 4 * positions + 2] = 0
    acted = generator.integers(0, 2 * positions, shape)[..., None] + 2 * positions + 2
    inputs[(*torch.meshgrid(*map(torch.arange, shape), indexing="ij"), acted[..., 0])] = 1
    inputs[:, : steps // 2, ::3] = 0
    before = generator.normal(size=(1, rooms, state))
    before[:, ::3] = 0
    fresh = generator.random(shape) < 0.2
    return Given(
        *(torch.from_numpy(part).float() for part in (inputs, before)), torch.tensor(fresh)
    )


def pair(sizes=TINY):
    networks = LeverPolicy(sizes, [rng(1)]), CompiledLeverPolicy(sizes, [rng(1)])
    for network in networks:
        with torch.no_grad():  # its first answers are nearly the same everywhere
            network.moves.weight.mul_(10)
            network.door_and_value.weight.mul_(10)
            network.moves.bias.add_(0.3)
    return networks


def learned(at, network, seed=2):
    """Actions after which some ratios are beyond what they are clipped to, some of them masked."""
    generator, shape = rng(seed), at.fresh.shape
    with torch.no_grad():
        logits, values, _ = network(*at)
    action = torch.from_numpy(generator.integers(0, logits.shape[-1], shape))
    now = torch.log_softmax(logits, dim=-1).gather(-1, action[..., None]).squeeze(-1)
    drawn = [torch.from_numpy(generator.normal(size=shape)).float() for _ in range(3)]
    return Rollout(
        *at,
        action=action,
        log_prob=now + drawn[0] / 4,
        value=values + drawn[1],
        reward=drawn[2],
        done=torch.from_numpy(generator.random(shape) < 0.1),
        mask=torch.from_numpy(generator.random(shape) < 0.8),
        bootstrap=values[:, -1],
    )


def gradients_of(network):
    parameters = network.named_parameters()
    return {name: part.grad for name, part in parameters if part.grad is not None}


@pytest.mark.parametrize(
    ("sizes", "positions", "steps", "rooms"),
    [(TINY, 3, 4, 2 * ROOMS + 3), (Sizes(), 7, 45, 2)],
    ids=["groups and a rest", "as trained"],
)
def test_it_runs_as_the_plain_network_and_has_its_gradients(sizes, positions, steps, rooms):
    plain, compiled = pair(sizes)
    at = given(positions, steps, rooms, plain.state_size(positions))
    assert at.fresh.any()
    with torch.no_grad():
        expected = plain(*at)
    for found, part in zip(compiled(*at), expected, strict=True):
        assert found.shape == part.shape
        assert (found - part).abs().max() <= TOLERANCE * part.abs().max()
    state = at.state
    for moment in range(steps):  # step by step it does exactly the same
        logits, _, state = compiled.step(at.inputs[:, moment], state, at.fresh[:, moment])
        assert torch.equal(logits, compiled(*at)[0][:, moment])
    assert torch.equal(state, compiled(*at)[2])

    rollout, which = learned(at, plain), torch.from_numpy(rng(3).permutation(rooms)[1:])
    better = advantages(rollout, 0.9, 0.9)
    told = [
        trainer(network, PPOSettings()).find_gradients(
            rollout, better, better + rollout.value, which, 0.1
        )
        for trainer, network in ((PPO, plain), (CompiledPPO, compiled))
    ]
    assert 0 < told[0]["clipped"] < 1
    assert told[1] == pytest.approx(told[0], rel=TOLERANCE)
    gradients = gradients_of(compiled)
    for name, gradient in gradients_of(plain).items():
        assert gradient.norm() > 0, name
        assert (gradients[name] - gradient).norm() <= TOLERANCE * gradient.norm(), name
