"""Double Q-learning on sequences with recurrent networks, for N agents (R2D2)."""

from __future__ import annotations

import copy
from dataclasses import fields

import torch
from torch import Tensor, nn

from openlock_learners.networks.recurrent_cells import CELLS, CellName, Generators, StackedLinear
from openlock_learners.networks.sequence_buffer import Sequences


class StackedRecurrentNetwork(nn.Module):
    """N networks of a recurrent layer and a perceptron, both of ``hidden`` units, that reads it."""

    def __init__(
        self, cell: CellName, inputs: int, hidden: int, outputs: int, generators: Generators
    ) -> None:
        super().__init__()
        self.cell = CELLS[cell](inputs, hidden, generators)
        self.reads = StackedLinear(hidden, hidden, generators)
        self.values = StackedLinear(hidden, outputs, generators)

    def forward(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """``[N, T, M, A]`` outputs, and the last hidden state; arguments as for the cell."""
        hidden, state = self.cell(inputs, state)
        outputs: Tensor = self.values(torch.relu(self.reads(hidden.flatten(1, 2))))
        return outputs.view(*inputs.shape[:3], -1), state


class RecurrentDoubleQ:
    """Double Q-learning on sequences, for N agents (R2D2: Kapturowski et al., 2019).

    The hidden state that was kept with a sequence was computed with older weights. Some steps of
    burn-in bring it up to date, separately for the online network and for the target network,
    before the others are learned from; no gradient flows back into them.

    Args:
        network: The agents' networks.
        learning_rate: Of Adam.
        gamma: Discount factor.
        target_period: Updates between copies of the network to the target network; ``None`` never
            copies it again.
    """

    def __init__(
        self,
        network: StackedRecurrentNetwork,
        learning_rate: float,
        gamma: float,
        target_period: int | None,
    ) -> None:
        self.online = network
        self.target = copy.deepcopy(network).requires_grad_(False)
        self.gamma = gamma
        self.target_period = target_period
        self.updates = 0
        self.optimizer = torch.optim.Adam(network.parameters(), lr=learning_rate)

    @torch.no_grad()
    def values(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """``[N, A]`` values of the actions and the next hidden state, by ``[N, in]`` inputs."""
        values, state = self.online(inputs[:, None, None], state[:, None])
        return values[:, 0, 0], state[:, 0]

    def losses(self, batch: Sequences) -> Tensor:
        """``[N]`` the Huber loss of each agent, a mean over all steps of its own sequences."""
        inputs, state, burn_in_mask, action, reward, not_done, mask = (
            torch.from_numpy(getattr(batch, field.name)) for field in fields(batch)
        )
        burn_in = burn_in_mask.shape[1]
        online = target = state
        with torch.no_grad():
            if burn_in:
                _, online = self.online.cell(inputs[:, :burn_in], state, burn_in_mask)
                _, target = self.target.cell(inputs[:, :burn_in], state, burn_in_mask)
            target_values, _ = self.target(inputs[:, burn_in:], target)
        values, _ = self.online(inputs[:, burn_in:], online)
        # Double Q: the online network chooses, the target network evaluates.
        best = values[:, 1:].detach().argmax(dim=-1, keepdim=True)
        following = target_values[:, 1:].gather(-1, best).squeeze(-1)
        td_target = reward + not_done * self.gamma * following
        chosen = values[:, :-1].gather(-1, action[..., None]).squeeze(-1)
        each = nn.functional.smooth_l1_loss(chosen, td_target, reduction="none") * mask
        losses: Tensor = each.sum((1, 2)) / mask.sum((1, 2)).clamp(min=1)
        return losses

    def update(self, batch: Sequences, trains: Tensor) -> Tensor:
        """One gradient step for every agent that ``trains``, ``[N]``, on its own sequences.

        The networks of the others stay as they are, whatever their sequences hold. Returned is the
        ``[N]`` loss of each agent.
        """
        losses = self.losses(batch)
        self.optimizer.zero_grad()
        losses[trains].sum().backward()  # type: ignore[no-untyped-call]
        if not trains.all():
            # Without gradient and momentum, Adam moves nothing.
            for moments in self.optimizer.state.values():
                moments["exp_avg"][~trains] = 0.0
        self.optimizer.step()
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())
        return losses.detach()
