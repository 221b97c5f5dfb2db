"""What ``causal-openlock fit`` does and prints, once it is known what is searched and how."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.analysis.statistics import too_few
from causal_openlock.analysis.table import p_value
from causal_openlock.cli.stopping import resumable
from causal_openlock.comparison.console import Terminal
from causal_openlock.comparison.progress_bar import counting, shown_steps
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting import to_means
from causal_openlock.fitting.hierarchical import ROUNDS, fit_group
from causal_openlock.fitting.plan import Plan
from causal_openlock.fitting.to_actions import fit_all, fit_table, groups_of
from causal_openlock.paper.likeness_section import signs
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.scoring.scores import choices_in
from causal_openlock.scoring.teacher_forcing import known_learners
from causal_openlock.storage.store import Store
from causal_openlock.wording import joined

MOST_ROWS = 20  #: fits that are printed; the file has all
BOUND, IDLE = "*", "?"  #: marks at fitted parameters that are no estimates


def fit_to_actions(
    plan: Plan, results: Path, hierarchical: bool, workers: int, folder: Path
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found."""
    console, how = Terminal(), plan.fit
    plan.require_hold_out(("trials", "subjects", "none"))
    record, played = Store(results).record()
    known_learners(how.of, played.learners)
    parts = recorded_subjects(record, played, how.of)
    rounds = 0
    with resumable(), shown_steps("fit") as begin:
        begin("no fit is done yet")
        if hierarchical:
            fits, rounds = fit_group(parts, plan, folder, workers, begin)
        else:
            report, groups = counting(begin, "fits are done"), groups_of(parts, plan)
            fits = fit_all(groups, plan, folder, workers=workers, report=report)
    table = fit_table(fits, plan)
    write_text(folder / "fits.csv", csv_of(table.round(6)))
    first = table.head(MOST_ROWS).set_index("who")
    chance = math.log2(max(choices_in(played).values(), default=1))
    worse = first["bits"].gt(chance).map({True: f" (worse than at random: {chance:.2f} bits)"})
    columns = [*plan.ranges, "bits", "held_out_bits", "actions", "at_bound", "without_effect"]
    names = {"bits": "bits/action", "held_out_bits": "held out"}
    shown = first.set_axis(first.index + worse.fillna(""))[columns].rename(columns=names)
    _show_fits(shown.rename_axis(None), list(plan.ranges), console, 3)
    if len(table) > MOST_ROWS:
        console.print_line(f"and {len(table) - MOST_ROWS} others")
    console.print_line(plan.in_words)
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
        _print_entry(plan.entry(fits[0].chosen), console)
    console.print_line(f"{folder / 'fits.csv'} written")


def fit_to_means(plan: Plan, workers: int, folder: Path) -> None:
    """Fit a learner to published means, and write and print what was found."""
    plan, how, console = to_means.means_plan(plan), plan.fit, Terminal()
    with resumable(), shown_steps("fit") as report:
        fitted = to_means.fit(plan, folder, workers=workers, report=report)
    fitted.write(folder)
    console.print_line(
        "\nThe nearest candidates, RMSE of means, in attempts, on what is fitted", "bold"
    )
    nearest = fitted.table().set_index("number").head(how.finalists)
    _show_fits(nearest, list(plan.ranges), console, 2)
    console.print_line(plan.in_words)
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
        f"A small p rejects a model. Fitted numbers, here {len(plan.ranges)}, each take away a "
        "degree of freedom."
    )
    if plan.learner == "bayes" and plan.fit.hold_out != "none":
        console.print_line(
            "The default ranges of bayes were narrowed with the transfer tests in view "
            "(evidence/likeness): what is held out is a check, not an untouched prediction.",
            "dim",
        )
    console.print_line("\nWhat people show, differences in attempts", "bold")
    effects = fitted.effects.set_index("effect")
    effects["p < .05"] = effects["like_people"] & (effects["p"] < ALPHA)
    _show(effects.assign(p=effects["p"].map(p_value)), console)
    console.print_line(signs(fitted.effects))
    _print_entry(fitted.entry, console)
    console.print_line(f"to play it: causal-openlock compare {folder / 'experiment.yaml'}")
    console.print_line(f"figure: {folder / 'fit.svg'}")


def _show(frame: pd.DataFrame, console: Terminal, digits: int = 2) -> None:
    """Print a table whose rows are named by its index."""
    formats = dict.fromkeys(frame.select_dtypes("float"), f".{digits}f")
    frame = frame.rename_axis(frame.index.name or "").reset_index()
    console.print_table(frame, formats)


def _show_fits(table: pd.DataFrame, names: Sequence[str], console: Terminal, digits: int) -> None:
    """Print fits, with marks at parameters that are no estimates, and what the marks mean."""
    shown = table.drop(columns=["at_bound", "without_effect"])
    for name in names:
        at, idle = (table[lists].str.contains(rf"\b{name}\b")
                    for lists in ("at_bound", "without_effect"))  # fmt: skip
        shown[name] = table[name].map("{:.4g}".format) + np.select([idle, at], [IDLE, BOUND], "")
    _show(shown, console, digits)
    if at_bound := [name for name in names if shown[name].str.endswith(BOUND).any()]:
        console.print_line(
            f"{BOUND} at a bound of what was searched ({joined(at_bound)}): better values may lie "
            "beyond it."
        )
    else:
        console.print_line("No estimate is at a bound of what was searched.")
    if any(shown[name].str.endswith(IDLE).any() for name in names):
        console.print_line(f"{IDLE} makes no difference here: any other value would do as well.")


def _print_entry(entry: Mapping[str, Any], console: Terminal) -> None:
    """Print the fitted learner, to paste, with six significant digits."""
    parameters = {
        name: float(f"{value:.6g}") if isinstance(value, float) else value
        for name, value in entry["parameters"].items()
    }
    console.print_line("for an experiment file, under learners:")
    text = dump_yaml([{**entry, "parameters": parameters}])
    console.print(text, highlight=False, soft_wrap=True, end="")
