"""``causal-openlock design``: which conditions tell theories apart, for the least time?"""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.scoring import LAPSE

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.comparison.console import Terminal


def design(
    experiment: Annotated[
        str, typer.Argument(help="An experiment: its learners are the theories.")
    ],
    subjects: Annotated[
        int | None, typer.Option(min=1, help="Subjects of each theory in each condition.")
    ] = None,
    condition: Annotated[
        list[str] | None, typer.Option("--condition", "-c", help="Only these conditions.")
    ] = None,
    outside: Annotated[
        list[str] | None,
        typer.Option(help="A learner that makes subjects and is none of the theories."),
    ] = None,
    halving: Annotated[
        bool,
        typer.Option(
            "--halving",
            help="Give up the half of the conditions that tells least a minute, double the "
            "subjects, and so on, until two are left.",
        ),
    ] = False,
    draws: Annotated[
        int, typer.Option(min=1, help="Most sets of unknown parameters to average over.")
    ] = 8,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = LAPSE,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness.")] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/design-NAME.")
    ] = None,
) -> None:
    """Rank conditions by how well a minute tells theories apart.

    Theories are the learners, with unknown parameters: those whose value lies in a range of the
    learner's search space. Subjects of each are simulated, and all theories predict them. What was
    stopped is continued by the same command. Written are conditions.csv, a row for each round and
    condition, and subjects.csv, of the last round.
    """
    import pandas as pd

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.progress_bar import shown_steps
    from causal_openlock.experiment.building import Changes
    from causal_openlock.experiment.experiment import Experiment
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.fitting.design import Effort, halved, informed, ranked, told_apart
    from causal_openlock.running.workers import available_cores

    console = Terminal()
    changes = Changes(conditions=condition or None, subjects=subjects, seed=seed)
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    folder = out or Path("results") / f"design-{chosen.name}"
    last: list[pd.DataFrame] = []
    with resumable(), shown_steps("design") as begin:

        def simulate(asked: Experiment) -> pd.DataFrame:
            last[:] = [
                told_apart(
                    asked,
                    Effort(draws, lapse),
                    outside=outside or (),
                    folder=folder / "subjects",
                    workers=workers or available_cores(),
                    report=lambda done, total: begin(f"{done} of {total} subjects"),
                )
            ]
            return last[0]

        tables = halved(chosen, simulate) if halving else iter([ranked(simulate(chosen))])
        rounds = []
        for number, table in enumerate(tables, 1):
            _print(table, console)
            rounds.append(table.assign(round=number))
    for name, found in {"conditions": pd.concat(rounds), "subjects": informed(last[0])}.items():
        write_text(folder / f"{name}.csv", csv_of(found.round(6)))
    console.print_line(f"{folder}: conditions.csv, subjects.csv written")


def _print(table: pd.DataFrame, console: Terminal) -> None:
    from causal_openlock.comparison.console import plain_table

    shown = plain_table("condition", "subjects", "right", "bits", "minutes", "bits a minute")
    for row in table.itertuples():
        error = "" if math.isnan(row.se) else f" ± {row.se:.2f}"
        shown.add_row(
            row.condition, str(row.subjects), f"{row.single:.0%}",
            f"{row.information:.2f}{error}", f"{row.minutes:.0f}", f"{row.per_minute:.3f}",
        )  # fmt: skip
    console.print_whole(shown)
    first = table.iloc[0]
    console.print_line(
        f"{first['condition']} tells most a minute. Bits are a lower bound of the information "
        "about the theory that made a subject, ± its standard error; minutes, at the pace of the "
        "paper's people."
    )
