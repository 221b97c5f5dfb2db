"""Many small recurrent networks as one, and double Q-learning with them on sequences.

As in :mod:`learners.networks.stacked`, N agents keep their weights as ``[N, in, out]`` tensors, and
nothing is shared between them. An agent's numbers do not depend on how many others there are: what
torch computes in another way for the last few numbers of a piece, or for pieces that begin at odd
places, is avoided (:func:`sigmoid`, :func:`product`, Adam that is not fused).

Time must be walked step by step, but only for what depends on the step
before: the inputs of all steps go through one product beforehand. torch's own LSTM is as fast as
the GRU here when it runs once for each agent (it has a fused kernel), and its GRU four times
slower.
"""

from __future__ import annotations

import copy
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import fields
from typing import Any, ClassVar, Literal

import numpy as np
import torch
from torch import Tensor, nn

from learners.networks.sequence_replay import Sequences

ALIGNED = 16
"""Single-precision numbers in the longest vector of today's processors."""

CellName = Literal["gru", "lstm"]
Generators = Sequence[np.random.Generator]


def initial(generators: Generators, width: int, *shape: int) -> nn.Parameter:
    """``[N, *shape]`` weights, uniform within 1/sqrt(width) as torch's own are."""
    bound = width**-0.5
    drawn = np.stack([generator.uniform(-bound, bound, shape) for generator in generators])
    return nn.Parameter(torch.tensor(drawn, dtype=torch.float32))


def sigmoid(numbers: Tensor) -> Tensor:
    """The logistic function, each number by itself.

    ``torch.sigmoid`` takes another formula for the last few numbers of a piece on a CPU, and which
    these are depends on how many agents there are.
    """
    return torch.tanh(numbers / 2) / 2 + 0.5


def product(bias: Tensor, inputs: Tensor, weight: Tensor) -> Tensor:
    """``[N, M, out]``: ``bias + inputs @ weight`` of each agent.

    It is made with columns of zeros behind the others, so that each agent's part begins where a
    vector of the processor's does: how a product is rounded may depend on that.

    Args:
        bias: ``[N, 1, out]``.
        inputs: ``[N, M, in]``.
        weight: ``[N, in, out]``.
    """
    outputs = weight.shape[-1]
    if not (rest := -outputs % ALIGNED):
        return torch.baddbmm(bias, inputs, weight)
    bias, weight = (nn.functional.pad(part, (0, rest)) for part in (bias, weight))
    return torch.baddbmm(bias, inputs, weight)[..., :outputs]


class StackedLinear(nn.Module):
    """N linear layers, from ``[N, M, in]`` to ``[N, M, out]``."""

    def __init__(self, inputs: int, outputs: int, generators: Generators) -> None:
        super().__init__()
        self.weight = initial(generators, inputs, inputs, outputs)
        self.bias = initial(generators, inputs, 1, outputs)

    def forward(self, inputs: Tensor) -> Tensor:
        """One product for all agents."""
        return product(self.bias, inputs, self.weight)


