"""The games of people, for agents that act through tools: a server of the Model Context Protocol.

An agent is told in words what a person sees (:mod:`causal_openlock.render.words`), with names and
in an order that are drawn for each subject, and has the tools ``look``, ``act`` and, where subjects
are asked for structures, ``explain``. What it does goes into the log and the record of
:class:`~causal_openlock.play.people.People`, as a person's clicks do.

Protocols since 2026 have no sessions, so a *subject* has a name: over HTTP it is the path of the
address, over stdio that of the process. Who comes back under a name continues its game, and there
is no way to begin it again.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any

from causal_openlock.contract.registry import registry
from causal_openlock.errors import LearnerError, OpenLockError, StoreError

try:
    import anyio
    import mcp_types as types
    from mcp.server.context import ServerRequestContext
    from mcp.server.lowlevel import Server
    from mcp.server.stdio import stdio_server
except ModuleNotFoundError as _missing:
    raise OpenLockError(
        f"serving agents needs the package {_missing.name}; install it with: pip install "
        "'causal-openlock[mcp]'"
    ) from None

from causal_openlock.experiment.protocol import NAME_FORM, NAME_IN_WORDS
from causal_openlock.experiment.session import Session
from causal_openlock.play.game import Game, Refused
from causal_openlock.play.people import People
from causal_openlock.play.recruiting import fault_of
from causal_openlock.play.web import WebServer, kept
from causal_openlock.render.words import Wording, feedback, room_now
from causal_openlock.version import __version__
from causal_openlock.wording import joined
from causal_openlock.world.randomness import generators

NAME = "name"  #: what a subject's row in recruited.csv has it under
LAST = "That was the last room. There is nothing left to do."
NOT_DONE = "Nothing was done."


class Subject:
    """One subject: its game, in its own words; a name that has been here continues.

    Raises:
        Refused: If no more subjects can join, or ``name`` can be no name.
        StoreError: If that cannot be written.
    """

    def __init__(self, people: People, name: str) -> None:
        fault = fault_of(name) if name.strip() else "is missing"
        if "/" in name:
            fault = "has a slash, and is one part of a path over HTTP"
        if fault:
            raise Refused(400, "", f"the name of a subject {fault}")
        self._people = people
        self._id = people.join(people.consent_mark, {NAME: name}, name)
        self.game: Game = people.game(self._id)
        cell, positions = self.game.cell, self.game.session.brief.positions
        (luck,) = generators(cell.seed, f"words/{cell.condition.name}", [cell.first_subject])
        self.words = Wording.draw(positions, luck)

    def tools(self) -> list[types.Tool]:
        """What it can call, with its own names of actions."""
        nodes = [self.words.nodes[place] for place in (*self.words.order, -1)]
        pair = _object(cause=_one_of(nodes[:-1]), effect=_one_of(nodes))
        tools = {
            "look": ("Read the rules, and how everything is now.", _object()),
            "act": ("Take one action.", _object(action=_one_of(self.words.choices))),
        }
        if self.game.ask:
            pairs = _object(enables={"type": "array", "items": pair})
            tools["explain"] = ("Say what enables what: all pairs that you believe in.", pairs)
        return [
            types.Tool(name=name, description=about, input_schema=schema)
            for name, (about, schema) in tools.items()
        ]

    def call(self, tool: str, given: dict[str, Any]) -> str:
        """What a tool answers; Refused or StoreError if nothing was done."""
        match tool, given:
            case "look", {**rest} if not rest:
                return self._look()
            case "act", {"action": str(action), **rest} if not rest:
                return self._act(action)
            case "explain", {"enables": list(pairs), **rest} if self.game.ask and not rest:
                return self._explain(pairs)
        raise Refused(400, "", f"There is no such call. {NOT_DONE}")

    def _look(self) -> str:
        brief = self.game.session.brief
        rules = self.words.instructions(brief.action_limit, brief.attempt_limit)
        self._watch()
        return "\n\n".join([rules, *self._film(), self._now()])

    def _act(self, action: str) -> str:
        if self.game.session.shown is not None:
            return f"{NOT_DONE}\n\n{self._look()}"
        if self.game.stage != "room":
            return f"{NOT_DONE}\n\n{self._now()}"
        index = self.words.read(action)
        if index is None:
            raise Refused(400, "", self.words.no_action)
        self._people.take(self._id, self.game.turn, action=index)
        step, room = self.game.step, self.game.stage == "room"
        assert step is not None
        told = feedback(self.words, step, 0, self.game.session.brief.trials, room=room)
        return told if room else f"{told}\n\n{self._now()}"

    def _explain(self, pairs: list[Any]) -> str:
        if self.game.stage != "question":
            raise Refused(409, "", f"There is no room to explain now. {NOT_DONE}")
        place = {name: number for number, name in enumerate(self.words.nodes)}
        try:
            edges = [(place[pair["cause"]], place[pair["effect"]]) for pair in pairs]
            self._people.take(self._id, self.game.turn, edges=edges)
        except (LookupError, TypeError, Refused):
            raise Refused(400, "", f"That is no list of such pairs. {NOT_DONE}") from None
        return self._now()

    def _watch(self) -> None:
        """Go through the rooms that are shown before its own."""
        while (shown := self.game.session.shown) is not None:
            self._people.take(self._id, self.game.turn, action=int(shown[0]))

    def _film(self) -> Iterator[str]:
        """What is done in these rooms; told as often as it looks."""
        if not self.game.session.shown_trials:
            return
        yield "You watch what somebody does who knows how."
        session = Session.of(self.game.cell)
        while (shown := session.shown) is not None:
            told = feedback(self.words, session.step(shown), 0, session.brief.trials)
            yield f"> {self.words.actions[int(shown[0])]}\n{told}"

    def _now(self) -> str:
        match self.game.stage:
            case "end":
                return LAST
            case "question":
                levers = joined([self.words.names[place] for place in self.game.view()["levers"]])
                only = f"It is {levers} that you are asked about; call the tool `explain`."
                return f"{self.words.question()}\n{only}"
        session = self.game.session
        return room_now(self.words, session.view, 0, session.brief.trials)


class Agents:
    """All subjects of a folder, as a server of the protocol.

    All requests are from the subject ``name``; without it, the path of each names its subject.
    """

    def __init__(self, people: People, name: str = "") -> None:
        self._people, self._name = people, name
        self._subjects: dict[str, Subject] = {}
        self.server: Server[Any] = Server(
            "openlock",
            version=__version__,
            instructions="Call the tool `look` first.",
            on_list_tools=self._list,
            on_call_tool=self._call,
        )

    def subject(self, name: str) -> Subject:
        """The subject of a name; refused as :class:`Subject` is."""
        if name not in self._subjects:
            self._subjects[name] = Subject(self._people, name)
        return self._subjects[name]

    def _asking(self, context: ServerRequestContext[Any, Any]) -> Subject:
        request: Any = context.request  # None over stdio
        return self.subject(self._name or request.path_params["name"])

    # Requests are answered one after the other: each takes some milliseconds, and of two calls by
    # one subject the second is told what there is after the first.

    async def _list(self, context: ServerRequestContext[Any, Any], _: Any) -> types.ListToolsResult:
        with suppress(Refused, StoreError):
            return types.ListToolsResult(tools=self._asking(context).tools())
        return types.ListToolsResult(tools=[])

    async def _call(
        self, context: ServerRequestContext[Any, Any], asked: types.CallToolRequestParams
    ) -> types.CallToolResult:
        try:
            text, failed = self._asking(context).call(asked.name, asked.arguments or {}), False
        except Refused as error:
            text, failed = str(error), True
        except StoreError:
            text, failed = f"This cannot be saved now. {NOT_DONE}", True
        return types.CallToolResult(
            content=[types.TextContent(type="text", text=text)], is_error=failed
        )


def options_of(label: str, seed: int, ask: bool) -> dict[str, Any]:
    """How agents play, as options of :class:`~causal_openlock.play.people.People`.

    Raises:
        LearnerError: If a learner has that name, beside which the agent is to stand.
    """
    if label in registry() or not re.fullmatch(NAME_FORM, label):
        raise LearnerError(
            f"{label[:80]!r} cannot be an agent's name; choose {NAME_IN_WORDS}, and no learner's"
        )
    return {"agent": label, "seed": seed, "ask": ask, "practice": False, "recruiting": (NAME,)}


def serve_stdio(people: People, name: str) -> None:
    """Serve one subject on standard input and output, until these end."""
    agents = Agents(people, name)
    try:
        agents.subject(name)
    except Refused as error:  # before anything is served
        raise OpenLockError(str(error)) from None
    server = agents.server

    async def run() -> None:
        async with stdio_server() as (read, write):
            await server.run(read, write, server.create_initialization_options())

    with kept(people):
        anyio.run(run)


def http_server(people: People, port: int = 0) -> WebServer:
    """A server on loopback; each path ``/NAME`` of its address is a subject."""
    app = Agents(people).server.streamable_http_app(streamable_http_path="/{name}")
    return WebServer(people, app, port=port)


def _one_of(names: Sequence[str]) -> dict[str, Any]:
    return {"type": "string", "enum": list(names)}


def _object(**properties: Any) -> dict[str, Any]:
    return {
        "type": "object",
        "properties": properties,
        "required": [*properties],
        "additionalProperties": False,
    }
