"""``causal-openlock recover``: can a study of this size tell these theories apart?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import LearnerError
from causal_openlock.scoring import LAPSE

if TYPE_CHECKING:
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.experiment import Experiment, LearnerSpec
    from causal_openlock.fitting.recovery import Recovery

FEW = 20
"""With fewer simulated subjects in a condition, groups drawn from them say little."""


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
        typer.Option(help="Recover the parameters of this learner, too; it needs a search space."),
    ] = None,
    sets: Annotated[int, typer.Option(min=3, help="Sets of parameters to recover.")] = 20,
    each: Annotated[
        int, typer.Option(min=1, help="Subjects in each condition that share a set.")
    ] = 1,
    candidates: Annotated[int, typer.Option(min=1, help="Settings to try for each fit.")] = 40,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = LAPSE,
    draws: Annotated[
        int, typer.Option(min=1, help="Most copies to ask of a learner without probabilities.")
    ] = 128,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all randomness.")] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/recover-NAME.")
    ] = None,
) -> None:
    """Simulate subjects of every learner, let all predict them, and say who is told apart.

    Goes on where it was. Written are single.csv, groups.csv, by_size.csv, bits.csv, a figure, and
    with --parameters what was recovered of each parameter.
    """
    from causal_openlock.analysis.plots import style
    from causal_openlock.comparison.comparing import play
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.building import Changes
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.experiment.store import Store
    from causal_openlock.experiment.workers import available_cores
    from causal_openlock.fitting.recovery import recovery
    from causal_openlock.fitting.recovery_figure import draw_recovery
    from causal_openlock.scoring.inverse_binomial import Draws
    from causal_openlock.scoring.teacher_forcing import known_learners, score_actions

    console = Terminal()
    changes = Changes(conditions=condition or None, subjects=subjects, seed=seed)
    chosen = read_experiment(find_experiment(experiment), changes, console.print_line)
    specs = list(chosen.learners)
    wanted = known_learners(parameters or (), specs)
    folder = out or Path("results") / f"recover-{chosen.name}"
    cores = workers or available_cores()
    with resumable(), console.status("") as status:
        status.update("subjects are simulated")
        if failed := play(chosen, folder / "simulated", workers=cores, warn=console.warn):
            raise failed
        actions = score_actions(
            *Store(folder / "simulated").record(),
            specs,
            lapse,
            draws=Draws(most=draws),
            workers=cores,
            keep=folder / "scores",
            report=lambda done, total: status.update(f"{done} of {total} parts are scored"),
        )
        found = recovery(actions, chosen.seed)
        files = found.save(folder)
        style.save(draw_recovery(found), folder / "recovery")
        _print(found, console)
        for spec in wanted:
            status.update(f"parameters of {spec.name} are recovered")
            files += _parameters(
                spec, chosen, folder, (sets, each, candidates), lapse, cores, console
            )
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
        else "A study of this size can tell these learners apart, if people follow one of them."
    )


def _parameters(
    spec: LearnerSpec,
    experiment: Experiment,
    folder: Path,
    size: tuple[int, int, int],
    lapse: float,
    workers: int,
    console: Terminal,
) -> list[Path]:
    from causal_openlock.comparison.comparing import play
    from causal_openlock.comparison.console import plain_table
    from causal_openlock.experiment.building import make_experiment
    from causal_openlock.experiment.store import Store
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.fitting.actions import ActionPlan, FitJob, fit_all
    from causal_openlock.fitting.recovery import drawn_sets, made_with, recovered, space_of
    from causal_openlock.fitting.study import require_optuna
    from causal_openlock.scoring.teacher_forcing import recorded_subjects

    require_optuna()
    space = space_of(spec)
    if space is None:
        raise LearnerError(
            f"{spec.name} has no search space of its own as it is set, so its parameters cannot "
            "be recovered; bayes with the policy thompson and theory_based have one"
        )
    sets, each, candidates = size
    truth = drawn_sets(space, sets, experiment.seed)
    made = make_experiment(
        list(experiment.conditions),
        made_with(space, truth, each),
        protocol=spec.protocol,
        seed=experiment.seed,
    )
    own = folder / f"parameters_{spec.name}"
    if failed := play(made, own / "simulated", workers=workers, warn=console.warn):
        raise failed
    record, played = Store(own / "simulated").record()
    plan = ActionPlan(space, lapse, "none", candidates=candidates, seed=experiment.seed)
    jobs = [
        FitJob(one.name, tuple(recorded_subjects(record, played, [one.name])), -1, plan)
        for one in made.learners
    ]
    fits = fit_all(jobs, own, workers=workers)
    pairs, correlated = recovered(truth, fits, space)
    shown = plain_table(f"parameter of {spec.name}", "r", "sets")
    for row in correlated.itertuples():
        shown.add_row(row.parameter, f"{row.r:.2f}", str(row.sets))
    console.print_whole(shown)
    files = [folder / f"parameters_{spec.name}.csv", folder / f"r_{spec.name}.csv"]
    for file, table in zip(files, (pairs, correlated), strict=True):
        write_text(file, csv_of(table.round(6)))
    return files
