"""The progress of a comparison, and the time left.

A cell of ``random`` takes a second and one of ``ddqn`` an hour, so work is counted in attempts: the
most that a cell can have. The time of an attempt is estimated for each learner from the cells that
it has played; for a learner that has not begun, it is the mean of the others. No result depends on
it.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache

import numpy as np

from causal_openlock.experiment.experiment import Cell
from causal_openlock.experiment.protocol import Condition, Protocol, plan
from causal_openlock.schemas.fsm import FloatArray


@dataclass(frozen=True)
class Playing:
    """A cell that is being played.

    Attributes:
        cell: The cell.
        share: The share of it that is done.
        seconds: How long it has been played in this run.
        still: Seconds since its last report.
    """

    cell: Cell
    share: float
    seconds: float
    still: float


@dataclass(frozen=True)
class RunProgress:
    """The progress of a comparison.

    Attributes:
        cells: Number of cells.
        done: Number of finished cells.
        failed: Number of failed cells.
        playing: The cells that are being played.
        share: The share of the work that is done.
        left: Seconds left, if they can be estimated.
    """

    cells: int
    done: int
    failed: int
    playing: tuple[Playing, ...]
    share: float
    left: float | None

    @property
    def over(self) -> bool:
        """Whether no cell is left to play."""
        return self.done + self.failed == self.cells


@dataclass
class _Begun:
    """When a cell began in this run, and its first and last report."""

    cell: Cell
    began: float
    heard: float
    since: float
    report: int = 0
    first: float = 0.0
    share: float = 0.0

    def spent(self, now: float, share: float) -> FloatArray:
        """Seconds, and the attempts played in them, when this share of the cell is done."""
        return np.array([now - self.since, (share - self.first) * work(self.cell)])


class ProgressEstimator:
    """Estimates progress from reports of cells. Every call passes the time in seconds.

    Args:
        cells: All cells.
        workers: How many are played at a time; this may change.
    """

    def __init__(self, cells: Iterable[Cell], workers: int) -> None:
        self._left = {cell.file_name: work(cell) for cell in cells}
        self._cells, self._work = len(self._left), sum(self._left.values())
        self.workers = workers
        self._failed = 0
        self._begun: dict[str, _Begun] = {}
        self._spent: dict[str, FloatArray] = {}  # of each learner: seconds, attempts

    def began(self, cell: Cell, now: float) -> None:
        """Register that a cell has begun."""
        self._begun[cell.file_name] = _Begun(cell, now, now, since=now)

    def heard(self, cell: Cell, report: int, share: float, now: float) -> None:
        """Register a cell's report of the share that is done; each report has another number."""
        begun = self._begun[cell.file_name]
        if report == begun.report:
            return
        if not begun.report:  # what was done before this run took no time in it
            begun.since, begun.first = now, share
        begun.report, begun.heard, begun.share = report, now, share

    def put_back(self, cell: Cell) -> None:
        """Register that a cell has lost its worker and waits for another one."""
        self._begun.pop(cell.file_name, None)

    def ended(self, cell: Cell, now: float, failed: bool = False) -> None:
        """Register that a cell is done, perhaps in an earlier run, or has failed."""
        begun = self._begun.pop(cell.file_name, None)
        if begun and not failed:
            self._spent[cell.spec.name] = begun.spent(now, 1.0) + self._spent.get(cell.spec.name, 0)
        del self._left[cell.file_name]
        self._failed += failed

    def playing(self, now: float) -> tuple[Playing, ...]:
        """The cells that are being played."""
        return tuple(
            Playing(one.cell, one.share, now - one.began, now - one.heard)
            for one in self._begun.values()
        )

    def standing(self, now: float, pending: Iterable[Cell] = ()) -> RunProgress:
        """The progress of all cells.

        Args:
            now: The time.
            pending: The cells that have not begun.
        """
        spent = dict(self._spent)
        for one in self._begun.values():
            name = one.cell.spec.name
            spent[name] = spent.get(name, 0) + one.spent(now, one.share)
        rates = {name: seconds / played for name, (seconds, played) in spent.items() if played > 0}
        seconds, played = sum(spent.values(), np.zeros(2))
        open_ = [(one.cell, 1 - one.share) for one in self._begun.values()]
        open_ += [(cell, 1.0) for cell in pending]
        costs = [
            share * work(cell) * rates.get(cell.spec.name, seconds / max(played, 1e-9))
            for cell, share in open_
        ]
        left = None
        if rates or not costs:
            left = max(sum(costs) / self.workers, max(costs, default=0.0))
        begun = sum(one.share * work(one.cell) for one in self._begun.values())
        to_do = sum(self._left.values()) - begun
        return RunProgress(
            cells=self._cells,
            done=self._cells - len(self._left) - self._failed,
            failed=self._failed,
            playing=self.playing(now),
            share=1 - to_do / self._work if self._work else 1.0,
            left=left,
        )


def work(cell: Cell) -> int:
    """The work in a cell: the most attempts that it can have."""
    protocol = cell.spec.protocol
    return cell.subjects * _trials(cell.condition, protocol) * protocol.attempt_limit


@cache
def _trials(condition: Condition, protocol: Protocol) -> int:
    return len(plan(condition, protocol, np.random.default_rng(0)))
