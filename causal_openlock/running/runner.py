"""Running an experiment: workers play its cells, and each record is saved when its cell is done.

The workers (:mod:`causal_openlock.running.workers`) are by default processes of this machine,
one for each core, those of a cluster (:mod:`causal_openlock.running.cluster`), or any
:class:`concurrent.futures.Executor`. A cell's record depends on the cell alone, not on the number
of workers, the order in which they finish, or how often the run was killed and started again.

If a cell fails, the others are played all the same. A learner that fails does so again, so its cell
has failed until the same command is given again. A worker may be lost for reasons of its own, so
its cell is played again, from its checkpoint. After :data:`MOST_FAILURES` failures without progress
a cell is left out.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Collection, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, wait
from contextlib import AbstractContextManager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from numbers import Real
from pathlib import Path
from uuid import uuid4

from causal_openlock.contract.learner import Learner
from causal_openlock.contract.registry import is_ours, learner_class
from causal_openlock.errors import CellsFailed, LearnerError, OpenLockError
from causal_openlock.experiment.experiment import Cell, Experiment
from causal_openlock.files.atomic import write_text
from causal_openlock.files.digest import digest
from causal_openlock.files.validation import whole_number
from causal_openlock.running.carried_code import carry
from causal_openlock.running.cluster import joined
from causal_openlock.running.progress import ProgressEstimator, RunProgress, work
from causal_openlock.running.worker import Watching, play_cell, record_failure
from causal_openlock.running.workers import Workers, available_cores, open_workers
from causal_openlock.storage.running_files import (
    AWAITED,
    checkpointed,
    remove_files_of,
    reported_progress,
)
from causal_openlock.storage.shard import Shard
from causal_openlock.storage.store import Store
from causal_openlock.usercode.session_code import is_of_session, packed, session_source
from causal_openlock.world.reward_code import OwnReward

LOOK_EVERY = 1.0
"""Seconds between two looks at the progress of the cells."""
MOST_FAILURES = 3
"""Failures after which a cell is left out."""


def run(
    experiment: Experiment,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    cluster: str | None = None,
    shard: Shard | None = None,
    retry_failed: bool = False,
    allow_version: bool = False,
    done: Callable[[Cell, bool], None] | None = None,
    failed: Callable[[Cell, str], None] | None = None,
    warn: Callable[[str], None] | None = None,
    progress: Callable[[RunProgress], None] | None = None,
    watching: Watching | None = None,
    time_limit: float | None = None,
    elsewhere: Collection[str] = (),
) -> Store:
    """Run the cells of an experiment that are not done yet.

    Args:
        experiment: The experiment.
        folder: The results folder; if it holds some of the results, the others are added.
        executor: Plays the cells; by default processes of this machine.
        workers: The number of these processes; by default one for each core. With 0 this process
            plays, one cell after another: small comparisons need not wait for another to start.
        cluster: The address of a Dask scheduler, ``"tcp://host:8786"``, whose workers play the
            cells, or ``"local:8"``, which starts such a cluster of eight workers here.
        shard: A share of the cells, which alone is played; other shards may be played in the same
            folder at the same time.
        retry_failed: Whether cells that have failed three times are tried again.
        allow_version: Whether a folder that was made with other versions of packages is completed
            with those here.
        done: Called with each finished cell, and whether it was finished before.
        failed: Called with each cell that failed, and a sentence with the reason.
        warn: Called with a sentence for each damaged file, whose cell is run again, and for each
            problem in a cell that did not stop it.
        progress: Called with the progress every second, before the first cell and after the last.
        watching: How often checkpoints are taken inside a cell, and what is logged.
        time_limit: Seconds after which a cell is ended, counted from its start or continuation; by
            default there is no limit. The cell then counts as failed, and keeps its checkpoint.
            It is ignored with a ``cluster`` or an ``executor``, and without workers: cells cannot
            be ended there.
        elsewhere: File names of cells that are not played, as their results are kept elsewhere.

    Raises:
        CellsFailed: If cells failed, after all others were played; the folder's ``errors`` has the
            reasons.
        LearnerError: If no learner can play any of the conditions.
        OpenLockError: If TensorBoard's logs are wanted and it is not installed, or no process can
            be started.
        StoreError: If the folder holds something else, was made with other versions of packages, or
            cannot be written to.

    Example:
        >>> from concurrent.futures import ThreadPoolExecutor
        >>> from tempfile import TemporaryDirectory
        >>> from causal_openlock import find_experiment, read_experiment
        >>> from causal_openlock.experiment.building import Changes
        >>> changes = Changes(learners=["oracle"], conditions=["CC3"], subjects=2)
        >>> experiment = read_experiment(find_experiment("default"), changes)
        >>> with TemporaryDirectory() as folder, ThreadPoolExecutor(1) as executor:
        ...     record, _ = run(experiment, folder, executor=executor).record()
        >>> record.num_rows
        20
    """
    watching, warn = watching or Watching(), warn or _ignore
    if workers is not None:
        workers = whole_number(workers, "workers")  # 0: this process
    waits: dict[str, object] = {"checkpoint_every": watching.checkpoint_every}
    if time_limit is not None:
        waits["time_limit"] = time_limit
    for name, value in waits.items():
        if isinstance(value, bool) or not (isinstance(value, Real) and float(value) >= 0):
            raise OpenLockError(f"{name} is a number of seconds, not {value!r}")
    if time_limit is not None:  # a cell that is ended has to have made progress
        often = min(watching.checkpoint_every, time_limit / 5)
        watching = replace(watching, checkpoint_every=often)
    if watching.tensorboard is not None:
        from causal_openlock.running.tensorboard import require_tensorboard

        require_tensorboard()
        # A worker may be in another directory.
        watching = replace(watching, tensorboard=str(Path(watching.tensorboard).resolve()))
    if time_limit is not None and (executor is not None or cluster or workers == 0):
        warn("the time limit is ignored: only worker processes of this machine can be ended")
    names = [name for spec in experiment.learners for name in (spec.learner, spec.reward.name)]
    definitions = b"" if workers == 0 else packed(names)
    sources = dict(_sources(experiment))
    if not experiment.cells():
        why = "; ".join(experiment.reasons)
        raise LearnerError(f"there is nothing to play ({why}); add a learner or a condition")
    cells = shard.of(experiment.cells()) if shard else experiment.cells()
    store = Store(folder)
    store.open(experiment, shard=shard)
    awaited = store.folder.resolve() / f"{AWAITED}{uuid4().hex}"
    try:
        for package, source in sources.items():
            write_text(store.source(package), source)
        missing, left_out = {}, {}
        for cell in cells:
            if cell.file_name in elsewhere:
                continue
            fault = store.check(cell)
            if fault is None:
                remove_files_of(store.path(cell))
                store.failures.clear(cell)
                continue
            if retry_failed:
                store.failures.clear(cell)
            missing[cell.file_name] = cell
            failures, why = store.failures.of(cell.file_name)
            if failures >= MOST_FAILURES:
                left_out[cell.file_name] = (
                    f"{why}; it has failed {failures} times and is left out, --retry-failed tries "
                    f"it again; see {store.failures.path(cell.file_name)}"
                )
            elif fault != "missing":
                warn(f"{fault}; its cell is run again")
        cores = available_cores() if workers is None else workers
        many = min(cores, len(missing) - len(left_out))
        course = ProgressEstimator(cells, max(1, many))
        for cell in cells:
            if cell.file_name in left_out:
                course.ended(cell, 0.0, failed=True)
                (failed or _ignore)(cell, left_out[cell.file_name])
            elif cell.file_name not in missing:
                course.ended(cell, 0.0)
                (done or _ignore)(cell, True)
        # What is stopped has some subjects of all, rather than all of some; and long cells come
        # first, so that no worker is left alone with one at the end.
        there = (cell for name, cell in missing.items() if name not in left_out)
        pending = sorted(there, key=lambda cell: (cell.first_subject, -work(cell)))
        if pending and not allow_version:
            store.require_versions()
        playing = _Run(
            pending=deque(pending),
            store=store,
            course=course,
            watching=watching,
            definitions=definitions,
            time_limit=float("inf") if time_limit is None else time_limit,
            done=done or _ignore,
            failed=failed or _ignore,
            warn=warn,
            progress=progress or _ignore,
            reasons=left_out,
        )
        if not pending:
            playing.progress(course.standing(time.monotonic(), ()))
        else:
            those: AbstractContextManager[Workers]
            if cluster:
                those = joined(cluster, carry(experiment, store.folder))
            else:
                those = open_workers(executor, many)
            with those as found:
                if executor is not None or cluster:  # their workers cannot be ended from here
                    with suppress(OSError):  # they then end when their cell does
                        awaited.touch()
                        playing.watching = replace(watching, awaited=str(awaited))
                try:
                    playing.play(found)
                finally:
                    awaited.unlink(missing_ok=True)
    finally:
        store.close()
    if playing.reasons:
        reasons = [playing.reasons[name] for name in missing if name in playing.reasons]
        raise CellsFailed(reasons, len(cells))
    return store


def _sources(experiment: Experiment) -> Iterator[tuple[str, str]]:
    """The source of each learner and reward of the running session, by its origin.

    Raises:
        LearnerError: If one has changed since the experiment was declared.
    """
    for spec in experiment.learners:
        named = {spec.learner: spec.origin.package}
        if isinstance(spec.reward, OwnReward):
            named[spec.reward.name] = spec.reward.source
        for name in filter(is_of_session, named):
            source = session_source(name)
            if not named[name].endswith(f".py {digest(source)}"):
                what = spec.name if name == spec.learner else f"the reward {name}"
                raise LearnerError(
                    f"{what} has changed since the experiment was declared; declare it again"
                )
            yield named[name], source


@cache
def _kinds(learner: str) -> frozenset[type]:
    """The toolkit's classes that a learner is one of; none if it is not the toolkit's."""
    classes = learner_class(learner).__mro__ if is_ours(learner) else ()
    return frozenset(
        one for one in classes if issubclass(one, Learner) and one.__module__ != Learner.__module__
    )


def _ignore(*_: object) -> None:
    """Default callback; does nothing."""


@dataclass
class _Run:
    """The pending and running cells, and the callbacks of :func:`run`."""

    pending: deque[Cell]
    store: Store
    course: ProgressEstimator
    watching: Watching
    definitions: bytes
    time_limit: float
    done: Callable[[Cell, bool], None]
    failed: Callable[[Cell, str], None]
    warn: Callable[[str], None]
    progress: Callable[[RunProgress], None]
    running: dict[Future[list[str]], Cell] = field(default_factory=dict)
    overdue: set[Future[list[str]]] = field(default_factory=set)
    reasons: dict[str, str] = field(default_factory=dict)
    warned: set[str] = field(default_factory=set)
    lost: dict[str, tuple[int, int]] = field(default_factory=dict)
    known: set[type] = field(default_factory=set)

    def play(self, workers: Workers) -> None:
        """Play all cells; ``reasons`` then has why some failed, by the file's name."""
        folder = str(self.store.folder.resolve())
        looked = self._look(workers)
        try:
            while self.pending or self.running:
                while self.pending and workers.free():
                    cell = self._next()
                    # Other people's code may change its process, so it gets a new one.
                    alone = not is_ours(cell.spec.learner)
                    job = (cell, folder, self.watching, self.definitions)
                    future = workers.submit(play_cell, *job, alone=alone)
                    self.running[future] = cell
                    if workers.begun(future):
                        self.course.began(cell, time.monotonic())
                if not self.running:  # there is no worker yet, or no longer
                    self._warn("there is no worker at the moment; the cells wait for one")
                    time.sleep(LOOK_EVERY)
                for future in wait(self.running, LOOK_EVERY, FIRST_COMPLETED).done:
                    self._ended(future, workers)
                if time.monotonic() >= looked + LOOK_EVERY:
                    looked = self._look(workers)
        finally:
            for future in self.running:
                future.cancel()
        self._look(workers)

    def _next(self) -> Cell:
        """Take the next cell; others first while the first cell of its kind of learner is played.

        Loops of a learner are compiled in its first cell, and read from numba's files from then on.
        """
        begun = {kind for cell in self.running.values() for kind in _kinds(cell.spec.learner)}
        begun -= self.known
        place = 0
        if begun:
            each = enumerate(_kinds(cell.spec.learner) for cell in self.pending)
            place = next((number for number, kinds in each if not kinds & begun), 0)
        cell = self.pending[place]
        del self.pending[place]
        return cell

    def _ended(self, future: Future[list[str]], workers: Workers) -> None:
        cell, how = self.running.pop(future), workers.done(future)
        error = future.exception()
        kept = bool(how) and self.store.check(cell) is None
        if error is None or kept:  # a process may end after its record was written
            self.store.failures.clear(cell)
            for warning in () if kept else future.result():
                self._warn(warning)
            self.course.ended(cell, time.monotonic())
            self.known |= _kinds(cell.spec.learner)
            self.done(cell, False)
            return
        if future in self.overdue:
            what = f"was ended after {self.time_limit:g} s"
            trace = "It has no traceback.\n"  # and it may have made progress
            why = self.store.failures.record(cell, what, trace, counts=False)
        elif how:
            what = f"ended its process ({how})"
            if self._has_lost(cell) < MOST_FAILURES:
                self.warn(f"the learner {cell.in_words}, {what}; it is tried again")
                self.course.put_back(cell)
                self.pending.append(cell)
                return
            trace = "A process that ends so leaves no traceback.\n"
            why = self.store.failures.record(cell, what, trace, MOST_FAILURES)
        elif isinstance(error, LearnerError):
            why = str(error)
        elif isinstance(error, OpenLockError):  # such as a full disk, which stops all of them
            raise error
        else:
            why = record_failure(self.store, cell, error)
        why = f"{why}; see {self.store.failures.path(cell.file_name)}"
        self.reasons[cell.file_name] = why
        self.course.ended(cell, time.monotonic(), failed=True)
        self.failed(cell, why)

    def _has_lost(self, cell: Cell) -> int:
        """Take note that a cell has lost its worker; returns how often it did without progress.

        With a checkpoint between two losses there was progress, and the count starts again.
        """
        taken = checkpointed(self.store.path(cell))
        losses, before = self.lost.get(cell.file_name, (0, taken))
        losses = losses + 1 if taken == before else 1
        self.lost[cell.file_name] = losses, taken
        return losses

    def _warn(self, sentence: str) -> None:
        """Warn of something once."""
        if sentence not in self.warned:
            self.warn(sentence)
        self.warned.add(sentence)

    def _look(self, workers: Workers) -> float:
        """Report the progress of the cells, and end those that take too long; returns the time."""
        now = time.monotonic()
        seconds = {one.cell.file_name: one.seconds for one in self.course.playing(now)}
        for future, cell in self.running.items():
            heard = reported_progress(self.store.path(cell))
            if cell.file_name not in seconds and (heard or workers.begun(future)):
                self.course.began(cell, now)
            if heard:
                self.course.heard(cell, *heard[:2], now)
            late = seconds.get(cell.file_name, 0.0) >= self.time_limit
            if late and future not in self.overdue and workers.end(future):
                self.overdue.add(future)
        self.course.workers = workers.number() or self.course.workers
        self.progress(self.course.standing(now, self.pending))
        return now
