"""The server: one page, and a handful of requests that answer its clicks.

=========================  =======================================================================
``GET /`` and its files    the page
``GET /brief``             budgets, for the instructions
``GET /geometry/7``        where things are in a room of seven levers
``POST /join``             ``{"id", "agreed", "recruited"}``: start a session under an id that the
                           page has drawn; answers it
``GET /state``             what the person may know now
``POST /proceed``          ``{"turn"}``: leave the practice room
``POST /act``              ``{"turn", "action", "reaction"}``: act; reaction in milliseconds or null
=========================  =======================================================================

A session id travels as ``Authorization: Bearer ID``, which no other site's page can send. Status
404 answers unknown sessions and addresses, 409 requests that are out of turn (with the state as it
is), 400 requests that the page never makes, and others what is in
:mod:`~causal_openlock.play.refusals`. None of these changes anything.

Starlette routes the requests and uvicorn speaks HTTP; the work for a request is done in a thread,
so that no click waits until another one is written. By default the server listens on
loopback, and then refuses requests under another name than this machine's own: those of a
foreign page whose host name was made to point here. Behind a reverse proxy it also accepts the
address that people use, which it has to be given.
"""

from __future__ import annotations

import re
import socket
import sys
import threading
from collections.abc import Callable
from functools import lru_cache
from ipaddress import ip_address
from typing import Annotated, Any, TypeVar
from urllib.parse import urlsplit

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from causal_openlock.errors import OpenLockError, StoreError

try:
    import uvicorn
    from starlette.applications import Starlette
except ModuleNotFoundError as _missing:
    raise OpenLockError(
        f"playing needs the package {_missing.name}; install it with: pip install "
        "'causal-openlock[play]'"
    ) from None
from starlette.concurrency import run_in_threadpool
from starlette.datastructures import Headers
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Route
from starlette.types import Receive, Scope, Send

from causal_openlock.files.escaping import printable
from causal_openlock.play.connections import IDLE, MOST_CONNECTIONS, Connection
from causal_openlock.play.game import Answer
from causal_openlock.play.pages import as_html, geometry, static_files
from causal_openlock.play.people import People
from causal_openlock.play.refusals import OutOfTurn, Refused, UnknownPerson
from causal_openlock.world.room import positions_for

MOST_BYTES = 4096
"""The longest body of a request; three long identifiers have room."""
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
ANOTHER_NAME = "this server has another name; its name is given with --address"
LOOPBACK = ("127.0.0.1", "localhost", "[::1]")
ORIGIN = re.compile(r"https?://([^/?#@\s]+)")


