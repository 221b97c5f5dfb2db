"""The table that answers first, as text: a row for each learner."""

from __future__ import annotations

import pandas as pd

from causal_openlock.analysis.report.first_screen import MEANING, SHOWN_PEOPLE, first_tables
from causal_openlock.comparison.console import Terminal, plain_table


def print_standings(standings: pd.DataFrame, console: Terminal) -> None:
    """Print the table of each protocol, and what its numbers mean.

    Args:
        standings: From :func:`~causal_openlock.analysis.results.standing.standings`.
        console: Where to.
    """
    for table in first_tables(standings):
        console.print(f"\nProtocol {table.protocol}: {table.measured}", style="bold")
        shown = plain_table(*table.short_heads)
        shown.columns[0].no_wrap = False
        for name, row in table.short_rows.items():
            shown.add_row(name, *row, style="bold" if name == SHOWN_PEOPLE else "")
        console.print_whole(shown)
    console.print(f"\n{MEANING}", style="dim", highlight=False)
