"""The server: one page, and a handful of requests that answer its clicks.

=========================  =======================================================================
``GET /`` and its files    the page
``GET /brief``             budgets, for the instructions
``GET /geometry/7``        where things are in a room of seven levers
``POST /join``             ``{"id", "agreed", "recruited"}``: start a session under an id that the
                           page has drawn; answers it
``GET /state``             what the person may know now
``POST /turn``             ``{"turn", "action", "reaction", "edges"}``: act, or say which lever
                           enables which, or with neither leave the practice room
=========================  =======================================================================

A session id travels as ``Authorization: Bearer ID``, which no other site's page can send. Status
404 answers unknown sessions and addresses, 409 requests that are out of turn (with the state as it
is), 400 requests that the page never makes. None of these changes anything.

Starlette routes the requests and uvicorn speaks HTTP; the work for a request is done in a thread,
so that no click waits until another one is written. By default the server listens on
loopback, and then refuses requests under another name than this machine's own: those of a
foreign page whose host name was made to point here. Behind a reverse proxy it also accepts the
address that people use, which it has to be given.
"""

from __future__ import annotations

import mimetypes
import socket
import sys
import threading
from collections.abc import Callable
from typing import Annotated, Any, TypeVar
from urllib.parse import urlsplit

from pydantic import Field, ValidationError

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
from starlette.convertors import IntegerConvertor, register_url_convertor
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from causal_openlock.files.escaping import printable
from causal_openlock.files.validation import StrictModel
from causal_openlock.play.game import Answer, Refused
from causal_openlock.play.log import Move
from causal_openlock.play.pages import as_html, geometry
from causal_openlock.play.people import People
from causal_openlock.play.recruiting import completion as checked_completion
from causal_openlock.play.recruiting import filled, web_page
from causal_openlock.world.room import positions_for

MOST_BYTES = 4096  # in the body of a request; three long identifiers have room
KEEP_EVERY = 10.0  # seconds between two writings of the record; the log has every click at once
KEEP_PAUSE = 0.05  # seconds between the records of two people, in which clicks are answered
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
LOOPBACK = ("127.0.0.1", "localhost")
mimetypes.add_type("text/javascript", ".js")  # Windows can say text/plain, which is not run


