"""``causal-openlock design``: which theories can be told apart, in which conditions?"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.comparison.progress_bar import counting, shown_steps
from causal_openlock.design import COPIES
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import folder_at, write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.scoring import LAPSE

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.comparison.console import Terminal

FEW = 20  #: simulated subjects in a condition below which groups drawn from them say little
CONFUSED = 0.1
"""Share of groups that is attributed to another theory, above which two theories are confused."""


def design(
    experiment: Annotated[
        str, typer.Argument(help="An experiment: its learners are the theories.")
    ],
    known: Annotated[
        bool, typer.Option("--known", help="Take all parameters as known, as they are declared.")
    ] = False,
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
        int, typer.Option(min=1, help="Sets of unknown parameters to average over.")
    ] = 8,
    copies: Annotated[
        int,
        typer.Option(
            min=1,
            help="Most copies to ask of a learner without probabilities; with few, what it hardly "
            "ever does is estimated too low.",
        ),
    ] = COPIES,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = LAPSE,
    parameters: Annotated[
        list[str] | None, typer.Option(help="Also recover the parameters of this learner.")
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
    candidates: Annotated[int, typer.Option(min=1, help="Settings to try for each fit.")] = 160,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness.")] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/design-NAME.")
    ] = None,
) -> None:
    """Say which theories can be told apart, and in which conditions.

    Theories are the learners; unknown are those of their parameters whose value lies in a range of
    the learner's search space. Subjects of each are simulated, and all theories predict them.
    Conditions are ranked by what a minute of a person's time tells. What was stopped is continued
    by the same command. Written are conditions.csv, subjects.csv, confusion.csv, bits.csv,
    design.json, with all settings, a figure, and with --parameters what was recovered.
    """
    from causal_openlock.analysis.plots import style
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.design.apart import theories_of, told_apart, unknown
    from causal_openlock.design.figure import draw_confusion
    from causal_openlock.design.parameters import correlations, parameters_recovered, searched
    from causal_openlock.design.telling import bits, by_size, informed, most_bits, ranked
    from causal_openlock.experiment.making import Changes, find_experiment, read_experiment
    from causal_openlock.running.workers import available_cores
    from causal_openlock.scoring.teacher_forcing import known_learners

    console, workers = Terminal(), workers or available_cores()
    changes = Changes(conditions=condition or None, subjects=subjects, seed=seed)
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    outside, draws = outside or [], 0 if known else draws
    theories = theories_of(chosen, outside)
    wanted = known_learners(parameters or (), chosen.learners)
    if search and len(wanted) != 1:
        raise OpenLockError("--search is for one learner; name it with --parameters")
    spaces = [searched(spec, search or ()) for spec in wanted]  # before hours of work
    folder = folder_at(out or Path("results") / f"design-{chosen.name}")
    ranges = {spec.name: unknown(spec) if draws else {} for spec in theories}
    for name, own in ranges.items():
        drawn = [f"{key} {bounds.low:g} to {bounds.high:g}" for key, bounds in own.items()]
        console.print_line(f"unknown of {name}: {', '.join(drawn) or 'nothing'}")
    with resumable(), shown_steps("design") as begin:
        simulated = told_apart(
            chosen, folder, draws=draws, lapse=lapse, copies=copies, outside=outside,
            workers=workers, report=counting(begin, "subjects"),
        )  # fmt: skip
        recovered = {
            spec.name: parameters_recovered(
                spec, space, chosen, folder / f"parameters_{spec.name}", sets=sets,
                candidates=candidates, lapse=lapse, workers=workers,
                report=counting(begin, f"sets of {spec.name}"),
            )
            for spec, space in zip(wanted, spaces, strict=True)
        }  # fmt: skip
    every, sizes = informed(simulated), by_size(simulated, chosen.seed)
    tables = {
        "conditions": ranked(simulated),
        "subjects": every,
        "confusion": sizes,
        "bits": bits(simulated).reset_index(),
        **{f"parameters_{name}": pairs for name, pairs in recovered.items()},
    }
    console.print_line(tables["conditions"].round(3).to_string(index=False))
    console.print_line(
        "The columns are those of conditions.csv: information is a lower bound, in bits, of what a "
        "subject tells about the theory that made it, se its standard error (at most "
        f"{most_bits(len(theories)):.2f} can be told); single the share of subjects attributed "
        "right; minutes those of the paper's people for as many attempts."
    )
    for name in outside:
        own = every[every["learner"] == name]
        far = own["unlike"].mean()
        beyond = "" if math.isnan(far) else f"; {far:.0%} are predicted worse than 95% of its own"
        console.print_line(
            f"{name}, of no theory: of {own['certain'].mean():.0%} of subjects a theory seems "
            f"certain{beyond}"
        )
    _print_confusion(sizes, every["single"].dropna(), console)
    for (name, pairs), space in zip(recovered.items(), spaces, strict=True):
        console.print_line(f"parameters of {name}:")
        console.print_line(correlations(pairs, space).round(2).to_string())
    for name, table in tables.items():
        write_text(folder / f"{name}.csv", csv_of(table.round(6)))
    style.save(draw_confusion(sizes), folder / "design.svg")
    settings = {
        "experiment": chosen.as_dict(),
        "unknown": ranges,
        **{"outside": outside, "draws": draws, "lapse": lapse, "copies": copies},
    }
    write_text(folder / "design.json", json.dumps(settings, indent=2, default=vars) + "\n")
    files = ", ".join(f"{name}.csv" for name in tables)
    console.print_line(f"{folder}: {files}, design.svg and design.json written")


def _print_confusion(sizes: pd.DataFrame, single: pd.Series[float], console: Terminal) -> None:
    """Print who is attributed to whom, and what that means for a study of this size."""
    from causal_openlock.analysis.statistics import share_interval
    from causal_openlock.design.telling import confusion

    largest, groups = int(sizes["subjects"].max()), confusion(sizes, of_groups=True)
    for table, what in ((confusion(sizes), "a subject"), (groups, f"a group of {largest}")):
        console.print_line(f"{what} (rows: made by) is attributed to:")
        shares = table.rename_axis(index=None)
        console.print_line(shares.map(lambda share: f"{share:.2f}" if share else "").to_string())
    right = sum(groups.loc[name, name] for name in groups) / len(groups)
    low, high = share_interval(single.mean(), len(single))
    interval = "" if math.isnan(low) else f" ({low:.0%} to {high:.0%})"
    console.print_line(
        f"Attributed to the theory that made them: {single.mean():.0%} of {len(single)} subjects"
        f"{interval}, and {right:.0%} of groups of {largest}."
    )
    confused = [
        f"{maker} for {taken} ({share:.0%} of groups)"
        for (maker, taken), share in groups.stack().items()
        if maker != taken and share > CONFUSED
    ]
    verdict = "A study of this size can tell these theories apart, if people follow one of them "
    verdict += "with such parameters."
    if confused:
        verdict = f"Taken for another: {'; '.join(confused)}. A study of this size cannot tell "
        verdict += "these apart."
    if largest < FEW:
        verdict = f"Groups are drawn from {largest} subjects, too few for a verdict: simulate at "
        verdict += f"least {FEW}."
    console.print_line(verdict)
