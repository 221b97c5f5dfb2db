"""``causal-openlock play``: let people play, in a browser."""

from __future__ import annotations

import shlex
import signal
import sys
import webbrowser
from pathlib import Path
from typing import Annotated

import typer

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
    protocol: Annotated[str, typer.Option(help="human or rl: the budgets.")] = "human",
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
    browser: Annotated[
        bool, typer.Option("--browser/--no-browser", help="Open the page in a browser.")
    ] = True,
) -> None:
    """Let people play, in a browser; people in a folder that exists go on where they were."""
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.protocol import Condition, find_protocol
    from causal_openlock.formats.schema_file import find_schema
    from causal_openlock.play.people import People
    from causal_openlock.play.server import PlayServer

    names = list(dict.fromkeys(condition or ["CC3-CC4"]))
    conditions = [Condition.named(name, find_schema) for name in names]
    words = ["causal-openlock", "play", *(word for name in names for word in ("-c", name))]
    words += ["--protocol", protocol, "--seed", str(seed), "--out", out.as_posix()]
    people = People(
        out,
        conditions,
        find_protocol(protocol),
        seed=seed,
        practice=practice,
        command=shlex.join(words),
    )
    try:
        server = PlayServer(people, host, port, address)
    except BaseException:
        people.close()
        raise
    console = Terminal()

    def joined() -> str:
        return counted(people.number, "person has", "people have")

    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    signal.signal(signal.SIGTERM, stop)
    sys.setswitchinterval(0.001)  # so that no click waits for a record that is being written
    console.print_line(f"play at {server.url}")
    if server.address:
        console.print_line(f"people reach it at {server.address}, through the proxy")
    if people.number:
        console.print_line(f"{joined()} joined before; they go on where they were")
    if not server.loopback:
        console.print_line("warning: everybody who can reach this machine can play")
    console.print_line(f"what people do is kept in {out}; stop with Ctrl-C")
    try:
        if browser:
            webbrowser.open(server.url)
        server.serve_forever()
    except KeyboardInterrupt:
        pass
    finally:
        server.finish()
    console.print_line(f"{joined()} joined; causal-openlock report {out}")
