"""``causal-openlock compare`` and ``report``: run an experiment, read what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import pandas as pd
    from rich.console import Console
    from rich.table import Table

    from causal_openlock.experiment import Cell, Experiment
    from causal_openlock.store import Store
    from causal_openlock.worker import Watching

MOST_COLUMNS = 1000


def compare(
    experiment: Annotated[
        str, typer.Argument(help="Path of an experiment file, or name of a bundled experiment.")
    ] = "default",
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Folder for the results; by default one of its own in results/."
        ),
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
    seed: Annotated[
        int | None, typer.Option(min=0, max=2**63 - 1, help="Seed of all randomness.")
    ] = None,
    workers: Annotated[
        int | None, typer.Option(min=1, help="Processes; default: one for each core.")
    ] = None,
    checkpoint_every: Annotated[
        float,
        typer.Option(min=0, help="Seconds between checkpoints inside a cell; inf takes none."),
    ] = 60.0,
    tensorboard: Annotated[
        Path | None, typer.Option(help="Folder for TensorBoard's logs, a run for each cell.")
    ] = None,
) -> None:
    """Compare learners; a folder that holds a part of this comparison is completed."""
    from rich.console import Console

    from causal_openlock.errors import Interrupted
    from causal_openlock.experiment_file import Changes, find_experiment, read_experiment
    from causal_openlock.worker import Watching

    changes = Changes(condition or None, learner or None, protocol, subjects, seed)
    chosen = read_experiment(find_experiment(experiment), changes)
    # A changed experiment is another one, and has results of its own.
    own = "" if changes == Changes() else f"-{chosen.identity[:8]}"
    folder = out or Path("results") / f"{chosen.name}{own}"
    console = Console()
    for caution in chosen.cautions():
        _warn(console, caution)
    try:
        watching = Watching(checkpoint_every, str(tensorboard) if tensorboard else None)
        store = _run(chosen, folder, workers, watching, console)
        _report(store, console)
    except KeyboardInterrupt:
        raise Interrupted("stopped; the same command goes on where it was") from None


def report(
    folder: Annotated[Path, typer.Argument(help="Folder that compare or play wrote to.")],
    against: Annotated[
        Path | None,
        typer.Argument(help="Another one: say what changed, and whether it is more than noise."),
    ] = None,
    beside: Annotated[
        list[Path] | None,
        typer.Option(help="Another folder whose learners or people the report shows as well."),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder for the comparison of two; default: the first."),
    ] = None,
) -> None:
    """Write the report of a comparison anew, or of what people played, or compare two of them."""
    from rich.console import Console

    from causal_openlock.errors import OpenLockError
    from causal_openlock.store import Store

    if against is None:
        if out is not None:
            raise OpenLockError(
                "--out is for the comparison of two folders; a report is written into its own"
            )
        _report(Store(folder), Console(), [Store(other) for other in beside or ()])
    elif beside:
        raise OpenLockError(
            "two folders are compared with one another and not shown --beside others; leave one out"
        )
    else:
        from causal_openlock.cli.difference import difference

        difference(folder, against, out or folder, Console())


def _run(
    experiment: Experiment,
    folder: Path,
    workers: int | None,
    watching: Watching,
    console: Console,
) -> Store:
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeElapsedColumn as Elapsed
    from rich.progress import TimeRemainingColumn as Remaining

    from causal_openlock.runner import run

    cells = list(experiment.cells())
    known = finished = 0
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
            nonlocal known, finished
            known += before
            finished += 1
            bar.update(task, completed=finished, description=f"{experiment.name}: {cell.name}")

        def progress(inside: float) -> None:
            bar.update(task, completed=finished + inside)

        store = run(
            experiment,
            folder,
            workers=workers,
            done=done,
            warn=partial(_warn, bar.console),
            progress=progress,
            watching=watching,
        )
        bar.update(task, description=experiment.name)
    if known:
        console.print(f"{known} of {len(cells)} cells were there already")
    return store


def _warn(console: Console, sentence: str) -> None:
    console.print(f"warning: {sentence}", style="yellow", soft_wrap=True, highlight=False)


def _report(store: Store, console: Console, others: Sequence[Store] = ()) -> None:
    from causal_openlock.analysis.people.beside import beside
    from causal_openlock.analysis.report.reading import read_results
    from causal_openlock.analysis.report.sections import columns_of
    from causal_openlock.analysis.report.writing import make_report

    columns = columns_of()
    record, description = beside([read_results(one, columns) for one in (store, *others)])
    missing = description.get("missing_cells", [])
    if missing:
        _warn(
            console,
            f"{len(missing)} cells are not there yet ({', '.join(missing[:3])}"
            f"{', ...' * (len(missing) > 3)}); compare completes them",
        )
    made = make_report(record, store.folder, description)
    learners = [learner["name"] for learner in description["learners"]]
    conditions = [condition["name"] for condition in description["conditions"]]
    _print_headline(made.headline, learners, conditions, console)
    console.print(f"report: {made.path}", soft_wrap=True, highlight=False)


def _print_headline(
    table: pd.DataFrame, learners: list[str], conditions: list[str], console: Console
) -> None:
    """The headline, for each protocol a row for each learner and a column for each condition."""
    from rich.table import Table

    for protocol in table["protocol"].unique():
        rows = table[table["protocol"] == protocol]
        played = set(rows["condition"])
        console.print(f"\n[bold]Attempts to find every solution, protocol {protocol}[/bold]")
        shown = Table(box=None, padding=(0, 2, 0, 0))
        shown.add_column("", min_width=max(map(len, [*learners, "published model"])))
        for condition in (order := [name for name in conditions if name in played]):
            at = rows.loc[rows["condition"] == condition, "measured"].iloc[0]
            shown.add_column(f"{condition}\n{at}", justify="right", no_wrap=True)
        for name, column, look in (
            ("people", "human_attempts", "bold"),
            ("published model", "model_attempts", ""),
            ("ideal observer", "ideal_attempts", ""),
        ):
            known = [_first(rows, condition, column) for condition in order]
            if any(known):
                shown.add_row(name, *known, style=look)
        for learner in learners:
            own = rows[rows["learner"] == learner]
            if len(own):
                cells = [_cell(own[own["condition"] == condition]) for condition in order]
                shown.add_row(learner, *cells)
        print_whole(shown, console)
    console.print(
        "\nMeans over subjects, the solving attempt included, with 95% bootstrap intervals; a "
        "trial not solved counts as its limit.",
        style="dim",
    )


def print_whole(table: Table, console: Console) -> None:
    """Print a table with all its columns, wider than the terminal if it must be."""
    # A column that is cut off would be lost; a line that wraps is only ugly.
    wide = console.measure(table, options=console.options.update(max_width=MOST_COLUMNS))
    usual = console.width
    console.width = max(usual, wide.maximum)
    console.print(table, crop=False)
    console.width = usual


def _first(rows: pd.DataFrame, condition: str, column: str) -> str:
    value = rows.loc[rows["condition"] == condition, column].iloc[0]
    return "" if value != value else _number(value)


def _cell(rows: pd.DataFrame) -> str:
    """Mean, interval, and how many trials were solved if not all were."""
    if not len(rows):
        return ""
    row = rows.iloc[0]
    lines = [_number(row.attempts)]
    if row.ci_low < row.ci_high:
        lines.append(f"[dim]{_number(row.ci_low)}–{_number(row.ci_high)}[/dim]")
    if row.share_solved < 1:
        lines.append(f"[dim]{row.share_solved:.0%} solved[/dim]")
    return "\n".join(lines)


def _number(attempts: float) -> str:
    return f"{attempts:.2f}" if attempts < 100 else f"{attempts:.0f}"
