"""``causal-openlock recover``: can a study of this size tell these theories apart?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import OpenLockError
from causal_openlock.scoring import LAPSE

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.fitting.recovery import Recovery

FEW = 20
"""Simulated subjects in a condition below which groups drawn from them say little."""


def recover(
    experiment: Annotated[str, typer.Argument(help="An experiment: name or file.")],
    subjects: Annotated[
        int | None, typer.Option(min=1, help="Subjects of each learner in each condition.")
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option("--condition", "-c", help="Only these conditions.")
    ] = None,
    parameters: Annotated[
        list[str] | None,
        typer.Option(help="Also recover the parameters of this learner."),
    ] = None,
    search: Annotated[
        list[str] | None,
        typer.Option(
            "--search",
            "-s",
            help="Parameters to recover: name=low:high, or ...:log; needed where the learner has "
            "no search space of its own.",
        ),
    ] = None,
    sets: Annotated[int, typer.Option(min=3, help="Sets of parameters to recover.")] = 20,
    each: Annotated[
        int, typer.Option(min=1, help="Subjects in each condition that share a set.")
    ] = 1,
    candidates: Annotated[int, typer.Option(min=1, help="Settings to try for each fit.")] = 160,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = LAPSE,
    draws: Annotated[
        int,
        typer.Option(
            min=1,
            help="Most copies to ask of a learner without probabilities; with few, what it hardly "
            "ever does is estimated too low.",
        ),
    ] = 128,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness.")] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/recover-NAME.")
    ] = None,
) -> None:
    """Simulate learners, and say which of them can be distinguished.

    Every learner predicts the subjects of every learner. What was stopped is continued by the same
    command. Written are single.csv, groups.csv, by_size.csv, bits.csv, a figure, and
    with --parameters what was recovered of each parameter.
    """
    from causal_openlock.analysis.plots import style
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.experiment.making import Changes
    from causal_openlock.files.atomic import folder_at
    from causal_openlock.fitting.recovering import (
        Running,
        ToRecover,
        is_another_twentieth,
        parameters_recovered,
        predicted,
        searched,
    )
    from causal_openlock.fitting.recovery import recovery
    from causal_openlock.fitting.recovery_figure import draw_recovery
    from causal_openlock.running.workers import available_cores
    from causal_openlock.scoring.teacher_forcing import known_learners

    console = Terminal()
    changes = Changes(conditions=condition or None, subjects=subjects, seed=seed)
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    wanted = known_learners(parameters or (), chosen.learners)
    if search and len(wanted) != 1:
        raise OpenLockError("--search is for one learner; name it with --parameters")
    spaces = [searched(spec, search or ()) for spec in wanted]  # before hours of work
    folder = folder_at(out or Path("results") / f"recover-{chosen.name}")
    size = ToRecover(draws=draws, lapse=lapse, sets=sets, each=each, candidates=candidates)
    with resumable(), console.status("") as status:

        def running(what: str) -> Running:
            def report(done: int, total: int) -> None:
                status.update(f"{what}: {done} of {total} parts")
                if not console.is_terminal and is_another_twentieth(done, total):
                    console.print_line(f"{what}: {done} of {total} parts")

            status.update(f"{what}: 0 parts are done")
            return Running(workers or available_cores(), console.warn, report=report)

        found = recovery(predicted(chosen, folder, size, running("scores")), chosen.seed)
        files = found.save(folder)
        style.save(draw_recovery(found), folder / "recovery.svg")
        _print(found, console)
        for spec, space in zip(wanted, spaces, strict=True):
            own = folder / f"parameters_{spec.name}"
            tables = parameters_recovered(spec, chosen, own, size, running(spec.name), space)
            files += _parameters(spec.name, folder, tables, console)
    names = ", ".join(file.name for file in files)
    console.print_line(f"{folder}: {names} and recovery.svg written")


def _print(found: Recovery, console: Terminal) -> None:
    from scipy.stats import binomtest

    from causal_openlock.comparison.console import plain_table

    for table, of in ((found.single, "a subject"), (found.groups, f"a group of {found.subjects}")):
        shown = plain_table(f"made by; {of} is attributed to:", *table.columns)
        for name, row in table.iterrows():
            shown.add_row(str(name), *(f"{share:.2f}" if share else "" for share in row))
        console.print_whole(shown)
    groups, single = found.shares_right()
    low = binomtest(round(single * found.made), found.made).proportion_ci(method="exact").low
    console.print_line(
        f"With {found.subjects} subjects in a condition, {groups:.0%} of groups and {single:.0%} "
        f"of single subjects are attributed to the learner that made them (of "
        f"{found.made}: at least {low:.0%} with 97.5% confidence)."
    )
    confused = [
        f"{maker} for {taken} ({share:.0%} of groups)"
        for maker, taken, share in found.confused(found.groups)
    ]
    if found.subjects < FEW:
        console.print_line(
            f"Groups are drawn from {found.subjects} subjects, too few for a verdict: simulate at "
            f"least {FEW}."
        )
        return
    console.print_line(
        f"Taken for another: {'; '.join(confused)}. A study of this size cannot tell these apart."
        if confused
        else "A study of this size can tell these learners apart, if people follow one of them "
        "with these parameters."
    )


def _parameters(
    name: str, folder: Path, tables: tuple[pd.DataFrame, pd.DataFrame], console: Terminal
) -> list[Path]:
    from causal_openlock.comparison.console import plain_table
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of

    shown = plain_table(f"parameter of {name}", "r", "sets", "at a bound")
    at_bound = tables[0].groupby("parameter")["at_bound"].sum()
    for row in tables[1].itertuples():
        shown.add_row(row.parameter, f"{row.r:.2f}", str(row.sets), str(at_bound[row.parameter]))
    console.print_whole(shown)
    files = [folder / f"parameters_{name}.csv", folder / f"r_{name}.csv"]
    for file, table in zip(files, tables, strict=True):
        write_text(file, csv_of(table.round(6)))
    return files
