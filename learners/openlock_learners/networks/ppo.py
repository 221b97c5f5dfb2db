"""Proximal policy optimization (PPO: Schulman et al., 2017) of recurrent policies.

Actions that turned out better than expected are made likelier and others less likely, but no
action's probability moves far from what it was when it was taken. What was expected is a value that
the network learns along with its policy; the advantage of an action is estimated over many steps
(GAE: Schulman et al., 2016).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from openlock_learners.networks.recurrent_policy import RecurrentPolicy

Floats = NDArray[np.float32]


def action_odds(logits: Floats) -> NDArray[np.float64]:
    """``[B, A]`` in what proportion the policy takes each action; the likeliest has 1."""
    odds: NDArray[np.float64] = np.exp(
        logits - logits.max(axis=-1, keepdims=True), dtype=np.float64
    )
    return odds


def sample_actions(logits: Floats, uniform: NDArray[np.float64]) -> NDArray[np.int64]:
    """``[B]`` actions drawn from the policy, each with one uniform number."""
    reached = action_odds(logits).cumsum(axis=-1)
    drawn: NDArray[np.int64] = (reached < uniform[:, None] * reached[:, -1:]).sum(axis=-1)
    return drawn


def log_prob(logits: Floats, action: NDArray[np.int64]) -> Floats:
    """``[B]`` logarithms of the probabilities of these actions."""
    logits = logits - logits.max(axis=-1, keepdims=True)
    taken = np.take_along_axis(logits, action[:, None], axis=-1)[:, 0]
    log_probs: Floats = taken - np.log(np.exp(logits).sum(axis=-1))
    return log_probs


class Rollout(NamedTuple):
    """T steps of N networks in M rooms each; tensors are ``[N, T, M]`` where no shape is given."""

    inputs: Tensor  # [N, T, M, in]
    state: Tensor  # [N, M, S] hidden state before the first step
    fresh: Tensor  # the hidden state was reset before the step
    action: Tensor
    log_prob: Tensor  # of the action, under the policy that took it
    value: Tensor
    reward: Tensor
    done: Tensor  # nothing that follows counts for the step
    mask: Tensor  # the step happened
    bootstrap: Tensor  # [N, M] value of what follows the last step

    @staticmethod
    def stacked(steps: list[dict[str, Any]], networks: int) -> dict[str, Tensor]:
        """``[N, T, M, ...]`` parts of T steps; each part of a step is ``[N * M, ...]``."""
        return {
            name: torch.from_numpy(
                np.stack(
                    [step[name].reshape(networks, -1, *step[name].shape[1:]) for step in steps],
                    axis=1,
                )
            )
            for name in steps[0]
        }

    def of_rooms(self, which: Tensor) -> Rollout:
        """The same steps in some of the rooms."""
        rooms_axis = {"state": 1, "bootstrap": 1}
        return Rollout(
            **{
                name: tensor.index_select(rooms_axis.get(name, 2), which)
                for name, tensor in self._asdict().items()
            }
        )


def advantages(rollout: Rollout, gamma: float, gae_lambda: float) -> Tensor:
    """``[N, T, M]`` how much better each action was than expected (GAE).

    A lambda of 0 trusts the values after one step, 1 only what was earned.
    """
    advantage = torch.zeros_like(rollout.value)
    following, ahead = rollout.bootstrap, torch.zeros_like(rollout.bootstrap)
    for step in range(rollout.value.shape[1] - 1, -1, -1):
        not_done = (~rollout.done[:, step]).to(following.dtype)
        delta = rollout.reward[:, step] + gamma * not_done * following - rollout.value[:, step]
        estimate = delta + gamma * gae_lambda * not_done * ahead
        # A step that did not happen is skipped.
        happened = rollout.mask[:, step]
        following = torch.where(happened, rollout.value[:, step], following)
        ahead = torch.where(happened, estimate, ahead)
        advantage[:, step] = torch.where(happened, estimate, 0.0)
    return advantage


@dataclass(frozen=True)
class PPOSettings:
    """Settings of proximal policy optimization."""

    learning_rate: float = 0.001
    gamma: float = 0.97
    gae_lambda: float = 0.95
    clip: float = 0.2  # how far an action's probability may move, as a share of what it was
    value_weight: float = 0.5  # of the squared error of the values
    epochs: int = 2
    minibatches: int = 4  # parts of the rooms, learned from one after another
    max_grad_norm: float = 0.5


class PPO:
    """Improves N policies from their rollouts."""

    def __init__(self, network: RecurrentPolicy, settings: PPOSettings) -> None:
        self.network, self.settings = network, settings
        # Not fused, which would compute the last few numbers of a tensor in another way.
        self.optimizer = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, eps=1e-5)

    def update(
        self, rollout: Rollout, entropy_weight: float, generator: np.random.Generator | None = None
    ) -> dict[str, float]:
        """Learn from a rollout; returns means over it of ``entropy``, ``value_error``, ``clipped``.

        The generator mixes the rooms before they are split; a single minibatch needs none.
        """
        settings = self.settings
        advantage = advantages(rollout, settings.gamma, settings.gae_lambda)
        returns = advantage + rollout.value
        mask = rollout.mask.to(advantage.dtype)
        total = mask.sum(dim=(1, 2), keepdim=True).clamp(min=1)
        centred = advantage - (advantage * mask).sum(dim=(1, 2), keepdim=True) / total
        spread = ((centred**2 * mask).sum(dim=(1, 2), keepdim=True) / total).sqrt()
        advantage = centred / (spread + 1e-6)
        rooms = advantage.shape[2]
        means: dict[str, float] = dict.fromkeys(("entropy", "value_error", "clipped"), 0.0)
        parts = min(settings.minibatches, rooms)
        for _ in range(settings.epochs):
            order = np.arange(rooms) if generator is None else generator.permutation(rooms)
            for part in np.array_split(order, parts):
                which = torch.from_numpy(part)
                metrics = self.find_gradients(rollout, advantage, returns, which, entropy_weight)
                self._clip_gradients()
                self.optimizer.step()
                for name, value in metrics.items():
                    means[name] += value
        return {name: value / (settings.epochs * parts) for name, value in means.items()}

    def find_gradients(
        self,
        rollout: Rollout,
        advantage: Tensor,
        returns: Tensor,
        which: Tensor,
        entropy_weight: float,
    ) -> dict[str, float]:
        """Set the loss's gradients in the rooms ``which``; returns means as :meth:`update` does."""
        part = rollout.of_rooms(which)
        advantage, returns = advantage[:, :, which], returns[:, :, which]
        settings = self.settings
        logits, values, _ = self.network(part.inputs, part.state, part.fresh)
        log_probs = torch.log_softmax(logits, dim=-1)
        ratio = (log_probs.gather(-1, part.action[..., None]).squeeze(-1) - part.log_prob).exp()
        clipped = ratio.clamp(1 - settings.clip, 1 + settings.clip)
        gain = torch.minimum(ratio * advantage, clipped * advantage)
        entropy = -(log_probs.exp() * log_probs).sum(dim=-1)
        value_error = (values - returns) ** 2
        loss = settings.value_weight * value_error - gain - entropy_weight * entropy
        mask = part.mask.to(loss.dtype)
        # Each network learns from its own steps alone.
        mean = (loss * mask).sum(dim=(1, 2)) / mask.sum(dim=(1, 2)).clamp(min=1)
        self.optimizer.zero_grad()
        mean.sum().backward()
        metrics = {"entropy": entropy, "value_error": value_error, "clipped": ratio != clipped}
        with torch.no_grad():
            steps = mask.sum().clamp(min=1)
            return {name: float((each * mask).sum() / steps) for name, each in metrics.items()}

    def _clip_gradients(self) -> None:
        """Clip the gradients of each network to a norm."""
        gradients = [p.grad for p in self.network.parameters() if p.grad is not None]
        # One by one: torch would sum a stack of them in another order for a single network.
        squares = torch.zeros(len(gradients[0]))
        for gradient in gradients:
            squares = squares + gradient.flatten(1).pow(2).sum(dim=1)
        share = (self.settings.max_grad_norm / (squares.sqrt() + 1e-6)).clamp(max=1.0)
        for gradient in gradients:
            gradient *= share.view(-1, *[1] * (gradient.dim() - 1))
