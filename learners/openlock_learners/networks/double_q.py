"""Double Q-learning for N agents at once, in torch.

N networks of the same shape keep their weights as ``[N, in, out]`` tensors, so that one batched
matrix product evaluates all of them and one optimizer step trains all of them. Nothing is shared:
an agent's gradient comes from its own loss alone.

At this size, recording what autograd needs and allocating new gradients takes as long as the
arithmetic. So the gradient of these plain layers is written out (:meth:`StackedMLP.backward`); the
tests hold it against autograd's.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from functools import cached_property
from itertools import pairwise, zip_longest
from typing import Any, Literal

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from openlock_learners.networks.replay_buffer import Batch

Device = Literal["auto", "cpu", "cuda"]
OptimizerName = Literal["adam", "rmsprop", "sgd"]
Loss = Literal["huber", "squared"]

OPTIMIZERS: dict[OptimizerName, Any] = {
    "adam": torch.optim.Adam,
    "rmsprop": torch.optim.RMSprop,
    "sgd": torch.optim.SGD,
}
LEAST_TABLE = 64
"""Rows of the padded table of observations at first; it doubles whenever it is full."""
LARGE_TABLE = 1000
"""Observations from which on the target network no longer evaluates all of them ahead of time."""


def find_device(name: Device) -> torch.device:
    """The device of that name; ``auto`` is a GPU where there is one."""
    if name == "auto":
        name = "cuda" if torch.cuda.is_available() else "cpu"
    return torch.device(name)


class StackedMLP:
    """N multi-layer perceptrons with ReLU between the layers and a linear output.

    Args:
        sizes: Width of the input, of each hidden layer and of the output.
        generators: One source of initial weights for each agent.
        device: Where the parameters are kept.

    Attributes:
        parameters: All parameters of all agents in one flat tensor, which is the fastest to update
            and to copy.
        weights: ``[N, in, out]`` of each layer: views of ``parameters``.
        biases: ``[N, 1, out]`` of each layer.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        generators: Sequence[np.random.Generator],
        device: torch.device | str | None = None,
    ) -> None:
        self.sizes = tuple(sizes)
        self.agents = len(generators)
        drawn = []
        for width_in, width_out in pairwise(sizes):
            # Uniform within 1/sqrt(fan in), as torch initialises a single linear layer.
            bound = width_in**-0.5
            for rows in (width_in, 1):
                part = [rng.uniform(-bound, bound, (rows, width_out)) for rng in generators]
                drawn.append(np.ravel(part))
        flat = torch.from_numpy(np.concatenate(drawn)).to(device, torch.get_default_dtype())
        self._keep(flat)

    def __getstate__(self) -> dict[str, Any]:
        """Sizes and parameters; all else are views of these."""
        return {name: vars(self)[name] for name in ("sizes", "agents", "parameters")}

    def __setstate__(self, state: dict[str, Any]) -> None:
        """Make the views again."""
        vars(self).update(state)
        self._keep(self.parameters)

    def _keep(self, flat: Tensor) -> None:
        self.parameters = flat
        self.weights, self.biases = self.layers_of(flat)
        flat.grad = torch.zeros_like(flat)
        self._gradients = self.layers_of(flat.grad)

    def layers_of(self, flat: Tensor) -> tuple[list[Tensor], list[Tensor]]:
        """Weights and biases, by layer, in a tensor that is laid out like ``parameters``."""
        shapes = [
            (self.agents, rows, width_out)
            for width_in, width_out in pairwise(self.sizes)
            for rows in (width_in, 1)
        ]
        parts = torch.split(flat, [math.prod(shape) for shape in shapes])
        layers = [part.view(shape) for part, shape in zip(parts, shapes, strict=True)]
        return layers[::2], layers[1::2]

    def copy(self) -> StackedMLP:
        """Copy the networks; the copy's parameters are independent."""
        return copy.deepcopy(self)

    def activations(self, inputs: Tensor) -> list[Tensor]:
        """The input of each layer, and last the outputs; inputs are as for :meth:`__call__`."""
        layers = [inputs.expand(self.agents, -1, -1)]
        for layer, (weight, bias) in enumerate(zip(self.weights, self.biases, strict=True)):
            if layer:
                layers[-1].relu_()
            layers.append(torch.baddbmm(bias, layers[-1], weight))
        return layers

    def __call__(self, inputs: Tensor) -> Tensor:
        """``[N, M, out]`` outputs for ``[N, M, in]`` inputs; ``[M, in]`` goes to every agent."""
        return self.activations(inputs)[-1]

    def backward(self, activations: list[Tensor], gradient: Tensor) -> None:
        """Set ``parameters.grad`` by the ``[N, M, out]`` gradient of each agent's loss.

        The gradient is with respect to the outputs, the last of :meth:`activations`.
        """
        weights, biases = self._gradients
        for layer in reversed(range(len(weights))):
            torch.bmm(activations[layer].transpose(1, 2), gradient, out=weights[layer])
            torch.sum(gradient, dim=1, keepdim=True, out=biases[layer])
            if layer:
                gradient = torch.bmm(gradient, self.weights[layer].transpose(1, 2))
                # The slope of a ReLU is 1 where it let something through and 0 elsewhere.
                gradient.mul_(activations[layer].sign())


