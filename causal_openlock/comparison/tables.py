"""The table that answers first, as text: a row for each learner, a column for each condition."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.table import Table
from rich.text import Text

from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.results.verdict import VerdictTable
from causal_openlock.comparison.console import Terminal, plain_table


def print_verdict(tables: list[VerdictTable], console: Terminal) -> None:
    """Print the table of each protocol, and what its numbers mean."""
    for table in tables:
        title = f"Attempts to find every solution, protocol {table.protocol}"
        console.print(f"\n{title}", style="bold")
        console.print_whole(as_text(table))
    text = Prose("report").sentence("measure")
    console.print(f"\n{text} With 95% bootstrap intervals.", style="dim", highlight=False)


def as_text(table: VerdictTable) -> Table:
    """The table for a terminal."""
    shown = plain_table("", *(f"{name}\n{measured}" for name, measured in table.columns))
    shown.columns[0].min_width = max(map(len, [*table.rows, "published model"]))
    shown.columns[0].no_wrap = False
    for name, row in table.beside.items():
        cells = ("" if value is None else number(value) for value in row)
        shown.add_row(name, *cells, style="bold" if name == "people" else "")
    for learner, rows in table.rows.items():
        shown.add_row(learner, *(Text("\n").join(map(_line, lines(row))) for row in rows))
    return shown


def lines(row: Mapping[str, Any] | None) -> list[str]:
    """A learner's result: the mean, its interval, and how many trials were solved if not all."""
    if row is None:
        return []
    found = [number(row["attempts"])]
    if row["ci_low"] is not None and row["ci_low"] < row["ci_high"]:
        found.append(f"{number(row['ci_low'])}–{number(row['ci_high'])}")
    if row["share_solved"] < 1:
        found.append(f"{row['share_solved']:.0%} solved")
    return found


def _line(text: str) -> Text:
    return Text(text, "dim" if "–" in text or "solved" in text else "")


def number(attempts: float) -> str:
    """Attempts as tables print them.

    >>> number(3.7512), number(150.2)
    ('3.75', '150')
    """
    return f"{attempts:.2f}" if attempts < 100 else f"{attempts:.0f}"
