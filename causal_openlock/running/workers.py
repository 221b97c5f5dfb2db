"""The workers that play cells: processes of this machine, this process, or a given executor.

Each is an iterator over the jobs that are done. In between it yields None, at least every
:data:`LOOK_EVERY` seconds, so that whoever waits can look at the progress.

A process does one job at a time over a pipe of its own. If it dies, its job is known and the others
continue. It is the head of a process group: what a learner starts is ended with it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import warnings
from collections import deque
from collections.abc import Callable, Collection, Generator, Iterable, Iterator
from concurrent import futures
from contextlib import contextmanager, suppress
from math import inf
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any, NamedTuple

from causal_openlock.errors import OpenLockError

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
LOOK_EVERY = 1.0
"""Seconds after which an iterator yields None, if no job is done."""
GRACE = 1.0
"""Seconds that processes have to end by themselves."""
GUARD = 'call compare under: if __name__ == "__main__":'
WORKER_ITSELF = (
    "this process is itself a worker and may not start others, so it plays one cell after another"
)

Do = Callable[[Any], Any]


class Done(NamedTuple):
    """A job that is over: its result, its error, or what happened to its worker."""

    job: Any
    result: Any = None
    error: BaseException | None = None
    lost: str = ""
    late: bool = False


Doing = Generator["Done | None", None, None]
"""What is done, and in between None."""


def in_this_process(do: Do, jobs: deque[Any]) -> Doing:
    """Do jobs here, one after another."""
    while jobs:
        yield None
        job = jobs.popleft()
        try:
            done = Done(job, do(job))
        except Exception as error:
            done = Done(job, error=error)
        yield done


def in_executor(
    executor: futures.Executor, do: Do, jobs: deque[Any], most: Callable[[], float] = lambda: inf
) -> Doing:
    """Let an executor do jobs, at most as many at a time as ``most`` returns."""
    running: dict[futures.Future[Any], Any] = {}
    try:
        while jobs or running:
            while jobs and len(running) < most():
                job = jobs.popleft()
                running[executor.submit(do, job)] = job
            if not running:
                time.sleep(LOOK_EVERY)
            for future in futures.wait(running, LOOK_EVERY, futures.FIRST_COMPLETED).done:
                job, error = running.pop(future), future.exception()
                if isinstance(error, futures.BrokenExecutor):
                    raise OpenLockError(
                        "a worker of the executor ended without a message, perhaps for lack of "
                        "memory; give the same command again: it continues where it stopped"
                    )
                yield Done(job, error=error) if error else Done(job, future.result())
            yield None
    finally:
        for future in running:
            future.cancel()


def in_processes(
    do: Do,
    jobs: deque[Any],
    workers: int,
    alone: Callable[[Any], bool],
    time_limit: float = inf,
) -> Doing:
    """Do jobs in processes of this machine; more jobs may be added meanwhile.

    Args:
        do: What is done with a job; it is pickled.
        jobs: The jobs.
        workers: Number of processes.
        alone: Whether a job needs a process that does no other job.
        time_limit: Seconds after which the process of a job is ended.
    """
    pool: list[_Worker] = []
    try:
        while jobs or any(worker.busy for worker in pool):
            while jobs and sum(worker.busy for worker in pool) < workers:
                job = jobs.popleft()
                worker = next((worker for worker in pool if not worker.busy), None)
                if worker and alone(job):
                    worker.leave(pool)
                if worker not in pool:
                    pool.append(worker := _Worker(do))
                worker.give(job)
            busy = [worker for worker in pool if worker.busy]
            ready = wait([worker.pipe for worker in busy], LOOK_EVERY)
            for worker in busy:
                done = worker.take() if worker.pipe in ready else None
                if time.monotonic() - worker.began >= time_limit and done is None:
                    done = Done(worker.job, lost=f"was ended after {time_limit:g} s", late=True)
                if done and (done.lost or alone(done.job)):
                    worker.leave(pool)
                yield done
            yield None
    finally:  # ended even if idle, since a learner's thread could keep them alive
        end([worker.process for worker in pool])


class _Worker:
    """A process and its job."""

    def __init__(self, do: Do) -> None:
        # A fresh process: a forked torch or Arrow may hang.
        context = multiprocessing.get_context("spawn")
        self.pipe, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other, do))
        with _one_thread():
            self.process.start()
        other.close()
        self.job: Any = None
        self.busy = self.has_begun = False  # the latter: it has been able to play
        self.began = inf

    def give(self, job: Any) -> None:
        """Give the process a job."""
        self.job, self.busy, self.began = job, True, inf
        with suppress(OSError):  # it is dead, which is seen when the answer is read
            self.pipe.send(job)

    def take(self) -> Done | None:
        """What the pipe has: the job's end, or nothing if it has just begun."""
        try:
            message = self.pipe.recv()
        except (EOFError, OSError):
            last = time.monotonic() + GRACE
            while self.process.exitcode is None and time.monotonic() < last:
                time.sleep(0.02)  # join would wait for ever if only its descriptors are closed
            return Done(self.job, lost=self._how_lost())
        if message is None:
            self.has_begun, self.began = True, time.monotonic()
            return None
        self.busy = False
        return Done(self.job, *message)

    def leave(self, pool: list[_Worker]) -> None:
        """End the process, and take it out of the pool."""
        pool.remove(self)
        self.pipe.close()
        end([self.process])

    def _how_lost(self) -> str:
        code = self.process.exitcode
        how = "it does not answer" if code is None else f"exit status {code}"
        if code is not None and code < 0:
            names = {number.value: number.name for number in signal.Signals}
            how = f"killed by {names.get(-code, f'signal {-code}')}"
            how += ", perhaps for lack of memory" * (code == -signal.SIGKILL)
        if self.has_begun:
            return (
                f"ended its process ({how})"
                if code is not None
                else "closed the connection to its worker"
            )
        raise OpenLockError(
            f"a process to play in ended before it could play ({how}); each worker first runs this "
            f"program, so {GUARD}"
        )


