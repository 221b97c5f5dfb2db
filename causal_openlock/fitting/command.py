"""``causal-openlock fit``: which parameters make a learner do what people did?"""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.cli.stopping import resumable
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.files.atomic import folder_at, is_empty

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.fitting.space import FitSettings, SearchSpace
    from causal_openlock.fitting.to_actions import Fitted

MOST_ROWS = 20
"""Fits that are printed; the file has all."""


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
        Path | None, typer.Option("--out", "-o", help="Folder; by default results/fit-LEARNER.")
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
    from causal_openlock.fitting.space import FitSettings, bundled_search, changed, read_plan
    from causal_openlock.running.workers import available_cores

    learner_class(learner)  # fails at once if there is none
    space, how = read_plan(plan) if plan else (bundled_search(learner), FitSettings())
    how = how.changed(settings or ())
    how = how.model_copy(update={"of": of or how.of})
    if hierarchical and (how.each or not to):
        raise OpenLockError(
            "--hierarchical fits each subject of a folder; give --to, and no each=true"
        )
    kind = "-hierarchical" if hierarchical else "-each" if how.each else ""
    folder = out or (to or Path("results")) / f"fit-{learner.replace(':', '.')}{kind}"
    _check_folder(folder)
    if space and space.learner != learner:
        raise LearnerError(f"{plan} is for the learner {space.learner}, and not for {learner}")
    if not (space or search):
        raise LearnerError(_nothing_searched(learner))
    searched = changed(space, learner, search or (), fix or ())
    if to:
        _fit_to_actions(searched, how, to, hierarchical, workers or available_cores(), folder)
    else:
        _fit_to_means(searched, how, workers or available_cores(), folder)


def _check_folder(folder: Path) -> None:
    """Refuse a folder that holds something else, before anything is played."""
    from causal_openlock.fitting.steps import STEPS

    if not folder_at(folder).exists() or (folder / STEPS).exists():
        return
    if (folder / "experiment.json").exists():
        raise StoreError(f"{folder} holds results of compare; choose another folder with --out")
    if not is_empty(folder):
        raise StoreError(
            f"{folder} is not empty and holds no fit that can be continued; choose another folder "
            "with --out"
        )


