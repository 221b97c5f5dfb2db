"""Who plays the cells: processes of this machine, or an executor that somebody gives.

A pool of processes is lost as a whole when one of them dies, and does not say whose fault it was.
So each of ours is a pool of its own with a single process: it plays one cell at a time, the cell
that it died of is known, another process takes its place, and one that hangs can be ended without
touching the others.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import BrokenExecutor, Executor, Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing.process import BaseProcess
from typing import Any, TypeVar

from causal_openlock.errors import OpenLockError

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

Result = TypeVar("Result")


class Processes:
    """Processes of this machine, each of which can die without the others.

    Args:
        workers: How many.
    """

    def __init__(self, workers: int) -> None:
        self._idle = [_Process() for _ in range(workers)]
        self._busy: dict[Future[Any], _Process] = {}

    def free(self) -> bool:
        """Whether a process has nothing to do."""
        return bool(self._idle)

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Have a job done; one that is done ``alone`` shares its process with no other."""
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

    def begun(self, future: Future[Any]) -> bool:
        """Whether the process has started."""
        return self._busy[future].has_begun

    def end(self, future: Future[Any]) -> bool:
        """Kill the process that does a job; returns whether it can be ended.

        The future then says that the pool is broken.
        """
        self._busy[future].process.kill()
        return True

    def done(self, future: Future[Any]) -> str:
        """Take back the process of a job that is done; returns how it ended, if it did.

        Raises:
            OpenLockError: If it could not even begin, as the next could not, either.
        """
        process = self._busy.pop(future)
        if not isinstance(future.exception(), BrokenExecutor):
            self._idle.append(process)
            return ""
        how = process.close()
        if not process.has_begun:
            raise OpenLockError(
                f"a process to play in cannot be started ({how}); free some memory, or ask for "
                "fewer --workers. In a program of one's own, compare is called below: "
                'if __name__ == "__main__":'
            )
        self._idle.append(_Process())
        return how

    def close(self) -> None:
        """End the processes, also in the midst of what they do."""
        for process in (*self._idle, *self._busy.values()):
            process.close()


class _Process:
    """One process that plays.

    Attributes:
        has_worked: Whether it was given a job.
        is_spent: Whether it must not be given another one.
    """

    has_worked = is_spent = False

    def __init__(self) -> None:
        self.pool = _spawning_pool(1, start_alone)
        others = set(multiprocessing.active_children())
        self._hello = self.pool.submit(os.getpid)
        self._started = _new(others)  # more than one if another thread starts processes, too

    def submit(self, job: Callable[..., Result], *arguments: Any, alone: bool) -> Future[Result]:
        """Have it do a job, and no other one after a job that is done alone."""
        self.has_worked, self.is_spent = True, alone
        return self.pool.submit(job, *arguments)

    @property
    def process(self) -> BaseProcess:
        """The process itself."""
        known = self._hello.result() if self.has_begun else None
        return next(one for one in self._started if known in (None, one.pid))

    @property
    def has_begun(self) -> bool:
        """Whether it was ever ready to play."""
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


class Given:
    """An executor that somebody gives; it says nothing of its processes, and ends none."""

    def __init__(self, executor: Executor) -> None:
        self._executor = executor

    def free(self) -> bool:
        """It always takes another job."""
        return True

    def submit(
        self, job: Callable[..., Result], *arguments: Any, alone: bool = False
    ) -> Future[Result]:
        """Give it a job; which others its process does is up to it."""
        return self._executor.submit(job, *arguments)

    def begun(self, future: Future[Any]) -> bool:
        """It does not say which jobs wait."""
        return False

    def end(self, future: Future[Any]) -> bool:
        """It does not end what it has begun."""
        return False

    def done(self, future: Future[Any]) -> str:
        """Refuse to go on if it is broken, with everything that it still had to do."""
        if isinstance(future.exception(), BrokenExecutor):
            raise OpenLockError(
                "a worker of the executor ended without a word (killed, out of memory, or a "
                "learner that ends its process); run the same command again, perhaps with fewer "
                "workers: it goes on where it was"
            )
        return ""


Crew = Processes | Given


@contextmanager
def crew(executor: Executor | None, workers: int) -> Iterator[Crew]:
    """The executor that is given, or so many processes of this machine with one thread each."""
    if executor is not None:
        yield Given(executor)
        return
    with _one_thread():
        processes = Processes(workers)
        try:
            yield processes
        finally:  # killed also where nothing is left to do: a learner's thread must not keep them
            processes.close()


@contextmanager
def worker_pool(workers: int) -> Iterator[Executor]:
    """A pool of so many processes of this machine with one thread each."""
    with _one_thread():
        pool = _spawning_pool(workers, start_worker)
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
    """Processes that are started here use one thread each."""
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


def start_worker() -> None:
    """Leave Ctrl-C to the parent, and end when it has ended, however that happened."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = multiprocessing.parent_process()
    if parent is not None:

        def end_with_parent() -> None:
            parent.join()
            os._exit(1)

        threading.Thread(target=end_with_parent, daemon=True).start()


def start_alone() -> None:
    """As :func:`start_worker`, and leave SIGTERM to the parent as well.

    A batch system sends it to all processes at once. What dies of it would look like a learner that
    had ended its process.
    """
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    start_worker()


def how_ended(code: int | None) -> str:
    """How a process ended, in words, by its exit code."""
    if code is None:
        return "it is not known how"
    if code >= 0:
        return f"exit status {code}"
    try:
        name = signal.Signals(-code).name
    except ValueError:
        name = f"signal {-code}"
    return f"killed by {name}" + ", perhaps for want of memory" * (name == "SIGKILL")


def available_cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1
