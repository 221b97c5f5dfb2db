"""``causal-openlock fit``: which parameters make a learner do what people did?"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.files.atomic import folder_at, is_empty


def fit(
    learner: Annotated[str, typer.Argument(help="Registered name of a learner.")] = "bayes",
    plan: Annotated[
        Path | None,
        typer.Option(
            "--plan",
            "--space",
            help="File with what is searched and how; bayes and theory_based have a search space "
            "of their own.",
        ),
    ] = None,
    search: Annotated[
        list[str] | None,
        typer.Option("--search", "-s", help="Search this instead: name=low:high, or ...:log."),
    ] = None,
    fix: Annotated[
        list[str] | None, typer.Option("--fix", "-f", help="Set a parameter: name=value.")
    ] = None,
    settings: Annotated[
        list[str] | None,
        typer.Option(
            "--set", help="Set how the fit is made, as under fit: in a plan: candidates=120."
        ),
    ] = None,
    to: Annotated[
        Path | None,
        typer.Option(help="Fit to every action of the subjects in this results folder instead."),
    ] = None,
    hierarchical: Annotated[
        bool, typer.Option(help="With --to: fit each subject, and the group that they are from.")
    ] = False,
    of: Annotated[
        list[str] | None, typer.Option(help="With --to: fit to these learners' subjects only.")
    ] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Folder; by default fit-LEARNER in results, or in --to."),
    ] = None,
) -> None:
    """Search a learner's parameters for the best likeness to people.

    A search that was stopped is continued by the same command.

    With --to they are fitted to single actions, by maximum likelihood. How many candidates are
    tried, what is held out and so on stands in the file of --plan, under fit:, or is given by
    --set: candidates, hold_out, seed, target, subjects, finalists, final_subjects, each, lapse,
    folds.
    """
    from causal_openlock.contract.registry import learner_class
    from causal_openlock.fitting.plan import Plan, bundled_plan, read_plan
    from causal_openlock.fitting.printing import fit_to_actions, fit_to_means
    from causal_openlock.fitting.steps import STEPS
    from causal_openlock.running.workers import available_cores

    learner_class(learner)  # fails at once if there is none
    if hierarchical and not to:
        raise OpenLockError("--hierarchical fits each subject of a results folder; give --to")
    known = read_plan(plan) if plan else bundled_plan(learner) or Plan(learner, {}, {})
    if known.learner != learner:
        raise LearnerError(f"{plan} is for the learner {known.learner}, and not for {learner}")
    asked = known.changed(search or (), fix or (), settings or ())
    asked.fit.of = of or asked.fit.of
    if hierarchical and asked.fit.each:
        raise OpenLockError("--hierarchical fits each subject in any case; take out each=true")
    kind = "-hierarchical" if hierarchical else "-each" if asked.fit.each else ""
    folder = out or (to or Path("results")) / f"fit-{learner.replace(':', '.')}{kind}"
    if not ((folder_at(folder) / STEPS).exists() or is_empty(folder)):
        raise StoreError(
            f"{folder} is not empty and holds no fit that can be continued; choose another folder "
            "with --out"
        )
    cores = workers or available_cores()
    if to:
        fit_to_actions(asked, to, hierarchical, cores, folder)
    else:
        fit_to_means(asked, cores, folder)
