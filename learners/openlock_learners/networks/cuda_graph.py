"""A step on tensors, replayed as a CUDA graph.

On a GPU an update of small networks is dozens of kernels of a few microseconds each, and starting
them from Python takes longer than they do. A CUDA graph records them once and starts them all with
one call. It can only hold what does not depend on the data: the same shapes at the same addresses
every time, and nothing that waits for a result.

The capture itself is not covered by the tests: on a CPU a step is called and not captured.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable

import torch
from torch import Tensor

WARM_UP = 3
"""Calls before the capture: libraries choose their kernels, the optimizer creates its state."""

Step = Callable[..., Tensor]


class Captured:
    """A step on tensors, replayed from a CUDA graph where there is one.

    The first calls run the step as it is, on a stream of their own, and count like all others. Then
    it is captured, which runs nothing, and replayed from there on. If it cannot be captured, a
    warning says so once and the step goes on being called.

    Args:
        step: Takes tensors of the same shapes at every call and returns one; what else it reads and
            writes must stay where it is.
        device: Where it runs. Anything but a GPU calls the step and captures nothing.
    """

    def __init__(self, step: Step, device: torch.device) -> None:
        self._step = step
        self._captures = device.type == "cuda"
        self._calls = 0
        self._replay: Callable[[], None] | None = None

    def __call__(self, *given: Tensor) -> Tensor:
        """What the step returns; after the capture, a tensor that the next call overwrites."""
        if not self._captures:
            return self._step(*given)
        self._calls += 1
        if self._calls <= WARM_UP:
            return self._aside(*given)
        if self._replay is None:
            try:
                self._capture(given)
            except RuntimeError as error:
                self._captures = False
                warnings.warn(
                    f"training goes on without a CUDA graph, and slower: {error}",
                    RuntimeWarning,
                    stacklevel=2,
                )
                return self._step(*given)
        for kept, new in zip(self._given, given, strict=True):
            kept.copy_(new)
        assert self._replay is not None
        self._replay()
        return self._returned

    def _aside(self, *given: Tensor) -> Tensor:
        stream = torch.cuda.Stream()  # type: ignore[no-untyped-call]
        present = torch.cuda.current_stream()
        stream.wait_stream(present)
        with torch.cuda.stream(stream):
            returned = self._step(*given)
        present.wait_stream(stream)
        return returned

    def _capture(self, given: tuple[Tensor, ...]) -> None:
        self._given = [tensor.clone() for tensor in given]
        graph = torch.cuda.CUDAGraph()
        with torch.cuda.graph(graph):
            self._returned = self._step(*self._given)
        self._replay = graph.replay
