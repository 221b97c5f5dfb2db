"""Connections that cannot keep others out, whoever opens them and however slowly they send.

A request has to be whole, and its answer read, within a time that further bytes do not extend. When
there are as many connections as there may be, a new one takes the place of the one that has waited
longest; none is closed while its request is being answered. Network addresses play no part, since
all people have the same one behind a reverse proxy, in a lab or in a class. A page whose connection
was closed opens another one with its next request.
"""

from __future__ import annotations

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol

MOST_CONNECTIONS = 512
IDLE = 75
"""Seconds after which a connection is closed on which no request begins."""
DEADLINE = 30
"""Seconds from the first byte of a request until its answer has left."""


class Connection(H11Protocol):
    """A connection that is closed when its time is over, or when its place is needed."""

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """Find a place for this connection, and give it time to begin a request."""
        super().connection_made(transport)
        self._patience = self.loop.call_later(IDLE, transport.abort)
        self._since, self._in_request = self.loop.time(), False
        if len(self.connections) > MOST_CONNECTIONS:
            self._make_room()

    def data_received(self, data: bytes) -> None:
        """Start the deadline with the first byte of a request."""
        if not self._in_request:
            self._wait(DEADLINE, in_request=True)
        super().data_received(data)

    def on_response_complete(self) -> None:
        """Wait for the next request."""
        self._wait(IDLE, in_request=False)
        super().on_response_complete()

    def connection_lost(self, exc: Exception | None) -> None:
        """Forget the time that was left."""
        self._patience.cancel()
        super().connection_lost(exc)

    def shutdown(self) -> None:
        """Close the connection when the server ends, also if half a request has come."""
        super().shutdown()
        if self.cycle is not None and self.cycle.more_body:  # it may never come
            self.transport.close()

    def _wait(self, seconds: float, in_request: bool) -> None:
        self._patience.cancel()
        self._patience = self.loop.call_later(seconds, self.transport.abort)
        self._since, self._in_request = self.loop.time(), in_request

    def _make_room(self) -> None:
        waiting = [
            one for one in self.connections if isinstance(one, Connection) and one._is_waiting()
        ]
        oldest = min(waiting, key=lambda one: one._since)  # at least this one is waiting
        # At once: several new ones can come before asyncio says that this one is lost.
        self.connections.discard(oldest)
        oldest.transport.abort()

    def _is_waiting(self) -> bool:
        """Whether the next thing has to come from the other side."""
        return self.cycle is None or self.cycle.response_complete or self.cycle.more_body
