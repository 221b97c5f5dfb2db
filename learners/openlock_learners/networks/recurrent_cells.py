"""Stacked recurrent layers: N agents' GRUs or LSTMs at once.

As in :mod:`openlock_learners.networks.double_q`, N agents keep their weights as ``[N, in, out]``
tensors, and nothing is shared between them. An agent's numbers do not depend on how many others
there are: torch operations that compute the last few numbers of a tensor, or tensors at unaligned
addresses, in another way are avoided (:func:`sigmoid`, :func:`product`, Adam that is not fused).

Only what depends on the step before is computed step by step; the inputs of all steps go through
one product beforehand. torch's own LSTM is as fast as the GRU here when it runs once for each agent
(it has a fused kernel), and its GRU four times slower.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar, Literal

import numpy as np
import torch
from torch import Tensor, nn

ALIGNED = 16
"""Single-precision numbers in the longest vector of today's processors."""

CellName = Literal["gru", "lstm"]
Generators = Sequence[np.random.Generator]


def initial(generators: Generators, width: int, *shape: int) -> nn.Parameter:
    """``[N, *shape]`` weights, uniform within 1/sqrt(width) as torch's own are."""
    bound = width**-0.5
    drawn = np.empty((len(generators), *shape))
    for agent, generator in enumerate(generators):
        drawn[agent] = generator.uniform(-bound, bound, shape)
    return nn.Parameter(torch.tensor(drawn, dtype=torch.float32))


def sigmoid(numbers: Tensor) -> Tensor:
    """The logistic function, each number by itself.

    ``torch.sigmoid`` takes another formula for the last few numbers of a tensor on a CPU, and which
    these are depends on how many agents there are.
    """
    return torch.tanh(numbers / 2) / 2 + 0.5


def padded(bias: Tensor, weight: Tensor) -> tuple[Tensor, Tensor]:
    """Pad a bias and a weight with columns of zeros, up to a multiple of the processor's vectors.

    Each agent's part of a product then begins where a vector does: how a product is rounded may
    depend on that.
    """
    if not (rest := -weight.shape[-1] % ALIGNED):
        return bias, weight
    return nn.functional.pad(bias, (0, rest)), nn.functional.pad(weight, (0, rest))


def product(bias: Tensor, inputs: Tensor, weight: Tensor) -> Tensor:
    """``[N, M, out]``: ``bias + inputs @ weight`` of each agent."""
    bias_, weight_ = padded(bias, weight)
    return torch.baddbmm(bias_, inputs, weight_)[..., : weight.shape[-1]]


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
        self, inputs: Tensor, state: Tensor, mask: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Run over T steps.

        Args:
            inputs: ``[N, T, M, in]`` for M sequences of T steps.
            state: ``[N, M, S]`` hidden state before the first step.
            mask: ``[N, T, M]`` which steps are real; the others leave the state as it is. By
                default all are.

        Returns:
            ``[N, T, M, H]`` the outputs, and ``[N, M, S]`` the last hidden state.
        """
        projected = product(self.input_bias, inputs.flatten(1, 2), self.input_weight)
        # Splitting time once makes autograd join the gradients of the steps once.
        steps = projected.view(*inputs.shape[:3], -1).unbind(1)
        masks = [None] * len(steps) if mask is None else mask[..., None].unbind(1)
        bias, weight = padded(self.hidden_bias, self.hidden_weight)
        width = self.hidden_weight.shape[-1]
        outputs = []
        for step, real in zip(steps, masks, strict=True):
            recurrent = torch.baddbmm(bias, state[..., : self.hidden], weight)[..., :width]
            after = self.step(step, recurrent, state)
            state = after if real is None else torch.where(real, after, state)
            outputs.append(state[..., : self.hidden])
        return torch.stack(outputs, dim=1), state

    @abstractmethod
    def step(self, projected: Tensor, recurrent: Tensor, state: Tensor) -> Tensor:
        """``[N, M, S]`` the next hidden state.

        ``projected`` and ``recurrent``, both ``[N, M, gates * H]``, are what the input and the last
        output contribute to each gate.
        """


class StackedGRU(StackedCell):
    """N layers of gated recurrent units."""

    gates, states = 3, 1

    def step(self, projected: Tensor, recurrent: Tensor, state: Tensor) -> Tensor:
        """Next state, from a reset gate, an update gate and new content."""
        two = 2 * self.hidden
        reset, keep = sigmoid(projected[..., :two] + recurrent[..., :two]).chunk(2, dim=-1)
        new = torch.tanh(torch.addcmul(projected[..., two:], reset, recurrent[..., two:]))
        return torch.lerp(new, state, keep)


class StackedLSTM(StackedCell):
    """N layers of long short-term memory; the state is the output and the cell, side by side."""

    gates, states = 4, 2

    def step(self, projected: Tensor, recurrent: Tensor, state: Tensor) -> Tensor:
        """Next state, from gates of input, forgetting and output, and new content."""
        take, keep, new, show = (projected + recurrent).chunk(4, dim=-1)
        held = sigmoid(keep) * state[..., self.hidden :]
        held = torch.addcmul(held, sigmoid(take), torch.tanh(new))
        return torch.cat([sigmoid(show) * torch.tanh(held), held], dim=-1)


CELLS: dict[CellName, type[StackedCell]] = {"gru": StackedGRU, "lstm": StackedLSTM}
