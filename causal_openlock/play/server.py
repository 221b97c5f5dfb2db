"""The server: one page, and a handful of requests that answer its clicks.

=========================  =======================================================================
``GET /`` and its files    the page
``GET /brief``             budgets, for the instructions, and where things are in rooms
``POST /join``             ``{"agreed", "recruited"}``: start a session, whose id the page has
                           drawn; answers as ``/state`` does
``GET /state``             what the person may know now
``POST /turn``             ``{"turn", "action", "reaction", "edges"}``: act, or say which lever
                           enables which, or with neither leave the practice room
=========================  =======================================================================

A session id travels as ``Authorization: Bearer ID``, which no other site's page can send, and
nothing changes without one. Status 404 answers unknown sessions and addresses, 409 requests that
are out of turn (with the state as it is), 400 requests that the page never makes. None of these
changes anything.

Starlette routes the requests and uvicorn speaks HTTP; the work for a request is done in a thread.
By default the server listens on loopback, and then refuses requests under another name than this
machine's own: those of a foreign page whose host name was made to point here. Behind a reverse
proxy it also accepts the address that people use, which it has to be given.
"""

from __future__ import annotations

import mimetypes
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Annotated, Any, TypeVar
from urllib.parse import quote, urlsplit

from markdown_it import MarkdownIt
from pydantic import Field, HttpUrl, ValidationError

from causal_openlock.errors import OpenLockError, StoreError

try:
    from causal_openlock.play.web import LOOPBACK, WebServer, warn
except ModuleNotFoundError as _missing:
    raise OpenLockError(
        f"playing needs the package {_missing.name}; install it with: pip install "
        "'causal-openlock[play]'"
    ) from None
from starlette.applications import Starlette
from starlette.concurrency import run_in_threadpool
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, Response
from starlette.routing import Mount, Route
from starlette.staticfiles import StaticFiles

from causal_openlock.files.validation import StrictModel, adapter
from causal_openlock.physics.geometry import BAR_LENGTH, BAR_WIDTH, DOOR_SWING, HANDLE, RoomGeometry
from causal_openlock.play.game import PRACTICE, Answer, Refused
from causal_openlock.play.log import Move
from causal_openlock.play.people import People
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import position_names, positions_for

MOST_BYTES = 4096  # in the body of a request; three long identifiers have room
HEADERS = {
    "Content-Security-Policy": (
        "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
        "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-store",
}
mimetypes.add_type("text/javascript", ".js")  # Windows can say text/plain, which is not run


class PlayServer(WebServer):
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
        self.completion = completion_page(completion, people.recruiting)
        self.address = public_address(address)
        self.host, self.loopback = host, host in LOOPBACK
        super().__init__(people, self._application(people), host, port, HEADERS, changed)

    # -- what is answered -----------------------------------------------------------------------

    def _application(self, people: People) -> Starlette:
        public = urlsplit(self.address).hostname or self.host
        names = [*LOOPBACK, public] if self.loopback else ["*"]
        answered = (OpenLockError, ValidationError, ClientDisconnect, HTTPException)
        return Starlette(
            routes=[
                _get("/brief", lambda _: self._brief()),
                _get("/state", lambda person: self._told(person, people.view(person))),
                _post("/join", _Join, self._join),
                _post("/turn", Move, self._turn),
                Mount("/", StaticFiles(packages=[("causal_openlock.play", "static")], html=True)),
            ],
            middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=names, www_redirect=False)],
            exception_handlers=dict.fromkeys(answered, self._refused),
        )

    def _brief(self) -> dict[str, Any]:
        markdown = MarkdownIt("commonmark", {"html": False})  # what is HTML is shown as written
        experiment = self.people.experiment
        (entry,) = experiment.learners
        schemas = [schema for condition in experiment.conditions for schema in condition.schemas]
        sizes = {*map(positions_for, [PRACTICE, *schemas])}
        return {
            "positions": max(map(positions_for, schemas)),
            "geometry": {size: geometry(size) for size in sizes},
            "action_limits": sorted({*map(entry.protocol.actions_for, schemas)}),
            "attempt_limit": entry.protocol.attempt_limit,
            "practice": self.people.practice,
            "consent": markdown.render(self.people.consent),
            "consent_mark": self.people.consent_mark,
            "recruiting": self.people.recruiting,
        }

    def _join(self, person: str, sent: _Join) -> Answer:
        self.people.join(sent.agreed, sent.recruited, adapter(SessionId).validate_python(person))
        return self._told(person, self.people.view(person))

    def _turn(self, person: str, sent: Move) -> Answer:
        return self._told(person, self.people.take(person, **dict(sent)))

    def _told(self, person: str, said: Answer) -> Answer:
        """What a person may know now; the link, which may be worth money, only at the end."""
        now = said.get("next", said)
        if self.completion and now["stage"] == "end":
            now["completion"] = filled(self.completion, self.people.identifiers(person))
        return said

    async def _refused(self, request: Request, error: Exception) -> Response:
        if isinstance(error, HTTPException):
            return JSONResponse({"error": "there is nothing at this address"}, error.status_code)
        if isinstance(error, Refused):
            if error.advice:
                warn(error.advice)
            said: Answer = {"title": error.title, "error": str(error)}
            if error.now:
                said["now"] = self._told(_session(request), error.now)
            return JSONResponse(said, error.status)
        if isinstance(error, StoreError):
            warn(error)  # the page need not know paths of this machine
            return JSONResponse({"error": "this cannot be saved now"}, 503)
        return JSONResponse({"error": "invalid request"}, 400)


