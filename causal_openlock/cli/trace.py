"""``causal-openlock trace``: the beliefs of a subject in a trial, in words and as a picture."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.one_trial import one_trial
from causal_openlock.cli.options import (
    ConditionName,
    ExperimentName,
    ProtocolName,
    Seed,
    SubjectNumber,
)


def trace(
    condition: ConditionName,
    learner: Annotated[
        str,
        typer.Option("--learner", "-l", help="The learner; it must hold beliefs, as bayes does."),
    ] = "bayes",
    trial: Annotated[
        int, typer.Option(min=1, help="The trial, counted over the whole condition.")
    ] = 1,
    subject: SubjectNumber = 0,
    seed: Seed = None,
    protocol: ProtocolName = None,
    experiment: ExperimentName = "default",
    attempts: Annotated[int, typer.Option(min=1, help="Attempts to describe at most.")] = 30,
    actions: Annotated[int, typer.Option(min=1, help="Actions to draw at most.")] = 36,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Picture to write (SVG, PNG or PDF, by its suffix)."),
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Write a row for each action to this CSV file, too.")
    ] = None,
) -> None:
    """Describe a trial: what a subject did, saw and learned, and what it believes."""
    from causal_openlock.analysis.plots.belief import check_suffix, save_trace_figure
    from causal_openlock.belief.trace import trace_text, trace_trial
    from causal_openlock.cli.terminal import say
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of

    who, how = one_trial(condition, learner, trial, subject, seed, protocol, experiment)
    path = check_suffix(out or Path(f"trace_{who[1].name}.svg"))
    traced = trace_trial(*who, **how)
    for line in trace_text(traced, attempts):
        say(line)
    save_trace_figure(traced, path, actions)
    say(f"\n{path} written")
    if table is not None:
        write_text(table, csv_of(traced.table()))
        say(f"{table} written")
