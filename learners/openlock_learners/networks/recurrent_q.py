"""Double Q-learning on sequences with recurrent networks, for N agents (R2D2).

N agents keep their weights as ``[N, in, out]`` tensors, and nothing is shared between them. An
agent's numbers do not depend on how many others there are: torch operations that compute the last
few numbers of a tensor, or tensors at unaligned addresses, in another way are avoided
(:func:`sigmoid`, :func:`product`, Adam that is not fused).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor, nn

from openlock_learners.networks.sequence_buffer import Sequences

ALIGNED = 16
"""Single-precision numbers in the longest vector of today's processors."""

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

    ``torch.sigmoid`` takes another formula for the last few numbers of a tensor, and which these
    are depends on how many agents there are.
    """
    return torch.tanh(numbers / 2) / 2 + 0.5


def product(bias: Tensor, inputs: Tensor, weight: Tensor) -> Tensor:
    """``[N, M, out]``: ``bias + inputs @ weight`` of each agent.

    Columns of zeros are added up to a multiple of the processor's vectors, so that each agent's
    part begins where a vector does: how a product is rounded may depend on that.
    """
    outputs = weight.shape[-1]
    if rest := -outputs % ALIGNED:
        bias, weight = nn.functional.pad(bias, (0, rest)), nn.functional.pad(weight, (0, rest))
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


class StackedGRU(nn.Module):
    """N layers of H gated recurrent units; weights are as in torch's cells, transposed."""

    def __init__(self, inputs: int, hidden: int, generators: Generators) -> None:
        super().__init__()
        self.hidden = hidden
        self.input_weight = initial(generators, hidden, inputs, 3 * hidden)
        self.hidden_weight = initial(generators, hidden, hidden, 3 * hidden)
        self.input_bias = initial(generators, hidden, 1, 3 * hidden)
        self.hidden_bias = initial(generators, hidden, 1, 3 * hidden)

    def forward(
        self, inputs: Tensor, state: Tensor, mask: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """``[N, T, M, H]`` outputs of T steps, ``[N, T, M, in]``, and ``[N, M, H]`` the last.

        ``state``, ``[N, M, H]``, precedes the first step; steps that are not real by ``mask``,
        ``[N, T, M]``, leave it as it is. By default all are.
        """
        projected = product(self.input_bias, inputs.flatten(1, 2), self.input_weight)
        # Splitting time once makes autograd join the gradients of the steps once.
        steps = projected.view(*inputs.shape[:3], -1).unbind(1)
        masks = [None] * len(steps) if mask is None else mask[..., None].unbind(1)
        two, outputs = 2 * self.hidden, []
        for step, real in zip(steps, masks, strict=True):
            recurrent = product(self.hidden_bias, state, self.hidden_weight)
            reset, keep = sigmoid(step[..., :two] + recurrent[..., :two]).chunk(2, dim=-1)
            new = torch.tanh(torch.addcmul(step[..., two:], reset, recurrent[..., two:]))
            after = torch.lerp(new, state, keep)
            state = after if real is None else torch.where(real, after, state)
            # A view's gradient is added after those of the next step: results depend on the order.
            outputs.append(state.view_as(state))
        return torch.stack(outputs, dim=1), state


class StackedRecurrentNetwork(nn.Module):
    """N networks of a recurrent layer and a perceptron, both of ``hidden`` units, that reads it."""

    def __init__(self, inputs: int, hidden: int, outputs: int, generators: Generators) -> None:
        super().__init__()
        self.cell = StackedGRU(inputs, hidden, generators)
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
    before the others are learned from; no gradient flows back into them. The target network becomes
    a copy of the network after every ``target_period`` updates; ``None`` never copies it again.
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
        inputs, state, burn_in_mask, action, reward, not_done, mask = map(torch.from_numpy, batch)
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

        The networks of the others stay as they are. Returned is the ``[N]`` loss of each agent.
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