class StackedDoubleQ:
    """Double Q-learning for N agents over a table of observations.

    The room shows few distinct observations, and most of a minibatch repeats them. So transitions
    hold indices into a table (see :meth:`observe`), and where the table is smaller than a
    minibatch, each agent's network evaluates the table once and the values of the transitions are
    read off; loss and gradient are the same as if each transition had been evaluated by itself. The
    target network changes seldom, so its values of the whole table are kept until it does.

    Args:
        sizes: As for :class:`StackedMLP`.
        generators: One source of initial weights for each agent.
        learning_rate: Of the optimizer.
        gamma: Discount factor.
        target_period: Updates between copies of the network to the target network; ``None`` never
            copies it again.
        loss: Huber's loss, or half the squared error.
        optimizer: Which of torch's to use, apart from the learning rate with its defaults.
        device: Where everything is kept.
        double: Whether the network itself chooses the next action that the target network
            evaluates, as in DDQN; otherwise the target network does both, as in DQN.
    """

    def __init__(
        self,
        sizes: Sequence[int],
        generators: Sequence[np.random.Generator],
        learning_rate: float,
        gamma: float,
        target_period: int | None,
        loss: Loss = "huber",
        optimizer: OptimizerName = "adam",
        device: torch.device | str | None = None,
        double: bool = True,
    ) -> None:
        self.online = StackedMLP(sizes, generators, device)
        # A copy, and not a second network: making one would draw from the generators again.
        self.target = self.online.copy()
        self.gamma = gamma
        self.target_period = target_period
        self.loss = loss
        self.double = double
        self.updates = 0
        self.optimizer_name, self.learning_rate = optimizer, learning_rate
        self._table = self.online.parameters.new_zeros(0, self.online.sizes[0])
        self._target_values: Tensor | None = None
        self.observe(self._table)

    @cached_property
    def optimizer(self) -> torch.optim.Optimizer:
        """Torch's optimizer."""
        options = {"fused": True} if self.optimizer_name == "adam" else {}
        kind = OPTIMIZERS[self.optimizer_name]
        made: torch.optim.Optimizer = kind(
            [self.online.parameters], lr=self.learning_rate, **options
        )
        return made

    def observe(self, table: Tensor) -> None:
        """Replace the table of ``[D, in]`` distinct observations, which all indices refer to."""
        rows = LEAST_TABLE
        while rows < len(table):
            rows *= 2
        if len(self._table) != rows:
            self._table = self.online.parameters.new_zeros(rows, self.online.sizes[0])
            self._target_values = None
        self._table.zero_()
        self._table[: len(table)] = table.to(self._table)
        self._target_changed()

    def greedy(
        self, observations: NDArray[Any], wanted: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """``[N]`` the best action for each agent's observation, ``[N, in]``.

        Of agents that are not ``wanted``, ``[N]``, it can be any. By default all are.
        """
        inputs = torch.from_numpy(observations).to(self.online.parameters)[:, None]
        best: NDArray[np.int64] = self.online(inputs).squeeze(1).argmax(dim=1).cpu().numpy()
        return best

    def _evaluate(self, batch: Batch) -> tuple[Tensor, list[Tensor], Tensor]:
        """TD errors; the activations; and ``[N, M]`` which output each transition is about."""
        rows, before, after = self._rows_of(batch)
        activations = self.online.activations(self._table[rows])
        values, actions = activations[-1], self.online.sizes[-1]
        target_values, row = self._target_values, batch.after
        if target_values is None:
            target_values, row = self.target(self._table[rows]), after
        # Double Q: the online network chooses, the target network evaluates. Else it does both.
        chooser, its_row = (values, after) if self.double else (target_values, row)
        choice = chooser.argmax(dim=2).gather(1, its_row)
        following = target_values.flatten(1).gather(1, row * actions + choice)
        td_target = batch.reward + batch.not_done * following * self.gamma
        output = before * actions + batch.action
        return values.flatten(1).gather(1, output) - td_target, activations, output

    def _rows_of(self, batch: Batch) -> tuple[Tensor, Tensor, Tensor]:
        """Observations to evaluate: the whole table, or those of the transitions if fewer.

        That is ``[N, U]`` rows of the table, and the ``[N, M]`` columns among them of the
        observations before and after each transition.
        """
        agents, many = batch.before.shape
        every = torch.arange(min(len(self._table), 2 * many), device=batch.before.device)
        every = every.expand(agents, -1)
        if len(self._table) <= 2 * many:
            return every, batch.before, batch.after
        before, after = (part.contiguous() for part in every.chunk(2, dim=1))
        return torch.cat([batch.before, batch.after], dim=1), before, after

    def update(self, batch: Batch, trains: Tensor | None = None) -> Tensor:
        """One gradient step for every agent on its own minibatch.

        Args:
            batch: The minibatches, of arrays or tensors. An agent's loss is the mean over its
                transitions, each times its weight.
            trains: ``[N]`` which agents take the step; the networks of the others, and the state
                of the optimizer, stay as they are, whatever their minibatches hold. By default all
                do.

        Returns:
            ``[N, M]`` the TD errors before the step.
        """
        batch = Batch(*map(self._here, batch))
        errors, activations, output = self._evaluate(batch)
        # The slope of half the square is the error; Huber's never exceeds 1.
        slope = errors.clamp(-1.0, 1.0) if self.loss == "huber" else errors
        slope = slope * batch.weight / errors.shape[1]
        loss_gradient = torch.zeros_like(activations[-1])
        loss_gradient.flatten(1).scatter_add_(1, output, slope)
        self.online.backward(activations, loss_gradient)
        before = [] if trains is None else [part.clone() for part in self._of_agents()]
        self.optimizer.step()
        if trains is not None:
            self._put_back(before, trains)
        self._after_step()
        return errors

    def _here(self, part: Any) -> Tensor:
        """Part of a minibatch where and as the networks are."""
        tensor = torch.as_tensor(part, device=self._table.device)
        return tensor.to(self._table.dtype) if tensor.is_floating_point() else tensor

    def _of_agents(self) -> list[Tensor]:
        """The networks and the state of the optimizer, all laid out alike."""
        parameters = self.online.parameters
        state = self.optimizer.state.get(parameters, {}).values()
        return [parameters, *(part for part in state if part.shape == parameters.shape)]

    def _put_back(self, kept: list[Tensor], trains: Tensor) -> None:
        """Undo the step of the agents that do not train."""
        for now, before in zip_longest(self._of_agents(), kept):
            # State that the optimizer created with this step was zero before.
            before = torch.zeros_like(now) if before is None else before
            for parts in zip(*map(self.online.layers_of, (now, before)), strict=True):
                for part, old in zip(*parts, strict=True):
                    part.copy_(torch.where(trains[:, None, None], part, old))

    def _after_step(self) -> None:
        self.updates += 1
        if self.target_period and self.updates % self.target_period == 0:
            self.target.parameters.copy_(self.online.parameters)
            self._target_changed()

    def _target_changed(self) -> None:
        """Evaluate the table again with the target network."""
        if len(self._table) <= LARGE_TABLE:
            self._target_values = self.target(self._table)
