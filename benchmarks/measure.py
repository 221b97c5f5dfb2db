"""Measuring side by side: what every benchmark here is made of.

A time by itself says more about the machine than about the code, and a machine that others use
changes from one second to the next. So what we have is measured against a named *peer* in turns
(peer, ours, peer, ours, ...), each turn gives one ratio, and what counts is the median of these
ratios. How far they spread says how much to believe it.
"""

from __future__ import annotations

import gc
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from statistics import median
from typing import Any, Literal

Unit = Literal["steps/s", "actions/s", "pairs/s", "subjects/s", "frames/s", "s", "bytes/attempt"]
Measurement = Callable[[], float]
"""Does some work and returns what was measured, in the unit of the row."""


@dataclass(frozen=True)
class Target:
    """What a row should reach.

    Attributes:
        sense: Whether the bound is the least or the most that is allowed.
        bound: The bound.
        on: Whether it is about the ratio to the peer or about our own measurement.
    """

    sense: Literal["at least", "at most", "under"]
    bound: float
    on: Literal["ratio", "ours"] = "ratio"

    def reached(self, value: float) -> bool:
        """Whether a value keeps to the bound."""
        if self.sense == "at least":
            return value >= self.bound
        return value < self.bound if self.sense == "under" else value <= self.bound


@dataclass(frozen=True)
class Row:
    """One line of the table: repeated measurements of one thing and of its peer.

    Attributes:
        benchmark: Name of the benchmark.
        case: What was measured.
        unit: Unit of the measurements.
        ours: Our measurements, in order.
        peer_name: What they are compared with.
        peer: Its measurements, each taken just before ours; empty if there is no peer.
        target: What to reach, if anything.
        broken: A promise that belongs to the target and was not kept; empty if all were.
        note: What else there is to say.
    """

    benchmark: str
    case: str
    unit: Unit
    ours: list[float]
    peer_name: str = ""
    peer: list[float] = field(default_factory=list)
    target: Target | None = None
    broken: str = ""
    note: str = ""

    @property
    def ratios(self) -> list[float]:
        """Ours over the peer's, turn by turn."""
        return [mine / other for mine, other in zip(self.ours, self.peer, strict=False)]

    @property
    def reached(self) -> bool | None:
        """Whether the median keeps to the target; ``None`` if there is no target."""
        if self.target is None:
            return None
        judged = self.ratios if self.target.on == "ratio" else self.ours
        return not self.broken and self.target.reached(median(judged))

    def as_dict(self) -> dict[str, Any]:
        """The row as plain data, every measurement included."""
        target = self.target
        return {
            "benchmark": self.benchmark,
            "case": self.case,
            "unit": self.unit,
            "ours": _summary(self.ours),
            "peer_name": self.peer_name,
            "peer": _summary(self.peer),
            "ratio": _summary(self.ratios),
            "target": target and {"sense": target.sense, "bound": target.bound, "on": target.on},
            "reached": self.reached,
            "broken": self.broken,
            "note": self.note,
        }


def _summary(values: list[float]) -> dict[str, Any] | None:
    if not values:
        return None
    return {"median": median(values), "min": min(values), "max": max(values), "all": values}


def in_turns(
    ours: Measurement, peer: Measurement | None, repeats: int, warm_up: bool = True
) -> tuple[list[float], list[float]]:
    """Measure ours and the peer in turns.

    Args:
        ours: Our measurement.
        peer: The peer's, which goes first in each turn.
        repeats: How many turns.
        warm_up: Whether to begin with a turn that does not count.

    Returns:
        Our measurements and the peer's.
    """
    mine, others = [], []
    for turn in range(-1 if warm_up else 0, repeats):
        other = peer() if peer else None
        own = ours()
        if turn >= 0:
            mine.append(own)
            if other is not None:
                others.append(other)
    return mine, others


@contextmanager
def stopwatch(
    clock: Callable[[], float] = time.perf_counter,
) -> Iterator[Callable[[], float]]:
    """Tell the seconds since the block began, without garbage left by what ran before it.

    ``time.process_time`` counts those of the processor, whatever else the machine does meanwhile.
    """
    gc.collect()
    began = clock()
    yield lambda: clock() - began
