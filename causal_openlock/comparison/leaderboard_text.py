"""The leaderboard as text: a few sentences, and a row for each learner."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import pandas as pd

from causal_openlock.analysis.topics.leaderboard import leaderboard_tables
from causal_openlock.comparison.console import Terminal, plain_table


def print_leaderboard(
    ranked: pd.DataFrame, console: Terminal, answers: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Print the table of each protocol, and what its numbers mean.

    Args:
        ranked: From :func:`~causal_openlock.analysis.topics.leaderboard.leaderboard`.
        console: Where to.
        answers: Sentences above the tables, by protocol, as a report has them.
    """
    for protocol, table in leaderboard_tables(ranked).items():
        console.print(f"\n{table.title}", style="bold")
        for sentence in (answers or {}).get(protocol, ()):
            console.print(sentence, highlight=False)
        shown = plain_table(*(head.replace(" than ", " than\n") for head in table.heads))
        shown.columns[0].no_wrap = False
        for number, row in enumerate(table.rows, start=1):
            shown.add_row(*(text.replace("\n", " ") for text in row))
            if number == len(table.looks):
                shown.add_row()  # below those who do not compete
        console.print_whole(shown)
        console.print(table.caption, style="dim", highlight=False)
