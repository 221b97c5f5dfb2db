"""Serving one folder's games: a thread keeps their record, and uvicorn answers over the web.

The thread flushes the log to the disk and writes the record; agents over stdio need it alone.
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import uvicorn
from starlette.applications import Starlette

from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError
from causal_openlock.play.people import People

LOOPBACK = ("127.0.0.1", "localhost")
KEEP_EVERY = 10.0  # seconds between two writings of the record; the log has every click at once


class WebServer:
    """Serves an application, with these headers, and keeps the record of its people meanwhile.

    Raises:
        OpenLockError: If it cannot listen on this host and port (0 for any that is free).
    """

    def __init__(
        self,
        people: People,
        application: Starlette,
        host: str = LOOPBACK[0],
        port: int = 0,
        headers: dict[str, str] | None = None,
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.people, self._changed = people, changed
        try:
            self._socket = socket.create_server((host, port), backlog=256)
        except OSError as error:
            raise OpenLockError(
                f"cannot listen on {host}, port {port} ({error.strerror or error}); choose another "
                "with --host or --port"
            ) from None
        # Else an answer's second packet waits 40 ms: asyncio asks for this of other sockets alone.
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        shown = LOOPBACK[0] if host == "0.0.0.0" else host
        self.port = int(self._socket.getsockname()[1])
        self.url = f"http://{shown}:{self.port}/"  #: its address, for this machine
        self._server = uvicorn.Server(
            uvicorn.Config(
                application,
                ws="none",
                log_config=None,
                log_level="error",  # addresses are not logged
                access_log=False,
                server_header=False,
                headers=[*(headers or {}).items()],
                timeout_graceful_shutdown=2,
            )
        )

    def serve_forever(self) -> None:
        """Serve until :meth:`shutdown`, SIGINT or SIGTERM; then people can be closed."""
        with self._socket, kept(self.people, self._changed):
            self._server.run(sockets=[self._socket])

    def shutdown(self) -> None:
        """Make :meth:`serve_forever` return soon; for another thread."""
        self._server.should_exit = True


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
