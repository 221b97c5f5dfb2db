"""The command line: ``causal-openlock``.

Each command is a function, a few lines over the library. Those of the core are listed below; all
others, such as ``fit`` and ``play``, are registered by the packages that they belong to, in the
group of entry points ``causal_openlock.commands``. ``options``, ``terminal`` and ``stopping`` serve
them all. A mistake of the user is one sentence on standard error, with exit status 2; everything
heavy is loaded only by the command that needs it.
"""

from __future__ import annotations

import gc
import signal
import sys
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from causal_openlock.cli import compare, folder, learners, notebook, pictures, report, schema, text
from causal_openlock.cli.stopping import stopped_by
from causal_openlock.cli.terminal import complain, say, warn_in_a_line, write_anything
from causal_openlock.errors import OpenLockError, in_short
from causal_openlock.files.plugins import COMMANDS, registered
from causal_openlock.version import __version__

GROUPS = {
    "Start here": ("compare", "report", "schema", "play", "notebook"),
    "Declare": ("learners", "room", "train"),
    "Compare": ("status", "trace", "film"),
    "People and agents": ("import", "forget", "text", "serve"),
    "Predict": ("score", "fit", "design"),
    "Share": ("export", "bundle"),
}  #: groups in which ``--help`` lists commands, what a newcomer needs first; all others come last


class GroupedCommands(TyperGroup):
    """A command line whose help lists commands in groups."""

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """Write a section for each group that has a command."""
        listed = {name: one for name, one in self.commands.items() if not one.hidden}
        others = listed.keys() - {name for names in GROUPS.values() for name in names}
        for title, names in {**GROUPS, "More": sorted(others)}.items():
            rows = [
                (name.ljust(8), listed[name].get_short_help_str(formatter.width - 14))
                for name in names
                if name in listed
            ]
            if rows:
                with formatter.section(title):
                    formatter.write_dl(rows)


app = typer.Typer(
    name="causal-openlock",
    cls=GroupedCommands,
    help="Which learners discover a causal schema by acting, and carry it to a new situation?",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100},
)
app.add_typer(schema.app, name="schema")
for _command in (
    learners.learners,
    compare.compare,
    report.report,
    folder.status,
    folder.export,
    folder.bundle,
    pictures.trace,
    pictures.film,
    pictures.room,
    text.text,
    notebook.notebook,
):
    app.command()(_command)


def add_registered(app: typer.Typer) -> None:
    """Add the commands that packages register: functions, or Typer apps of several commands."""
    for name, entry in registered(COMMANDS).items():
        try:
            command = entry.load()
        except Exception as error:  # a package of somebody else can fail in any way
            say(f"warning: the command {name} cannot be loaded: {in_short(error)}", error=True)
            continue
        if isinstance(command, typer.Typer):
            app.add_typer(command, name=name)
        else:
            app.command(name)(command)


add_registered(app)


def _version(wanted: bool) -> None:
    if wanted:
        say(__version__)
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
    write_anything()
    warn_in_a_line()
    try:
        for word in sys.argv[1:]:
            if word.encode(errors="replace") != word.encode(errors="surrogatepass"):
                raise OpenLockError(f"{word} is not valid UTF-8; rename it, or set PYTHONUTF8=1")
        with stopped_by(signal.SIGINT):  # so that no learner can be taken for Ctrl-C
            app()
    except OpenLockError as error:
        complain(str(error))
        sys.exit(error.status)
    except OSError as error:
        where = f"{error.filename}: " if error.filename else ""
        complain(f"{where}{error.strerror or error}; check the path, its permissions and the disk")
        sys.exit(2)
    finally:
        gc.freeze()  # the process ends: looking for cycles in what it holds takes up to a second
