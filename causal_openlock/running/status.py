"""Status of a comparison, as far as its results folder says.

Workers report the share of their cells that is done in files next to the cells, wherever they run,
and a finished record has the seconds that it took. So the status is the same whether processes, a
cluster or the shards of a job array play.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from causal_openlock.experiment.experiment import Cell
from causal_openlock.running.progress import ProgressEstimator, RunProgress
from causal_openlock.storage.running_files import MOST_SECONDS, reported_progress
from causal_openlock.storage.store import Store

QUIET = 120.0
"""Seconds without a report after which a cell counts as stopped: steps rarely take as long."""
MOST_READ = 3
"""Finished cells of each learner whose time is read: the last ones."""


@dataclass(frozen=True)
class Status:
    """Status of a comparison.

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
    experiment, now = store.experiment(), time.time()
    cells = experiment.cells()
    estimator = ProgressEstimator(cells, 1)
    pending, quiet, failures = [], {}, []
    read: dict[str, int] = {}
    for cell, path, written in _latest_first(store, cells, experiment.files):
        name = cell.spec.name
        if written:
            if read.setdefault(name, 0) < MOST_READ:
                read[name] += 1
                wall_time = store.read(path, columns=["wall_time"])["wall_time"].to_numpy()
                took = float(wall_time.max(initial=0.0))
                if took <= MOST_SECONDS:  # no NaN
                    estimator.began(cell, now - took)
            estimator.ended(cell, now)
            continue
        report = reported_progress(store.path(cell))
        if report is not None and now - report[0] / 1e9 < QUIET:
            _, share, seconds = report
            estimator.began(cell, now - seconds)
            estimator.heard(cell, 1, 0.0, now - seconds)
            estimator.heard(cell, 2, share, report[0] / 1e9)
        elif why := store.failures.of(cell.file_name)[1]:
            failures.append(why)
            estimator.ended(cell, now, failed=True)
        else:
            pending.append(cell)
            if report is not None:
                quiet[cell.in_words] = now - report[0] / 1e9
    estimator.workers = max(1, len(estimator.playing(now)))
    return Status(experiment.name, estimator.standing(now, pending), quiet, tuple(failures))


def _latest_first(
    store: Store, cells: tuple[Cell, ...], files: tuple[str, ...]
) -> list[tuple[Cell, Path, float]]:
    """Each cell with its file and when that was written; 0 if it was not."""
    found = []
    for cell, file in zip(cells, files, strict=False):
        path = store.cells / file
        found.append((cell, path, path.stat().st_mtime if path.exists() else 0.0))
    return sorted(found, key=lambda one: -one[2])
