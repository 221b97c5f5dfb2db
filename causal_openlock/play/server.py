"""The server: one page, and a handful of calls that answer its clicks.

=========================  =======================================================================
``GET /`` and its files    the page
``GET /brief``             budgets, for the instructions
``GET /geometry/7``        where things are in a room of seven levers
``POST /join``             a new session; answers its id
``GET /state``             what the person may know now
``POST /proceed``          ``{"turn"}``: leave the practice room
``POST /act``              ``{"turn", "action", "reaction"}``: act; reaction in milliseconds or null
=========================  =======================================================================

A session id travels as ``Authorization: Bearer ID``, which no other site's page can send. Status
404 is for sessions and addresses that do not exist, 409 for calls out of turn (with the state as it
is), 400 for what is no such call. None of these changes anything.

It is Python's own threading HTTP server: a thread for each connection, most of them asleep. It
listens on loopback unless told otherwise, and then also refuses requests that came by another name
than this machine's own, as those of a page elsewhere whose name was made to point here would. Where
a reverse proxy stands before it, it is told the address that people use, and takes that name too.
"""

from __future__ import annotations

import json
import re
import socket
import sys
import threading
from collections.abc import Callable
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from ipaddress import ip_address
from typing import Any, cast
from urllib.parse import urlsplit

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.files.escaping import printable
from causal_openlock.play.pages import geometry, static_files
from causal_openlock.play.people import FullHouse, OutOfTurn, People, UnknownPerson
from causal_openlock.world.room import positions_for

MOST_BYTES = 1024
"""The longest call."""
MOST_CONNECTIONS = 512
LONGEST_REACTION = 24 * 60 * 60 * 1000
KEEP_EVERY = 10.0
"""Seconds between two writings of the record; the log is written with every click."""
KEEP_PAUSE = 0.05
"""Seconds between the records of two people, in which clicks are answered."""

HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cache-Control": "no-store",
}

Answer = tuple[HTTPStatus, Any]


