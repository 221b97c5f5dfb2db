"""Rooms for a browser or for agents, served from a notebook or a script that keeps running."""

from __future__ import annotations

import atexit
import threading
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from causal_openlock.experiment.condition import Condition, Trials, find_condition
from causal_openlock.experiment.protocol import find_protocol
from causal_openlock.files.validation import whole_number
from causal_openlock.play.people import People
from causal_openlock.play.server import PlayServer
from causal_openlock.play.web import WebServer
from causal_openlock.schemas.finding import schema as declared


class OpenedRoom(ExitStack):
    """Rooms that are open until :meth:`close`, or until Python ends.

    Closing stops the server and completes the record; a temporary folder is deleted.

    Attributes:
        url: Where it is, for this machine.
        folder: Where what people do is kept.
    """

    def __init__(
        self,
        out: Path | str | None,
        conditions: Sequence[Condition],
        protocol: str,
        server_of: Callable[[People], WebServer],
        **options: Any,
    ) -> None:
        # Records are written with it, and when Python ends it can no longer be imported.
        import pandas  # noqa: F401

        super().__init__()
        # What is entered and called here is left and called in reverse order when it is closed.
        if out is None:
            out = self.enter_context(TemporaryDirectory(prefix="causal_openlock_"))
        people = self.enter_context(
            closing(People(out, conditions, find_protocol(protocol), **options))
        )
        server = server_of(people)
        self.url, self.folder = server.url, people.store.folder
        self._thread = threading.Thread(target=server.serve_forever, daemon=True)
        self._thread.start()
        self.callback(self._thread.join)
        self.callback(server.shutdown)
        self.callback(atexit.unregister, atexit.register(self.close))

    def __repr__(self) -> str:
        return f"<OpenedRoom{f' at {self.url}' if self._thread.is_alive() else ', closed'}>"


def serve(
    *conditions: Any,
    label: str = "agent",
    out: Path | str | None = None,
    protocol: str = "human",
    seed: int = 0,
    ask: bool = False,
) -> OpenedRoom:
    """Serve rooms to agents on this machine, as tools of the Model Context Protocol.

    Each path of the address, such as ``opened.url + "first"``, is a subject.

    Args:
        conditions: Anything that :func:`~causal_openlock.experiment.condition.find_condition`
            takes; subjects are dealt among them.
        label: What tables call the agent.
        out: Folder for what is done; by default a temporary one.
        protocol: The budgets.
        seed: Seed of layouts and of luck.
        ask: Whether subjects are asked after each room what enables what.

    Returns:
        What has the address, and closes the rooms.

    Raises:
        OpenLockError: If there is no such condition, the folder cannot be used, or the package
            ``mcp`` is not installed.

    Example:
        >>> with serve("CC3") as opened:
        ...     opened.url.startswith("http://127.0.0.1:")
        True
    """
    from causal_openlock.play.agents import http_server, options_of

    found = [find_condition(form) for form in conditions]
    about = options_of(label, whole_number(seed, "seed"), ask)
    return OpenedRoom(out, found, protocol, http_server, **about)


def play_room(
    schema: Any,
    *,
    out: Path | str | None = None,
    protocol: str = "human",
    seed: int = 0,
    practice: bool = False,
    browser: bool = True,
) -> OpenedRoom:
    """Open rooms of a schema in the browser, to play oneself; other machines cannot connect.

    Args:
        schema: Anything that :func:`~causal_openlock.schemas.finding.schema` takes.
        out: Folder for what is done, which is results as ``compare`` has them; by default a
            temporary one.
        protocol: The budgets.
        seed: Seed of layouts and of luck.
        practice: Whether a practice room comes first.
        browser: Whether to open the page; otherwise follow the link.

    Returns:
        What shows the link, and closes the room.

    Raises:
        OpenLockError: If there is no such schema, or the folder cannot be used.

    Example:
        >>> with play_room("CC3", browser=False) as opened:
        ...     opened.url.startswith("http://127.0.0.1:")
        True
    """
    found, seed = declared(schema), whole_number(seed, "seed")
    condition = Condition(found.name, (Trials(found),))
    opened = OpenedRoom(out, [condition], protocol, PlayServer, seed=seed, practice=practice)
    if browser:
        webbrowser.open(opened.url)
    return opened
