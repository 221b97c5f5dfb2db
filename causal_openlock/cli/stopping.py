"""Stopping long work: Ctrl-C and SIGTERM, and the message that the user reads."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from causal_openlock.errors import Interrupted, Stopped


@contextmanager
def resumable() -> Iterator[None]:
    """A block that can be stopped; the same command then resumes it.

    Raises:
        Interrupted: If it is stopped.
    """
    try:
        with stopped_by(signal.SIGTERM):
            yield
    except KeyboardInterrupt as stopped:
        interrupted = Interrupted("stopped; run the same command again to continue")
        if isinstance(stopped, Stopped):
            interrupted.status = 128 + stopped.number
        raise interrupted from None


@contextmanager
def stopped_by(number: int) -> Iterator[None]:
    """A block in which a signal raises ``Stopped``, unless this process ignores the signal."""
    is_main = threading.current_thread() is threading.main_thread()  # only that can handle signals
    if not is_main or (before := signal.getsignal(number)) in (signal.SIG_IGN, None):
        yield
        return
    signal.signal(number, _stop)
    try:
        yield
    finally:
        signal.signal(number, before)


def _stop(number: int, frame: FrameType | None) -> None:
    raise Stopped(number)
