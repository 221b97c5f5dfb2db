"""``causal-openlock design``: which conditions tell theories apart, for the least time?"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
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
        typer.Option(
            help="A learner of the experiment that makes subjects without being a theory."
        ),
    ] = None,
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

    A minute is one of a person's time. Theories are the learners, with unknown parameters: those
    whose value lies in a range of the learner's search space. Subjects of each are simulated, and
    all theories predict them. What was stopped is continued by the same command. Written are
    conditions.csv, a row for each condition; subjects.csv; and design.json, with all settings.
    """
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.progress_bar import counting, shown_steps
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.experiment.making import Changes
    from causal_openlock.files.atomic import folder_at, write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.fitting.design import (
        Effort,
        information_ends,
        informed,
        ranked,
        theories_of,
        told_apart,
        unknown,
    )
    from causal_openlock.running.workers import available_cores

    console = Terminal()
    changes = Changes(conditions=condition or None, subjects=subjects, seed=seed)
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    effort, theories = Effort(draws, lapse), theories_of(chosen, outside or ())
    folder = folder_at(out or Path("results") / f"design-{chosen.name}")
    ranges = {one.name: unknown(one) for one in theories}
    for name, own in ranges.items():
        drawn = [f"{key} {each.low:g} to {each.high:g}" for key, each in own.items()]
        console.print_line(f"unknown of {name}: {', '.join(drawn) or 'nothing'}")
    with resumable(), shown_steps("design") as begin:
        simulated = told_apart(
            chosen,
            effort,
            outside=outside or (),
            folder=folder / "subjects",
            workers=workers or available_cores(),
            report=counting(begin, "subjects"),
        )
    table, every = ranked(simulated), informed(simulated)
    _print(table, console)
    for name, found in {"conditions": table, "subjects": every}.items():
        write_text(folder / f"{name}.csv", csv_of(found.round(6)))
    settings = {
        "experiment": chosen.as_dict(),
        "unknown": {name: {key: asdict(one) for key, one in own.items()}
                    for name, own in ranges.items()},
        "outside": outside or [],
        **asdict(effort),
    }  # fmt: skip
    write_text(folder / "design.json", json.dumps(settings, indent=2, default=str) + "\n")
    console.print_line(
        "The columns are those of conditions.csv: single is the share of subjects attributed "
        "right; information a lower bound, in bits, of what a subject tells about the theory that "
        f"made it, ± its standard error (at most {information_ends(len(theories))[1]:.2f} can be "
        "told); minutes those of the paper's people for as many attempts."
    )
    for name in outside or ():
        own = every[every["learner"] == name]
        far = own["unlike"].mean()
        beyond = "" if math.isnan(far) else f"; {far:.0%} are predicted worse than 95% of its own"
        console.print_line(
            f"{name}, of no theory: of {own['certain'].mean():.0%} of subjects a theory seems "
            f"certain{beyond}"
        )
    console.print_line(f"{folder}: conditions.csv, subjects.csv, design.json written")


def _print(table: pd.DataFrame, console: Terminal) -> None:
    from causal_openlock.comparison.console import plain_table

    shown = plain_table("condition", "subjects", "single", "information", "minutes", "per_minute")
    for row in table.itertuples():
        error = "" if math.isnan(row.se) else f" ± {row.se:.2f}"
        shown.add_row(
            row.condition,
            str(row.subjects),
            f"{row.single:.0%}",
            f"{row.information:.2f}{error}",
            f"{row.minutes:.0f}",
            f"{row.per_minute:.3f}",
        )
    console.print_whole(shown)