class PlayServer:
    """Serves the page to the people of one results folder.

    Args:
        people: The people who play.
        host: Address to listen on.
        port: Port to listen on; 0 for any that is free.
        completion: Where people go when they have finished, such as the page of a recruiting
            service; empty for nowhere. The page has it only at the end.
        address: What people type, such as ``https://study.example.org``, if a reverse proxy passes
            their requests on; empty without one.
        changed: Called soon after somebody has joined or finished.

    Raises:
        OpenLockError: If it cannot listen there, or the address is invalid.
    """

    def __init__(
        self,
        people: People,
        host: str = "127.0.0.1",
        port: int = 0,
        address: str = "",
        completion: str = "",
        changed: Callable[[], None] = lambda: None,
    ) -> None:
        self.people, self._changed = people, changed
        self.completion = _completion(completion)
        self.address = _checked(address)
        self._socket = _listening(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        self.loopback = _is_loopback(host)
        names = (*LOOPBACK, host, f"[{host}]")
        self._names = {f"{name}:{self.port}" for name in names}
        if self.port == 80:  # which browsers leave out
            self._names.update(names)
        self._public = urlsplit(self.address).netloc
        if self._public:
            self._names.add(self._public)
        self._stopped = threading.Event()
        self._keeper = threading.Thread(target=self._keep, name="keeper", daemon=True)
        # What happens to one participant may happen to all, and again and again.
        self._warn_once = lru_cache(maxsize=100)(_warn)
        self._app = self._starlette()
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._guarded,
                interface="asgi3",
                http=Connection,
                ws="none",
                loop="asyncio",
                lifespan="off",
                log_config=None,
                log_level="error",  # addresses are not logged
                access_log=False,
                proxy_headers=False,
                server_header=False,
                headers=[*HEADERS.items()],
                limit_concurrency=MOST_CONNECTIONS + 1,  # it refuses from this number on
                timeout_keep_alive=IDLE,
                timeout_graceful_shutdown=2,
            )
        )

    @property
    def url(self) -> str:
        """Address of the page, for this machine."""
        host = {"0.0.0.0": "127.0.0.1", "": "127.0.0.1", "::": "[::1]"}.get(self.host, self.host)
        return f"http://{f'[{host}]' if ':' in host and '[' not in host else host}:{self.port}/"

    def serve_forever(self) -> None:
        """Serve until :meth:`shutdown`, SIGINT or SIGTERM."""
        self._keeper.start()
        self._server.run(sockets=[self._socket])

    def shutdown(self) -> None:
        """Make :meth:`serve_forever` return soon; for another thread."""
        self._server.should_exit = True

    def finish(self) -> None:
        """Stop listening, write the record and release the folder."""
        self._stopped.set()
        self._socket.close()
        if self._keeper.is_alive():
            self._keeper.join()
        self.people.close()

    def _keep(self) -> None:
        # The first time at once: a server that was killed may have left something to write.
        waited, ended_only = KEEP_EVERY, False
        before = self.people.number, self.people.finished
        while not self._stopped.wait(1.0):
            waited += 1.0
            now = self.people.number, self.people.finished
            if now != before:
                self._changed()
            before = now
            try:
                self.people.sync()
                if waited >= KEEP_EVERY:
                    self.people.keep(KEEP_PAUSE, ended_only)
                    waited, ended_only = 0.0, True
            except (OpenLockError, OSError) as error:
                _warn(error)
            except RuntimeError:  # Python ends: `finish` writes what is left
                if threading.main_thread().is_alive():
                    raise
                return

    # -- which requests are accepted ------------------------------------------------------------

    async def _guarded(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request if it is clear where it ends and that it is meant for this server."""
        headers = Headers(scope=scope)
        if not _is_clear(scope["method"], headers):
            answer: Any = _invalid()
        elif not self._is_meant_for_us(headers):
            answer = JSONResponse({"error": ANOTHER_NAME}, 403)
        else:
            answer = self._app
        await answer(scope, receive, send)

    def _is_meant_for_us(self, headers: Headers) -> bool:
        host = headers.get("host", "")
        if self.loopback and host not in self._names:
            return False
        origin = headers.get("origin")
        if origin is None:
            return True
        # A proxy may put its own name for us in the place of the host that the browser asked for.
        asked = ORIGIN.fullmatch(origin)
        return asked is not None and asked[1] in (host, self._public)

    # -- what is answered -----------------------------------------------------------------------

    def _starlette(self) -> Starlette:
        people = self.people
        app = Starlette(
            routes=[
                *(_file(path, *file) for path, file in static_files().items()),
                _get("/brief", lambda request: self._brief()),
                _get("/geometry/{size}", lambda request: geometry(_size(request))),
                _get("/state", lambda request: self._told(people.view(_session(request)))),
                _post("/join", _Join, lambda request, sent: {
                    "id": people.join(sent.agreed, sent.recruited, sent.id)}),
                _post("/answer", _Answer, lambda request, sent: self._told(people.answer(
                    _session(request), sent.turn, sent.edges))),
                _post("/proceed", _Turn, lambda request, sent: self._told(people.proceed(
                    _session(request), sent.turn))),
                _post("/act", _Action, lambda request, sent: self._after(people.act(
                    _session(request), sent.turn, sent.action, sent.reaction))),
            ],
            exception_handlers=dict.fromkeys(
                (OpenLockError, ClientDisconnect, HTTPException), self._refused
            ),
        )  # fmt: skip
        app.router.redirect_slashes = False
        return app

    def _brief(self) -> dict[str, Any]:
        experiment = self.people.experiment
        (entry,) = experiment.learners
        schemas = [schema for condition in experiment.conditions for schema in condition.schemas]
        return {
            "positions": max(map(positions_for, schemas)),
            "action_limit": max(map(entry.protocol.actions_for, schemas)),
            "attempt_limit": entry.protocol.attempt_limit,
            "practice": self.people.practice,
            "consent": as_html(self.people.consent),
            "consent_mark": self.people.consent_mark,
            "recruiting": self.people.recruiting,
        }

    def _told(self, now: Answer) -> Answer:
        """State that a person may know now; the link, which may be worth money, only at the end."""
        if self.completion and now["stage"] == "end":
            return {**now, "completion": self.completion}
        return now

    def _after(self, answer: Answer) -> Answer:
        """Result of an action, with the state that the person may know then."""
        return {**answer, "next": self._told(answer["next"])}

    async def _refused(self, request: Request, error: Exception) -> Response:
        match error:
            case HTTPException():
                return JSONResponse({"error": "there is nothing at this address"}, 404)
            case Refused():
                if error.advice:
                    self._warn_once(error.advice)
                said: Answer = {"error": str(error), "why": type(error).__name__}
                if isinstance(error, OutOfTurn):
                    said["now"] = self._told(error.now)
                return JSONResponse(said, error.status)
            case StoreError():
                _warn(error)  # the page need not know paths of this machine
                return JSONResponse({"error": "this cannot be saved now"}, 503)
        return _invalid()


# -- where to listen ------------------------------------------------------------------------------


def _listening(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    # asyncio sends at once only where the socket says that it is TCP.
    listener = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    try:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind((host, port))
        listener.listen(256)
    except OSError as error:
        listener.close()
        raise OpenLockError(
            f"cannot listen on {host}, port {port} ({error.strerror or error}); choose another "
            "with --host or --port"
        ) from None
    return listener


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
    except ValueError:  # a bracket that is not closed, an invalid port
        parts, whole = urlsplit(""), False
    if address and (not whole or parts.query or parts.fragment or "@" in parts.netloc):
        raise OpenLockError(
            f"{address!r} is not an address of a server; give one such as "
            "https://study.example.org, without a path: the page needs a host name of its own"
        )
    return f"{parts.scheme}://{parts.netloc.lower()}/" if address else ""


def _completion(address: str) -> str:
    """Address to which people go when they have finished; it must be a web page."""
    try:
        parts = urlsplit(address)
        whole = parts.scheme in ("http", "https") and bool(parts.hostname)
    except ValueError:
        whole = False
    if address and not whole:
        raise OpenLockError(
            f"{address!r} is not an address of a page; give one such as "
            "https://app.prolific.com/submissions/complete?cc=C0DE"
        )
    return address


# -- answers --------------------------------------------------------------------------------------


def _file(path: str, kind: str, content: bytes) -> Route:
    async def answer(request: Request) -> Response:
        return Response(content, media_type=kind)

    return Route(path, answer)


def _get(path: str, work: Callable[[Request], Any]) -> Route:
    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(work, request))

    return Route(path, answer, methods=["GET"])


def _post(path: str, kind: type[Sent], work: Callable[[Request, Sent], Any]) -> Route:
    async def answer(request: Request) -> Response:
        try:
            sent = kind.model_validate_json(await request.body())
        except ValidationError:
            return _invalid()
        return JSONResponse(await run_in_threadpool(work, request, sent))

    return Route(path, answer, methods=["POST"])


def _invalid() -> Response:
    """The answer to what the page never sends; nothing more is read from this connection."""
    return JSONResponse({"error": "invalid request"}, 400, {"Connection": "close"})


def _warn(error: Exception | str) -> None:
    print(f"warning: {printable(error)}", file=sys.stderr)


# -- what is in a request -------------------------------------------------------------------------


class _Body(BaseModel):
    """The body of a request: a JSON object."""

    model_config = ConfigDict(strict=True)


class _Join(_Body):
    agreed: Annotated[str, Field(pattern="^(?:[0-9a-f]{16})?$")] = ""
    recruited: Annotated[dict[str, str], Field(max_length=3)] = {}
    id: Annotated[str, Field(pattern="^(?:[A-Za-z0-9_-]{32})?$")] = ""


class _Turn(_Body):
    turn: Annotated[int, Field(ge=0, le=2**31)]


class _Answer(_Turn):
    edges: Annotated[
        list[Annotated[list[int], Field(min_length=2, max_length=2)]], Field(max_length=200)
    ]


class _Action(_Turn):
    action: Annotated[int, Field(ge=0, le=255)]
    reaction: Annotated[int, Field(ge=0, le=LONGEST_REACTION)] | None = None


Sent = TypeVar("Sent", bound=_Body)


def _is_clear(method: str, headers: Headers) -> bool:
    """Whether a proxy and this server agree on where the request ends, and it is not too long.

    If they did not, what follows could be another person's request.
    """
    if "transfer-encoding" in headers:
        return False
    if method != "POST":
        return "content-length" not in headers
    return int(headers.get("content-length", MOST_BYTES + 1)) <= MOST_BYTES


def _session(request: Request) -> str:
    kind, _, name = request.headers.get("authorization", "").partition(" ")
    if kind != "Bearer" or not name.isascii():
        raise UnknownPerson("there is no such session")
    return name


def _size(request: Request) -> int:
    if not re.fullmatch("[0-9]{1,2}", request.path_params["size"]):
        raise HTTPException(404)
    return int(request.path_params["size"])
