"""Proximal policy optimization (PPO: Schulman et al., 2017) of a recurrent policy.

Actions that turned out better than expected are made likelier and others less likely, but no
action's probability moves far from what it was when it was taken. What was expected is a value that
the network learns along with its policy; the advantage of an action is estimated over many steps
(GAE: Schulman et al., 2016).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch
from torch import Tensor, nn

from openlock_learners.meta.training_file import TrainingFile
from openlock_learners.networks.recurrent_policy import LeverPolicy

VALUE_WEIGHT, MAX_NORM = 0.5, 0.5
"""Weight of the squared error of the values, and the norm that gradients are clipped to."""


def sample_actions(logits: Tensor, uniform: Tensor) -> Tensor:
    """``[M]`` actions drawn from the policy, each with one uniform number."""
    reached = torch.softmax(logits.double(), dim=-1).cumsum(dim=-1)
    return (reached < uniform[:, None] * reached[:, -1:]).sum(dim=-1)


def log_prob(logits: Tensor, action: Tensor) -> Tensor:
    """Logarithms of the probabilities of these actions; logits have one more dimension."""
    return torch.log_softmax(logits, dim=-1).gather(-1, action[..., None]).squeeze(-1)


class Rollout(NamedTuple):
    """T steps in M rooms; tensors are ``[T, M]`` where no shape is given."""

    inputs: Tensor  # [T, M, in]
    fresh: Tensor  # the hidden state was reset before the step
    action: Tensor
    log_prob: Tensor  # of the action, under the policy that took it
    value: Tensor
    reward: Tensor
    done: Tensor  # nothing that follows counts for the step
    state: Tensor  # [M, S] hidden state before the first step
    bootstrap: Tensor  # [M] value of what follows the last step

    def of_rooms(self, part: Tensor) -> Rollout:
        """The same steps in some of the rooms, ``[m]``."""
        *steps, state, bootstrap = self
        return Rollout(*[*(tensor[:, part] for tensor in steps), state[part], bootstrap[part]])


def advantages(rollout: Rollout, gamma: float, gae_lambda: float) -> Tensor:
    """``[T, M]`` how much better each action was than expected (GAE).

    A lambda of 0 trusts the values after one step, 1 only what was earned.
    """
    advantage = torch.zeros_like(rollout.value)
    following, ahead = rollout.bootstrap, torch.zeros_like(rollout.bootstrap)
    for step in range(len(advantage) - 1, -1, -1):
        continues = ~rollout.done[step]
        error = rollout.reward[step] + gamma * continues * following - rollout.value[step]
        ahead = error + gamma * gae_lambda * continues * ahead
        following = rollout.value[step]
        advantage[step] = ahead
    return advantage


def improve(
    network: LeverPolicy,
    optimizer: torch.optim.Optimizer,
    rollout: Rollout,
    file: TrainingFile,
    entropy_weight: float,
    generator: np.random.Generator,
) -> float:
    """Train on a rollout, whose rooms the generator mixes; returns the mean entropy."""
    entropies = []
    advantage = advantages(rollout, file.gamma, file.decay)
    returns = advantage + rollout.value
    advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1e-6)
    rooms = advantage.shape[1]
    for _ in range(file.epochs):
        order = torch.from_numpy(generator.permutation(rooms))
        for part in order.tensor_split(min(file.minibatches, rooms)):
            steps = rollout.of_rooms(part)
            logits, values, _ = network(steps.inputs, steps.state, steps.fresh)
            ratio = (log_prob(logits, steps.action) - steps.log_prob).exp()
            clipped = ratio.clamp(1 - file.clip, 1 + file.clip)
            gain = torch.minimum(ratio * advantage[:, part], clipped * advantage[:, part])
            log_probs = torch.log_softmax(logits, dim=-1)
            entropy = -(log_probs.exp() * log_probs).sum(dim=-1)
            error = VALUE_WEIGHT * (values - returns[:, part]) ** 2
            optimizer.zero_grad()
            (error - gain - entropy_weight * entropy).mean().backward()
            nn.utils.clip_grad_norm_(network.parameters(), MAX_NORM)
            optimizer.step()
            entropies.append(float(entropy.detach().mean()))
    return float(np.mean(entropies))
