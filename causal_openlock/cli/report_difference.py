"""``causal-openlock report A B``: what changed between two results, and is it more than noise?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.cli.terminal import Console

MOST_ROWS = 40
"""Changes and differences that are shown on the terminal; the page has them all."""


def report_difference(first: Path, second: Path, out: Path, console: Console) -> None:
    """Compare two results folders: a page, and the same on the terminal.

    Args:
        first: What ``compare`` wrote to.
        second: Another such folder.
        out: The folder to write the page to.
        console: Where to print.
    """
    from causal_openlock.analysis.report.difference_page import (
        sentence_on_changes,
        sentence_on_noise,
        write_difference,
    )
    from causal_openlock.analysis.results.reading import read_results
    from causal_openlock.experiment.store import Store

    names = _names(first, second)
    path = out / f"difference_{second.resolve().name}.html"
    changed, table = write_difference(
        read_results(Store(first)), read_results(Store(second)), path, names
    )
    if len(changed):
        _print_changes(changed, names, console)
    else:
        console.print(sentence_on_changes(changed))
    _print_differences(table, names, console)
    console.print_line(sentence_on_noise(table))
    console.print_line(f"report: {path}")


def _names(first: Path, second: Path) -> tuple[str, str]:
    """What to call the folders: their names, or paths if these are the same."""
    short = first.resolve().name, second.resolve().name
    return short if short[0] != short[1] else (str(first), str(second))


def _print_changes(changed: pd.DataFrame, names: tuple[str, str], console: Console) -> None:
    from rich.table import Table

    shown = Table("changed", *names, box=None, padding=(0, 2, 0, 0), highlight=False)
    for row in changed.head(MOST_ROWS).itertuples(index=False):
        shown.add_row(*map(str, row))
    console.print_whole(shown)
    if len(changed) > MOST_ROWS:
        console.print(f"and {len(changed) - MOST_ROWS} more, on the page")


def _print_differences(table: pd.DataFrame, names: tuple[str, str], console: Console) -> None:
    from causal_openlock.analysis.report.difference_page import MORE
    from causal_openlock.analysis.report.section import printed
    from causal_openlock.cli.terminal import plain_table

    console.print(f"\nMean attempts in {names[0]} and in {names[1]}", style="bold")
    heads = ("learner", "condition", "protocol", *names, "difference", "95% interval", "p (Holm)")
    shown = plain_table(*heads, left=3)
    shown.add_column("", no_wrap=True)
    # What is more than noise comes first, so that it is on the screen however much there is.
    order = (table["verdict"] != MORE).sort_values(kind="stable").index
    for row in table.loc[order].head(MOST_ROWS).to_dict("records"):
        low, high = (printed(row[name], "+.2f") for name in ("ci_low", "ci_high"))
        shown.add_row(
            row["learner"],
            row["condition"],
            row["protocol"],
            printed(row["attempts_first"], ".2f"),
            printed(row["attempts_second"], ".2f"),
            printed(row["difference"], "+.2f"),
            f"{low} to {high}" if row["ci_low"] == row["ci_low"] else "",
            printed(row["p_holm"], ".2g"),
            row["verdict"],
            style="bold" if row["verdict"] == MORE else "",
        )
    if len(table):
        console.print_whole(shown)
    if len(table) > MOST_ROWS:
        console.print(f"and {len(table) - MOST_ROWS} more, on the page")
