"""``causal-openlock report``: the report of a results folder, or what differs between two."""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Exclude, ReferenceFolders, ResultsFolder
from causal_openlock.errors import OpenLockError

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.analysis.results.missing import Missing
    from causal_openlock.analysis.results.reading import Exclusion
    from causal_openlock.analysis.results.references import ReferenceForm
    from causal_openlock.comparison.console import Terminal

MOST_MISSING = 40
"""Missing cells that are listed on the terminal; the report has them all."""
MOST_ROWS = 40
"""Changes and differences that are shown on the terminal; the page has them all."""


def report(
    folder: ResultsFolder,
    against: Annotated[
        Path | None,
        typer.Argument(help="Another one: say what changed, and whether the results differ."),
    ] = None,
    beside: Annotated[
        list[Path] | None,
        typer.Option(help="Another folder whose learners or people the report shows as well."),
    ] = None,
    reference: ReferenceFolders = None,
    exclude: Exclude = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the comparison of two; default: the first."),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures",
            help="Also write figures (PDF) and tables (CSV, LaTeX) as files; without it, "
            "those of an earlier report are removed.",
        ),
    ] = False,
    methods: Annotated[
        bool, typer.Option("--methods", help="Print the methods section for a paper instead.")
    ] = False,
) -> None:
    """Write the report of a results folder, or compare two folders."""
    from causal_openlock.comparison.console import Terminal

    console = Terminal()
    if methods:
        from causal_openlock.comparison.results import open_results

        if against or out or figures:
            raise OpenLockError(
                "--methods is about one comparison; leave out the other, --out and --figures"
            )
        results = open_results(folder, *beside or (), reference=reference, exclude=exclude)
        console.print_line(results.methods())
    elif against is None:
        if out is not None:
            raise OpenLockError(
                "--out is for the comparison of two folders; a report is written into its own"
            )
        report_store(
            folder, console, beside or (), reference or (), exclude=exclude, figures=figures
        )
    elif beside or reference or exclude:
        raise OpenLockError(
            "two folders are compared with one another, whole, and not with a --reference or "
            "--beside others; leave one out, or --exclude"
        )
    else:
        report_difference(folder, against, out or folder, console, figures)


@contextmanager
def _steps() -> Iterator[Callable[[str], None]]:
    """Show the steps of a report, which begins with reading; cycles are not looked for."""
    from causal_openlock.comparison.progress_bar import shown_steps

    gc.disable()  # looking for cycles takes a twentieth of the time
    try:
        with shown_steps("report") as begin:
            begin("reading")
            yield begin
    finally:
        gc.enable()


def report_store(
    folder: Path,
    console: Terminal,
    others: Sequence[Path] = (),
    references: Sequence[ReferenceForm] = (),
    reasons: bool = True,
    exclude: Exclusion | None = None,
    figures: bool = False,
) -> None:
    """Write the report of a results folder, perhaps with others, and print its leaderboard.

    Args:
        folder: The folder.
        console: Where to print.
        others: Folders whose learners or people are shown with those of this one.
        references: What learners are compared with.
        reasons: Whether to say why some learners are not applicable; ``compare`` has said it.
        exclude: The rule by which people are left out.
        figures: Whether figures and tables are also written as files.
    """
    from causal_openlock.analysis.report.about_people import exclusions
    from causal_openlock.analysis.report.warnings import not_applicable
    from causal_openlock.analysis.report.writing import make_report
    from causal_openlock.analysis.results.missing import missing_cells
    from causal_openlock.comparison.leaderboard_text import print_leaderboard
    from causal_openlock.comparison.results import open_results

    with _steps() as begin:
        results = open_results(folder, *others, reference=references, exclude=exclude)
        page = make_report(results, folder, begin=begin, figures=figures)
    print_leaderboard(page.leaderboard, console, page.answers)
    said = not_applicable(results.experiment.reasons) if reasons else ()
    for sentence in (*exclusions(results), *said):
        console.print(sentence, highlight=False)
    _print_missing(missing_cells(results.experiment), console)
    if page.removed:
        console.print_line(page.removed)
    console.print_line(f"report: {page.path}")


def _print_missing(missing: Sequence[Missing], console: Terminal) -> None:
    """The cells that no number includes, a line for each."""
    from causal_openlock.analysis.prose import Prose

    if missing:
        failed = sum(one.failed for one in missing)
        text = Prose("causal_openlock.analysis.report.report").sentence(
            "unfinished", cells=len(missing), failed=failed
        )
        console.print(f"\n{text}", style="yellow", soft_wrap=True, highlight=False)
    for one in missing[:MOST_MISSING]:
        console.print_line(f"  {one.text}")
    if len(missing) > MOST_MISSING:
        console.print(f"  and {len(missing) - MOST_MISSING} more")


def report_difference(
    first: Path, second: Path, out: Path, console: Terminal, figures: bool = False
) -> None:
    """Compare two results folders: a page in a folder, and the same on the terminal."""
    from causal_openlock.analysis.report.difference_page import (
        sentence_on_changes,
        sentence_on_differences,
        write_difference,
    )
    from causal_openlock.analysis.results.reading import read_results
    from causal_openlock.storage.store import Store

    names = _names(first, second)
    path = out / f"difference_{second.resolve().name}.html"
    with _steps() as begin:
        both = read_results(Store(first)), read_results(Store(second))
        begin("comparing")
        changed, table, removed = write_difference(*both, path, names, figures)
    if len(changed):
        _print_changes(changed, names, console)
    else:
        console.print(sentence_on_changes(changed))
    _print_differences(table, names, console)
    console.print_line(sentence_on_differences(table))
    if removed:
        console.print_line(removed)
    console.print_line(f"report: {path}")


def _names(first: Path, second: Path) -> tuple[str, str]:
    """Names of the folders, or their paths if the names are the same."""
    short = first.resolve().name, second.resolve().name
    return short if short[0] != short[1] else (str(first), str(second))


def _print_changes(changed: pd.DataFrame, names: tuple[str, str], console: Terminal) -> None:
    from rich.table import Table

    shown = Table("changed", *names, box=None, padding=(0, 2, 0, 0), highlight=False)
    for row in changed.head(MOST_ROWS).itertuples(index=False):
        shown.add_row(*map(str, row))
    console.print_whole(shown)
    if len(changed) > MOST_ROWS:
        console.print(f"and {len(changed) - MOST_ROWS} more, on the page")


def _print_differences(table: pd.DataFrame, names: tuple[str, str], console: Terminal) -> None:
    from causal_openlock.analysis.report.difference_page import DIFFERENT
    from causal_openlock.analysis.table import printed
    from causal_openlock.comparison.console import plain_table

    console.print(f"\nMean attempts in {names[0]} and in {names[1]}", style="bold")
    heads = ("learner", "condition", "protocol", *names, "difference", "95% interval", "p (Holm)")
    shown = plain_table(*heads, left=3)
    shown.add_column("", no_wrap=True)
    # What differs comes first, so that it is on the screen however much there is.
    order = (table["verdict"] != DIFFERENT).sort_values(kind="stable").index
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
            style="bold" if row["verdict"] == DIFFERENT else "",
        )
    if len(table):
        console.print_whole(shown)
    if len(table) > MOST_ROWS:
        console.print(f"and {len(table) - MOST_ROWS} more, on the page")
