"""Running an experiment: workers play its cells, and each record is saved when its cell is done.

A cell's record depends on the cell alone, not on the number of workers, the order in which they
finish, or how often the run was killed and started again. If a cell fails, the others are played
all the same. A learner that fails does so again, so its cell has failed until the same command is
given again. A worker may be lost for reasons of its own, so its cell is played again, from its
checkpoint. After three failures without progress a cell is left out.
"""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack, closing
from dataclasses import dataclass, field, replace
from functools import cache, partial
from importlib.util import find_spec
from math import inf
from numbers import Real
from pathlib import Path
from uuid import uuid4

from causal_openlock.contract.registry import is_ours
from causal_openlock.errors import CellsFailed, LearnerError, OpenLockError
from causal_openlock.experiment.declare import Cell, Experiment
from causal_openlock.files.validation import whole_number
from causal_openlock.running import workers as workplaces
from causal_openlock.running.cluster import in_cluster
from causal_openlock.running.progress import RunProgress, paces_of, playing_in, progress_of, work
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.running.workers import Doing, LostError, ThisProcess, TooLateError, done_jobs
from causal_openlock.storage import beside_cell
from causal_openlock.storage.folder_lock import Shard
from causal_openlock.storage.own_code import store_code
from causal_openlock.storage.store import Store
from causal_openlock.usercode.session_code import packed

MOST_FAILURES = 3  # after which a cell is left out


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
    warn: Callable[[str], None] | None = None,
    progress: Callable[[RunProgress], None] | None = None,
    watching: Watching | None = None,
    time_limit: float | None = None,
) -> Store:
    """Run the cells of an experiment that are not done yet.

    Args:
        experiment: The experiment.
        folder: The results folder; if it holds some of the results, the others are added.
        executor: Plays the cells; by default processes of this machine do.
        workers: Number of these processes; by default one for each core. With 0 this process plays,
            one cell after another.
        cluster: Address of a Dask scheduler whose workers play, such as ``"tcp://host:8786"``.
        shard: A share of the cells, which alone is played, while others may play in this folder.
        retry_failed: Whether cells that have failed three times are tried again.
        allow_version: Whether a folder that was made with other versions of packages is completed.
        warn: Called with a sentence for each cell that failed or is damaged, and other problems.
        progress: Called with the progress every second, before the first cell and after the last.
        watching: How often checkpoints are taken inside a cell, and what is logged.
        time_limit: Seconds after which a cell is ended, counted from its start or continuation, by
            a process of this machine. It counts as failed, and keeps its checkpoint.

    Raises:
        CellsFailed: If cells failed, after all others were played; ``errors`` has the reasons.
        LearnerError: If no learner can play any of the conditions.
        OpenLockError: If no process can be started, or the folder holds something else, was made
            with other versions of packages, or cannot be written to.

    Example:
        >>> from tempfile import TemporaryDirectory
        >>> from causal_openlock import make_experiment
        >>> with TemporaryDirectory() as folder:
        ...     store = run(make_experiment("CC3", "oracle", subjects=2), folder, workers=0)
        ...     record, _ = store.record()
        >>> record.num_rows
        20
    """
    warn = cache(warn or (lambda sentence: None))  # it is called with each sentence once
    limit = inf if time_limit is None else time_limit
    watching = _checked(watching or Watching(), limit)
    here = executor is None and cluster is None
    if workers is not None:
        workers = whole_number(workers, "workers")  # 0: this process
    if here and workers != 0 and not workplaces.may_start_processes():
        warn(workplaces.WORKER_ITSELF)
        workers = 0
    if time_limit is not None and (workers == 0 or not here):
        warn("the time limit is ignored: only worker processes of this machine can be ended")
    names = [name for spec in experiment.learners for name in (spec.learner, spec.reward.name)]
    definitions = b"" if workers == 0 else packed(names)
    if not experiment.cells():
        why = "; ".join(experiment.reasons)
        raise LearnerError(f"there is nothing to play ({why}); add a learner or a condition")
    cells = shard.of(experiment.cells()) if shard else experiment.cells()
    store = Store(folder)
    store.open(experiment, shard=shard)
    with ExitStack() as stack:
        stack.callback(store.close)
        place = store.folder.resolve()  # a worker may be in another directory
        code = store_code(experiment, place)
        playing = _Run(store, cells, warn, progress or (lambda standing: None))
        playing.jobs = jobs = playing.missing(retry_failed)
        if jobs and not allow_version:
            store.require_versions()
        if jobs and not here:  # cells there end when this file is gone
            awaited = place / f"{beside_cell.AWAITED}{uuid4().hex}"
            awaited.touch()
            stack.callback(awaited.unlink, missing_ok=True)
            watching = replace(watching, awaited=str(awaited))
        do = partial(play_cell, folder=str(place), watching=watching, definitions=definitions)
        if not jobs or (here and workers == 0):
            doing = done_jobs(ThisProcess(), do, jobs, lambda: 1)
        elif cluster:
            doing = in_cluster(cluster, do, jobs, code, place, warn)
        elif executor:
            doing = done_jobs(executor, do, jobs)
        else:
            many = workers or workplaces.available_cores()
            # Other people's code may change its process for the cells after it.
            pool = workplaces.Processes(
                many, fresh=lambda cell: not is_ours(cell.spec.learner), time_limit=float(limit)
            )
            doing = done_jobs(stack.enter_context(pool), do, jobs, lambda: many)
        playing.follow(stack.enter_context(closing(doing)))
    if playing.reasons:
        named = (playing.reasons.get(cell.file_name) for cell in cells)
        raise CellsFailed(filter(None, named), len(cells))
    return store


