"""Double Q-learning for N agents on a CPU, by compiled loops.

:class:`CompiledDoubleQ` keeps its parameters and its optimizer's moments in tensors, as a
:class:`~openlock_learners.networks.double_q.StackedDoubleQ` does; only how it evaluates and trains
is its own (:mod:`openlock_learners.networks.double_q_kernels`). An agent's numbers do not depend on
which others there are, nor on what else is evaluated.

The first call compiles for some seconds; the machine code is stored next to the module (or, where
that cannot be written to, in the user's cache) for all later processes of the installation.
"""

from __future__ import annotations

import inspect
from functools import cached_property, lru_cache
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from openlock_learners.networks import double_q_kernels as kernels
from openlock_learners.networks.double_q import OPTIMIZERS, OptimizerName, StackedDoubleQ
from openlock_learners.networks.replay_buffer import Batch

RULES: dict[OptimizerName, int] = {
    "adam": kernels.ADAM,
    "rmsprop": kernels.RMSPROP,
    "sgd": kernels.SGD,
}
VIEWS = {"_networks", "_optimizer"}
"""Attributes of a :class:`CompiledDoubleQ` that share the memory of its tensors."""
LOSSES = {"huber": kernels.HUBER, "squared": kernels.SQUARED}


@lru_cache
def layout(widths: tuple[int, ...], agents: int) -> tuple[kernels.Integers, kernels.Integers]:
    """The sizes of networks, and where each layer begins in the parameters of all agents."""
    sizes = np.array(widths, dtype=np.int64)
    lengths = agents * (sizes[:-1] + 1) * sizes[1:]
    return sizes, np.concatenate([[0], lengths.cumsum()[:-1]])


@lru_cache
def defaults_of(optimizer: OptimizerName) -> dict[str, Any]:
    """Torch's settings of an optimizer."""
    known = inspect.signature(OPTIMIZERS[optimizer]).parameters.values()
    return {one.name: one.default for one in known if one.default is not one.empty}


class CompiledDoubleQ(StackedDoubleQ):
    """A :class:`StackedDoubleQ` in compiled code for a CPU, without torch's optimizer.

    The first optimizer of a process loads torch's compiler, which takes a second.
    """

    @cached_property
    def _networks(self) -> tuple[kernels.Networks, kernels.Networks]:
        """The networks and the target networks, as views of the tensors."""
        online, target = self.online.parameters.numpy(), self.target.parameters.numpy()
        shape = *layout(self.online.sizes, self.online.agents), self.online.agents
        return kernels.Networks(online, *shape), kernels.Networks(target, *shape)

    @cached_property
    def _type(self) -> np.dtype[Any]:
        return self.online.parameters.numpy().dtype

    def __getstate__(self) -> dict[str, Any]:
        """All but the views: those of a copy are of its own tensors."""
        return {name: part for name, part in vars(self).items() if name not in VIEWS}

    def observe(self, table: Tensor) -> None:
        """See :class:`~openlock_learners.networks.double_q.StackedDoubleQ`."""
        self._table = table.to(self.online.parameters)
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
            listed=np.zeros(terms, dtype=np.uint64),
            factors=np.zeros(terms, self._type),
            rows=np.zeros(observations, dtype=np.int64),
            inputs=np.zeros((observations, sizes[0]), self._type),
            column=np.full(len(self._table), -1),
        )

    def greedy(
        self, observations: NDArray[Any], wanted: NDArray[np.bool_] | None = None
    ) -> NDArray[np.int64]:
        """See :class:`~openlock_learners.networks.double_q.StackedDoubleQ`."""
        if wanted is None:
            wanted = np.ones(self.online.agents, dtype=bool)
        inputs = observations.astype(self._type)
        return kernels.greedy(self._networks[0], inputs, wanted, self._scratch)

    def update(self, batch: Batch, trains: Tensor | None = None) -> Tensor:
        """See :class:`~openlock_learners.networks.double_q.StackedDoubleQ`."""
        most = min(2 * batch.before.shape[1], len(self._table))
        if len(self._scratch.rows) < most:
            self._scratch = self._scratch_for(most)
        errors = kernels.update(
            *self._networks,
            Batch(*map(self._here, batch)),
            np.ones(self.online.agents, dtype=bool) if trains is None else np.asarray(trains),
            self._target_table,
            self._optimizer_step(),
            self.gamma,
            LOSSES[self.loss],
            self.double,
            self._scratch,
        )
        self._after_step()
        return torch.from_numpy(errors)

    def _here(self, part: Any) -> Any:
        array = np.asarray(part)
        return np.ascontiguousarray(array, self._type if array.dtype.kind == "f" else None)

    def _target_changed(self) -> None:
        self._target_table.is_known[:] = False

    @cached_property
    def _state(self) -> dict[str, Tensor]:
        """The optimizer's step and moments, as torch names them; empty before the first step."""
        return {}

    @cached_property
    def _optimizer(self) -> tuple[NDArray[Any], float, float, kernels.Optimizer]:
        """The steps taken, what two moments keep, and torch's optimizer: views of the tensors."""
        rule, parameters = RULES[self.optimizer_name], self.online.parameters
        settings = defaults_of(self.optimizer_name)
        first = second = parameters.numpy()  # unused where the rule keeps no moments
        kept, kept_square, count = 0.0, 0.0, np.ones(())
        if rule != kernels.SGD:
            moments = ("exp_avg", "exp_avg_sq") if rule == kernels.ADAM else ("square_avg",)
            state = self._state
            if not state:  # created at the first step, as torch does
                state["step"] = torch.zeros((), dtype=torch.float32)
                state |= {name: torch.zeros_like(parameters) for name in moments}
            count, first, second = (
                state[name].numpy() for name in ("step", moments[0], moments[-1])
            )
            kept, kept_square = settings.get("betas", (0.0, settings.get("alpha")))
        numbers = (0.0, 1 - kept, kept_square, 1 - kept_square, settings.get("eps", 0.0), 0.0)
        optimizer = kernels.Optimizer(rule, np.array(numbers, self._type), first, second)
        return count, kept, kept_square, optimizer

    def _optimizer_step(self) -> kernels.Optimizer:
        """Count one more step of torch's optimizer, and describe it at that step."""
        steps, kept, kept_square, optimizer = self._optimizer
        steps += 1
        optimizer.settings[0] = self.learning_rate / (1 - kept ** float(steps))
        optimizer.settings[5] = (1 - kept_square ** float(steps)) ** -0.5
        return optimizer