class PlayServer:
    """Serves the page to the people of one results folder.

    Args:
        people: The people who play.
        host: Address to listen on.
        port: Port to listen on; 0 for any that is free.
        completion: Where people go when they have finished, such as the page of a recruiting
            service; ``%NAME%`` in it stands for an identifier. The page has it only at the end.
        address: What people type, such as ``https://study.example.org``, if a reverse proxy passes
            their requests on; empty without one.
        changed: Called soon after somebody has joined or finished.

    Raises:
        OpenLockError: If it cannot listen there, or an address is invalid.
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
        self.completion = checked_completion(completion, people.recruiting)
        self.address = _checked(address)
        self._socket = _listening(host, port)
        self.host, self.port = host, int(self._socket.getsockname()[1])
        self.loopback = host in LOOPBACK
        self._stopped = threading.Event()
        self._server = uvicorn.Server(
            uvicorn.Config(
                self._application(),
                ws="none",
                lifespan="off",
                log_config=None,
                log_level="error",  # addresses are not logged
                access_log=False,
                server_header=False,
                headers=[*HEADERS.items()],
                timeout_graceful_shutdown=2,
            )
        )

    @property
    def url(self) -> str:
        """Address of the page, for this machine."""
        host = "127.0.0.1" if self.host == "0.0.0.0" else self.host
        return f"http://{host}:{self.port}/"

    def serve_forever(self) -> None:
        """Serve until :meth:`shutdown`, SIGINT or SIGTERM; then people can be closed."""
        keeper = threading.Thread(target=self._keep, name="keeper", daemon=True)
        keeper.start()
        try:
            self._server.run(sockets=[self._socket])
        finally:
            self._stopped.set()
            self._socket.close()
            keeper.join()

    def shutdown(self) -> None:
        """Make :meth:`serve_forever` return soon; for another thread."""
        self._server.should_exit = True

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
            except RuntimeError:  # Python ends: closing people writes what is left
                if threading.main_thread().is_alive():
                    raise
                return

    # -- what is answered -----------------------------------------------------------------------

    def _application(self) -> Starlette:
        people, public = self.people, urlsplit(self.address)
        names = [*LOOPBACK, public.hostname or self.host] if self.loopback else ["*"]
        app = Starlette(
            routes=[
                _get("/brief", lambda request: self._brief()),
                _get("/geometry/{of:size}", lambda request: geometry(request.path_params["of"])),
                _get("/state", lambda request: self._told(request, people.view(_session(request)))),
                _post("/join", _Join, lambda request, sent: {
                    "id": people.join(sent.agreed, sent.recruited, sent.id)}),
                _post("/turn", Move, self._turn),
                Mount("/", StaticFiles(packages=[("causal_openlock.play", "static")], html=True)),
            ],
            middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=names, www_redirect=False)],
            exception_handlers=dict.fromkeys(
                (OpenLockError, ClientDisconnect, HTTPException), self._refused
            ),
        )  # fmt: skip
        app.state.public = public.netloc
        return app

    def _brief(self) -> dict[str, Any]:
        experiment = self.people.experiment
        (entry,) = experiment.learners
        schemas = [schema for condition in experiment.conditions for schema in condition.schemas]
        return {
            "positions": max(map(positions_for, schemas)),
            "action_limits": sorted({*map(entry.protocol.actions_for, schemas)}),
            "attempt_limit": entry.protocol.attempt_limit,
            "practice": self.people.practice,
            "consent": as_html(self.people.consent),
            "consent_mark": self.people.consent_mark,
            "recruiting": self.people.recruiting,
        }

    def _turn(self, request: Request, sent: Move) -> Answer:
        return self._told(request, self.people.take(_session(request), **dict(sent)))

    def _told(self, request: Request, said: Answer) -> Answer:
        """What a person may know now; the link, which may be worth money, only at the end."""
        if "next" in said:
            return {**said, "next": self._told(request, said["next"])}
        if self.completion and said["stage"] == "end":
            identifiers = self.people.identifiers(_session(request))
            return {**said, "completion": filled(self.completion, identifiers)}
        return said

    async def _refused(self, request: Request, error: Exception) -> Response:
        if isinstance(error, HTTPException):
            return JSONResponse({"error": "there is nothing at this address"}, error.status_code)
        if isinstance(error, Refused):
            if error.advice:
                _warn(error.advice)
            said: Answer = {"title": error.title, "error": str(error)}
            if error.now:
                said["now"] = self._told(request, error.now)
            return JSONResponse(said, error.status)
        if isinstance(error, StoreError):
            _warn(error)  # the page need not know paths of this machine
            return JSONResponse({"error": "this cannot be saved now"}, 503)
        return _invalid()


def _checked(address: str) -> str:
    """An address that people can type, with a slash in the end."""
    parts = web_page(address)
    whole = parts and parts.path in ("", "/") and not (parts.query or parts.fragment)
    if address and not (whole and "@" not in address):
        raise OpenLockError(
            f"{address!r} is not an address of a server; give one such as "
            "https://study.example.org, without a path: the page needs a host name of its own"
        )
    return f"{parts.scheme}://{parts.netloc.lower()}/" if parts else ""


def _listening(host: str, port: int) -> socket.socket:
    try:
        return socket.create_server((host, port), backlog=256)
    except OSError as error:
        raise OpenLockError(
            f"cannot listen on {host}, port {port} ({error.strerror or error}); choose another "
            "with --host or --port"
        ) from None


# -- requests -------------------------------------------------------------------------------------


class _Size(IntegerConvertor):
    regex = "[0-9]{1,2}"  # Python refuses to convert thousands of digits


register_url_convertor("size", _Size())


class _Join(StrictModel):
    agreed: Annotated[str, Field(pattern="^(?:[0-9a-f]{16})?$")] = ""
    recruited: dict[str, str] = Field({}, max_length=3)
    id: Annotated[str, Field(pattern="^(?:[A-Za-z0-9_-]{32})?$")] = ""


Sent = TypeVar("Sent", bound=StrictModel)


def _get(path: str, work: Callable[[Request], Any]) -> Route:
    async def answer(request: Request) -> Response:
        return JSONResponse(await run_in_threadpool(work, request))

    return Route(path, answer, methods=["GET"])


def _post(path: str, kind: type[Sent], work: Callable[[Request, Sent], Any]) -> Route:
    async def answer(request: Request) -> Response:
        if not _is_ours(request):
            return JSONResponse({"error": "this is the page of another server"}, 403)
        if int(request.headers.get("content-length", MOST_BYTES + 1)) > MOST_BYTES:
            return _invalid()
        try:
            sent = kind.model_validate_json(await request.body())
        except ValidationError:
            return _invalid()
        return JSONResponse(await run_in_threadpool(work, request, sent))

    return Route(path, answer, methods=["POST"])


def _is_ours(request: Request) -> bool:
    """Whether a request comes from this server's own page, if the browser says from which."""
    origin = request.headers.get("origin")
    # A proxy may put its own name for us in the place of the host that the browser asked for.
    ours = request.headers.get("host"), request.app.state.public
    return origin is None or (web_page(origin) is not None and urlsplit(origin).netloc in ours)


def _invalid() -> Response:
    return JSONResponse({"error": "invalid request"}, 400)


def _warn(error: Exception | str) -> None:
    print(f"warning: {printable(error)}", file=sys.stderr)


def _session(request: Request) -> str:
    """The session id of a request; a wrong one is nobody's."""
    kind, _, name = request.headers.get("authorization", "").partition(" ")
    return name if kind == "Bearer" else ""
