"""The command line: ``causal-openlock``.

Each command is one file, a few lines over the library; to add one, write a module here and register
it below. ``options``, ``terminal``, ``progress``, ``stopping``, ``encoding`` and ``one_trial``
serve them all, and ``report_difference`` is part of ``report``. A mistake of the user is one
sentence on standard error, with exit status 2; everything heavy is loaded only by the command that
needs it.
"""

from __future__ import annotations

import sys
from typing import Annotated

import typer

from causal_openlock.cli import (
    bundle,
    compare,
    export,
    film,
    fit,
    learners,
    play,
    report,
    room,
    schema,
    trace,
)
from causal_openlock.cli.encoding import write_anything

app = typer.Typer(
    name="causal-openlock",
    help="Which learners discover a causal schema by acting, and carry it to a new situation?",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(schema.app, name="schema")
app.command()(learners.learners)
app.command()(compare.compare)
app.command()(report.report)
app.command()(export.export)
app.command()(bundle.bundle)
app.command()(fit.fit)
app.command()(trace.trace)
app.command()(film.film)
app.command()(room.room)
app.command()(play.play)


def _version(wanted: bool) -> None:
    if wanted:
        from causal_openlock.version import __version__

        typer.echo(__version__)
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Options of every command."""


def main() -> None:
    """Run the command line; the entry point ``causal-openlock``."""
    from causal_openlock.errors import OpenLockError

    write_anything()
    try:
        app()
    except OpenLockError as error:
        _fail(str(error), error.status)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        _fail(f"{where}{error.strerror or error}; check the path, its permissions and the disk", 2)


def _fail(message: str, status: int) -> None:
    from causal_openlock.cli.terminal import complain

    complain(message)
    sys.exit(status)
