"""The leaderboard as text: a few sentences, and a row for each learner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from causal_openlock.analysis.topics.leaderboard import leaderboard_tables, legend
from causal_openlock.comparison.console import Terminal, plain_table


def print_leaderboard(
    ranked: pd.DataFrame,
    console: Terminal,
    answers: Mapping[str, Sequence[str]] | None = None,
    warn: bool = True,
) -> None:
    """Print the table of each protocol, and what its numbers mean.

    Args:
        ranked: From :func:`~causal_openlock.analysis.topics.leaderboard.leaderboard`.
        console: Where to.
        answers: Sentences above the tables, by protocol, as a report has them.
        warn: Whether to warn of few subjects below a table.
    """
    tables = list(leaderboard_tables(ranked))
    for table in tables:
        console.print(f"\nProtocol {table.protocol}: {table.measured}", style="bold")
        for sentence in (answers or {}).get(table.protocol, ()):
            console.print(sentence, highlight=False)
        shown = plain_table(*table.short_heads)
        shown.columns[0].no_wrap = False
        for name, row in table.short_rows.items():
            is_reference = name in table.references and name not in table.given
            shown.add_row(name, *row, style="bold" if is_reference else "")
            if table.references[-1:] == (name,):
                shown.add_row()
        console.print_whole(shown)
        if warn and table.few:
            console.print(table.few, style="yellow", highlight=False)
    console.print(f"\n{legend(tables, narrow=True)}", style="dim", highlight=False)
