"""``causal-openlock schema``: list, show, check, draw, export, begin and value schemas."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Output, SchemaName
from causal_openlock.cli.terminal import say
from causal_openlock.comparison.progress_bar import shown_steps
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.wording import counted

if TYPE_CHECKING:
    from causal_openlock.schemas.schema import Schema

app = typer.Typer(no_args_is_help=True, help="List, show, check, draw, export and begin schemas.")


@app.command("list")
def list_schemas() -> None:
    """List the schemas of the package, and those in ./schemas."""
    from rich.table import Table

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.schemas.finding import bundled_schemas
    from causal_openlock.schemas.graphs import read_schema

    table = Table("schema", "levers", "solutions", "actions", "title", box=None, pad_edge=False)
    found = bundled_schemas()
    for path in sorted(Path("schemas").glob("*.yaml")):
        try:
            found[path.stem] = read_schema(path)
        except OpenLockError as error:
            say(f"warning: {error}", error=True)
    for name, schema in found.items():
        counts = len(schema.levers), len(schema.solutions), schema.least_action_limit
        table.add_row(name, *map(str, counts), schema.title)
    Terminal().print(table)


@app.command()
def show(
    name: SchemaName,
    layout: Annotated[
        str | None, typer.Option(help="Also show the solutions in this layout, such as trial7.")
    ] = None,
) -> None:
    """Show a schema: its graph and its solutions."""
    from causal_openlock.render.graph import schema_text
    from causal_openlock.world.room import Room, action_names

    schema = _read(name)
    say(schema_text(schema).rstrip())
    if layout is not None:
        room = Room.of(schema, layout)
        names = action_names(room.positions)
        say(f"\nIn {room.layout.name}:")
        for levers in schema.solutions:
            say("  " + ", ".join(names[action] for action in room.action_of(levers)))


@app.command()
def check(
    names: Annotated[list[str], typer.Argument(help="Names of schemas, or paths of files.")],
) -> None:
    """Check schemas: their faults, and which learners cannot play them."""
    from causal_openlock.contract.registry import learner_class
    from causal_openlock.experiment.protocol import default_action_limit

    faults = []
    for given in names:
        try:
            schema = _read(given)
        except OpenLockError as error:
            faults.append(str(error))
            continue
        levers = counted(len(schema.levers), "lever")
        solutions = counted(len(schema.solutions), "solution")
        say(
            f"{given}: good: {levers}, {solutions}, attempts of at least "
            f"{schema.least_action_limit} actions"
        )
        for name in ("ideal", "theory_based"):
            kind = learner_class(name)
            if why := kind.cannot_play(kind.Parameters(), schema, default_action_limit(schema)):
                say(f"  the learner {name} cannot play it: {why}")
    if faults:
        raise OpenLockError("\n".join(faults))


@app.command()
def draw(name: SchemaName, out: Output = None) -> None:
    """Draw a schema as a figure: PNG, SVG or PDF."""
    from causal_openlock.render.graph import save_schema_figure

    schema = _read(name)
    path = out or Path(f"{schema.name}.svg")
    save_schema_figure(schema, path)
    say(f"{path} written")


@app.command()
def export(
    name: SchemaName,
    format: Annotated[
        str | None,
        typer.Option(
            "--format", "-f", help="yaml, line, node-link, gml, graphml, dot, dagitty or bif."
        ),
    ] = None,
    out: Output = None,
    force: Annotated[bool, typer.Option("--force", help="Replace a file that is there.")] = False,
) -> None:
    """Write a schema in another format.

    Files in these formats, except bif, can be given as well.
    """
    from causal_openlock.schemas.graphs import export_schema, write_schema

    schema = _read(name)
    if out is not None:
        if out.exists() and not force:
            raise OpenLockError(f"{out} exists already; choose another name, or pass --force")
        write_schema(schema, out, format)
        say(f"{out} written")
    else:
        say(export_schema(schema, format or "yaml"), end="")


@app.command()
def new(
    name: Annotated[str, typer.Argument(help="Its name: letters, digits and underscores.")],
    like: Annotated[str, typer.Option(help="A schema to begin with.")] = "CC3",
    out: Output = None,
) -> None:
    """Begin a schema of one's own: a commented file to change."""
    from causal_openlock.schemas.schema import schema_from_dict

    path = out or Path(f"{name}.yaml")
    if path.exists():
        raise OpenLockError(f"{path} exists already; choose another name, or remove it first")
    schema = schema_from_dict(
        {**_read(like).as_dict(), "name": name, "title": f"{name}, after {like}"}
    )
    write_text(path, _GUIDE + schema.to_yaml())
    say(f"{path} written; change it, then try:")
    say(f"  causal-openlock schema check {path}")
    say(f"  causal-openlock schema show {path}")
    say(f"  causal-openlock compare --condition {path} --learner oracle --learner random")


@app.command()
def worth(
    name: SchemaName,
    among: Annotated[
        list[str] | None,
        typer.Option(
            "--among",
            "-a",
            help="What else may govern the room: a schema, or SCHEMA=WEIGHT (may be repeated); all "
            "schemas of its size (the default); or grammar, the prior of the learner bayes.",
        ),
    ] = None,
    action_limit: Annotated[
        int | None, typer.Option(help="Actions in an attempt; by default 3, or as many as needed.")
    ] = None,
    levers_unknown: Annotated[
        bool, typer.Option("--levers-unknown", help="Any of seven levers may be active.")
    ] = False,
) -> None:
    """Compute what knowing the schema is worth to an ideal observer, in attempts."""
    from causal_openlock.belief.worth import schema_worth
    from causal_openlock.comparison.console import Terminal

    among = among or ["all"]
    with shown_steps("worth") as report:
        found = schema_worth(
            name,
            among[0] if among in (["all"], ["grammar"]) else dict(map(_weighted, among)),
            action_limit=action_limit,
            levers_known=not levers_unknown,
            report=report,
        )
    Terminal().print_table(found.table, dict.fromkeys(("known", "unknown", "worth"), ".3f"))
    say(str(found))


def _weighted(text: str) -> tuple[str, float]:
    """A schema and its weight, which is 1 unless the text ends with another."""
    schema, equals, weight = text.rpartition("=")
    try:
        return (schema, float(weight)) if equals else (text, 1.0)
    except ValueError:
        return text, 1.0


_GUIDE = """\
# A causal schema: which lever enables which, and what unlocks the door.
#   levers  the active levers; a lever that no edge leads to moves freely
#   edges   cause: [effects]; the effect `door` is the door. Where a push does not always take
#           effect, write L0: {L1: {strength: 0.8}}
#   gates   how a node combines its causes: any (the default), all, {at_least: 2}
#   inert   levers that move but lead nowhere
"""


def _read(name: str) -> Schema:
    from causal_openlock.schemas.finding import find_schema

    return find_schema(name)