# -- requests -------------------------------------------------------------------------------------

SessionId = Annotated[str, Field(pattern="^[A-Za-z0-9_-]{32}$")]


class _Join(StrictModel):
    agreed: Annotated[str, Field(pattern="^(?:[0-9a-f]{16})?$")] = ""
    recruited: dict[str, str] = Field({}, max_length=3)


Sent = TypeVar("Sent", bound=StrictModel)


def _get(path: str, work: Callable[[str], Any]) -> Route:
    return Route(path, lambda request: JSONResponse(work(_session(request))))


def _post(path: str, kind: type[Sent], work: Callable[[str, Sent], Any]) -> Route:
    async def answer(request: Request) -> Response:
        if int(request.headers.get("content-length", MOST_BYTES + 1)) > MOST_BYTES:
            raise OpenLockError("no request of the page is as long")
        sent = kind.model_validate_json(await request.body())
        return JSONResponse(await run_in_threadpool(work, _session(request), sent))

    return Route(path, answer, methods=["POST"])


def _session(request: Request) -> str:
    """The session id of a request; a wrong one is nobody's."""
    kind, _, session_id = request.headers.get("authorization", "").partition(" ")
    return session_id if kind == "Bearer" else ""


# -- what the page is told, and where people come from and go -------------------------------------


def geometry(positions: int) -> dict[str, Any]:
    """Geometry of a room of some size, as the page needs it; it holds nothing latent.

    See :class:`~causal_openlock.physics.geometry.RoomGeometry`.
    """
    facts = room_facts()
    return {
        **asdict(RoomGeometry.of(positions)),
        "names": [_in_words(name) for name in position_names(positions)],
        "bar_length": BAR_LENGTH,
        "bar_width": BAR_WIDTH,
        "track_width": facts["track"]["width"],
        "button_side": facts["button"]["side"],
        "swing": DOOR_SWING,
        "handle": HANDLE,
    }


def _in_words(name: str) -> str:
    """``UPPERRIGHT`` in words: ``upper right``."""
    if not name.isalpha():
        return f"number {int(name[1:]) + 1}"
    return re.sub(r"^(upper|lower)\B", r"\1 ", name.lower())


def completion_page(address: str, names: Sequence[str]) -> str:
    """The address of the page of completion, if it is one.

    Raises:
        OpenLockError: If it is not, or has a placeholder that no identifier fills in.
    """
    example = filled(address, dict.fromkeys(names, "x"))
    if address and not _web_page(example):
        raise OpenLockError(
            f"{address!r} is not an address of a page; give one such as "
            "https://app.prolific.com/submissions/complete?cc=C0DE"
        )
    if left := re.search(r"[{}<>]|%(?![0-9a-fA-F]{2})\w*%?", example):
        raise OpenLockError(
            f"--completion {address} has {left[0]}, which nothing fills in; %NAME% is filled in "
            "with the identifier NAME of --recruiting, and a percent sign is written %25"
        )
    return address


def filled(address: str, identifiers: Mapping[str, str]) -> str:
    """An address with a person's identifiers in the place of their names.

    >>> filled("https://a.org/?code=%PID%", {"PID": "a&b"})
    'https://a.org/?code=a%26b'
    """
    for name, value in identifiers.items():
        address = address.replace(f"%{name}%", quote(value, safe=""))
    return address


def public_address(address: str) -> str:
    """An address that people can type, with a slash at its end; empty without one.

    Raises:
        OpenLockError: If it is not the address of a whole server.

    >>> public_address("https://Study.example.org")
    'https://study.example.org/'
    """
    url = _web_page(address)
    whole = url and url.path == "/" and not (url.query or url.fragment or url.username)
    if address and not whole:
        raise OpenLockError(
            f"{address!r} is not an address of a server; give one such as "
            "https://study.example.org, without a path: the page needs a host name of its own"
        )
    return str(url or "")


def _web_page(address: str) -> HttpUrl | None:
    """An address of a page; None if it is not one."""
    try:
        url: HttpUrl = adapter(HttpUrl).validate_python(address)
    except ValidationError:
        return None
    return url
