"""The progress of a comparison, and the time left.

Workers report the share of their cells that is done in files next to the cells, wherever they run,
and a finished record has the seconds that it took. So the progress is the same whether processes, a
cluster or the shards of a job array play, and whether the run itself or ``status`` asks.

A cell of ``random`` takes a second and one of ``ddqn`` an hour, so work is counted in attempts: the
most that a cell can have. The time of an attempt is estimated for each learner from the cells that
it has played; for a learner that has not begun, it is the mean of the others. No result depends on
it.
"""

from __future__ import annotations

import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache

import numpy as np

from causal_openlock.experiment.declare import Cell, Condition, Protocol
from causal_openlock.experiment.plan import plan
from causal_openlock.storage.beside_cell import MOST_SECONDS, failures_of, reported_progress
from causal_openlock.storage.store import Store

QUIET = 120.0
"""Seconds without a report after which a cell counts as stopped: steps rarely take as long."""
MOST_READ = 3
"""Finished cells of each learner whose time is read: the last ones."""


@dataclass(frozen=True)
class Playing:
    """A cell that is being played.

    Attributes:
        cell: The cell.
        share: The share of it that is done.
        seconds: How long it has been played.
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
        left: Seconds left with as many cells at a time as now, if they can be estimated.
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


class Course:
    """Which cells are done, and how long they took.

    Args:
        cells: All cells.

    Attributes:
        left: The cells that are neither done nor failed, by the names of their files.
    """

    def __init__(self, cells: Iterable[Cell]) -> None:
        self.left = {cell.file_name: cell for cell in cells}
        self._cells, self._work = len(self.left), sum(map(work, self.left.values()))
        self._failed = 0
        self._seconds: defaultdict[str, float] = defaultdict(float)  # of each learner
        self._attempts: defaultdict[str, float] = defaultdict(float)

    def ended(self, cell: Cell, seconds: float = 0.0, *, failed: bool = False) -> None:
        """Register that a cell has failed, or is done after some seconds, if these are known."""
        del self.left[cell.file_name]
        self._failed += failed
        if seconds:
            self._seconds[cell.spec.name] += seconds
            self._attempts[cell.spec.name] += work(cell)

    def standing(self, playing: Iterable[Playing]) -> RunProgress:
        """The progress, given the cells that are being played."""
        playing, shares = tuple(playing), dict.fromkeys(self.left, 0.0)
        seconds, attempts = self._seconds.copy(), self._attempts.copy()
        for one in playing:
            shares[one.cell.file_name] = one.share
            seconds[one.cell.spec.name] += one.seconds
            attempts[one.cell.spec.name] += one.share * work(one.cell)
        rates = {name: seconds[name] / played for name, played in attempts.items() if played}
        mean = sum(seconds.values()) / (sum(attempts.values()) or 1.0)
        to_do = {name: (1 - shares[name]) * work(cell) for name, cell in self.left.items()}
        costs = [to_do[name] * rates.get(self.left[name].spec.name, mean) for name in to_do]
        left = max(sum(costs) / max(len(playing), 1), max(costs, default=0.0))
        return RunProgress(
            cells=self._cells,
            done=self._cells - len(self.left) - self._failed,
            failed=self._failed,
            playing=playing,
            share=1 - sum(to_do.values()) / self._work if self._work else 1.0,
            left=left if rates or not costs else None,
        )


def playing_in(store: Store, cells: Iterable[Cell]) -> list[Playing]:
    """Those of some cells that have reported their progress."""
    playing = []
    for cell in cells:
        if report := reported_progress(store.path(cell)):
            still = max(0.0, time.time() - report[0] / 1e9)
            playing.append(Playing(cell, report[1], report[2] + still, still))
    return playing


def work(cell: Cell) -> int:
    """The work in a cell: the most attempts that it can have."""
    protocol = cell.spec.protocol
    return cell.subjects * _trials(cell.condition, protocol) * protocol.attempt_limit


@cache
def _trials(condition: Condition, protocol: Protocol) -> int:
    return len(plan(condition, protocol, np.random.default_rng(0)))


@dataclass(frozen=True)
class Status:
    """Status of a comparison, as far as its results folder says.

    Attributes:
        name: Its name.
        progress: What is done, failed and being played, and the seconds left at the speed of the
            workers that play at the moment; of one worker, if none does.
        quiet: Cells that were begun and report nothing, and seconds since their last report.
        failures: Why cells failed, a sentence each.
    """

    name: str
    progress: RunProgress
    quiet: Mapping[str, float]
    failures: tuple[str, ...]


def status_of(store: Store) -> Status:
    """Status of the comparison in a results folder.

    Raises:
        StoreError: If the folder holds no results.
    """
    experiment = store.experiment()
    cells = experiment.cells()
    course, failures, quiet = Course(cells), [], {}
    paths = zip(cells, (store.cells / name for name in experiment.files), strict=False)
    done = [(path.stat().st_mtime, cell, path) for cell, path in paths if path.exists()]
    read: Counter[str] = Counter()
    for _, cell, path in sorted(done, key=lambda row: -row[0]):
        read[cell.spec.name] += 1
        seconds = 0.0
        if read[cell.spec.name] <= MOST_READ:
            seconds = float(store.read(path, columns=["wall_time"])["wall_time"].to_numpy().max())
        course.ended(cell, seconds if 0 < seconds <= MOST_SECONDS else 0.0)  # no NaN
    begun = {one.cell.file_name: one for one in playing_in(store, course.left.values())}
    for name, cell in [*course.left.items()]:
        if name in begun and begun[name].still < QUIET:
            continue
        if why := failures_of(store.path(cell))[1]:
            failures.append(why)
            course.ended(cell, failed=True)
        elif name in begun:
            quiet[cell.in_words] = begun[name].still
    playing = [one for one in begun.values() if one.still < QUIET]
    return Status(experiment.name, course.standing(playing), quiet, tuple(failures))
