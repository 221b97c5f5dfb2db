"""The progress of a comparison, and the time left.

Workers report the share of their cells that is done in files next to the cells, wherever they run.
So the progress is the same whether processes, a cluster or the shards of a job array play, and
whether the run itself or ``status`` asks.

A cell of ``random`` takes a second and one of ``ddqn`` an hour, so work is counted in attempts: the
most that a cell can have. The time of an attempt is that of the learner's cell that was seen last;
for a learner that has not begun, it is the mean of the others. No result depends on it.
"""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cache
from statistics import mean
from typing import NamedTuple

import numpy as np

from causal_openlock.experiment.declare import Cell, Condition, Protocol
from causal_openlock.experiment.plan import plan
from causal_openlock.storage.beside_cell import failures_of, reported_progress
from causal_openlock.storage.store import Store
from causal_openlock.storage.stored import StoredExperiment

QUIET = 120.0
"""Seconds without a report after which a cell counts as stopped: steps rarely take as long."""


class Playing(NamedTuple):
    """A cell that is being played: the share that is done, for how long, and its last report."""

    cell: Cell
    share: float
    seconds: float
    still: float
    """Seconds since the last report."""


@dataclass(frozen=True)
class RunProgress:
    """The progress of a comparison: how many of its cells are done, have failed, or are played."""

    cells: int
    done: int
    failed: int
    playing: tuple[Playing, ...]
    share: float
    """The share of the work that is done."""
    left: float | None
    """Seconds left with as many cells at a time as now, if they can be estimated."""

    @property
    def over(self) -> bool:
        """Whether no cell is left to play."""
        return self.done + self.failed == self.cells


class Course:
    """Which of some cells are done.

    Attributes:
        left: The cells that are neither done nor failed, by the names of their files.
    """

    def __init__(self, cells: Iterable[Cell]) -> None:
        self.left = {cell.file_name: cell for cell in cells}
        self._cells, self._work = len(self.left), sum(map(work, self.left.values()))
        self._failed = 0
        self._rates: dict[str, float] = {}  # seconds of an attempt of each learner

    def ended(self, cell: Cell, *, failed: bool = False) -> None:
        """Register that a cell is done, or has failed."""
        del self.left[cell.file_name]
        self._failed += failed

    def standing(self, playing: Iterable[Playing]) -> RunProgress:
        """The progress, given the cells that are being played."""
        playing, shares = tuple(playing), dict.fromkeys(self.left, 0.0)
        for cell, share, seconds, _ in playing:
            shares[cell.file_name] = share
            if share:
                self._rates[cell.spec.name] = seconds / (share * work(cell))
        to_do = {name: (1 - shares[name]) * work(cell) for name, cell in self.left.items()}
        others = mean(self._rates.values()) if self._rates else 0.0
        costs = [to_do[name] * self._rates.get(self.left[name].spec.name, others) for name in to_do]
        left = max(sum(costs) / max(len(playing), 1), max(costs, default=0.0))
        return RunProgress(
            cells=self._cells,
            done=self._cells - len(self.left) - self._failed,
            failed=self._failed,
            playing=playing,
            share=1 - sum(to_do.values()) / self._work if self._work else 1.0,
            left=left if self._rates or not costs else None,
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


def status_of(
    store: Store, experiment: StoredExperiment
) -> tuple[RunProgress, dict[str, float], list[str]]:
    """Status of a comparison, as far as its results folder says.

    Returns:
        The progress, with the seconds left at the speed of the workers that play at the moment;
        the cells that were begun and report nothing, with the seconds since their last report; and
        why cells failed, a sentence each.
    """
    cells = experiment.cells()
    course, failures, quiet = Course(cells), list[str](), dict[str, float]()
    for cell, file in zip(cells, experiment.files, strict=False):
        if (store.cells / file).exists():
            course.ended(cell)
    begun = {report.cell.file_name: report for report in playing_in(store, course.left.values())}
    playing = [report for report in begun.values() if report.still < QUIET]
    for name, cell in [*course.left.items()]:
        if name in begun and begun[name].still < QUIET:
            continue
        if why := failures_of(store.path(cell))[1]:
            failures.append(why)
            course.ended(cell, failed=True)
        elif name in begun:
            quiet[cell.in_words] = begun[name].still
    return course.standing(playing), quiet, failures
