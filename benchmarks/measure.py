"""Measuring side by side: what every benchmark here is made of.

A time by itself says more about the machine than about the code, and a machine that others use
changes from one second to the next. So ours is measured against a named *peer* in turns (peer,
ours, peer, ours, ...). Each turn gives one ratio; their median counts, and how far they spread says
how much to believe it.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from statistics import median

Measurement = Callable[[], float]
"""Does some work and returns what was measured, in the unit of its row."""


@dataclass(frozen=True)
class Row:
    """Repeated measurements of one thing and of its peer.

    Attributes:
        case: What was measured.
        unit: Unit of the measurements: ``steps/s``, where more is better, or ``s``.
        peer_name: What it is compared with.
        ours: Our measurements, in order.
        peer: The peer's, each taken just before ours.
    """

    case: str
    unit: str
    peer_name: str
    ours: list[float]
    peer: list[float]

    @property
    def ratios(self) -> list[float]:
        """Ours over the peer's, turn by turn."""
        return [mine / other for mine, other in zip(self.ours, self.peer, strict=True)]

    def __str__(self) -> str:
        ratio, least, most = (f"{f(self.ratios):.3g}" for f in (median, min, max))
        said = f"{ratio} x {self.peer_name} ({least} to {most})"
        return f"{self.case}: {median(self.ours):,.4g} {self.unit}, {said}"


def in_turns(
    case: str, unit: str, ours: Measurement, peer_name: str, peer: Measurement, turns: int
) -> Row:
    """Measure ours and the peer in turns; the peer goes first in each."""
    pairs = [(peer(), ours()) for _ in range(turns)]
    return Row(case, unit, peer_name, [mine for _, mine in pairs], [other for other, _ in pairs])


@contextmanager
def stopwatch() -> Iterator[Callable[[], float]]:
    """Yield a function that returns the processor's seconds since the block began."""
    gc.collect()
    began = time.process_time()
    yield lambda: time.process_time() - began
