"""A single lever policy on a CPU, by compiled loops, for meta-training.

:class:`CompiledLeverPolicy` has the parameters of a
:class:`~openlock_learners.networks.recurrent_policy.LeverPolicy`, and :class:`CompiledPPO` finds
the same gradients for it as :class:`~openlock_learners.networks.ppo.PPO`; only how they are
computed differs (:mod:`openlock_learners.networks.lever_policy_kernels`). Sums have another order
than torch's, so the last digits of a result differ. The first call compiles for half a minute; the
machine code is stored for all later processes of the installation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from openlock_learners.networks import lever_policy_kernels as kernels
from openlock_learners.networks.ppo import PPO, Rollout
from openlock_learners.networks.recurrent_policy import OWN, SHARED, LeverPolicy

LEVER_INPUT = 4
"""Index of the parameter that is in two parts among the kernels' weights."""


class CompiledLeverPolicy(LeverPolicy):
    """A :class:`LeverPolicy` in compiled code for a CPU; N is 1."""

    @torch.no_grad()
    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps, without gradients; see :class:`~.recurrent_policy.RecurrentPolicy`."""
        if fresh is None:
            fresh = torch.zeros(inputs.shape[:3], dtype=torch.bool)
        seen = kernels.Perceived(*(_of_one(part) for part in (inputs, state, fresh)))
        found = kernels.run(self.weights(), seen, self.trace(inputs))
        logits, values, last = (torch.from_numpy(part)[None] for part in found)
        return logits, values, last

    def weights(self) -> kernels.Weights:
        """Views of the parameters, by their names in the kernels."""
        parts = [part.detach().numpy()[0] for part in self.parameters()]
        parts[LEVER_INPUT : LEVER_INPUT + 1] = np.split(parts[LEVER_INPUT], [OWN])
        return kernels.Weights(*parts)

    def trace(self, inputs: Tensor) -> kernels.Trace:
        """A trace for inputs of this shape, used again from call to call."""
        self._traces: dict[tuple[int, int], kernels.Trace] = getattr(self, "_traces", {})
        shape = inputs.shape[1], (inputs.shape[3] - SHARED) // OWN
        if shape not in self._traces:
            self._traces[shape] = kernels.new_trace(self.weights(), *shape)
        return self._traces[shape]


class CompiledPPO(PPO):
    """Improves a :class:`CompiledLeverPolicy` from its rollouts."""

    network: CompiledLeverPolicy

    def find_gradients(
        self,
        rollout: Rollout,
        advantage: Tensor,
        returns: Tensor,
        which: Tensor,
        entropy_weight: float,
    ) -> dict[str, float]:
        """See :meth:`PPO.find_gradients`."""
        weights = self.network.weights()
        gradients = kernels.Weights(*(np.zeros(part.shape[::-1], np.float32) for part in weights))
        seen = kernels.Perceived(*map(_of_one, (rollout.inputs, rollout.state, rollout.fresh)))
        learned = rollout.action, rollout.log_prob, advantage, returns, rollout.mask
        factors = self.settings.clip, self.settings.value_weight, entropy_weight
        taken = kernels.Taken(np.array(factors, np.float32), *map(_of_one, learned))
        trace = self.network.trace(rollout.inputs)
        sums = kernels.learn(weights, seen, taken, which.numpy(), trace, gradients)
        steps = max(int(rollout.mask[:, :, which].sum()), 1)
        parts = [part.T / np.float32(steps) for part in gradients]
        two = slice(LEVER_INPUT, LEVER_INPUT + 2)
        parts[two] = [np.concatenate(parts[two])]
        for parameter, part in zip(self.network.parameters(), parts, strict=True):
            parameter.grad = torch.from_numpy(part)[None].contiguous()
        means = (sums / steps).tolist()
        return dict(zip(("entropy", "value_error", "clipped"), means, strict=True))


def _of_one(part: Tensor) -> NDArray[Any]:
    """The part of the only network."""
    return np.ascontiguousarray(part.numpy()[0])
