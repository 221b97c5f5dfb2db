"""``causal-openlock fit NAME --to FOLDER``: which parameters predict single actions best?"""

from __future__ import annotations

import math
from collections.abc import Callable, Hashable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.cli.stopping import resumable
from causal_openlock.fitting.marks import legend, marked, rounded
from causal_openlock.wording import counted, joined

if TYPE_CHECKING:
    import pandas as pd

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.fitting.actions import ActionPlan, Fitted

MOST_ROWS = 20
"""Fits that are printed; the file has all."""


def fit_to(
    plan: ActionPlan,
    folder: Path,
    of: Sequence[str],
    how: str,
    workers: int,
    out: Path,
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found.

    ``how`` is ``all`` of them together, ``each`` by itself, or as a ``group``.
    """
    from causal_openlock.analysis.statistics import too_few
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.comparison.progress_bar import shown_steps
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.files.yaml_file import dump_yaml
    from causal_openlock.fitting.actions import WHOLE, fit_all, fit_table, jobs_of
    from causal_openlock.fitting.hierarchical import GROUP, ROUNDS, GroupFit
    from causal_openlock.scoring.scores import choices_in
    from causal_openlock.scoring.teacher_forcing import known_learners, recorded_subjects
    from causal_openlock.storage.store import Store

    console = Terminal()
    record, played = Store(folder).record()
    known_learners(of, played.learners)
    parts = recorded_subjects(record, played, of)
    with resumable(), shown_steps("fit") as begin:
        if how == "group":
            group = GroupFit(parts, plan, out)
            fits = group.run(workers, begin)
        else:
            jobs = jobs_of(parts, plan, how == "each")
            steps = _Steps(len(jobs), plan.tries, begin)
            fits = fit_all(jobs, out, workers=workers, report=steps.fits, tried=steps.tried)
    table = fit_table(fits)
    write_text(out / "fits.csv", csv_of(table.round(6)))
    shown = table.head(MOST_ROWS)
    chance = math.log2(max(choices_in(played).values(), default=1))
    _print_fits(shown, list(plan.space.ranges), chance, console)
    if len(table) > MOST_ROWS:
        console.print_line(f"and {len(table) - MOST_ROWS} others")
    doubts = (_names(shown[name]) for name in ("at_bound", "without_effect"))
    for sentence in legend(*doubts):
        console.print_line(sentence)
    console.print_line(plan.space.in_words)
    subjects = sum(len(part.numbers) for part in parts)
    if few := too_few(subjects, "generalise the parameters to others"):
        console.warn(few)
    if how == "group":
        for one in fits:
            if one.who == GROUP and one.fold == WHOLE:
                console.print_line(_spread(one))
        if max(group.rounds.values()) == ROUNDS:
            console.print_line(
                f"After {ROUNDS} rounds the group was not settled: its spread is uncertain; more "
                "subjects, fewer parameters or narrower ranges help."
            )
    if how == "all":
        label = f"{plan.space.learner.rpartition(':')[2]}_fitted"
        chosen = rounded(plan.space.parameters(fits[0].chosen))
        entry = {"learner": plan.space.learner, "name": label, "parameters": chosen}
        console.print_line("for an experiment file, under learners:")
        console.print(dump_yaml([entry]), highlight=False, markup=False, soft_wrap=True, end="")
    console.print_line(f"{out / 'fits.csv'} written")


class _Steps:
    """Tells how far the fits are, in a line."""

    def __init__(self, jobs: int, tries: int, begin: Callable[[str], None]) -> None:
        self._jobs, self._tries, self._begin = jobs, jobs * tries, begin
        self._done = self._number = 0
        self._tell()

    def fits(self, done: int, _: int) -> None:
        """Note that some fits are done."""
        self._done = done
        self._tell()

    def tried(self, number: int) -> None:
        """Note that some sets of parameters have been tried."""
        self._number = number
        self._tell()

    def _tell(self) -> None:
        self._begin(
            f"{self._done} of {counted(self._jobs, 'fit')} done, {self._number:,} of up to "
            f"{counted(self._tries, 'set')} of parameters tried"
        )


def _print_fits(
    table: pd.DataFrame, names: Sequence[str], chance: float, console: Terminal
) -> None:
    """The parameters of each, and how well they predict, next to the bits of random actions."""
    from causal_openlock.comparison.console import plain_table

    shown = plain_table("", *names, "bits/action", "held out", "actions")
    for row in table.to_dict("records"):
        held_out = "" if math.isnan(row["held_out_bits"]) else f"{row['held_out_bits']:.3f}"
        numbers = [*(_marked(row, name) for name in names), f"{row['bits']:.3f}", held_out]
        worse = f" (worse than at random: {chance:.2f} bits)" if row["bits"] > chance else ""
        shown.add_row(f"{row['who']}{worse}", *numbers, str(row["actions"]))
    console.print_whole(shown)


def _names(column: pd.Series) -> list[str]:
    """The parameters that any row of a column names, each once."""
    from causal_openlock.fitting.actions import NONE

    return [name for name in dict.fromkeys(" ".join(column).split()) if name != NONE]


def _marked(row: Mapping[Hashable, Any], name: str) -> str:
    return marked(row[name], name, row["at_bound"].split(), row["without_effect"].split())


def _spread(group: Fitted) -> str:
    """Between what two thirds of a group are, in a sentence."""
    ranges = [f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in group.between.items()]
    return f"Two thirds of such a group have {joined(ranges)}."
