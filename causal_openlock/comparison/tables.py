"""What answers first, as text: a few sentences, and a row for each learner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from causal_openlock.analysis.report.first_screen import SHOWN_PEOPLE, first_tables, legend
from causal_openlock.comparison.console import Terminal, plain_table


def print_standings(
    standings: pd.DataFrame,
    console: Terminal,
    answers: Mapping[str, Sequence[str]] | None = None,
    warn: bool = True,
) -> None:
    """Print the table of each protocol, and what its numbers mean.

    Args:
        standings: From :func:`~causal_openlock.analysis.results.standing.standings`.
        console: Where to.
        answers: Sentences above the tables, by protocol, as a report has them.
        warn: Whether to warn of few subjects below a table.
    """
    tables = list(first_tables(standings))
    for table in tables:
        console.print(f"\nProtocol {table.protocol}: {table.measured}", style="bold")
        for sentence in (answers or {}).get(table.protocol, ()):
            console.print(sentence, highlight=False)
        shown = plain_table(*table.short_heads)
        shown.columns[0].no_wrap = False
        for name, row in table.short_rows.items():
            shown.add_row(name, *row, style="bold" if name == SHOWN_PEOPLE else "")
            if table.references[-1:] == (name,):
                shown.add_row()
        console.print_whole(shown)
        if warn and table.few:
            console.print(table.few, style="yellow", highlight=False)
    console.print(f"\n{legend(tables, narrow=True)}", style="dim", highlight=False)
