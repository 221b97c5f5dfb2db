"""``causal-openlock fit NAME --to FOLDER``: which parameters predict single actions best?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from causal_openlock.cli.stopping import resumable
from causal_openlock.wording import joined

if TYPE_CHECKING:
    from causal_openlock.fitting.actions import ActionPlan, Fitted


def fit_to(
    plan: ActionPlan, folder: Path, of: Sequence[str], how: str, workers: int, out: Path
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found.

    ``how`` is ``all`` of them together, ``each`` by itself, or as a ``group``.
    """
    from causal_openlock.comparison.console import Terminal, plain_table
    from causal_openlock.experiment.store import Store
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.files.yaml_file import dump_yaml
    from causal_openlock.fitting.actions import fit_all, fit_table, jobs_of
    from causal_openlock.fitting.hierarchical import ROUNDS, GroupFit
    from causal_openlock.scoring.teacher_forcing import known_learners, recorded_subjects

    console = Terminal()
    record, played = Store(folder).record()
    known_learners(of, played.learners)
    parts = recorded_subjects(record, played, of)
    jobs = jobs_of(parts, plan, how == "each")
    with resumable(), console.status("fitting") as status:
        if how == "group":
            group = GroupFit(parts, plan, out)
            fits = group.run(workers, status.update)
        else:
            fits = fit_all(
                jobs,
                out,
                workers=workers,
                report=lambda done, total: status.update(f"{done} of {total} fits"),
            )
    table = fit_table(fits)
    names = list(plan.space.ranges)
    write_text(out / "fits.csv", csv_of(table.round(6)))
    shown = plain_table("", *names, "bits/action", "held out", "actions")
    for row in table.head(20).to_dict("records"):
        held_out = "" if row["held_out_bits"] != row["held_out_bits"] else row["held_out_bits"]
        numbers = [*(f"{row[name]:.4g}" for name in names), f"{row['bits']:.3f}"]
        shown.add_row(row["who"], *numbers, held_out and f"{held_out:.3f}", str(row["actions"]))
    console.print_whole(shown)
    if len(table) > 20:
        console.print_line(f"and {len(table) - 20} others")
    if how == "group":
        console.print_line(_spread(fits[0]))
        if max(group.rounds.values()) == ROUNDS:
            console.print_line(
                f"After {ROUNDS} rounds the group was not settled: its spread is uncertain; more "
                "subjects, fewer parameters or narrower ranges help."
            )
    if how == "all":
        label = f"{plan.space.learner.rpartition(':')[2]}_fitted"
        chosen = plan.space.parameters(fits[0].chosen)
        entry = {"learner": plan.space.learner, "name": label, "parameters": chosen}
        console.print_line("for an experiment file, under learners:")
        console.print(dump_yaml([entry]), highlight=False, markup=False, soft_wrap=True, end="")
    console.print_line(f"{out / 'fits.csv'} written")


def _spread(group: Fitted) -> str:
    """Between what two thirds of a group are, in a sentence."""
    ranges = [f"{name} from {low:.4g} to {high:.4g}" for name, (low, high) in group.between.items()]
    return f"Two thirds of such a group have {joined(ranges)}."
