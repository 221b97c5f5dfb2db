"""Executors that play cells, score and fit: processes of this machine, or this process.

A process does one job at a time over a pipe of its own. If it dies, its job is lost, and the others
continue. It is the head of a process group: what a learner starts is ended with it.
"""

from __future__ import annotations

import multiprocessing
import os
import signal
import sys
import threading
import time
import traceback
import warnings
from collections import deque
from collections.abc import Callable, Generator
from concurrent import futures
from contextlib import suppress
from functools import partial
from math import inf
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, NamedTuple, cast

from causal_openlock.errors import OpenLockError

# One thread for each worker: the cores are shared out by cells, and the matrices are small.
ONE_THREAD = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
LOOK_EVERY = 1.0  #: seconds between two looks at jobs that are being done
GRACE = 1.0  #: seconds in which processes can end by themselves
GUARD = 'call compare under: if __name__ == "__main__":'
WORKER_ITSELF = (
    "this process is itself a worker and may not start others, so it plays one cell after another"
)


class LostError(OpenLockError):
    """The process that did a job has ended."""


class TooLateError(LostError):
    """The process that did a job was ended at the time limit."""


class Done(NamedTuple):
    """A job that is over, with its result or its error."""

    job: Any
    result: Any = None
    error: BaseException | None = None


Doing = Generator[Done | None, None, None]


def done_jobs(
    executor: futures.Executor,
    do: Callable[[Any], Any],
    jobs: deque[Any],
    most: Callable[[], float] = lambda: inf,
) -> Doing:
    """Let an executor do jobs, at most as many at a time as ``most`` returns.

    Yields:
        The jobs that are done; in between None, at least every :data:`LOOK_EVERY` seconds.
    """
    running: dict[futures.Future[Any], Any] = {}
    try:
        while jobs or running:
            yield None
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
    finally:
        for future in running:
            future.cancel()


