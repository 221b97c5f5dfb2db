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
import traceback
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, ProcessPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path

from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment import Cell, Experiment
from causal_openlock.files import write_text
from causal_openlock.learner_registry import create
from causal_openlock.session import Session
from causal_openlock.store import Store

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")


def play_cell(cell: Cell, folder: str) -> int:
    """Play one cell and keep its record; this is what a worker does.

    Returns:
        Number of attempts.

    Raises:
        LearnerError: If the learner fails; its traceback is kept in the folder ``errors``.
        StoreError: If the record cannot be written.
    """
    session = Session(
        cell.condition,
        cell.entry.protocol,
        range(cell.first_subject, cell.first_subject + cell.subjects),
        seed=cell.seed,
        reward=cell.entry.reward,
        learner=cell.entry.name,
        experiment=cell.experiment,
    )
    try:
        record = session.play(create(cell.entry.learner, cell.entry.parameters))
    except OpenLockError as error:
        raise LearnerError(f"{cell.entry.name} in {cell.condition.name}: {error}") from None
    except (Exception, SystemExit) as error:
        kept = Path(folder) / "errors" / f"{cell.name}.txt"
        write_text(kept, traceback.format_exc())
        said = " ".join(str(error).split())[:200]
        raise LearnerError(
            f"the learner {cell.entry.name} failed in {cell.condition.name} "
            f"({type(error).__name__}: {said}); its traceback is in {kept}"
        ) from None
    Store(folder).write(cell, record)
    return int(record.num_rows)


def run(
    experiment: Experiment,
    folder: Path | str,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    done: Callable[[Cell, bool], None] | None = None,
    warn: Callable[[str], None] | None = None,
) -> Store:
    """Run what is not yet done of an experiment.

    Args:
        experiment: What to run.
        folder: Where the results go; one that holds a part of them is completed.
        executor: Where cells are played; by default processes of this machine.
        workers: How many of these; by default one for each core.
        done: Called with each cell that is done, and whether it was done before.
        warn: Called with a sentence for each damaged file, whose cell is run again.

    Raises:
        StoreError: If the folder holds something else or cannot be written to.
        LearnerError: If a learner fails. Cells that were done stay done.
    """
    store = Store(folder)
    store.open(experiment)
    try:
        pending = []
        for cell in experiment.cells():
            fault = store.check(cell)
            if fault is None:
                if done:
                    done(cell, True)
                continue
            if fault != "missing" and warn:
                warn(f"{fault}; its cell is run again")
            pending.append(cell)
        if pending:
            with _executor(executor, min(workers or _cores(), len(pending))) as pool:
                _play(pool, pending, store.folder.resolve(), done)
    finally:
        store.close()
    return store


def _play(
    pool: Executor, cells: list[Cell], folder: Path, done: Callable[[Cell, bool], None] | None
) -> None:
    futures = {pool.submit(play_cell, cell, str(folder)): cell for cell in cells}
    try:
        for future in as_completed(futures):
            future.result()
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
def _executor(executor: Executor | None, workers: int) -> Iterator[Executor]:
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


def _cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
