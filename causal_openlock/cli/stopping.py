"""Stopping long work: Ctrl-C and SIGTERM, and the message that the user reads."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from causal_openlock.errors import Interrupted, Terminated


@contextmanager
def resumable() -> Iterator[None]:
    """A block that can be stopped; the same command then resumes it.

    Raises:
        Interrupted: If it is stopped.
    """
    # Only the main thread can handle signals.
    here = threading.current_thread() is threading.main_thread()
    before = signal.signal(signal.SIGTERM, _terminated) if here else None
    try:
        yield
    except KeyboardInterrupt as stopped:
        interrupted = Interrupted("stopped; run the same command again to continue")
        if isinstance(stopped, Terminated):
            interrupted.status = 128 + signal.SIGTERM
        raise interrupted from None
    finally:
        if here:
            signal.signal(signal.SIGTERM, before)


def _terminated(number: int, frame: FrameType | None) -> None:
    raise Terminated
