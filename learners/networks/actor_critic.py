"""How a policy gradient improves networks with a memory.

Proximal policy optimisation (PPO: Schulman et al., 2017): what was done is made likelier where it
turned out better than expected, and less likely where worse, but no action's chance moves far from
what it was when it was taken. What was expected is a value that the network learns beside its
policy; how much better an action was is estimated over many steps (GAE: Schulman et al., 2016).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learners.networks.memories import Memory

Floats = NDArray[np.float32]


def chosen(logits: Floats, uniform: NDArray[np.float64]) -> NDArray[np.int64]:
    """``[B]`` actions drawn from the policy, each with one uniform number."""
    weights = np.exp(logits - logits.max(axis=-1, keepdims=True), dtype=np.float64)
    reached = weights.cumsum(axis=-1)
    drawn: NDArray[np.int64] = (reached < uniform[:, None] * reached[:, -1:]).sum(axis=-1)
    return drawn


def log_chance(logits: Floats, action: NDArray[np.int64]) -> Floats:
    """``[B]`` logarithms of the chances of these actions."""
    logits = logits - logits.max(axis=-1, keepdims=True)
    taken = np.take_along_axis(logits, action[:, None], axis=-1)[:, 0]
    chance: Floats = taken - np.log(np.exp(logits).sum(axis=-1))
    return chance


class Rollout(NamedTuple):
    """T steps of N networks in M rooms each; arrays are ``[N, T, M]`` unless said."""

    inputs: Tensor  # [N, T, M, in]
    state: Tensor  # [N, M, S] remembered before the first step
    fresh: Tensor  # everything was forgotten before the step
    action: Tensor
    log_chance: Tensor  # of the action, under the policy that took it
    value: Tensor
    reward: Tensor
    over: Tensor  # nothing that follows counts for the step
    counts: Tensor  # the step happened
    bootstrap: Tensor  # [N, M] value of what follows the last step

    def of_rooms(self, which: Tensor) -> Rollout:
        """The same steps in some of the rooms."""
        whole = {"state": 1, "bootstrap": 1}
        return Rollout(
            **{
                name: tensor.index_select(whole.get(name, 2), which)
                for name, tensor in self._asdict().items()
            }
        )


def advantages(rollout: Rollout, gamma: float, decay: float) -> Tensor:
    """``[N, T, M]`` how much better each action was than expected (GAE).

    Args:
        rollout: What happened.
        gamma: Discount factor.
        decay: Lambda: 0 trusts the values after one step, 1 only what was earned.
    """
    better = torch.zeros_like(rollout.value)
    following, ahead = rollout.bootstrap, torch.zeros_like(rollout.bootstrap)
    for step in range(rollout.value.shape[1] - 1, -1, -1):
        goes_on = (~rollout.over[:, step]).to(following.dtype)
        error = rollout.reward[:, step] + gamma * goes_on * following - rollout.value[:, step]
        estimate = error + gamma * decay * goes_on * ahead
        # A step that did not happen is passed over.
        here = rollout.counts[:, step]
        following = torch.where(here, rollout.value[:, step], following)
        ahead = torch.where(here, estimate, ahead)
        better[:, step] = torch.where(here, estimate, 0.0)
    return better


@dataclass(frozen=True)
class PolicyGradient:
    """Settings of proximal policy optimisation.

    Attributes:
        learning_rate: Of Adam.
        gamma: Discount factor.
        decay: Lambda of the advantage estimate.
        clip: How far an action's chance may move from what it was, as a share of it.
        value_weight: Weight of the squared error of the values.
        epochs: How often a rollout is gone through.
        minibatches: Parts of its rooms that are learned from one after another.
        largest_gradient: Norm to which gradients are cut.
    """

    learning_rate: float = 0.001
    gamma: float = 0.97
    decay: float = 0.95
    clip: float = 0.2
    value_weight: float = 0.5
    epochs: int = 2
    minibatches: int = 4
    largest_gradient: float = 0.5


class Trainer:
    """Improves N networks from what they did.

    Args:
        network: The networks.
        settings: How.
    """

    def __init__(self, network: Memory, settings: PolicyGradient) -> None:
        self.network, self.settings = network, settings
        # Not fused, which would compute the last few numbers of a piece in another way.
        self.optimiser = torch.optim.Adam(network.parameters(), lr=settings.learning_rate, eps=1e-5)

    def update(
        self, rollout: Rollout, entropy_weight: float, generator: np.random.Generator | None = None
    ) -> dict[str, float]:
        """Learn from a rollout.

        Args:
            rollout: What happened.
            entropy_weight: What undecidedness is worth.
            generator: Mixes the rooms before they are parted; not needed for a single part.

        Returns:
            Means over the rollout: ``entropy``, ``value_error`` and ``clipped``.
        """
        settings = self.settings
        better = advantages(rollout, settings.gamma, settings.decay)
        goal = better + rollout.value
        counts = rollout.counts.to(better.dtype)
        total = counts.sum(dim=(1, 2), keepdim=True).clamp(min=1)
        centred = better - (better * counts).sum(dim=(1, 2), keepdim=True) / total
        spread = ((centred**2 * counts).sum(dim=(1, 2), keepdim=True) / total).sqrt()
        better = centred / (spread + 1e-6)
        rooms = better.shape[2]
        told = {"entropy": 0.0, "value_error": 0.0, "clipped": 0.0}
        for _ in range(settings.epochs):
            order = np.arange(rooms) if generator is None else generator.permutation(rooms)
            for part in np.array_split(order, min(settings.minibatches, rooms)):
                which = torch.from_numpy(part)
                self._step(rollout, better, goal, which, entropy_weight, told)
        parts = settings.epochs * min(settings.minibatches, rooms)
        return {name: value / parts for name, value in told.items()}

    def _step(
        self,
        rollout: Rollout,
        better: Tensor,
        goal: Tensor,
        which: Tensor,
        entropy_weight: float,
        told: dict[str, float],
    ) -> None:
        settings = self.settings
        part = rollout.of_rooms(which)
        better, goal = better[:, :, which], goal[:, :, which]
        logits, values, _ = self.network(part.inputs, part.state, part.fresh)
        log_chances = torch.log_softmax(logits, dim=-1)
        now = log_chances.gather(-1, part.action[..., None]).squeeze(-1)
        ratio = (now - part.log_chance).exp()
        within = ratio.clamp(1 - settings.clip, 1 + settings.clip)
        gain = torch.minimum(ratio * better, within * better)
        entropy = -(log_chances.exp() * log_chances).sum(dim=-1)
        error = (values - goal) ** 2
        loss = settings.value_weight * error - gain - entropy_weight * entropy
        counts = part.counts.to(loss.dtype)
        # Each network learns from its own steps alone.
        mean = (loss * counts).sum(dim=(1, 2)) / counts.sum(dim=(1, 2)).clamp(min=1)
        self.optimiser.zero_grad()
        mean.sum().backward()
        self._cut()
        self.optimiser.step()
        with torch.no_grad():
            number = counts.sum().clamp(min=1)
            told["entropy"] += float((entropy * counts).sum() / number)
            told["value_error"] += float((error * counts).sum() / number)
            told["clipped"] += float(((ratio != within) * counts).sum() / number)

    def _cut(self) -> None:
        """Cut the gradients of each network to a norm."""
        gradients = [p.grad for p in self.network.parameters() if p.grad is not None]
        # One by one: torch would sum a stack of them in another order for a single network.
        squares = torch.zeros(len(gradients[0]))
        for gradient in gradients:
            squares = squares + gradient.flatten(1).pow(2).sum(dim=1)
        share = (self.settings.largest_gradient / (squares.sqrt() + 1e-6)).clamp(max=1.0)
        for gradient in gradients:
            gradient *= share.view(-1, *[1] * (gradient.dim() - 1))

    def state_dict(self) -> dict[str, Any]:
        """Networks and optimiser; the tensors are those in use."""
        return {"network": self.network.state_dict(), "optimiser": self.optimiser.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
