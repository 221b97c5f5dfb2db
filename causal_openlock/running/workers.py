"""The workers that play cells: processes of this machine, or a given executor.

(Those of a cluster are in :mod:`causal_openlock.running.cluster`.)

When a process dies, its whole pool is broken, and the pool does not report which job was the cause.
So each process here is a pool of its own and plays one cell at a time: the cell in which it died is
known, another process replaces it, and a process that hangs can be ended without the others.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from functools import partial
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from causal_openlock.errors import OpenLockError

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

Result = TypeVar("Result")


class WorkerPool:
    """Processes of this machine; if one dies, the others continue.

    Args:
        workers: Number of processes.
    """

    def __init__(self, workers: int) -> None:
        self._idle = [_Process() for _ in range(workers)]
        self._busy: dict[Future[Any], _Process] = {}

    def free(self) -> bool:
        """Whether a process is idle."""
        return bool(self._idle)

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Start a job; if ``alone``, in a process that runs no other job."""
        process = self._idle.pop(0)
        if process.is_spent or (alone and process.has_worked):
            process = process.replaced()
        try:
            future = process.submit(job, *arguments, alone=alone)
        except BrokenExecutor:  # it died while it was idle
            process = process.replaced()
            future = process.submit(job, *arguments, alone=alone)
        self._busy[future] = process
        return future

    def number(self) -> int:
        """Number of workers."""
        return len(self._idle) + len(self._busy)

    def begun(self, future: Future[Any]) -> bool:
        """Whether the process has started."""
        return self._busy[future].has_begun

    def end(self, future: Future[Any]) -> bool:
        """Kill the process of a job; returns whether that is possible.

        The future then fails with a broken pool.
        """
        self._busy[future].process.kill()
        return True

    def done(self, future: Future[Any]) -> str:
        """Free the process of a finished job; returns how it ended, if it did.

        Its job may then be given to another one.

        Raises:
            OpenLockError: If the process could not be started.
        """
        process = self._busy.pop(future)
        if not isinstance(future.exception(), BrokenExecutor):
            self._idle.append(process)
            return ""
        how = process.close()
        if not process.has_begun:
            raise OpenLockError(
                f"a process to play in cannot be started ({how}); free some memory, or ask for "
                "fewer --workers. In your own program, call compare under: "
                'if __name__ == "__main__":'
            )
        self._idle.append(_Process())
        return how

    def close(self) -> None:
        """End the processes, even during jobs."""
        for process in (*self._idle, *self._busy.values()):
            process.close()


class _Process:
    """A process that plays cells.

    Attributes:
        has_worked: Whether it has had a job.
        is_spent: Whether it must not get another one.
    """

    has_worked = is_spent = False

    def __init__(self) -> None:
        self.pool = _spawning_pool(1, start_alone)
        others = set(multiprocessing.active_children())
        self._hello = self.pool.submit(os.getpid)
        self._started = _new(others)  # more than one if another thread starts processes, too

    def submit(self, job: Callable[..., Result], *arguments: Any, alone: bool) -> Future[Result]:
        """Start a job; no other one may follow a job that runs alone."""
        self.has_worked, self.is_spent = True, alone
        return self.pool.submit(job, *arguments)

    @property
    def process(self) -> BaseProcess:
        """The process itself."""
        known = self._hello.result() if self.has_begun else None
        return next(one for one in self._started if known in (None, one.pid))

    @property
    def has_begun(self) -> bool:
        """Whether the process was ever ready to play."""
        return self._hello.done() and self._hello.exception() is None

    def close(self) -> str:
        """End it; returns how it ended."""
        self.process.kill()
        self.pool.shutdown(cancel_futures=True)
        return how_ended(self.process.exitcode)

    def replaced(self) -> _Process:
        """End it; returns a new one."""
        self.close()
        return _Process()


class ExternalExecutor:
    """An executor from elsewhere; it cannot report on its processes or end them."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def number(self) -> int:
        """Number of workers: not known, so 0."""
        return 0

    def free(self) -> bool:
        """Whether the executor takes another job: always."""
        return True

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Start a job; ``alone`` is ignored."""
        return self._executor.submit(job, *arguments)

    def begun(self, future: Future[Any]) -> bool:
        """Whether a job has begun: not known, so False."""
        return False

    def end(self, future: Future[Any]) -> bool:
        """Whether a job was ended: not possible, so False."""
        return False

    def done(self, future: Future[Any]) -> str:
        """Raise an error if the executor is broken, since its other jobs are also lost."""
        if isinstance(future.exception(), BrokenExecutor):
            raise OpenLockError(
                "a worker of the executor ended without a message (killed, out of memory, or a "
                "learner that ends its process); run the same command again, perhaps with fewer "
                "workers: it continues where it stopped"
            )
        return ""


class InlineExecutor(ExternalExecutor):
    """This process plays, one job after the other; it cannot report on a job while it runs."""

    def __init__(self) -> None:
        self._free = True

    def free(self) -> bool:
        """Whether the last job was taken note of."""
        return self._free

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Do a job; ``alone`` is ignored."""
        self._free = False
        future: Future[Result] = Future()
        try:
            future.set_result(job(*arguments))
        except Exception as error:
            future.set_exception(error)
        return future

    def done(self, future: Future[Any]) -> str:
        """Take the next job."""
        self._free = True
        return ""


Workers = WorkerPool | ExternalExecutor


@contextmanager
def open_workers(executor: Executor | None, workers: int) -> Iterator[Workers]:
    """Yield the external executor, a pool of processes, or, with 0 workers, an inline executor."""
    if executor is not None or not workers:
        yield ExternalExecutor(executor) if executor else InlineExecutor()
        return
    with _one_thread():
        processes = WorkerPool(workers)
        try:
            yield processes
        finally:  # killed even if idle, since a learner's thread could keep them alive
            processes.close()


@contextmanager
def worker_pool(workers: int, prepare: Callable[[], None] | None = None) -> Iterator[Executor]:
    """A pool of processes of this machine with one thread each.

    Args:
        workers: How many.
        prepare: Called in each before it works; it is pickled.
    """
    with _one_thread():
        pool = _spawning_pool(workers, partial(_start, prepare) if prepare else start_worker)
        others = set(multiprocessing.active_children())
        try:
            yield pool
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            for worker in _new(others):
                worker.terminate()
            raise
        pool.shutdown()


def _spawning_pool(workers: int, initializer: Callable[[], None]) -> ProcessPoolExecutor:
    # Fresh processes: a forked torch or Arrow may hang.
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=initializer)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Make processes that are started in this context use one thread each."""
    before = {name: os.environ.get(name) for name in ONE_THREAD}
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _new(others: set[BaseProcess]) -> set[BaseProcess]:
    return set(multiprocessing.active_children()) - others


def _start(prepare: Callable[[], None]) -> None:
    start_worker()
    prepare()


def start_worker() -> None:
    """Ignore Ctrl-C, which the parent handles, and end when the parent has ended."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def end_with_parent() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=end_with_parent, daemon=True).start()


def start_alone() -> None:
    """Do as :func:`start_worker`, and also ignore SIGTERM, which the parent handles.

    A batch system sends it to all processes at once; a worker that it ends would look like a
    learner that had ended its process.
    """
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    start_worker()


def how_ended(code: int | None) -> str:
    """End of a process in words, by its exit code."""
    if code is None:
        return "it is not known how"
    if code >= 0:
        return f"exit status {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    if name == "SIGKILL":
        return "killed by SIGKILL, perhaps for lack of memory"
    return f"killed by {name}"


def available_cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
