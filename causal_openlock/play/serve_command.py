"""``causal-openlock serve``: let agents play, through tools."""

from __future__ import annotations

import os
import secrets
import shlex
import signal
import sys
from contextlib import closing, suppress
from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import Budgets
from causal_openlock.cli.terminal import say
from causal_openlock.errors import OpenLockError


def serve(
    condition: Annotated[
        list[str], typer.Argument(help="CC4, CC3-CC4, my.yaml, ...; each subject plays one.")
    ],
    label: Annotated[str, typer.Option("--as", help="What tables call the agent.")] = "agent",
    protocol: Budgets = "human",
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder for what it does.")] = Path(
        "results/agents"
    ),
    http: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            metavar="PORT",
            help="Serve many subjects over HTTP, on this machine; 0 for any port that is free.",
        ),
    ] = None,
    name: Annotated[
        str, typer.Option(help="Name of the subject over stdio, which continues; else a new one.")
    ] = "",
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Seed of rooms and luck.")] = 0,
    ask: Annotated[
        bool, typer.Option("--ask-structure", help="Ask after each room what enables what.")
    ] = False,
) -> None:
    """Let agents play, through the tools of a server of the Model Context Protocol.

    Over stdio one subject plays, and the agent starts this command; with --http each path of the
    address is a subject. What was played stands beside learners: compare ... --beside FOLDER.
    """
    from causal_openlock.experiment.condition import find_condition
    from causal_openlock.experiment.protocol import find_protocol
    from causal_openlock.play.agents import http_server, options_of, serve_stdio
    from causal_openlock.play.people import People

    if name and http is not None:
        raise OpenLockError("--name is for stdio; over HTTP the path of the address is the name")
    people = People(
        out,
        [find_condition(name) for name in dict.fromkeys(condition)],
        find_protocol(protocol),
        command=shlex.join(["causal-openlock", *sys.argv[1:]]),
        **options_of(label, seed, ask),
    )
    with closing(people), suppress(KeyboardInterrupt):
        signal.signal(signal.SIGTERM, signal.default_int_handler)  # as Ctrl-C
        if http is None:
            serve_stdio(people, name or secrets.token_hex(8))
        else:
            server = http_server(people, http)
            say(f"agents connect to {server.url}NAME; each NAME is a subject")
            say(f"what they do is kept in {out}; stop with Ctrl-C")
            server.serve_forever()
    say(f"joined: {people.number}, finished: {people.finished}", error=True)
    if http is None:
        os._exit(0)  # a thread may still wait for standard input, which nothing interrupts
