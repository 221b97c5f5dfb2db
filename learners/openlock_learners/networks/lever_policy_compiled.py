"""A single lever policy on a CPU, by compiled loops, for meta-training.

:class:`CompiledLeverPolicy` has the parameters of a
:class:`~openlock_learners.networks.recurrent_policy.LeverPolicy` and computes the same gradients;
only how it runs over steps, forward and back, is its own
(:mod:`openlock_learners.networks.lever_policy_kernels`). Sums have another order than torch's, so
the last digits of a result differ. The first call compiles for half a minute; the machine code is
stored for all later processes of the installation.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from openlock_learners.networks import lever_policy_kernels as kernels
from openlock_learners.networks.recurrent_policy import OWN, SHARED, LeverPolicy

Spare = dict[tuple[int, ...], kernels.Trace]


class _Course(torch.autograd.Function):
    """The compiled loops as a function of the weights; no gradients go to what is perceived."""

    @staticmethod
    def forward(
        ctx: Any, spare: Spare, inputs: Tensor, state: Tensor, fresh: Tensor, *parameters: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        weights = kernels.Weights(*(part.detach()[0].numpy() for part in parameters))
        seen, before, resets = (np.ascontiguousarray(p[0].numpy()) for p in (inputs, state, fresh))
        # Memory that the system has just handed out is slow: a trace is used again.
        kept = any(ctx.needs_input_grad)
        trace = spare.pop((kept, *seen.shape), None)
        if trace is None:
            steps, rooms, width = seen.shape
            trace = kernels.new_trace(weights, steps, rooms, (width - SHARED) // OWN, kept)
        found = kernels.forward(weights, seen, before, resets, trace)
        if kept:
            ctx.kept = spare, seen.shape, weights, resets, trace
        else:
            spare[kept, *seen.shape] = trace
        logits, values, last = (torch.from_numpy(part)[None] for part in found)
        ctx.mark_non_differentiable(last)
        return logits, values, last

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor) -> tuple[Tensor | None, ...]:
        spare, shape, weights, resets, trace = ctx.kept
        ctx.kept = None  # what it holds is used up
        by_logits, by_values = (np.ascontiguousarray(slope[0].numpy()) for slope in slopes[:2])
        gradients = kernels.Weights(*(np.zeros_like(part) for part in weights))
        kernels.backward(weights, resets, trace, by_logits, by_values, gradients)
        spare[True, *shape] = trace
        return None, None, None, None, *(torch.from_numpy(part)[None] for part in gradients)


class CompiledLeverPolicy(LeverPolicy):
    """A :class:`LeverPolicy` in compiled code for a CPU; N is 1."""

    def forward(
        self, inputs: Tensor, state: Tensor, fresh: Tensor | None = None
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Run over T steps; see :class:`~.recurrent_policy.RecurrentPolicy`."""
        if fresh is None:
            fresh = torch.zeros(inputs.shape[:3], dtype=torch.bool)
        self._spare: Spare = getattr(self, "_spare", {})
        parameters = [
            part if torch.is_grad_enabled() else part.detach() for part in self.parameters()
        ]
        given = self._spare, inputs, state, fresh, *parameters
        logits, values, last = _Course.apply(*given)  # type: ignore[no-untyped-call]
        return logits, values, last
