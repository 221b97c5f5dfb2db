"""Many small networks as one: stacked parameters, one matrix product for all agents.

N agents with networks of the same shape keep their weights as ``[N, in, out]`` tensors, so that a
batched matrix product evaluates all of them and one optimiser step trains all of them. Nothing is
shared: an agent's gradient comes from its own loss alone, since the losses are summed.
"""

from __future__ import annotations

import copy
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

    The room shows few distinct observations, and most of a minibatch repeats them. So transitions
    hold indices into a table (see :meth:`observe`), each agent's network evaluates every
    observation of its minibatch once, and the values of the transitions are read off; loss and
    gradient are the same as if each transition had been evaluated by itself. The target network
    changes seldom, so that its values of the whole table are kept until it does.

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
        # A copy, and not a second network: making one would draw from the generators again.
        self.target = copy.deepcopy(self.online).requires_grad_(False)
        self.gamma = gamma
        self.target_period = target_period
        self.updates = 0
        self.optimiser = torch.optim.Adam(self.online.parameters(), lr=learning_rate, fused=True)
        self._agents = torch.arange(len(generators))[:, None]
        self.observe(torch.zeros(0, self.online.sizes[0]))

    def observe(self, table: Tensor) -> None:
        """Take ``[D, in]`` distinct observations; all indices mean rows of this table."""
        self._table = table
        self._judged: Tensor | None = None

    @torch.no_grad()
    def greedy(self, observations: Tensor) -> Tensor:
        """``[N]`` the best action for each agent's observation, ``[N, in]``."""
        best: Tensor = self.online(observations[:, None]).squeeze(1).argmax(dim=1)
        return best

    @torch.no_grad()
    def targets(self, values: Tensor, which: Tensor, reward: Tensor, goes_on: Tensor) -> Tensor:
        """``[N, M]`` double-Q targets: the online network chooses, the target network judges.

        Args:
            values: ``[N, M, out]`` online values of the observation that followed.
            which: ``[N, M]`` index of that observation.
            reward: ``[N, M]`` rewards.
            goes_on: ``[N, M]`` 1 where there is a value after it, 0 where the target ends.
        """
        if self._judged is None:
            self._judged = self.target(self._table)
        judged = self._judged[self._agents, which, values.argmax(dim=2)]
        targets: Tensor = reward + goes_on * judged * self.gamma
        return targets

    def losses(
        self, before: Tensor, action: Tensor, reward: Tensor, after: Tensor, goes_on: Tensor
    ) -> Tensor:
        """``[N]`` the Huber loss of each agent on its own minibatch of M transitions.

        Args:
            before: ``[N, M]`` index of the observation that the action was taken in.
            action: ``[N, M]`` the action.
            reward: ``[N, M]`` its reward.
            after: ``[N, M]`` index of the observation that followed.
            goes_on: ``[N, M]`` 1 where there is a value after it, 0 where the target ends.
        """
        # What follows an end has no value to look up, so that it need not be evaluated.
        which = torch.cat([before, torch.where(goes_on > 0, after, before)], dim=1)
        rows, at = distinct(which, len(self._table))
        from_before, from_after = at.chunk(2, dim=1)
        values = self.online(self._table[rows])
        target = self.targets(
            values.detach()[self._agents, from_after], which.chunk(2, dim=1)[1], reward, goes_on
        )
        chosen = values[self._agents, from_before, action]
        each = nn.functional.smooth_l1_loss(chosen, target, reduction="none")
        losses: Tensor = each.mean(dim=1)
        return losses

    def update(
        self,
        before: Tensor,
        action: Tensor,
        reward: Tensor,
        after: Tensor,
        goes_on: Tensor,
        trains: Tensor | None = None,
    ) -> Tensor:
        """One gradient step for every agent on its own minibatch.

        Args:
            before: As for :meth:`losses`, with the four that follow.
            action: The actions.
            reward: Their rewards.
            after: What followed.
            goes_on: Whether there is a value after it.
            trains: ``[N]`` which agents take the step; the networks of the others stay as they
                are, whatever their minibatches hold. By default all do.

        Returns:
            ``[N]`` the loss of each agent.
        """
        losses = self.losses(before, action, reward, after, goes_on)
        self.optimiser.zero_grad()
        (losses if trains is None else losses[trains]).sum().backward()  # type: ignore[no-untyped-call]
        if trains is not None:
            self._stop(~trains)
        self.optimiser.step()
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())
            self._judged = None
        return losses.detach()

    def _stop(self, agents: Tensor) -> None:
        """Without gradient and momentum, Adam moves nothing."""
        for state in self.optimiser.state.values():
            state["exp_avg"][agents] = 0.0

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimiser and counters as they are now."""
        return copy.deepcopy(
            {
                "online": self.online.state_dict(),
                "target": self.target.state_dict(),
                "optimiser": self.optimiser.state_dict(),
                "updates": self.updates,
            }
        )

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.online.load_state_dict(state["online"])
        self.target.load_state_dict(state["target"])
        # Unlike the networks, the optimiser would take over the checkpoint's own tensors.
        self.optimiser.load_state_dict(copy.deepcopy(state["optimiser"]))
        self.updates = state["updates"]
        self._judged = None


def distinct(which: Tensor, size: int) -> tuple[Tensor, Tensor]:
    """The distinct indices of each row, and where each index stands among them.

    Args:
        which: ``[N, M]`` indices below ``size``.
        size: Their bound.

    Returns:
        ``[N, U]`` distinct indices in ascending order, U being the most that a row has; rows with
        fewer are filled up with others. ``[N, M]`` position of each index in its row.
    """
    occurs = torch.zeros(len(which), size, dtype=torch.bool)
    occurs.scatter_(1, which, True)
    place = occurs.cumsum(dim=1) - 1
    most = int(place[:, -1].max()) + 1
    rows = occurs.to(torch.uint8).argsort(dim=1, descending=True, stable=True)[:, :most]
    return rows, place.gather(1, which)