class ThisProcess(futures.Executor):
    """Does each job at once, in the thread that asks for it."""

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Do a job; Ctrl-C stops it."""
        future: futures.Future[Any] = futures.Future()
        try:
            future.set_result(fn(*args, **kwargs))
        except Exception as error:
            future.set_exception(error)
        return future


class Processes(futures.ThreadPoolExecutor):
    """Processes of this machine, for each of which a thread waits; leaving the block ends them.

    A job of which ``fresh`` is true, by its arguments, has a process that does no other job. The
    process of a job is ended after ``time_limit`` seconds.
    """

    def __init__(
        self, workers: int, fresh: Callable[..., bool] = lambda *_: False, time_limit: float = inf
    ) -> None:
        super().__init__(workers)
        self._fresh, self._time_limit = fresh, time_limit
        self._processes: dict[int, _Process] = {}  # by the threads that wait for them
        self._is_over = False

    def submit(self, fn: Any, /, *args: Any, **kwargs: Any) -> futures.Future[Any]:
        """Have a job done in one of the processes; the future can also raise LostError."""
        return super().submit(self._do, partial(fn, *args, **kwargs), self._fresh(*args))

    def shutdown(self, wait: bool = True, *, cancel_futures: bool = True) -> None:
        """End the processes, with the jobs that they have."""
        self._is_over = True
        super().shutdown(wait=False, cancel_futures=cancel_futures)
        for process in [*self._processes.values()]:
            process.end()
        super().shutdown(wait=wait)

    def _do(self, job: Callable[[], Any], fresh: bool) -> Any:
        thread = threading.get_ident()
        process = self._processes.get(thread)
        if process is None or process.is_over or fresh:
            if process:
                process.end()
            process = self._processes[thread] = _Process()
        if self._is_over:  # since this thread began
            process.end()
        try:
            return process.do(job, self._time_limit)
        finally:
            if fresh:
                process.end()


class _Process:
    """A process that does one job at a time."""

    _starting = threading.Lock()

    def __init__(self) -> None:
        # A fresh process: a forked torch or Arrow may hang.
        context = multiprocessing.get_context("spawn")
        self._pipe, other = context.Pipe()
        self._process = context.Process(target=_serve, args=(other,))
        self._has_begun = False  # it has been able to do something
        self.is_over = False
        with self._starting:
            before = dict(os.environ)
            os.environ.update(ONE_THREAD)
            try:
                self._process.start()
            finally:
                for name in ONE_THREAD:
                    del os.environ[name]
                os.environ.update(before)
        other.close()

    def do(self, job: Callable[[], Any], time_limit: float) -> Any:
        """Wait until a job is done, or the process has ended."""
        try:
            with suppress(BrokenPipeError):  # it has ended, and may have said why
                self._pipe.send(job)
            self._pipe.recv()
            self._has_begun, last = True, time.monotonic() + time_limit
            while not self._pipe.poll(1.0):
                if time.monotonic() >= last:
                    self.end()
                    raise TooLateError(f"was ended after {time_limit:g} s")
            result, error = self._pipe.recv()
        except (EOFError, OSError):
            raise self._loss() from None
        if error:
            raise error
        return result

    def end(self) -> None:
        """End the process, and what has been started in it."""
        if self.is_over:
            return
        self.is_over = True
        self._process.kill()
        self._process.join()
        end_group(cast(int, self._process.pid))

    def _loss(self) -> OpenLockError:
        # One that is ending keeps its exit code. One that closed its descriptors looks as if it had
        # ended, and `join` would wait for its end for ever.
        last = time.monotonic() + GRACE
        while self._process.exitcode is None and time.monotonic() < last:
            time.sleep(0.02)
        hung_up = self._process.exitcode is None
        self.end()
        if hung_up:
            return LostError("closed the connection to its worker")
        code = self._process.exitcode or 0
        how = f"exit status {code}" if code >= 0 else f"killed by {signal.Signals(-code).name}"
        if code == -signal.SIGKILL:
            how += ", perhaps for lack of memory"
        if self._has_begun:
            return LostError(f"ended its process ({how})")
        return OpenLockError(
            f"a process to play in ended before it could play ({how}); each worker first runs this "
            f"program, so {GUARD}"
        )


def _serve(pipe: Connection) -> None:
    """Do the jobs that come through a pipe, and say when one begins and how it ends.

    The process is the head of a group, which ends when its parent has ended. It ignores Ctrl-C and
    SIGTERM, which its parent handles: a batch system sends SIGTERM to all processes at once, and a
    worker that it ends would look like a learner that ended its process.
    """
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: None)  # SIG_IGN would be inherited
    with suppress(AttributeError, OSError):  # Windows has no groups
        os.setsid()
    threading.Thread(target=_end_with_parent, daemon=True).start()
    with suppress(EOFError, OSError):
        while True:
            job = pipe.recv()
            pipe.send(None)
            try:
                pipe.send((job(), None))
            except BaseException as error:
                if not isinstance(error, OpenLockError):
                    error.add_note(traceback.format_exc())
                pipe.send((None, error))


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        with suppress(OSError):  # a learner has closed all descriptors, and the parent lives
            os.fstat(parent.sentinel)
            end_group(os.getpid())
            os._exit(1)


def end_group(group: int) -> None:
    """End a process group: with SIGTERM, and after some time with SIGKILL."""
    with suppress(OSError, AttributeError):  # nothing is left of it, or this is Windows
        os.killpg(group, signal.SIGTERM)
        last = time.monotonic() + GRACE
        while time.monotonic() < last:
            os.killpg(group, 0)
            time.sleep(0.02)
        os.killpg(group, signal.SIGKILL)


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


def worker_pool(workers: int) -> futures.Executor:
    """Processes of this machine, to be used in a ``with`` block."""
    if may_start_processes():
        return Processes(workers)
    warnings.warn(WORKER_ITSELF, stacklevel=2)
    return futures.ThreadPoolExecutor(1)


def available_cores() -> int:
    """Number of cores that this process may use."""
    # On macOS there is no affinity.
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
