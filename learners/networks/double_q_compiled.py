"""Double Q-learning for N agents on a CPU, by compiled loops.

:class:`CompiledDoubleQ` keeps its parameters and its optimizer's moments in the tensors of a
:class:`~learners.networks.double_q.StackedDoubleQ`, and so writes and reads the same checkpoints;
only how it evaluates and trains is its own (:mod:`learners.networks.double_q_kernels`). An agent's
numbers do not depend on which others there are, nor on what else is evaluated.

The first call compiles for some seconds; the machine code is kept beside the module (or, where that
cannot be written to, in the user's cache) for all later processes of the installation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from learners.networks import double_q_kernels as kernels
from learners.networks.double_q import StackedDoubleQ, StackedMLP
from learners.networks.replay_buffer import Batch

RULES: dict[type[torch.optim.Optimizer], int] = {
    torch.optim.Adam: kernels.ADAM,
    torch.optim.RMSprop: kernels.RMSPROP,
    torch.optim.SGD: kernels.SGD,
}
LOSSES = {"huber": kernels.HUBER, "squared": kernels.SQUARED}


def networks_of(stack: StackedMLP) -> kernels.Networks:
    """The same parameters as compiled code takes them."""
    sizes = np.array(stack.sizes, dtype=np.int64)
    lengths = stack.agents * (sizes[:-1] + 1) * sizes[1:]
    begins = np.concatenate([[0], lengths.cumsum()[:-1]])
    return kernels.Networks(stack.parameters.numpy(), sizes, begins, stack.agents)


class CompiledDoubleQ(StackedDoubleQ):
    """A :class:`StackedDoubleQ` in compiled code for a CPU."""

    _views: tuple[kernels.Networks, kernels.Networks] | None = None

    @property
    def _networks(self) -> tuple[kernels.Networks, kernels.Networks]:
        """The networks and the target networks, as views of the tensors."""
        if self._views is None:
            self._views = networks_of(self.online), networks_of(self.target)
        return self._views

    def __getstate__(self) -> dict[str, Any]:
        # A copy has tensors of its own, and needs views of those.
        return {**vars(self), "_views": None}

    @property
    def _rule(self) -> int:
        return RULES[type(self.optimizer)]

    @property
    def _type(self) -> np.dtype[Any]:
        return self.online.parameters.numpy().dtype

    def observe(self, table: Tensor) -> None:
        """As for :class:`~learners.networks.double_q.StackedDoubleQ`."""
        super().observe(table)
        values = (self.online.agents, len(table), self.online.sizes[-1])
        self._target_table = kernels.TargetTable(
            self._table.numpy(), np.zeros(values, self._type), np.zeros(values[:2], dtype=bool)
        )
        self._scratch = self._scratch_for(1)

    def _scratch_for(self, observations: int) -> kernels.Scratch:
        sizes, widest = self.online.sizes, max(self.online.sizes[1:])
        terms = max(observations, kernels.BLOCK) + 4
        return kernels.Scratch(
            given=np.zeros(observations * sum(sizes), self._type),
            slope=np.zeros(2 * (observations + 1) * widest, self._type),
            rest=np.zeros(widest, self._type),
            listed=np.zeros(terms, dtype=np.int64),
            factors=np.zeros(terms, self._type),
            rows=np.zeros(observations, dtype=np.int64),
            inputs=np.zeros((observations, sizes[0]), self._type),
            column=np.full(len(self._table), -1),
        )

    def greedy(
        self, observations: NDArray[Any], wanted: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """As for :class:`~learners.networks.double_q.StackedDoubleQ`."""
        if wanted is None:
            wanted = np.ones(self.online.agents, dtype=bool)
        inputs = observations.astype(self._type)
        return kernels.greedy(self._networks[0], inputs, wanted, self._scratch)

    def update(self, batch: Batch, trains: Tensor | None = None) -> Tensor:
        """As for :class:`~learners.networks.double_q.StackedDoubleQ`."""
        most = min(2 * batch.before.shape[1], len(self._table))
        if len(self._scratch.rows) < most:
            self._scratch = self._scratch_for(most)
        parts = (
            batch.before,
            batch.action,
            batch.reward,
            batch.after,
            batch.not_done,
            batch.weight,
        )
        errors = kernels.update(
            *self._networks,
            kernels.Minibatch(*(np.ascontiguousarray(part.numpy()) for part in parts)),
            np.ones(self.online.agents, dtype=bool) if trains is None else trains.numpy(),
            self._target_table,
            self._optimizer_step(),
            self.gamma,
            LOSSES[self.loss],
            self._scratch,
        )
        self._after_step()
        return torch.from_numpy(errors)

    def _target_changed(self) -> None:
        super()._target_changed()
        self._target_table.is_known[:] = False

    def _optimizer_state(self) -> dict[str, Tensor]:
        """The state of torch's optimizer, created at the first step as torch does."""
        parameters = self.online.parameters
        if self._rule == kernels.SGD:
            return {}
        state = self.optimizer.state[parameters]
        if not state:
            state["step"] = torch.zeros((), dtype=torch.float32)
            adam = self._rule == kernels.ADAM
            for name in ("exp_avg", "exp_avg_sq") if adam else ("square_avg",):
                state[name] = torch.zeros_like(parameters)
        return state

    def _optimizer_step(self) -> kernels.Optimizer:
        """Count one more step, and describe the optimizer at that step."""
        settings, state = self.optimizer.param_groups[0], self._optimizer_state()
        first = second = self._networks[0].flat  # unused where the rule keeps no moments
        kept = kept_square = 0.0
        if state:
            state["step"] += 1
        if self._rule == kernels.ADAM:
            kept, kept_square = settings["betas"]
            first, second = state["exp_avg"].numpy(), state["exp_avg_sq"].numpy()
        elif self._rule == kernels.RMSPROP:
            kept_square, second = settings["alpha"], state["square_avg"].numpy()
        count = float(state.get("step", 1.0))
        numbers = (
            settings["lr"] / (1 - kept**count),
            1 - kept,
            kept_square,
            1 - kept_square,
            settings.get("eps", 0.0),
            (1 - kept_square**count) ** -0.5,
        )
        return kernels.Optimizer(self._rule, np.array(numbers, self._type), first, second)