class StackedCell(nn.Module, ABC):
    """N recurrent layers; a subclass says what one step of time does.

    Weights and biases are laid out as in torch's own cells, transposed.

    Args:
        inputs: Width of the input.
        hidden: Width of the output, H.
        generators: One source of initial weights for each agent.

    Attributes:
        state_size: Numbers that are handed from one step to the next, S; the first H of them are
            the layer's output.
    """

    gates: ClassVar[int]
    states: ClassVar[int]

    def __init__(self, inputs: int, hidden: int, generators: Generators) -> None:
        super().__init__()
        self.hidden = hidden
        self.state_size = self.states * hidden
        width = self.gates * hidden
        self.input_weight = initial(generators, hidden, inputs, width)
        self.hidden_weight = initial(generators, hidden, hidden, width)
        self.input_bias = initial(generators, hidden, 1, width)
        self.hidden_bias = initial(generators, hidden, 1, width)

    def forward(
        self, inputs: Tensor, state: Tensor, real: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Walk through time.

        Args:
            inputs: ``[N, T, M, in]`` for M sequences of T steps.
            state: ``[N, M, S]`` to begin with.
            real: ``[N, T, M]`` which steps happened; others leave the state as it is. By default
                all did.

        Returns:
            ``[N, T, M, H]`` the outputs, and ``[N, M, S]`` the state in the end.
        """
        projected = product(self.input_bias, inputs.flatten(1, 2), self.input_weight)
        # Cutting time into pieces once makes autograd join their gradients once.
        pieces = projected.view(*inputs.shape[:3], -1).unbind(1)
        happened = [None] * len(pieces) if real is None else real[..., None].unbind(1)
        outputs = []
        for piece, here in zip(pieces, happened, strict=True):
            recalled = product(self.hidden_bias, state[..., : self.hidden], self.hidden_weight)
            after = self.step(piece, recalled, state)
            state = after if here is None else torch.where(here, after, state)
            outputs.append(state[..., : self.hidden])
        return torch.stack(outputs, dim=1), state

    @abstractmethod
    def step(self, projected: Tensor, recalled: Tensor, state: Tensor) -> Tensor:
        """``[N, M, S]`` the next state.

        Args:
            projected: ``[N, M, gates * H]`` what the input contributes to each gate.
            recalled: ``[N, M, gates * H]`` what the last output contributes.
            state: ``[N, M, S]`` the last state.
        """


class StackedGRU(StackedCell):
    """N layers of gated recurrent units."""

    gates, states = 3, 1

    def step(self, projected: Tensor, recalled: Tensor, state: Tensor) -> Tensor:
        """How much to reset, how much to keep, and what is new."""
        two = 2 * self.hidden
        reset, keep = sigmoid(projected[..., :two] + recalled[..., :two]).chunk(2, dim=-1)
        new = torch.tanh(torch.addcmul(projected[..., two:], reset, recalled[..., two:]))
        return torch.lerp(new, state, keep)


class StackedLSTM(StackedCell):
    """N layers of long short-term memory; the state is the output and the cell, side by side."""

    gates, states = 4, 2

    def step(self, projected: Tensor, recalled: Tensor, state: Tensor) -> Tensor:
        """How much to take in, how much to keep, what is new, and how much to show."""
        take, keep, new, show = (projected + recalled).chunk(4, dim=-1)
        held = sigmoid(keep) * state[..., self.hidden :]
        held = torch.addcmul(held, sigmoid(take), torch.tanh(new))
        return torch.cat([sigmoid(show) * torch.tanh(held), held], dim=-1)


CELLS: dict[CellName, type[StackedCell]] = {"gru": StackedGRU, "lstm": StackedLSTM}


class StackedRecurrentNetwork(nn.Module):
    """N networks of a recurrent layer and a perceptron that reads it.

    Args:
        cell: Kind of the recurrent layer.
        inputs: Width of the input.
        hidden: Width of the recurrent layer, and of the hidden layer behind it.
        outputs: Width of the output, A.
        generators: One source of initial weights for each agent.
    """

    def __init__(
        self,
        cell: CellName,
        inputs: int,
        hidden: int,
        outputs: int,
        generators: Generators,
    ) -> None:
        super().__init__()
        self.cell = CELLS[cell](inputs, hidden, generators)
        self.reads = StackedLinear(hidden, hidden, generators)
        self.values = StackedLinear(hidden, outputs, generators)

    def forward(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """``[N, T, M, A]`` outputs, and the state in the end; arguments as for the cell."""
        remembered, state = self.cell(inputs, state)
        outputs: Tensor = self.values(torch.relu(self.reads(remembered.flatten(1, 2))))
        return outputs.view(*inputs.shape[:3], -1), state


class RecurrentDoubleQ:
    """Double Q-learning on sequences, for N agents (R2D2: Kapturowski et al., 2019).

    The state that was kept with a sequence stems from older weights. Some steps of burn-in bring it
    up to date, for the online network and for the target network by themselves, before the others
    are learned from; no gradient reaches back into them.

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
        self.optimiser = torch.optim.Adam(network.parameters(), lr=learning_rate)

    @torch.no_grad()
    def values(self, inputs: Tensor, state: Tensor) -> tuple[Tensor, Tensor]:
        """``[N, A]`` values of the actions now and ``[N, S]`` the memory's state after it.

        Args:
            inputs: ``[N, in]`` what each agent perceives.
            state: ``[N, S]`` the memory's state before it.
        """
        values, state = self.online(inputs[:, None, None], state[:, None])
        return values[:, 0, 0], state[:, 0]

    def losses(self, batch: Sequences) -> Tensor:
        """``[N]`` the Huber loss of each agent, a mean over all steps of its own sequences."""
        inputs, state, real, action, reward, goes_on, counts = (
            torch.from_numpy(getattr(batch, field.name)) for field in fields(batch)
        )
        burn_in = real.shape[1]
        online = target = state
        with torch.no_grad():
            if burn_in:
                _, online = self.online.cell(inputs[:, :burn_in], state, real)
                _, target = self.target.cell(inputs[:, :burn_in], state, real)
            judged, _ = self.target(inputs[:, burn_in:], target)
        values, _ = self.online(inputs[:, burn_in:], online)
        # The online network chooses what comes next, and the target network judges it.
        best = values[:, 1:].detach().argmax(dim=-1, keepdim=True)
        goal = reward + goes_on * self.gamma * judged[:, 1:].gather(-1, best).squeeze(-1)
        chosen = values[:, :-1].gather(-1, action[..., None]).squeeze(-1)
        each = nn.functional.smooth_l1_loss(chosen, goal, reduction="none") * counts
        losses: Tensor = each.sum((1, 2)) / counts.sum((1, 2)).clamp(min=1)
        return losses

    def update(self, batch: Sequences, trains: Tensor) -> Tensor:
        """One gradient step for every agent on its own sequences.

        Args:
            batch: The sequences of all agents.
            trains: ``[N]`` which agents take the step; the networks of the others stay as they
                are, whatever their sequences hold.

        Returns:
            ``[N]`` the loss of each agent.
        """
        losses = self.losses(batch)
        self.optimiser.zero_grad()
        losses[trains].sum().backward()  # type: ignore[no-untyped-call]
        if not trains.all():
            # Without gradient and momentum, Adam moves nothing.
            for moments in self.optimiser.state.values():
                moments["exp_avg"][~trains] = 0.0
        self.optimiser.step()
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.target.load_state_dict(self.online.state_dict())
        return losses.detach()

    def state_dict(self) -> dict[str, Any]:
        """Networks, optimiser and counter as they are now."""
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