def _nothing_searched(learner: str) -> str:
    """A message on a learner without a search space, with an example for it."""
    from causal_openlock.contract.registry import parameter_table

    numbers = {
        info.name: info.default
        for info in parameter_table(learner)
        if isinstance(info.default, int | float) and not isinstance(info.default, bool)
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


# -- to actions -----------------------------------------------------------------------------------


def _fit_to_actions(
    space: SearchSpace,
    how: FitSettings,
    results: Path,
    hierarchical: bool,
    workers: int,
    folder: Path,
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found."""
    from causal_openlock.analysis.statistics import too_few
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.progress_bar import shown_steps
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.fitting.hierarchical import ROUNDS, fit_group
    from causal_openlock.fitting.space import Plan
    from causal_openlock.fitting.to_actions import fit_all, fit_table, jobs_of
    from causal_openlock.scoring.scores import choices_in
    from causal_openlock.scoring.teacher_forcing import known_learners, recorded_subjects
    from causal_openlock.storage.store import Store
    from causal_openlock.wording import counted

    console, plan = Terminal(), Plan(space, how)
    record, played = Store(results).record()
    known_learners(how.of, played.learners)
    parts = recorded_subjects(record, played, how.of)
    rounds = 0
    with resumable(), shown_steps("fit") as begin:
        if hierarchical:
            fits, rounds = fit_group(parts, plan, folder, workers, begin)
        else:
            jobs = jobs_of(parts, plan)
            most = counted(len(jobs) * plan.candidates, "set")

            def report(done: int, tried: int) -> None:
                of_fits = f"{done} of {counted(len(jobs), 'fit')} done"
                begin(f"{of_fits}, {tried:,} of up to {most} of parameters tried")

            report(0, 0)
            fits = fit_all(jobs, folder, workers=workers, report=report)
    table = fit_table(fits)
    write_text(folder / "fits.csv", csv_of(table.round(6)))
    chance = math.log2(max(choices_in(played).values(), default=1))
    _print_fits(table.head(MOST_ROWS), list(space.ranges), chance, console)
    if len(table) > MOST_ROWS:
        console.print_line(f"and {len(table) - MOST_ROWS} others")
    console.print_line(space.in_words)
    subjects = sum(len(part.numbers) for part in parts)
    if few := too_few(subjects, "generalise the parameters to others"):
        console.warn(few)
    if hierarchical:
        console.print_line(_spread(fits))
    if rounds == ROUNDS:
        console.print_line(
            f"After {ROUNDS} rounds the group was not settled: its spread is uncertain; more "
            "subjects, fewer parameters or narrower ranges help."
        )
    if not (hierarchical or how.each):
        chosen = space.parameters(fits[0].chosen)
        entry = {"learner": space.learner, "name": space.fitted_name, "parameters": chosen}
        _print_entry(entry, console)
    console.print_line(f"{folder / 'fits.csv'} written")


def _print_fits(
    table: pd.DataFrame, names: Sequence[str], chance: float, console: Terminal
) -> None:
    """The parameters of each, and how well they predict, next to the bits of random actions."""
    from causal_openlock.comparison.console import plain_table
    from causal_openlock.fitting.marks import legend, marked

    shown = plain_table("", *names, "bits/action", "held out", "actions")
    bounds, idle = (table[name].str.split() for name in ("at_bound", "without_effect"))
    for place, row in enumerate(table.to_dict("records")):
        values = [marked(row[name], name, bounds[place], idle[place]) for name in names]
        held_out = "" if math.isnan(row["held_out_bits"]) else f"{row['held_out_bits']:.3f}"
        worse = f" (worse than at random: {chance:.2f} bits)" if row["bits"] > chance else ""
        bits = f"{row['bits']:.3f}"
        shown.add_row(f"{row['who']}{worse}", *values, bits, held_out, str(row["actions"]))
    console.print_whole(shown)
    of_any = ([name for name in names if name in {*row.explode()}] for row in (bounds, idle))
    for sentence in legend(*of_any):
        console.print_line(sentence)


def _spread(fits: Sequence[Fitted]) -> str:
    """Between what two thirds of a group are, in a sentence."""
    from causal_openlock.wording import joined

    group = fits[0].between.items()  # of the fold without anything held out
    ranges = [f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in group]
    return f"Two thirds of such a group have {joined(ranges)}."


def _print_entry(entry: dict[str, Any], console: Terminal) -> None:
    """The fitted learner, to paste."""
    from causal_openlock.files.yaml_file import dump_yaml
    from causal_openlock.fitting.marks import rounded

    console.print_line("for an experiment file, under learners:")
    text = dump_yaml([{**entry, "parameters": rounded(entry["parameters"])}])
    console.print(text, highlight=False, soft_wrap=True, end="")


# -- to means -------------------------------------------------------------------------------------


def _fit_to_means(space: SearchSpace, how: FitSettings, workers: int, folder: Path) -> None:
    """Fit a learner to published means, and write and print what was found."""
    from causal_openlock.analysis.statistics import too_few
    from causal_openlock.comparison.console import Terminal, plain_table
    from causal_openlock.comparison.progress_bar import shown_steps
    from causal_openlock.fitting.marks import legend, marked
    from causal_openlock.fitting.search import at_bound
    from causal_openlock.fitting.to_means import TARGETS, fit, means_plan
    from causal_openlock.paper.likeness_figure import CLEAR, signs

    plan, console = means_plan(space, how), Terminal()
    with resumable(), shown_steps("fit") as report:
        fitted = fit(plan, folder, workers=workers, report=report)
    fitted.write(folder)

    def show(title: str, frame: pd.DataFrame, index: str = "") -> None:
        console.print_line(f"\n{title}", "bold")
        table = plain_table(index, *frame.columns)
        for name, *row in frame.itertuples():
            texts = [cell if isinstance(cell, str) else f"{cell:.2f}" for cell in row]
            table.add_row(str(name), *("" if text == "nan" else text for text in texts))
        console.print_whole(table)

    nearest, bounds = fitted.table().set_index("number").head(how.finalists), set[str]()
    shown = nearest.astype(object)
    for number, chosen in nearest[[*space.ranges]].iterrows():
        own = at_bound(space.ranges, chosen)
        bounds |= {*own}
        for name, value in chosen.items():
            shown.loc[number, name] = marked(value, name, own, fitted.idle)
    show("The nearest candidates, RMSE of means, in attempts, on what is fitted", shown, "number")
    for sentence in legend([name for name in space.ranges if name in bounds], fitted.idle):
        console.print_line(sentence)
    console.print_line(space.in_words)
    if few := too_few(how.final_subjects, "say how near the learner is to people"):
        console.warn(few)
    distances, misfits = fitted.compared()
    show(
        f"Distance from {TARGETS[how.target]}, RMSE of means, in attempts, {how.final_subjects} "
        "subjects on a seed that nothing was chosen by",
        distances,
    )
    show("Misfit of means: does sampling error explain it?", misfits)
    console.print_line(
        f"A small p rejects a model. Fitted numbers, here {len(space.ranges)}, each take away a "
        "degree of freedom."
    )
    if space.learner == "bayes" and plan.hold_out != "none":
        console.print_line(
            "The default ranges of bayes were narrowed with the transfer tests in view "
            "(evidence/likeness): what is held out is a check, not an untouched prediction.",
            "dim",
        )
    effects = fitted.effects.set_index("effect")
    clear = effects["like_people"] & (effects["p"] < CLEAR)
    effects = effects[["difference", "t", "p", "like_people"]].assign(clear=clear)
    effects["p"] = effects["p"].map("{:.2g}".format)
    effects[["like_people", "clear"]] = effects[["like_people", "clear"]].replace(
        {True: "yes", False: "no"}
    )
    names = {"like_people": "people's sign", "clear": f"p < {CLEAR:g}"}
    show("What people show, differences in attempts", effects.rename(columns=names))
    console.print_line(signs(fitted.effects))
    _print_entry(fitted.entry, console)
    console.print_line(f"to play it: causal-openlock compare {folder / 'experiment.yaml'}")
    console.print_line(f"figure: {folder / 'fit.svg'}")