class PlayServer(ThreadingHTTPServer):
    """Serves the page to the people of one results folder.

    Args:
        people: Who plays.
        host: Address to listen on.
        port: Port to listen on; 0 for any that is free.
        address: What people type, such as ``https://study.example.org``, if a reverse proxy passes
            their requests on; empty without one.

    Raises:
        OpenLockError: If it cannot listen there, or the address is none.
    """

    daemon_threads = True
    block_on_close = False
    request_queue_size = 256

    def __init__(
        self, people: People, host: str = "127.0.0.1", port: int = 0, address: str = ""
    ) -> None:
        self.people = people
        self.address = _checked(address)
        self._room_for = threading.BoundedSemaphore(MOST_CONNECTIONS)
        self._stop = threading.Event()
        if ":" in host:
            self.address_family = socket.AF_INET6
        try:
            super().__init__((host, port), _Handler)
        except (OSError, OverflowError) as error:
            said = getattr(error, "strerror", None) or error
            raise OpenLockError(
                f"cannot listen on {host}, port {port} ({said}); choose another with --host or "
                "--port"
            ) from None
        self.host, self.port = host, int(self.server_address[1])
        self.loopback = _is_loopback(host)
        names = (*LOOPBACK, host, f"[{host}]")
        self.names = {f"{name}:{self.port}" for name in names}
        if self.port == 80:  # which browsers leave out
            self.names.update(names)
        self.public = urlsplit(self.address).netloc
        if self.public:
            self.names.add(self.public)
        self._keeper = threading.Thread(target=self._keep, name="keeper", daemon=True)

    @property
    def url(self) -> str:
        """Where the page is, for this machine."""
        host = {"0.0.0.0": "127.0.0.1", "": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        return f"http://{f'[{host}]' if ':' in host and '[' not in host else host}:{self.port}/"

    def serve_forever(self, poll_interval: float = 0.2) -> None:
        """Serve until :meth:`shutdown`."""
        self._keeper.start()
        super().serve_forever(poll_interval)

    def finish(self) -> None:
        """Stop listening, write the record and let go of the folder."""
        self._stop.set()
        self.server_close()
        if self._keeper.is_alive():
            self._keeper.join()
        self.people.close()

    def _keep(self) -> None:
        # At once, what a server that was killed had not come to.
        waited, ended_only = KEEP_EVERY, False
        while not self._stop.wait(1.0):
            waited += 1.0
            try:
                self.people.sync()
                if waited >= KEEP_EVERY:
                    self.people.keep(KEEP_PAUSE, ended_only)
                    waited, ended_only = 0.0, True
            except (OpenLockError, OSError) as error:
                print(f"warning: {printable(error)}", file=sys.stderr)

    def process_request(self, request: Any, client_address: Any) -> None:
        """Answer in a thread, unless there are too many of them."""
        if self._room_for.acquire(blocking=False):
            super().process_request(request, client_address)
        else:
            self.shutdown_request(request)

    def process_request_thread(self, request: Any, client_address: Any) -> None:
        """A thread of one connection."""
        try:
            super().process_request_thread(request, client_address)
        finally:
            self._room_for.release()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A client that goes away is nobody's fault."""
        if not isinstance(sys.exception(), ConnectionError | TimeoutError):
            super().handle_error(request, client_address)


LOOPBACK = ("127.0.0.1", "localhost", "[::1]")


def _is_loopback(host: str) -> bool:
    if host == "localhost":
        return True
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False


def _checked(address: str) -> str:
    """An address that people can type, with a slash in the end."""
    try:
        parts = urlsplit(address)
        whole = parts.scheme in ("http", "https") and parts.hostname and parts.path in ("", "/")
        whole = whole and parts.port != 0
    except ValueError:  # a bracket that is not closed, a port that is none
        parts, whole = urlsplit(""), False
    if address and (not whole or parts.query or parts.fragment or "@" in parts.netloc):
        raise OpenLockError(
            f"{address!r} is no address of a server; give one such as https://study.example.org, "
            "without a path: the page wants a host name of its own"
        )
    return f"{parts.scheme}://{parts.netloc.lower()}/" if address else ""


_ORIGIN = re.compile(r"https?://([^/?#@\s]+)")
_LENGTH = re.compile(r"[0-9]{1,4}")


class _Malformed(Exception):  # noqa: N818 - an answer to the page
    """This is no call that the page makes."""


class _Handler(BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    wbufsize = -1  # an answer leaves in one piece
    timeout = 75  # seconds that an idle connection is kept

    @property
    def home(self) -> PlayServer:
        return cast(PlayServer, self.server)

    @property
    def people(self) -> People:
        return self.home.people

    # -- HTTP -----------------------------------------------------------------------------------

    def do_GET(self) -> None:
        if "Content-Length" in self.headers:
            self.close_connection = True  # what follows would be taken for the next request
        if not self._is_clear():
            self._answer(HTTPStatus.BAD_REQUEST, {"error": "this is no call"})
        elif not self._is_meant_for_us():
            self._answer(HTTPStatus.FORBIDDEN, {"error": "this server has another name"})
        elif self.path in (page := static_files()):
            kind, content = page[self.path]
            self._send(HTTPStatus.OK, kind, content)
        elif self.path == "/brief":
            self._answer(HTTPStatus.OK, self._brief())
        elif room := re.fullmatch(r"/geometry/(\d{1,2})", self.path):
            self._call(lambda: geometry(int(room[1])))
        elif self.path == "/state":
            self._call(lambda: self.people.view(self._session()))
        else:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is nothing at this address"})

    def do_POST(self) -> None:
        calls: dict[str, Callable[[dict[str, Any]], Any]] = {
            "/join": lambda body: {"id": self.people.join()},
            "/proceed": lambda body: self.people.proceed(self._session(), _turn(body)),
            "/act": lambda body: self.people.act(
                self._session(), _turn(body), _action(body), _reaction(body)
            ),
        }
        body = self._body() if self._is_clear() else None
        call = calls.get(self.path)
        if not self._is_meant_for_us():
            self._answer(HTTPStatus.FORBIDDEN, {"error": "this server has another name"})
        elif call is None:
            self._answer(HTTPStatus.NOT_FOUND, {"error": "there is nothing at this address"})
        elif body is None:
            self._answer(HTTPStatus.BAD_REQUEST, {"error": "this is no call"})
        else:
            chosen, said = call, body
            self._call(lambda: chosen(said))

    def _is_clear(self) -> bool:
        """Whether everybody takes the request to end in the same place; if not, it is the last.

        Where a proxy and this server would disagree, what follows could be another's request.
        """
        heads = self.headers
        odd = heads.defects or heads.get_payload() or "Transfer-Encoding" in heads
        odd = odd or any("\n" in value or "\r" in value for value in heads.values())
        doubled = any(len(heads.get_all(name, [])) > 1 for name in ("Content-Length", "Host"))
        if odd or doubled:
            self.close_connection = True
        return not (odd or doubled)

    def _is_meant_for_us(self) -> bool:
        host = self.headers.get("Host", "")
        if self.home.loopback and host not in self.home.names:
            return False
        origin = self.headers.get("Origin")
        if origin is None:
            return True
        # A proxy may put its own name for us in the place of the host that the browser asked for.
        asked = _ORIGIN.fullmatch(origin)
        return asked is not None and asked[1] in (host, self.home.public)

    def _body(self) -> dict[str, Any] | None:
        """What was sent; ``None`` if that is no JSON object."""
        length = self.headers.get("Content-Length", "")
        if not _LENGTH.fullmatch(length) or int(length) > MOST_BYTES:
            self.close_connection = True  # what follows is not worth reading
            return None
        sent = self.rfile.read(int(length))
        try:
            body = json.loads(sent) if len(sent) == int(length) else None
        except (ValueError, RecursionError):
            return None
        return body if isinstance(body, dict) else None

    def _call(self, call: Callable[[], Any]) -> None:
        status: HTTPStatus
        try:
            status, answer = HTTPStatus.OK, call()
        except UnknownPerson as error:
            status, answer = HTTPStatus.NOT_FOUND, {"error": str(error)}
        except OutOfTurn as error:
            status, answer = HTTPStatus.CONFLICT, {"error": str(error), "now": error.now}
        except FullHouse as error:
            status, answer = HTTPStatus.TOO_MANY_REQUESTS, {"error": str(error)}
        except StoreError as error:  # a path of this machine is not the page's to know
            print(f"warning: {printable(error)}", file=sys.stderr)
            status = HTTPStatus.SERVICE_UNAVAILABLE
            answer = {"error": "this cannot be put on file now"}
        except (_Malformed, OpenLockError):
            status, answer = HTTPStatus.BAD_REQUEST, {"error": "this is no call"}
        self._answer(status, answer)

    def _answer(self, status: HTTPStatus, answer: Any) -> None:
        content = json.dumps(answer, separators=(",", ":")).encode()
        self._send(status, "application/json", content)

    def _send(self, status: HTTPStatus, kind: str, content: bytes) -> None:
        self.send_response(status)
        for name, value in HEADERS.items():
            self.send_header(name, value)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(content)

    # -- what is in a call ----------------------------------------------------------------------

    def _session(self) -> str:
        kind, _, name = self.headers.get("Authorization", "").partition(" ")
        if kind != "Bearer" or not name.isascii():
            raise UnknownPerson("there is no such session")
        return name

    def _brief(self) -> dict[str, Any]:
        experiment = self.people.experiment
        (entry,) = experiment.learners
        schemas = [schema for condition in experiment.conditions for schema in condition.schemas]
        return {
            "positions": max(map(positions_for, schemas)),
            "action_limit": max(map(entry.protocol.actions_for, schemas)),
            "attempt_limit": entry.protocol.attempt_limit,
            "practice": self.people.practice,
        }

    def version_string(self) -> str:
        return "causal-openlock"

    def log_message(self, format: str, *args: Any) -> None:
        """Who calls from where is nobody's business."""


def _whole(body: dict[str, Any], key: str, least: int, most: int) -> int:
    value = body.get(key)
    if type(value) is not int or not least <= value <= most:
        raise _Malformed
    return value


def _turn(body: dict[str, Any]) -> int:
    return _whole(body, "turn", 0, 2**31)


def _action(body: dict[str, Any]) -> int:
    return _whole(body, "action", 0, 255)


def _reaction(body: dict[str, Any]) -> int | None:
    if body.get("reaction") is None:
        return None
    return _whole(body, "reaction", 0, LONGEST_REACTION)
