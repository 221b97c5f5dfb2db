"""The progress of a comparison, and the time left.

Workers report the share of their cells that is done in files next to the cells, wherever they run.
So the progress is the same whether processes, a cluster or the shards of a job array play, and
whether the run itself or ``status`` asks.

Work is counted in attempts: the most that a cell can have. The time left is estimated from the
seconds that each learner takes for one. No result depends on it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from statistics import mean
from typing import NamedTuple

from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.plan import phases_of
from causal_openlock.storage.beside_cell import failures_of, reported_progress
from causal_openlock.storage.store import Store, StoredExperiment

QUIET = 120.0  # seconds without a report after which a cell counts as stopped


class Playing(NamedTuple):
    """A cell that is being played: the share that is done, for how long, and its last report."""

    cell: Cell
    share: float
    seconds: float
    still: float  # seconds since the last report


@dataclass(frozen=True)
class RunProgress:
    """The progress of a comparison: how many of its cells are done, have failed, or are played."""

    cells: int
    done: int
    failed: int
    playing: tuple[Playing, ...]
    share: float  # of the work that is done
    left: float | None  # seconds with as many cells at a time as now, if they can be estimated

    @property
    def over(self) -> bool:
        """Whether no cell is left to play."""
        return self.done + self.failed == self.cells


def progress_of(
    cells: Sequence[Cell],
    left: Collection[Cell],
    failed: int,
    playing: Sequence[Playing],
    paces: Mapping[str, float],
) -> RunProgress:
    """The progress of cells of which some are left, some of these are played, and some failed.

    ``paces`` are seconds of an attempt, by learner; the others' are taken to be the mean.
    """
    to_do: dict[str, float] = {cell.file_name: work(cell) for cell in left}
    for cell, share, *_ in playing:
        to_do[cell.file_name] *= 1 - share
    remaining, usual = sum(to_do.values()), mean(paces.values() or [0.0])
    known = any(paces.values()) or not left
    times = [to_do[cell.file_name] * paces.get(cell.spec.name, usual) for cell in left]
    return RunProgress(
        cells=len(cells),
        done=len(cells) - len(left) - failed,
        failed=failed,
        playing=tuple(playing),
        share=1 - remaining / sum(map(work, cells)) if remaining else 1.0,
        left=max([sum(times) / max(len(playing), 1), *times]) if known else None,
    )


def playing_in(store: Store, cells: Iterable[Cell]) -> list[Playing]:
    """Those of some cells that have reported their progress."""
    reports = ((cell, reported_progress(store.path(cell))) for cell in cells)
    return [Playing(cell, *report) for cell, report in reports if report]


def paces_of(playing: Iterable[Playing]) -> dict[str, float]:
    """Seconds of an attempt, by learner, in cells that are being played."""
    return {
        cell.spec.name: seconds / (share * work(cell))
        for cell, share, seconds, _ in playing
        if share
    }


def work(cell: Cell) -> int:
    """The work in a cell: the most attempts that it can have."""
    protocol = cell.spec.protocol
    return cell.subjects * len(phases_of(cell.condition, protocol)) * protocol.attempt_limit


def status_of(
    store: Store, experiment: StoredExperiment
) -> tuple[RunProgress, dict[str, float], list[str]]:
    """Status of a comparison, as far as its results folder says.

    Returns:
        The progress; the cells that were begun and report nothing, with the seconds since their
        last report; and why cells failed, a sentence each.
    """
    cells, failures, quiet = experiment.cells(), list[str](), dict[str, float]()
    # Those of a person who was forgotten are not listed.
    files = zip_longest(cells, experiment.files[: len(cells)])
    left = [cell for cell, file in files if not (file and (store.cells / file).exists())]
    begun = {report.cell.file_name: report for report in playing_in(store, left)}
    playing = [report for report in begun.values() if report.still < QUIET]
    for cell in [*left]:
        report = begun.get(cell.file_name)
        if report in playing:
            continue
        if why := failures_of(store.path(cell))[1]:
            failures.append(why)
            left.remove(cell)
        elif report:
            quiet[cell.in_words] = report.still
    progress = progress_of(cells, left, len(failures), playing, paces_of(playing))
    return progress, quiet, failures