def _work(pipe: Connection, do: Do) -> None:
    """Do the jobs that come through a pipe, and say when one begins and how it ends."""
    begin_worker()
    with suppress(EOFError, OSError):
        while True:
            job = pipe.recv()
            pipe.send(None)
            try:
                message: tuple[Any, OpenLockError | None] = (do(job), None)
            except OpenLockError as error:
                message = (None, error)
            pipe.send(message)


# -- processes ------------------------------------------------------------------------------------


def begin_worker(prepare: Callable[[], None] | None = None) -> None:
    """Make this process a worker: the head of a group, which ends when its parent has ended.

    It ignores Ctrl-C and SIGTERM, which its parent handles: a batch system sends SIGTERM to all
    processes at once, and a worker that it ends would look like a learner that ended its process.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)  # SIG_IGN would be inherited
    with suppress(AttributeError, OSError):  # Windows has none; or it is the head already
        os.setsid()
    parent = multiprocessing.parent_process()
    if parent is not None:

        def end_with_parent() -> None:
            parent.join()
            with suppress(OSError):  # a learner has closed all descriptors, and the parent lives
                os.fstat(parent.sentinel)
                end_groups([os.getpid()])
                os._exit(1)

        threading.Thread(target=end_with_parent, daemon=True).start()
    if prepare:
        prepare()


def end(processes: Collection[BaseProcess]) -> None:
    """End workers and what is left of their groups."""
    for process in processes:
        process.kill()
    for process in processes:
        process.join()
    end_groups([process.pid for process in processes if process.pid])


def end_groups(groups: Iterable[int]) -> None:
    """End process groups: with SIGTERM, and after some time with SIGKILL."""
    left, last = _reached(groups, signal.SIGTERM), time.monotonic() + GRACE
    while left and time.monotonic() < last:
        time.sleep(0.02)
        left = _reached(left, 0)
    _reached(left, signal.SIGKILL)


def _reached(groups: Iterable[int], number: int) -> list[int]:
    """Send a signal to process groups; those that are still there."""
    reached = []
    for group in groups:
        with suppress(OSError, AttributeError):  # there is none left, or this is Windows
            os.killpg(group, number)
            reached.append(group)
    return reached


def may_start_processes() -> bool:
    """Whether this process may start others: workers of multiprocessing and joblib may not."""
    process, method = multiprocessing.current_process(), multiprocessing.get_start_method(True)
    if process.daemon or method not in (None, *multiprocessing.get_all_start_methods()):
        return False
    if getattr(process, "_inheriting", False):  # a worker that runs a program without a guard
        raise SystemExit(1)
    main = sys.modules["__main__"]
    file = getattr(main, "__file__", None)
    if file and getattr(main, "__spec__", None) is None and not Path(file).exists():
        raise OpenLockError(
            f"the processes that play run this program first, and it is in no file ({file}); save "
            f"it in one and {GUARD} Or compare with workers=0"
        )
    return True


@contextmanager
def worker_pool(
    workers: int, prepare: Callable[[], None] | None = None
) -> Iterator[futures.Executor]:
    """A pool of processes of this machine with one thread each, which first call ``prepare``."""
    if not may_start_processes():
        warnings.warn(WORKER_ITSELF, stacklevel=3)
        with futures.ThreadPoolExecutor(1, initializer=prepare) as thread:
            yield thread
        return
    context = multiprocessing.get_context("spawn")
    with _one_thread():
        pool = futures.ProcessPoolExecutor(workers, context, begin_worker, (prepare,))
        try:
            yield pool
        finally:
            processes = [*(pool._processes or {}).values()]  # none if it is broken
            pool.shutdown(wait=False, cancel_futures=True)
            end(processes)


@contextmanager
def _one_thread() -> Iterator[None]:
    """Make processes that are started in this context use one thread each."""
    before = dict(os.environ)
    os.environ.update(ONE_THREAD)
    try:
        yield
    finally:
        for name in ONE_THREAD:
            del os.environ[name]
        os.environ.update(before)


def available_cores() -> int:
    """Number of cores that this process may use."""
    # On macOS there is no affinity.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
