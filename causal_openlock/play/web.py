"""A server of one folder's games, by uvicorn, whatever application answers the requests."""

from __future__ import annotations

import socket
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette

from causal_openlock.errors import OpenLockError
from causal_openlock.play.keeping import kept
from causal_openlock.play.people import People

LOOPBACK = ("127.0.0.1", "localhost")


class WebServer:
    """Serves an application, and keeps the record of its people meanwhile.

    Args:
        people: The people who play.
        application: What answers requests.
        host: Address to listen on.
        port: Port to listen on; 0 for any that is free.
        headers: Headers of every answer.
        changed: Called soon after somebody has joined or finished.

    Raises:
        OpenLockError: If it cannot listen there.
    """

    def __init__(
        self,
        people: People,
        application: Starlette,
        *,
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
