"""``causal-openlock compare`` and ``report``: run an experiment, read what came of it."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console

    from causal_openlock.experiment import Cell, Experiment
    from causal_openlock.store import Store



def compare(
    experiment: Annotated[
        str, typer.Argument(help="Path of an experiment file, or name of a bundled experiment.")
    ] = "default",
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the results; default results/EXPERIMENT."),
    ] = None,
    condition: Annotated[
        list[str] | None,
        typer.Option("--condition", "-c", help="Play this instead: CC4, CC3-CC4, my.yaml, ..."),
    ] = None,
    learner: Annotated[
        list[str] | None, typer.Option("--learner", "-l", help="Let this play instead.")
    ] = None,
    protocol: Annotated[
        str | None, typer.Option(help="human, rl, or one that the experiment declares.")
    ] = None,
    subjects: Annotated[
        int | None, typer.Option(min=1, help="Subjects for each learner and condition.")
    ] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness.")] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: one for each core.")
    ] = None,
) -> None:
    """Compare learners; a folder that holds a part of this comparison is completed."""
    from rich.console import Console

    from causal_openlock.experiment_file import Changes, find_experiment, read_experiment

    changes = Changes(condition or None, learner or None, protocol, subjects, seed)
    chosen = read_experiment(find_experiment(experiment), changes)
    folder = out or Path("results") / chosen.name
    console = Console()
    store = _run(chosen, folder, workers, console)
    _report(store, store.record(chosen), console)


def report(
    folder: Annotated[Path, typer.Argument(help="Folder that compare wrote to.")],
) -> None:
    """Write the report of a comparison anew, from its record."""
    from rich.console import Console

    from causal_openlock.store import Store

    store = Store(folder)
    store.description()
    _report(store, store.record(), Console())


def _run(experiment: Experiment, folder: Path, workers: int | None, console: Console) -> Store:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeElapsedColumn as Elapsed
    from rich.progress import TimeRemainingColumn as Remaining

    from causal_openlock.runner import run

    cells = list(experiment.cells())
    known = 0
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("cells"),
        Elapsed(),
        TextColumn("left"),
        Remaining(),
        console=console,
    )
    with bar:
        task = bar.add_task(experiment.name, total=len(cells))

        def done(cell: Cell, before: bool) -> None:
            nonlocal known
            known += before
            bar.update(task, advance=1, description=f"{experiment.name}: {cell.name}")

        def warn(sentence: str) -> None:
            bar.console.print(f"warning: {sentence}", style="yellow", soft_wrap=True)

        store = run(experiment, folder, workers=workers, done=done, warn=warn)
        bar.update(task, description=experiment.name)
    if known:
        console.print(f"{known} of {len(cells)} cells were there already")
    return store


def _report(store: Store, record: Any, console: Console) -> None:
    from causal_openlock.analysis.report import write_report
    from causal_openlock.analysis.summary import headline_table

    held = store.description()
    held.pop("identity", None)
    path = write_report(record, store.folder, held)
    _print_headline(headline_table(record), console)
    console.print(f"\nreport: {path}", soft_wrap=True, highlight=False)


def _print_headline(table: pd.DataFrame, console: Console) -> None:
    """The headline, a row for each learner and condition, people beside it."""
    from rich.table import Table

    shown = Table(
        *("learner", "protocol", "condition", "at", "n", "attempts", "95%", "solved", "people"),
        title="Attempts to find every solution (mean, bootstrap interval)",
        title_justify="left",
        box=None,
        padding=(0, 2, 0, 0),
    )
    for column in shown.columns[4:]:
        column.justify = "right"
        column.no_wrap = True
    last = None
    for row in table.itertuples():
        if last not in (None, (row.learner, row.protocol)):
            shown.add_section()
        last = (row.learner, row.protocol)
        people = "" if row.human_attempts != row.human_attempts else f"{row.human_attempts:.2f}"
        interval = "" if row.ci_low != row.ci_low else f"{row.ci_low:.2f}–{row.ci_high:.2f}"
        shown.add_row(
            row.learner,
            row.protocol,
            row.condition,
            row.measured,
            str(row.subjects),
            f"{row.attempts:.2f}",
            interval,
            f"{row.share_solved:.0%}",
            people,
        )
    console.print(shown)
