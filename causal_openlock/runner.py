"""Running an experiment: its cells on an executor, each kept as soon as it is done.

The runner takes any :class:`concurrent.futures.Executor`; by default processes of this machine,
one for each core. A cell's record depends on the cell alone, so it does not matter how many workers
there are, in which order they finish, or how often the run was killed and started again.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import (
    BrokenExecutor,
    Executor,
    Future,
    ProcessPoolExecutor,
    as_completed,
)
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

from causal_openlock.errors import LearnerError
from causal_openlock.experiment import Cell, Experiment
from causal_openlock.store import Store
from causal_openlock.worker import Played, Watching, play_cell

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

LOOK_EVERY = 1.0
"""Seconds after which the runner looks again how far the cells are."""


def run(
    experiment: Experiment,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    done: Callable[[Cell, bool], None] | None = None,
    warn: Callable[[str], None] | None = None,
    progress: Callable[[float], None] | None = None,
    watching: Watching | None = None,
) -> Store:
    """Run what is not yet done of an experiment.

    Args:
        experiment: What to run.
        folder: Where the results go; one that holds a part of them is completed.
        executor: Where cells are played; by default processes of this machine.
        workers: How many of these; by default one for each core.
        done: Called with each cell that is done, and whether it was done before.
        warn: Called with a sentence for each damaged file, whose cell is run again, and for what
            went wrong in a cell without stopping it.
        progress: Called every second, in a thread of its own, with how many cells' worth is done
            of those being played.
        watching: How often checkpoints are taken inside a cell, and what is logged.

    Raises:
        OpenLockError: If TensorBoard's logs are asked for and it is not installed.
        StoreError: If the folder holds something else or cannot be written to.
        LearnerError: If a learner fails. Cells that were done stay done.
    """
    watching = watching or Watching()
    if watching.tensorboard is not None:
        from causal_openlock.tensorboard import require_tensorboard

        require_tensorboard()
        # A worker may be in another directory.
        watching = replace(watching, tensorboard=str(Path(watching.tensorboard).resolve()))
    store = Store(folder)
    store.open(experiment)
    try:
        pending: list[Cell] = []
        for cell in experiment.cells():
            fault = store.check(cell)
            if fault is None:
                store.clear(cell)
                if done:
                    done(cell, True)
                continue
            if fault != "missing" and warn:
                warn(f"{fault}; its cell is run again")
            pending.append(cell)
        if pending:
            workers = min(workers or available_cores(), len(pending))
            with worker_pool(executor, workers) as pool, _telling(store, progress):
                futures = {
                    pool.submit(play_cell, cell, str(store.folder.resolve()), watching): cell
                    for cell in pending
                }
                _wait(futures, done, warn)
    finally:
        store.close()
    return store


def _wait(
    futures: dict[Future[Played], Cell],
    done: Callable[[Cell, bool], None] | None,
    warn: Callable[[str], None] | None,
) -> None:
    told: set[str] = set()
    try:
        for future in as_completed(futures):
            for warning in future.result().warnings:
                if warn and warning not in told:
                    warn(warning)
                told.add(warning)
            if done:
                done(futures[future], False)
    except BrokenExecutor:
        raise LearnerError(
            "a worker process ended without a word (killed, out of memory, or a learner that ends "
            "its process); run the same command again, perhaps with fewer --workers: it goes on "
            "where it was"
        ) from None
    finally:
        for future in futures:
            future.cancel()


@contextmanager
def _telling(store: Store, progress: Callable[[float], None] | None) -> Iterator[None]:
    """Tell every now and then how far the cells are that are being played."""
    over = threading.Event()

    def look() -> None:
        while progress and not over.wait(LOOK_EVERY):
            progress(store.progress())

    looking = threading.Thread(target=look, daemon=True)
    looking.start()
    try:
        yield
    finally:
        over.set()
        looking.join()


@contextmanager
def worker_pool(executor: Executor | None, workers: int) -> Iterator[Executor]:
    """The executor that is given, or so many processes of this machine with one thread each."""
    if executor is not None:
        yield executor
        return
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        # Fresh processes: a forked torch or Arrow may hang.
        context = multiprocessing.get_context("spawn")
        pool = ProcessPoolExecutor(workers, mp_context=context, initializer=_start_worker)
        others = set(multiprocessing.active_children())
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in set(multiprocessing.active_children()) - others:
                worker.terminate()
            raise
        pool.shutdown()
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _start_worker() -> None:
    """Leave Ctrl-C to the parent, and end when it has ended, however that happened."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def end_with_parent() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=end_with_parent, daemon=True).start()


def available_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
