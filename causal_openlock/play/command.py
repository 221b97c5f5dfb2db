"""``causal-openlock play``: let people play, in a browser."""

from __future__ import annotations

import re
import shlex
import signal
import sys
import webbrowser
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import Budgets
from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError
from causal_openlock.files.yaml_file import read_text
from causal_openlock.wording import counted


def play(
    condition: Annotated[
        list[str] | None,
        typer.Option(
            "--condition",
            "-c",
            help="CC4, CC3-CC4, my.yaml, ...; of several, each person plays one.",
        ),
    ] = None,
    protocol: Budgets = "human",
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for what people do.")] = Path(
        "results/people"
    ),
    host: Annotated[
        str, typer.Option(help="Address to listen on; by default only this machine can connect.")
    ] = "127.0.0.1",
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="Port to listen on; 0 for any that is free.")
    ] = 8630,
    address: Annotated[
        str,
        typer.Option(
            help="What people type where a reverse proxy passes their requests on, such as "
            "https://study.example.org."
        ),
    ] = "",
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of rooms and luck.")] = 0,
    practice: Annotated[
        bool, typer.Option("--practice/--no-practice", help="Begin with a practice room.")
    ] = True,
    ask: Annotated[
        bool,
        typer.Option("--ask-structure", help="Ask after each room which lever enables which."),
    ] = False,
    consent: Annotated[
        Path | None,
        typer.Option(help="What people agree to before they begin, in Markdown."),
    ] = None,
    recruiting: Annotated[
        str,
        typer.Option(
            help="What a recruiting service adds to the address, such as "
            "PROLIFIC_PID,STUDY_ID,SESSION_ID; kept in recruited.csv."
        ),
    ] = "",
    completion: Annotated[
        str,
        typer.Option(
            help="Address to which people go back when they have finished; %NAME% in it becomes "
            "their identifier NAME."
        ),
    ] = "",
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")
    ] = True,
) -> None:
    """Let people play, in a browser.

    People in a folder that exists continue where they stopped.
    """
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.condition import find_condition
    from causal_openlock.experiment.protocol import find_protocol
    from causal_openlock.play.people import People
    from causal_openlock.play.server import PlayServer

    names = list(dict.fromkeys(condition or ["CC3-CC4"]))
    people = People(
        out,
        [find_condition(name) for name in names],
        find_protocol(protocol),
        seed=seed,
        practice=practice,
        ask=ask,
        consent=_text(consent) if consent else "",
        recruiting=_names(recruiting),
        command=shlex.join(["causal-openlock", *sys.argv[1:]]),
    )
    console = Terminal()

    def standing() -> str:
        return f"joined: {people.number}, finished: {people.finished}"

    with closing(people):
        server = PlayServer(
            people, host, port, address, completion, lambda: console.print_line(standing())
        )
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
        sys.setswitchinterval(0.001)  # so that no click waits for a record that is being written
        console.print_line(f"play at {server.url}")
        if server.address:
            console.print_line(f"people reach it at {server.address}, through the proxy")
        if people.number:
            console.print_line(f"{standing()}; they continue where they stopped")
        if not server.loopback:
            console.print_line("warning: everybody who can reach this machine can play")
        console.print_line(f"what people do is kept in {out}; stop with Ctrl-C")
        if browser:
            webbrowser.open(server.url)
        with suppress(KeyboardInterrupt):
            server.serve_forever()
    report = f"; to see the results: causal-openlock report {out}" if people.finished else ""
    console.print_line(f"{standing()}{report}")


def _text(path: Path) -> str:
    if not (text := read_text(path)).strip():
        raise OpenLockError(f"{path} is empty; give a file of Markdown")
    return text


def _names(recruiting: str) -> list[str]:
    names = [name.strip() for name in recruiting.split(",")] if recruiting else []
    if len(names) > 3 or any(not re.fullmatch("[A-Za-z0-9_]{1,40}", name) for name in names):
        raise OpenLockError(
            f"--recruiting takes up to three names with commas between, not {recruiting!r}; "
            "such as PROLIFIC_PID,STUDY_ID,SESSION_ID"
        )
    return names


def forget(
    # No store: what is deleted in the copy here would still be there.
    folder: Annotated[Path, typer.Argument(help="Folder that play or import wrote to.")],
    subject: Annotated[int, typer.Argument(min=0, help="Number of the person.")],
    condition: Annotated[
        str | None, typer.Option("--condition", "-c", help="The condition that they played.")
    ] = None,
) -> None:
    """Delete all data of one person, played or imported, for good."""
    from causal_openlock.play.forgetting import forget_person

    gone, left = forget_person(folder, subject, condition)
    files = counted(len(gone), "file")
    say(f"person {subject} is deleted from {folder}: {files}, and all there was in its logs")
    if left:
        say(
            "these files may contain this person's data; regenerate or delete them: "
            + ", ".join(left),
            error=True,
        )
    say("also delete whatever was made of the folder elsewhere (bundles, fits, copies)")