def _checked(watching: Watching, limit: float) -> Watching:
    """The duties of workers, checked and completed."""
    waits = {"checkpoint_every": watching.checkpoint_every, "time_limit": limit}
    for name, value in waits.items():
        if isinstance(value, bool) or not (isinstance(value, Real) and float(value) >= 0):
            raise OpenLockError(f"{name} is a number of seconds, not {value!r}")
    tensorboard = watching.tensorboard
    if tensorboard is not None:
        if find_spec("tensorboard") is None:
            raise OpenLockError(
                "logs for TensorBoard need the package tensorboard; install it with: "
                "pip install 'causal-openlock[tensorboard]'"
            )
        tensorboard = str(Path(tensorboard).resolve())  # a worker may be in another directory
    # A cell that is ended has to have made progress.
    every = min(watching.checkpoint_every, limit / 5)
    return replace(watching, checkpoint_every=every, tensorboard=tensorboard)


@dataclass
class _Run:
    """The cells of a run: those that are missing, and why some failed."""

    store: Store
    cells: Sequence[Cell]
    warn: Callable[[str], None]
    progress: Callable[[RunProgress], None]
    left: dict[str, Cell] = field(default_factory=dict)
    jobs: deque[Cell] = field(default_factory=deque)
    reasons: dict[str, str] = field(default_factory=dict)
    losses: dict[str, tuple[int, int]] = field(default_factory=dict)
    paces: dict[str, float] = field(default_factory=dict)  # seconds of an attempt, by learner

    def missing(self, retry_failed: bool) -> deque[Cell]:
        """The cells that have to be played, in order."""
        for cell in self.cells:
            path = self.store.path(cell)
            if (fault := self.store.check(cell)) is None:
                self.is_done(cell)
                continue
            if retry_failed:
                beside_cell.failure_file(path).unlink(missing_ok=True)
            failures, why = beside_cell.failures_of(path)
            if failures >= MOST_FAILURES:
                often = f"it has failed {failures} times and is left out"
                self.has_failed(cell, f"{why}; {often}, --retry-failed tries it again")
                continue
            if fault != "missing":
                self.warn(f"{fault}; its cell is run again")
            self.left[cell.file_name] = cell
        # What is stopped has some subjects of all, rather than all of some; and long cells come
        # first, so that no worker is left alone with one at the end.
        return deque(sorted(self.left.values(), key=lambda cell: (cell.first_subject, -work(cell))))

    def follow(self, doing: Doing) -> None:
        """Take note of the cells that are over, and report the progress every second."""
        looked = -inf
        for done in doing:
            if done is not None:
                self.take(done.job, done.result, done.error)
            if time.monotonic() >= looked + workplaces.LOOK_EVERY:
                self.look()
                looked = time.monotonic()
        self.look()

    def look(self) -> None:
        """Report the progress."""
        waiting = {cell.file_name for cell in self.jobs}
        given = [cell for name, cell in self.left.items() if name not in waiting]
        playing = playing_in(self.store, given)
        self.paces |= paces_of(playing)
        left, failed = self.left.values(), len(self.reasons)
        self.progress(progress_of(self.cells, left, failed, playing, self.paces))

    def take(self, cell: Cell, remarks: list[str], error: BaseException | None) -> None:
        """Take note of a cell that is done, has failed, or has lost its worker."""
        if isinstance(error, LostError):
            self.has_lost(cell, error)
        elif isinstance(error, LearnerError):
            # It has to be corrected, so its checkpoint is of no use.
            beside_cell.remove_files_of(self.store.path(cell))
            self.has_failed(cell, str(error))
        elif error:  # such as a full disk, which stops all of them
            raise error
        else:
            for remark in remarks:
                self.warn(remark)
            self.paces.setdefault(cell.spec.name, 0.0)  # it was too quick to report any progress
            self.is_done(cell)

    def is_done(self, cell: Cell) -> None:
        """Take note of a finished cell."""
        path = self.store.path(cell)
        beside_cell.remove_files_of(path)
        beside_cell.failure_file(path).unlink(missing_ok=True)
        self.left.pop(cell.file_name, None)

    def has_failed(self, cell: Cell, why: str) -> None:
        """Take note of a failed cell."""
        self.reasons[cell.file_name] = (
            f"{why}; see {beside_cell.failure_file(self.store.path(cell))}"
        )
        self.warn(self.reasons[cell.file_name])
        self.left.pop(cell.file_name, None)

    def has_lost(self, cell: Cell, error: LostError) -> None:
        """Try a cell again that has lost its worker, unless that is too often without progress.

        With a checkpoint between two losses there was progress, and the count starts again.
        """
        path, is_late = self.store.path(cell), isinstance(error, TooLateError)
        taken = beside_cell.checkpointed(path)
        losses, before = self.losses.get(cell.file_name, (0, taken))
        losses = losses + 1 if taken == before else 1
        self.losses[cell.file_name] = losses, taken
        if losses < MOST_FAILURES and not is_late:
            self.warn(f"the learner {cell.in_words}, {error}; it is tried again")
            self.jobs.append(cell)
            return
        trace = "A process that ends so leaves no traceback.\n"
        failures = 0 if is_late else MOST_FAILURES  # one that is late may have made progress
        self.has_failed(cell, beside_cell.keep_failure(path, cell, str(error), trace, failures))
