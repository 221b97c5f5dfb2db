"""``causal-openlock learners``: the installed learners and their parameters."""

from __future__ import annotations

from typing import Annotated

import typer


def learners(
    name: Annotated[str | None, typer.Argument(help="Show the parameters of this learner.")] = None,
) -> None:
    """List the installed learners, or the parameters of one."""
    from rich.table import Table
    from rich.text import Text

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.contract.registry import learner_class, parameter_table, registry
    from causal_openlock.wording import first_line

    console = Terminal()
    if name is None:
        table = Table("learner", "what it is", "from", box=None, pad_edge=False)
        for known, entry in registry().items():
            about = first_line(learner_class(known).__doc__)
            table.add_row(known, about, entry.dist.name if entry.dist else "")
        console.print(table)
        console.print("\ncausal-openlock learners NAME shows the parameters of one.")
        return
    about = first_line(learner_class(name).__doc__)
    console.print(Text(name, "bold"), f": {about}\n", sep="")
    rows = parameter_table(name)
    if not rows:
        console.print("It has no parameters.")
        return
    table = Table("parameter", "default", "meaning", box=None, pad_edge=False)
    for row in rows:
        table.add_row(row.name, "null" if row.default is None else str(row.default), row.meaning)
    console.print(table)
