"""``causal-openlock compare`` and ``report``: run an experiment, read what came of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    import pandas as pd
    from rich.text import Text

    from causal_openlock.analysis.report.missing import Missing
    from causal_openlock.cli.terminal import Console
    from causal_openlock.experiment.experiment import Cell, Experiment
    from causal_openlock.experiment.store import Store
    from causal_openlock.experiment.worker import Watching

MOST_TOLD = 40
"""Missing cells that are told of on the terminal; the report has them all."""


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
    time_limit: Annotated[
        float | None,
        typer.Option(
            min=0.001,
            help="Seconds after which a cell is ended and counted as failed; by default never.",
        ),
    ] = None,
    tensorboard: Annotated[
        Path | None, typer.Option(help="Folder for TensorBoard's logs, a run for each cell.")
    ] = None,
) -> None:
    """Compare learners; a folder that holds a part of this comparison is completed.

    Exit status: 0 if everything was played, 1 if cells failed and all others were played, 2 if what
    was asked for cannot be done, 130 or 143 if it was stopped.
    """
    from causal_openlock.cli.stopping import goes_on
    from causal_openlock.cli.terminal import Console
    from causal_openlock.errors import CellsFailed, OpenLockError
    from causal_openlock.experiment.expected_cost import cost_cautions
    from causal_openlock.experiment.file import Changes, find_experiment, read_experiment
    from causal_openlock.experiment.store import Store
    from causal_openlock.experiment.worker import Watching

    changes = Changes(condition or None, learner or None, protocol, subjects, seed)
    console = Console()
    tell = partial(console.print, soft_wrap=True, highlight=False)
    chosen = read_experiment(find_experiment(experiment), changes, tell)
    # A changed experiment is another one, and has results of its own.
    own = "" if changes == Changes() else f"-{chosen.identity[:8]}"
    folder = out or Path("results") / f"{chosen.name}{own}"
    if own and (name := Store(folder).name):  # other learners, say: one comparison all the same
        chosen = replace(chosen, name=name)
    for caution in [*chosen.cautions(), *cost_cautions(chosen)]:
        _warn(console, caution)
    with goes_on():
        watching = Watching(checkpoint_every, str(tensorboard) if tensorboard else None)
        try:
            store = _run(chosen, folder, workers, watching, time_limit, console)
        except CellsFailed as failed:
            if len(failed.reasons) == failed.cells:  # there is nothing to report
                raise
            _report(Store(folder), console)
            error = OpenLockError(failed.summary)  # which they are stands above
            error.status = failed.status
            raise error from None
        _report(store, console)


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
    from causal_openlock.cli.terminal import Console
    from causal_openlock.errors import OpenLockError
    from causal_openlock.experiment.store import Store

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
    time_limit: float | None,
    console: Console,
) -> Store:
    from causal_openlock.cli.progress import shown
    from causal_openlock.experiment.runner import run

    known = 0

    def done(cell: Cell, before: bool) -> None:
        nonlocal known
        known += before

    with shown(experiment.name, console) as show:
        store = run(
            experiment,
            folder,
            workers=workers,
            done=done,
            failed=lambda cell, why: _warn(console, why),
            warn=partial(_warn, console),
            progress=show,
            watching=watching,
            time_limit=time_limit,
        )
    if known:
        console.print(f"{known} of {len(list(experiment.cells()))} cells were there already")
    return store


def _warn(console: Console, sentence: str) -> None:
    text = f"warning: {sentence}"
    console.print(text, style="yellow", soft_wrap=True, highlight=False, markup=False)


def _report(store: Store, console: Console, others: Sequence[Store] = ()) -> None:
    from causal_openlock.analysis.report.missing import missing_cells
    from causal_openlock.analysis.report.sections import columns_of
    from causal_openlock.analysis.report.writing import make_report
    from causal_openlock.analysis.results.reading import beside, read_results

    columns = columns_of()
    record, experiment = beside([read_results(one, columns) for one in (store, *others)])
    made = make_report(record, store.folder, experiment)
    learners = [spec.name for spec in experiment.learners]
    conditions = [condition.name for condition in experiment.conditions]
    _print_headline(made.headline, learners, conditions, console)
    _print_missing(missing_cells(experiment), console)
    console.print(f"report: {made.path}", soft_wrap=True, highlight=False)


def _print_missing(missing: Sequence[Missing], console: Console) -> None:
    """What none of the numbers is about, a line for each cell."""
    from causal_openlock.analysis.report.prose import Prose

    if missing:
        failed = sum(one.failed for one in missing)
        text = Prose("report").sentence("unfinished", cells=len(missing), failed=failed)
        console.print(f"\n{text}", style="yellow", soft_wrap=True, highlight=False)
    for one in missing[:MOST_TOLD]:
        console.print(f"  {one.text}", soft_wrap=True, highlight=False, markup=False)
    if len(missing) > MOST_TOLD:
        console.print(f"  and {len(missing) - MOST_TOLD} more")


def _print_headline(
    table: pd.DataFrame, learners: list[str], conditions: list[str], console: Console
) -> None:
    """The headline, for each protocol a row for each learner and a column for each condition."""
    from rich.table import Table

    from causal_openlock.analysis.report.prose import Prose

    for protocol in table["protocol"].unique():
        rows = table[table["protocol"] == protocol]
        played = set(rows["condition"])
        console.print(f"\nAttempts to find every solution, protocol {protocol}", style="bold")
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
        console.print_whole(shown)
    text = Prose("report").sentence("measure")
    console.print(f"\n{text} With 95% bootstrap intervals.", style="dim", highlight=False)


def _first(rows: pd.DataFrame, condition: str, column: str) -> str:
    value = rows.loc[rows["condition"] == condition, column].iloc[0]
    return "" if value != value else _number(value)


def _cell(rows: pd.DataFrame) -> Text:
    """Mean, interval, and how many trials were solved if not all were."""
    from rich.text import Text

    if not len(rows):
        return Text()
    row = rows.iloc[0]
    lines = [Text(_number(row.attempts))]
    if row.ci_low < row.ci_high:
        lines.append(Text(f"{_number(row.ci_low)}–{_number(row.ci_high)}", "dim"))
    if row.share_solved < 1:
        lines.append(Text(f"{row.share_solved:.0%} solved", "dim"))
    return Text("\n").join(lines)


def _number(attempts: float) -> str:
    return f"{attempts:.2f}" if attempts < 100 else f"{attempts:.0f}"
