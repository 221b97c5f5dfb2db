"""``causal-openlock fit``: which parameters make a learner do what people did?"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.files.atomic import folder_at, is_empty

if TYPE_CHECKING:
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.fitting.candidates import Fit
    from causal_openlock.fitting.outcome import FittedLearner


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
    # What follows stands in a plan, under fit:; options are taken all the same.
    each: Annotated[bool | None, typer.Option(hidden=True)] = None,
    lapse: Annotated[float | None, typer.Option(min=0, max=1, hidden=True)] = None,
    folds: Annotated[int | None, typer.Option(min=2, hidden=True)] = None,
    hold_out: Annotated[str | None, typer.Option(hidden=True)] = None,
    target: Annotated[str | None, typer.Option(hidden=True)] = None,
    candidates: Annotated[int | None, typer.Option(min=1, hidden=True)] = None,
    subjects: Annotated[int | None, typer.Option(min=2, hidden=True)] = None,
    finalists: Annotated[int | None, typer.Option(min=1, hidden=True)] = None,
    final_subjects: Annotated[int | None, typer.Option(min=2, hidden=True)] = None,
    seed: Annotated[int | None, typer.Option(min=0, max=2**62, hidden=True)] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/fit-LEARNER.")
    ] = None,
) -> None:
    """Search a learner's parameters for the best likeness to people.

    A search that was stopped is continued by the same command.

    With --to they are fitted to single actions, by maximum likelihood. How many candidates are
    tried, what is held out and so on stands in the file of --plan, under fit:.
    """
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.contract.registry import learner_class
    from causal_openlock.fitting.candidates import Plan, require_optuna
    from causal_openlock.fitting.candidates import fit as run
    from causal_openlock.fitting.objective import conditions_to_fit, towards
    from causal_openlock.fitting.outcome import fitted_learner, write_fitted_learner
    from causal_openlock.fitting.search import (
        bundled_search,
        changed,
        read_search,
        read_settings,
    )
    from causal_openlock.paper.likeness import published_points
    from causal_openlock.running.workers import available_cores

    given = {
        "candidates": candidates, "seed": seed, "hold_out": hold_out, "target": target,
        "subjects": subjects, "finalists": finalists,
        "final_subjects": final_subjects, "of": of, "each": each, "lapse": lapse, "folds": folds,
    }  # fmt: skip
    how = read_settings(plan, given)
    if hierarchical and (how.each or not to):
        raise OpenLockError(
            "--hierarchical fits each subject of a folder; give --to, and no --each"
        )
    if not hierarchical:
        require_optuna()
    learner_class(learner)  # fails at once if there is none
    kind = "-hierarchical" if hierarchical else "-each" if how.each else ""
    name = f"fit-{learner.replace(':', '.')}{kind}"
    folder = out or (to or Path("results")) / name
    _check_folder(folder)
    known = read_search(plan) if plan else bundled_search(learner)
    if known is not None and known.learner != learner:
        raise LearnerError(f"{plan} is for the learner {known.learner}, and not for {learner}")
    if known is None and not search:
        raise LearnerError(_nothing_searched(learner))
    chosen = changed(known, learner, search or (), fix or ())
    if to:
        from causal_openlock.fitting.actions import ActionPlan
        from causal_openlock.fitting.command_to_actions import fit_to

        held_out = how.hold_out or "trials"
        to_actions = ActionPlan(
            chosen, how.lapse, held_out, how.folds, how.candidates, seed=how.seed
        )
        how_many = "group" if hierarchical else "each" if how.each else "all"
        fit_to(to_actions, to, how.of, how_many, workers or available_cores(), folder)
        return
    held_out = how.hold_out or "transfer"
    conditions_to_fit(held_out)  # fails at once if there is no such way
    towards(published_points(), how.target)
    played = how.candidates, how.subjects, how.finalists, how.final_subjects
    declared = Plan(chosen, held_out, *played, how.seed, how.target)
    console = Terminal()
    bar = Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("candidates"),
        TimeElapsedColumn(),
        console=console,
    )
    with resumable(), bar:
        task = bar.add_task("searching", total=declared.candidates)

        def report(done: int, total: int, what: str) -> None:
            bar.update(task, completed=done, total=total, description=what)

        cores = workers or available_cores()
        fitted, trials = run(declared, folder, workers=cores, report=report)
    found = fitted_learner(fitted, trials)
    files = write_fitted_learner(fitted, found, folder)
    print_fit(fitted, found, console)
    console.print(f"\nto play it: causal-openlock compare {files[0]}", soft_wrap=True)
    console.print_line(f"figure: {folder / 'fit.svg'}")


def _check_folder(folder: Path) -> None:
    """Refuse a folder that holds something else, before anything is played."""
    from causal_openlock.fitting.actions import FILE as OF_ACTIONS
    from causal_openlock.fitting.candidates import FILE
    from causal_openlock.fitting.group_progress import PROGRESS

    if not folder_at(folder).exists() or any(
        (folder / name).exists() for name in (FILE, OF_ACTIONS, PROGRESS)
    ):
        return
    if (folder / "experiment.json").exists():
        raise StoreError(f"{folder} holds results of compare; choose another folder with --out")
    if not is_empty(folder):
        raise StoreError(
            f"{folder} is not empty and holds no fit; choose another folder with --out"
        )


def _nothing_searched(learner: str) -> str:
    """A message on a learner without a search space, with an example for it."""
    from causal_openlock.contract.registry import parameter_table

    numbers = {
        one.name: one.default
        for one in parameter_table(learner)
        if isinstance(one.default, int | float) and not isinstance(one.default, bool)
    }
    if not numbers:
        return f"nothing is searched: {learner} has no parameter that is a number; fit another one"
    # A small positive number is most likely to take other values too.
    name = min(numbers, key=lambda name: (numbers[name] <= 0, isinstance(numbers[name], int)))
    name = "learning_rate" if "learning_rate" in numbers else name
    high = numbers[name] if numbers[name] > 0 else 1
    low = 1 if isinstance(high, int) and high > 1 else 0 if high == 1 else high / 10
    return (
        f"nothing is searched, as {learner} has no search space of its own; give one with --plan, "
        f"or ranges such as --search {name}={low:g}:{high:g}"
    )


def print_fit(fitted: Fit, found: FittedLearner, console: Terminal) -> None:
    """The best candidates, the distances, the effects and the entry to paste."""
    from causal_openlock.analysis.statistics import too_few
    from causal_openlock.comparison.console import plain_table
    from causal_openlock.files.yaml_file import dump_yaml
    from causal_openlock.fitting.actions import at_bound
    from causal_openlock.fitting.marks import legend, marked, rounded
    from causal_openlock.fitting.objective import TARGETS
    from causal_openlock.paper.likeness_figure import CLEAR, signs
    from causal_openlock.paper.noise_ceiling import null_curves

    plan = fitted.plan
    console.print(
        "\n[bold]The nearest candidates[/bold], RMSE of means, in attempts, on what is fitted",
        markup=True,
    )
    names, idle = list(plan.space.ranges), fitted.idle.get(fitted.best.number, ())
    bounds: set[str] = set()
    nearest = plain_table("number", *names, "RMSE", "again")
    for row in fitted.table().head(plan.finalists).to_dict("records"):
        again = f"{row['again']:.2f}" if row["again"] == row["again"] else ""
        own = at_bound(plan.space.ranges, {name: row[name] for name in names})
        bounds |= {*own}
        values = [marked(row[name], name, own, idle) for name in names]
        nearest.add_row(str(row["number"]), *values, f"{row['rmse']:.2f}", again)
    console.print(nearest)
    for sentence in legend([name for name in names if name in bounds], idle):
        console.print_line(sentence)
    console.print_line(plan.space.in_words)
    if few := too_few(plan.final_subjects, "say how near the learner is to people"):
        console.warn(few)

    console.print(
        f"\n[bold]Distance from {TARGETS[plan.target]}[/bold], RMSE of means, in attempts, "
        f"{plan.final_subjects} subjects on a seed that nothing was chosen by",
        markup=True,
    )
    apart = plain_table("", "fitted", "held out", "all 14 points")
    distances, to_people = {found.label: found.score}, plan.target == "people"
    if to_people:
        distances["published model"] = found.model
    distances["perfect model"] = found.perfect
    if to_people:
        distances |= {name: plan.score(curve.points) for name, curve in null_curves().items()}
    for name, one in distances.items():
        numbers = [one.fitted, one.held_out, one.all]
        apart.add_row(name, *(f"{n:.2f}" if n == n else "" for n in numbers))
    console.print(apart)
    console.print("\n[bold]Misfit[/bold] of means: does sampling error explain it?", markup=True)
    misses = plain_table("", "fitted", "held out", "all 14 points")
    for name, words in found.misfits.items():
        misses.add_row(name, *words)
    console.print_whole(misses)
    console.print_line(
        "A small p rejects a model. Fitted numbers, here "
        f"{len(plan.space.ranges)}, each take away a degree of freedom."
    )
    if plan.space.learner == "bayes" and plan.hold_out != "none":
        console.print(
            "The default ranges of bayes were narrowed with the transfer tests in view "
            "(evidence/likeness):\nwhat is held out is a check, not an untouched prediction.",
            style="dim",
        )

    console.print("\n[bold]What people show[/bold], differences in attempts", markup=True)
    effects = plain_table("", "difference", "t", "p", "people's sign", "p < .05")
    for row in found.effects.to_dict("records"):
        sign = "yes" if row["like_people"] else "no"
        clear = "yes" if row["like_people"] and row["p"] < CLEAR else "no"
        tested = f"{row['difference']:+.2f}", f"{row['t']:.1f}", f"{row['p']:.2g}"
        effects.add_row(row["effect"], *tested, sign, clear)
    console.print(effects)
    console.print(signs(found.effects))
    console.print("\n[bold]For an experiment file[/bold], under learners:", markup=True)
    text = dump_yaml([{**found.entry(), "parameters": rounded(found.parameters)}])
    console.print(text, highlight=False, markup=False, soft_wrap=True, end="")
