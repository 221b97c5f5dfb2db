"""``causal-openlock report``: the report of a results folder, or what differs between two."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import BesideFolders, Exclude, ResultsFolder
from causal_openlock.cli.terminal import say
from causal_openlock.comparison.progress_bar import shown_steps
from causal_openlock.errors import OpenLockError, first_lines

if TYPE_CHECKING:
    from causal_openlock.comparison.results import Results


def report(
    folder: ResultsFolder,
    against: Annotated[
        Path | None,
        typer.Argument(help="Another one: say what changed, and whether the results differ."),
    ] = None,
    beside: BesideFolders = None,
    exclude: Exclude = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the comparison of two; default: the first."),
    ] = None,
    figures: Annotated[
        bool,
        typer.Option(
            "--figures", help="Also write figures (PDF) and tables (CSV, LaTeX) as files."
        ),
    ] = False,
    methods: Annotated[
        bool, typer.Option("--methods", help="Print the methods section for a paper instead.")
    ] = False,
) -> None:
    """Write the report of a results folder, or compare two folders.

    That of the default comparison takes ten to twenty seconds.
    """
    if against is not None:
        if beside or exclude or methods:
            raise OpenLockError(
                "two folders are compared with one another, whole, and not --beside others; leave "
                "one out, or --exclude and --methods"
            )
        report_difference(folder, against, out or folder, figures)
        return
    if out is not None:
        raise OpenLockError(
            "--out is for the comparison of two folders; a report is written into its own"
        )
    if methods and figures:
        raise OpenLockError("--methods writes no --figures; leave one out")
    from causal_openlock.comparison.results import open_results

    results = open_results(folder, beside=beside or (), exclude=exclude)
    if methods:
        say(results.methods())
    else:
        report_results(results, folder, figures)


def report_results(
    results: Results, folder: Path, figures: bool = False, reasons: bool = True
) -> None:
    """Write the report of results into a folder, and print its leaderboard.

    Without ``reasons`` it is not said why some learners are not applicable: ``compare`` has.
    """
    from causal_openlock.analysis.report.warnings import exclusions, not_applicable
    from causal_openlock.analysis.report.writing import make_report
    from causal_openlock.analysis.results.missing import missing_cells, unfinished
    from causal_openlock.analysis.topics.leaderboard import answers
    from causal_openlock.comparison.console import Terminal, print_leaderboard
    from causal_openlock.storage.store import Store

    with shown_steps("report") as begin:
        page = make_report(results, folder, begin=begin, figures=figures)
    console = Terminal()
    ranked = results.leaderboard
    print_leaderboard(ranked, console, answers(ranked, results.pairs))
    said = not_applicable(results.experiment.reasons) if reasons else ()
    for sentence in (*exclusions(results), *said):
        console.print(sentence, highlight=False)
    if unwritten := Store(folder).unwritten():
        console.warn(unwritten)
    if missing := missing_cells(results.experiment):
        console.print_line(f"\n{unfinished(missing)}", "yellow")
        console.print_line(first_lines([f"  {one.text}" for one in missing], "  "))
    console.print_line(f"report: {page.path}")


def report_difference(first: Path, second: Path, out: Path, figures: bool) -> None:
    """Write a page on what differs between two results folders, and say whether anything does."""
    from causal_openlock.analysis.report.difference_page import write_difference
    from causal_openlock.comparison.results import open_results

    names = first.resolve().name, second.resolve().name
    path = out / f"difference_{names[1]}.html"
    if names[0] == names[1]:
        names = str(first), str(second)
    with shown_steps("report") as begin:
        begin("reading")
        both = open_results(first), open_results(second)
        begin("comparing")
        sentences = write_difference(*both, path, names, figures)
    for sentence in sentences:
        say(sentence)
    say(f"report: {path}")
