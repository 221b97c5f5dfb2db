"""Running an experiment: its cells are played, each kept as soon as it is done.

A crew plays them (:mod:`causal_openlock.experiment.workers`): by default processes of this machine,
one for each core, or any :class:`concurrent.futures.Executor` that is given. A cell's record
depends on the cell alone, so it does not matter how many workers there are, in which order they
finish, or how often the run was killed and started again. A cell that fails, however it does, is no
reason not to play the others.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import replace
from pathlib import Path

from causal_openlock.contract.registry import is_ours
from causal_openlock.errors import CellsFailed, LearnerError, OpenLockError
from causal_openlock.experiment.experiment import Cell, Experiment
from causal_openlock.experiment.standing import Course, Standing
from causal_openlock.experiment.store import Store
from causal_openlock.experiment.worker import Played, Watching, blame, play_cell
from causal_openlock.experiment.workers import Crew, available_cores, crew

LOOK_EVERY = 1.0
"""Seconds after which the runner looks again how far the cells are."""


def run(
    experiment: Experiment,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    done: Callable[[Cell, bool], None] | None = None,
    failed: Callable[[Cell, str], None] | None = None,
    warn: Callable[[str], None] | None = None,
    progress: Callable[[Standing], None] | None = None,
    watching: Watching | None = None,
    time_limit: float | None = None,
) -> Store:
    """Run what is not yet done of an experiment.

    Args:
        experiment: What to run.
        folder: Where the results go; one that holds a part of them is completed.
        executor: Where cells are played; by default processes of this machine.
        workers: How many of these; by default one for each core.
        done: Called with each cell that is done, and whether it was done before.
        failed: Called with each cell that failed, and a sentence that says why.
        warn: Called with a sentence for each damaged file, whose cell is run again, and for what
            went wrong in a cell without stopping it.
        progress: Called every second, and before the first cell and after the last, with how far
            everything is.
        watching: How often checkpoints are taken inside a cell, and what is logged.
        time_limit: Seconds after which a cell is ended, counted from when it is begun or gone on
            with; by default there is no limit. It then counts as failed, and keeps its checkpoint.
            What an executor that is given has begun, nobody can end: there it is not heeded.

    Raises:
        CellsFailed: If cells failed, after all others were played. Why is in ``errors``.
        OpenLockError: If TensorBoard's logs are asked for and it is not installed, or no process
            can be started.
        StoreError: If the folder holds something else or cannot be written to.
    """
    watching = watching or Watching()
    if time_limit is not None:  # a cell that is ended is to have got on
        often = min(watching.checkpoint_every, time_limit / 5)
        watching = replace(watching, checkpoint_every=often)
    if watching.tensorboard is not None:
        from causal_openlock.experiment.tensorboard import require_tensorboard

        require_tensorboard()
        # A worker may be in another directory.
        watching = replace(watching, tensorboard=str(Path(watching.tensorboard).resolve()))
    if time_limit is not None and executor is not None and warn:
        warn("the time limit is not heeded: nobody can end what a given executor has begun")
    store = Store(folder)
    store.open(experiment)
    cells = list(experiment.cells())
    reasons: list[str] = []
    try:
        pending = []
        for cell in cells:
            fault = store.check(cell)
            if fault is None:
                store.clear(cell)
                store.forgive(cell)
            else:
                if fault != "missing" and warn:
                    warn(f"{fault}; its cell is run again")
                pending.append(cell)
        many = min(workers or available_cores(), max(1, len(pending)))
        playing = _Run(cells, pending, store, watching, many, time_limit)
        playing.done, playing.failed = done, failed
        playing.warn, playing.progress = warn, progress
        playing.known()
        if pending:
            with crew(executor, many) as those:
                reasons = playing.play(those)
    finally:
        store.close()
    if reasons:
        raise CellsFailed(reasons, len(cells))
    return store


class _Run:
    """The cells that are to be played, are being played, and were."""

    done: Callable[[Cell, bool], None] | None
    failed: Callable[[Cell, str], None] | None
    warn: Callable[[str], None] | None
    progress: Callable[[Standing], None] | None

    def __init__(
        self,
        cells: Iterable[Cell],
        pending: Iterable[Cell],
        store: Store,
        watching: Watching,
        workers: int,
        time_limit: float | None,
    ) -> None:
        self._cells, self._pending = tuple(cells), deque(pending)
        self._store, self._watching, self._time_limit = store, watching, time_limit
        self._course = Course(self._cells, workers)
        self._running: dict[Future[Played], Cell] = {}
        self._overdue: set[Future[Played]] = set()
        self._reasons: dict[str, str] = {}
        self._warned: set[str] = set()
        self._looked = time.monotonic()

    def known(self) -> None:
        """Tell of the cells that were done before."""
        waiting = {cell.file_name for cell in self._pending}
        for cell in self._cells:
            if cell.file_name not in waiting:
                self._course.ended(cell, 0.0)
                if self.done:
                    self.done(cell, True)

    def play(self, crew: Crew) -> list[str]:
        """Play all of them; returns why some failed."""
        self._look(crew)
        try:
            while self._pending or self._running:
                while self._pending and crew.free():
                    cell = self._pending.popleft()
                    folder = str(self._store.folder.resolve())
                    # What code that is not ours changes in its process stays with its own cell.
                    alone = not is_ours(cell.spec.learner)
                    future = crew.submit(play_cell, cell, folder, self._watching, alone=alone)
                    self._running[future] = cell
                    if crew.begun(future):
                        self._course.began(cell, time.monotonic())
                for future in wait(self._running, LOOK_EVERY, FIRST_COMPLETED).done:
                    self._ended(future, crew)
                if time.monotonic() >= self._looked + LOOK_EVERY:
                    self._look(crew)
        finally:
            for future in self._running:
                future.cancel()
        self._look(crew)
        names = [cell.file_name for cell in self._cells]
        return [self._reasons[name] for name in names if name in self._reasons]

    def _ended(self, future: Future[Played], crew: Crew) -> None:
        cell, how = self._running.pop(future), crew.done(future)
        error = future.exception()
        kept = isinstance(error, BrokenExecutor) and self._store.check(cell) is None
        if error is None or kept:  # a process may end after its record was written
            self._store.forgive(cell)
            for warning in () if kept else future.result().warnings:
                if self.warn and warning not in self._warned:
                    self.warn(warning)
                self._warned.add(warning)
            self._course.ended(cell, time.monotonic())
            if self.done:
                self.done(cell, False)
            return
        if future in self._overdue:
            what = f"was ended after {self._time_limit:g} s"
            why = self._store.blame(cell, what, "It has no traceback.\n")
        elif how:
            what = f"ended its process ({how})"
            why = self._store.blame(cell, what, "A process that ends so leaves no traceback.\n")
        elif isinstance(error, LearnerError):
            why = str(error)
        elif isinstance(error, OpenLockError):  # a disk that is full is full for all of them
            raise error
        else:
            why = blame(self._store, cell, error)
        why = f"{why}; see {self._store.error(cell)}"
        self._reasons[cell.file_name] = why
        self._course.ended(cell, time.monotonic(), failed=True)
        if self.failed:
            self.failed(cell, why)

    def _look(self, crew: Crew) -> None:
        """See how far the cells are, end those that take too long, and tell."""
        self._looked = now = time.monotonic()
        seconds = {one.cell.file_name: one.seconds for one in self._course.playing(now)}
        for future, cell in self._running.items():
            heard = self._store.share(cell)
            if cell.file_name not in seconds and (heard or crew.begun(future)):
                self._course.began(cell, now)
            if heard:
                self._course.heard(cell, *heard, now)
            late = seconds.get(cell.file_name, 0.0) >= (self._time_limit or float("inf"))
            if late and future not in self._overdue and crew.end(future):
                self._overdue.add(future)
        if self.progress:
            self.progress(self._course.standing(now, self._pending))
