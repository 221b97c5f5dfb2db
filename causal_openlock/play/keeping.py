"""While people play, a thread flushes their log to the disk and writes their record.

Whatever serves :class:`~causal_openlock.play.people.People`, over the web
(:mod:`~causal_openlock.play.web`) or for one agent, serves them in a block of :func:`kept`.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError
from causal_openlock.play.people import People

KEEP_EVERY = 10.0  # seconds between two writings of the record; the log has every click at once


@contextmanager
def kept(people: People, changed: Callable[[], None] = lambda: None) -> Iterator[None]:
    """A block in which people can play; ``changed`` is called soon after one joins or finishes."""
    stopped = threading.Event()
    keeper = threading.Thread(target=_keep, args=(people, changed, stopped), daemon=True)
    keeper.start()
    try:
        yield
    finally:
        stopped.set()
        keeper.join()


def warn(error: Exception | str) -> None:
    """Tell the researcher."""
    say(f"warning: {error}", error=True)


def _keep(people: People, changed: Callable[[], None], stopped: threading.Event) -> None:
    waited = KEEP_EVERY  # written at once: a server that was killed may have left something
    before = people.number, people.finished
    while not stopped.wait(1.0):
        waited += 1.0
        now = people.number, people.finished
        if now != before:
            changed()
            waited = KEEP_EVERY if now[1] != before[1] else waited  # soon after one has finished
        before = now
        try:
            people.sync()
            if waited >= KEEP_EVERY:
                people.keep()
                waited = 0.0
        except (OpenLockError, OSError) as error:
            warn(error)
        except RuntimeError:  # Python ends: closing people writes what is left
            if threading.main_thread().is_alive():
                raise
            return
