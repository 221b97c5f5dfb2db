"""How far a comparison is, and how long it will take.

Cells are no measure: one of ``random`` takes a second and one of ``ddqn`` an hour. So work is
counted in attempts, as many as a cell may have at most, and what an attempt costs is learned for
each learner from the cells that it has played. For one that has not begun it is taken to be the
mean. None of this touches what is played.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.protocol import Condition, Protocol, plan


@dataclass(frozen=True)
class Playing:
    """A cell that is being played.

    Attributes:
        cell: The cell.
        share: The share of it that is over.
        seconds: How long it has been played here.
        still: Seconds since a step of it was last heard of.
    """

    cell: Cell
    share: float
    seconds: float
    still: float


@dataclass(frozen=True)
class Standing:
    """How far a comparison is.

    Attributes:
        cells: How many it has.
        done: How many of them are done.
        failed: How many failed.
        playing: Those that are being played.
        share: The share of the work that is over.
        left: Seconds that are left, if anything tells.
    """

    cells: int
    done: int
    failed: int
    playing: tuple[Playing, ...]
    share: float
    left: float | None


@dataclass
class _Begun:
    """When a cell began here, and what was first and last heard of it."""

    cell: Cell
    began: float
    heard: float
    told: int = 0
    since: float = 0.0
    first: float = 0.0
    share: float = 0.0


class Course:
    """Follows the cells of an experiment. It has no clock: the time is told, in seconds.

    Args:
        cells: All of them.
        workers: How many are played at a time.
    """

    def __init__(self, cells: Iterable[Cell], workers: int) -> None:
        self._work = {cell.file_name: work(cell) for cell in cells}
        self._left = dict.fromkeys(self._work)  # in order
        self._workers = workers
        self._done = self._failed = 0
        self._begun: dict[str, _Begun] = {}
        self._spent: dict[str, list[float]] = {}  # of each learner: seconds, and work done in them

    def began(self, cell: Cell, now: float) -> None:
        """A cell is played from now on."""
        self._begun[cell.file_name] = _Begun(cell, now, now, since=now)

    def heard(self, cell: Cell, told: int, share: float, now: float) -> None:
        """A cell has said how far it is; ``told`` is another number each time that it does."""
        begun = self._begun[cell.file_name]
        if told == begun.told:
            return
        if not begun.told:  # what it had done before it began here has cost nothing here
            begun.since, begun.first = now, share
        begun.told, begun.heard, begun.share = told, now, share

    def ended(self, cell: Cell, now: float, failed: bool = False) -> None:
        """A cell is done, or has failed; it may have been done before."""
        begun = self._begun.pop(cell.file_name, None)
        if begun and not failed:
            spent = self._spent.setdefault(cell.spec.name, [0.0, 0.0])
            spent[0] += now - begun.since
            spent[1] += (1 - begun.first) * self._work[cell.file_name]
        del self._left[cell.file_name]
        self._failed += failed
        self._done += not failed

    def playing(self, now: float) -> tuple[Playing, ...]:
        """The cells that are being played."""
        return tuple(
            Playing(one.cell, one.share, now - one.began, now - one.heard)
            for one in self._begun.values()
        )

    def standing(self, now: float, pending: Iterable[Cell] = ()) -> Standing:
        """How far all of it is.

        Args:
            now: The time.
            pending: The cells that have not begun.
        """
        spent = {name: list(both) for name, both in self._spent.items()}
        for name, one in self._begun.items():
            mine = spent.setdefault(one.cell.spec.name, [0.0, 0.0])
            mine[0] += now - one.since
            mine[1] += (one.share - one.first) * self._work[name]
        rates = {name: both[0] / both[1] for name, both in spent.items() if both[1] > 0}
        mean = sum(b[0] for b in spent.values()) / max(sum(b[1] for b in spent.values()), 1e-9)

        def cost(cell: Cell, share: float) -> float:
            return (1 - share) * self._work[cell.file_name] * rates.get(cell.spec.name, mean)

        costs = [cost(one.cell, one.share) for one in self._begun.values()]
        costs += [cost(cell, 0.0) for cell in pending]
        left = None
        if rates or not costs:
            left = max(sum(costs) / self._workers, max(costs, default=0.0))
        whole = sum(self._work.values())
        open_: float = sum(self._work[name] for name in self._left)
        open_ -= sum(one.share * self._work[name] for name, one in self._begun.items())
        return Standing(
            len(self._work),
            self._done,
            self._failed,
            self.playing(now),
            1 - open_ / whole if whole else 1.0,
            left,
        )


def work(cell: Cell) -> int:
    """How much there is to do in a cell: the attempts that it may have at most."""
    protocol = cell.spec.protocol
    return cell.subjects * _trials(cell.condition, protocol) * protocol.attempt_limit


@cache
def _trials(condition: Condition, protocol: Protocol) -> int:
    return len(plan(condition, protocol, np.random.default_rng(0)))
