"""Many small networks as one: stacked parameters, one matrix product for all agents.

N agents with networks of the same shape keep their weights as ``[N, in, out]`` tensors, so that a
batched matrix product evaluates all of them and one optimiser step trains all of them. Nothing is
shared: an agent's gradient comes from its own loss alone, since the losses are summed.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn


class StackedMLP(nn.Module):
    """N multi-layer perceptrons with ReLU between the layers and a linear output.

    Args:
        sizes: Width of the input, of each hidden layer and of the output.
        generators: One source of initial weights for each agent.
    """

    def __init__(self, sizes: Sequence[int], generators: Sequence[np.random.Generator]) -> None:
        super().__init__()
        self.sizes = tuple(sizes)
        self.weights = nn.ParameterList()
        self.biases = nn.ParameterList()
        for width_in, width_out in pairwise(sizes):
            # Uniform within 1/sqrt(fan in), as torch initialises a single linear layer.
            bound = width_in**-0.5
            for parameters, rows in ((self.weights, width_in), (self.biases, 1)):
                drawn = [rng.uniform(-bound, bound, (rows, width_out)) for rng in generators]
                stack = torch.tensor(np.stack(drawn), dtype=torch.float32)
                parameters.append(nn.Parameter(stack))

    def forward(self, inputs: Tensor) -> Tensor:
        """``[N, M, out]`` outputs for ``[N, M, in]`` inputs; ``[M, in]`` goes to every agent."""
        hidden = inputs
        last = len(self.weights) - 1
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            # A shared input would be copied N times by a batched product; broadcasting does not.
            hidden = (
                torch.matmul(hidden, weight) + bias
                if hidden.dim() == 2
                else torch.baddbmm(bias, hidden, weight)
            )
            if layer < last:
                hidden = torch.relu(hidden)
        return hidden


class StackedDoubleQ:
    """Double Q-learning for N agents over a table of observations.

    The room shows few distinct observations, and a minibatch holds most of them. So a transition
    is kept as the indices of its two observations in a table, every observation of the table is
    evaluated once, and the values of the minibatch are read off; loss and gradient are the same
    as if each transition had been evaluated by itself.

    Args:
        sizes: As for :class:`StackedMLP`.
        generators: One source of initial weights for each agent.
        learning_rate: Of Adam.
        gamma: Discount factor.
        target_period: Updates between copies of the network to the target network; ``None`` never
            copies it again.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        generators: Sequence[np.random.Generator],
        learning_rate: float,
        gamma: float,
        target_period: int | None,
    ) -> None:
        self.online = StackedMLP(sizes, generators)
        self.target = StackedMLP(sizes, generators)
        self.target.load_state_dict(self.online.state_dict())
        self.gamma = gamma
        self.target_period = target_period
        self.updates = 0
        self.optimiser = torch.optim.Adam(self.online.parameters(), lr=learning_rate, fused=True)
        self._agents = torch.arange(len(generators))[:, None]

    @torch.no_grad()
    def greedy(self, observations: Tensor) -> Tensor:
        """``[N]`` the best action for each agent's observation, ``[N, in]``."""
        return self.online(observations[:, None]).squeeze(1).argmax(dim=1)

    def targets(
        self, table: Tensor, reward: Tensor, after: Tensor, goes_on: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Double-Q targets: the online network chooses, the target network evaluates.

        Args:
            table: ``[D, in]`` the distinct observations.
            reward: ``[N, M]`` rewards.
            after: ``[N, M]`` index of the observation that followed.
            goes_on: ``[N, M]`` 1 where there is a value after it, 0 where the target ends.

        Returns:
            ``[N, M]`` the targets, and ``[N, D, out]`` the online values of the table, which the
            loss needs too.
        """
        values = self.online(table)
        with torch.no_grad():
            best = values.argmax(dim=2)
            judged = self.target(table).gather(2, best[..., None]).squeeze(2)
            return reward + self.gamma * goes_on * judged[self._agents, after], values

    def update(
        self,
        table: Tensor,
        before: Tensor,
        action: Tensor,
        reward: Tensor,
        after: Tensor,
        goes_on: Tensor,
    ) -> Tensor:
        """One gradient step for every agent on its own minibatch of M transitions.

        Args:
            table: ``[D, in]`` the distinct observations.
            before: ``[N, M]`` index of the observation that the action was taken in.
            action: ``[N, M]`` the action.
            reward: ``[N, M]`` its reward.
            after: ``[N, M]`` index of the observation that followed.
            goes_on: ``[N, M]`` 1 where there is a value after it, 0 where the target ends.

        Returns:
            ``[N]`` the Huber loss of each agent.
        """
        target, values = self.targets(table, reward, after, goes_on)
        chosen = values[self._agents, before, action]
        losses: Tensor = nn.functional.smooth_l1_loss(chosen, target, reduction="none").mean(dim=1)
        self.optimiser.zero_grad()
        losses.sum().backward()  # type: ignore[no-untyped-call]
        self.optimiser.step()
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())
        return losses.detach()

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimiser and counters."""
        return {
            "online": self.online.state_dict(),
            "target": self.target.state_dict(),
            "optimiser": self.optimiser.state_dict(),
            "updates": self.updates,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.online.load_state_dict(state["online"])
        self.target.load_state_dict(state["target"])
        self.optimiser.load_state_dict(state["optimiser"])
        self.updates = state["updates"]
