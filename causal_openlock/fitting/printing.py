"""What ``causal-openlock fit`` does and prints, once it is known what is searched and how."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.analysis.statistics import too_few
from causal_openlock.cli.stopping import resumable
from causal_openlock.comparison.console import Terminal, plain_table
from causal_openlock.comparison.progress_bar import counting, shown_steps
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting import to_means
from causal_openlock.fitting.hierarchical import ROUNDS, fit_group
from causal_openlock.fitting.space import FitSettings, Plan, SearchSpace
from causal_openlock.fitting.to_actions import fit_all, fit_table, groups_of
from causal_openlock.paper.likeness_figure import CLEAR, signs
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.scoring.scores import choices_in
from causal_openlock.scoring.teacher_forcing import known_learners
from causal_openlock.storage.store import Store
from causal_openlock.wording import joined

MOST_ROWS = 20
"""Fits that are printed; the file has all."""
BOUND, IDLE = "*", "?"
"""Marks at fitted parameters that are no estimates."""


def fit_to_actions(
    space: SearchSpace,
    how: FitSettings,
    results: Path,
    hierarchical: bool,
    workers: int,
    folder: Path,
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found."""
    console, plan = Terminal(), Plan(space, how)
    plan.require_hold_out(("trials", "subjects", "none"))
    record, played = Store(results).record()
    known_learners(how.of, played.learners)
    parts = recorded_subjects(record, played, how.of)
    rounds = 0
    with resumable(), shown_steps("fit") as begin:
        if hierarchical:
            fits, rounds = fit_group(parts, plan, folder, workers, begin)
        else:
            report, groups = counting(begin, "fits are done"), groups_of(parts, plan)
            fits = fit_all(groups, plan, folder, workers=workers, report=report)
    table = fit_table(fits)
    write_text(folder / "fits.csv", csv_of(table.round(6)))
    first = table.head(MOST_ROWS)
    chance = math.log2(max(choices_in(played).values(), default=1))
    worse = first["bits"].gt(chance).map({True: f" (worse than at random: {chance:.2f} bits)"})
    columns = [*space.ranges, "bits", "held_out_bits", "actions", "at_bound", "without_effect"]
    shown = first.astype({"actions": str})[columns].set_axis(first["who"] + worse.fillna(""))
    names = {"bits": "bits/action", "held_out_bits": "held out"}
    _show_fits(shown.rename(columns=names), list(space.ranges), console, 3)
    if len(table) > MOST_ROWS:
        console.print_line(f"and {len(table) - MOST_ROWS} others")
    console.print_line(space.in_words)
    subjects = sum(len(part.numbers) for part in parts)
    if few := too_few(subjects, "generalise the parameters to others"):
        console.warn(few)
    if hierarchical:
        between = fits[0].between.items()  # of the group, with nothing held out
        ranges = [f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in between]
        console.print_line(f"Two thirds of such a group have {joined(ranges)}.")
    if rounds == ROUNDS:
        console.print_line(
            f"After {ROUNDS} rounds the group was not settled: its spread is uncertain; more "
            "subjects, fewer parameters or narrower ranges help."
        )
    if not (hierarchical or how.each):
        _print_entry(space.entry(fits[0].chosen), console)
    console.print_line(f"{folder / 'fits.csv'} written")


def fit_to_means(space: SearchSpace, how: FitSettings, workers: int, folder: Path) -> None:
    """Fit a learner to published means, and write and print what was found."""
    plan, console = to_means.means_plan(space, how), Terminal()
    with resumable(), shown_steps("fit") as report:
        fitted = to_means.fit(plan, folder, workers=workers, report=report)
    fitted.write(folder)
    console.print_line(
        "\nThe nearest candidates, RMSE of means, in attempts, on what is fitted", "bold"
    )
    nearest = fitted.table().set_index("number").head(how.finalists)
    _show_fits(nearest, list(space.ranges), console, 2)
    console.print_line(space.in_words)
    if few := too_few(how.final_subjects, "say how near the learner is to people"):
        console.warn(few)
    distances, misfits = fitted.compared()
    console.print_line(
        f"\nDistance from {to_means.TARGETS[how.target]}, RMSE of means, in attempts, "
        f"{how.final_subjects} subjects on a seed that nothing was chosen by",
        "bold",
    )
    _show(distances, console)
    console.print_line("\nMisfit of means: does sampling error explain it?", "bold")
    _show(misfits, console)
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
    console.print_line("\nWhat people show, differences in attempts", "bold")
    effects = fitted.effects.set_index("effect")
    effects["p < .05"] = effects["like_people"] & (effects["p"] < CLEAR)
    effects["p"] = effects["p"].map("{:.2g}".format)
    yes = {True: "yes", False: "no"}
    _show(effects.replace({"like_people": yes, "p < .05": yes}), console)
    console.print_line(signs(fitted.effects))
    _print_entry(fitted.entry, console)
    console.print_line(f"to play it: causal-openlock compare {folder / 'experiment.yaml'}")
    console.print_line(f"figure: {folder / 'fit.svg'}")


def _show(table: pd.DataFrame, console: Terminal, digits: int = 2) -> None:
    """Print a table; empty is what is not a number."""
    shown = plain_table(table.index.name or "", *table.columns)
    for name, *row in table.itertuples():
        texts = [cell if isinstance(cell, str) else f"{cell:.{digits}f}" for cell in row]
        shown.add_row(str(name), *("" if text == "nan" else text for text in texts))
    console.print_whole(shown)


def _show_fits(table: pd.DataFrame, names: Sequence[str], console: Terminal, digits: int) -> None:
    """Print fits, with marks at parameters that are no estimates, and what the marks mean."""
    bounds, idle = (table[column].str.split() for column in ("at_bound", "without_effect"))
    shown = table.drop(columns=["at_bound", "without_effect"]).astype(object)
    for name in names:
        values = zip(table[name], bounds, idle, strict=True)
        shown[name] = [marked(value, name, *lists) for value, *lists in values]
    _show(shown, console, digits)
    for sentence in legend(
        *([n for n in names if n in {*row.explode()}] for row in (bounds, idle))
    ):
        console.print_line(sentence)


def _print_entry(entry: Mapping[str, Any], console: Terminal) -> None:
    """Print the fitted learner, to paste, with six significant digits."""
    parameters = {
        name: float(f"{value:.6g}") if isinstance(value, float) else value
        for name, value in entry["parameters"].items()
    }
    console.print_line("for an experiment file, under learners:")
    text = dump_yaml([{**entry, "parameters": parameters}])
    console.print(text, highlight=False, soft_wrap=True, end="")


def marked(value: float, name: str, at_bound: Collection[str], idle: Collection[str]) -> str:
    """The value of a parameter, with its mark.

    >>> marked(0.5, "a", ["a"], []), marked(0.5, "a", ["a"], ["a"]), marked(10.0, "a", [], [])
    ('0.5*', '0.5?', '10')
    """
    mark = IDLE if name in idle else BOUND if name in at_bound else ""
    return f"{value:.4g}{mark}"


def legend(at_bound: Collection[str], idle: Collection[str]) -> list[str]:
    """Explanations of the marks, with their parameters; also where none stands at a bound.

    >>> legend([], [])
    ['No estimate is at a bound of what was searched.']
    """
    estimates = [name for name in at_bound if name not in idle]
    lines = ["No estimate is at a bound of what was searched."]
    if estimates:
        lines = [
            f"{BOUND} at a bound of what was searched ({joined(estimates)}): better values may "
            "lie beyond it."
        ]
    if idle:
        lines.append(f"{IDLE} makes no difference here: any other value would do as well.")
    return lines
