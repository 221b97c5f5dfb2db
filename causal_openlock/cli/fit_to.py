"""``causal-openlock fit NAME --to FOLDER``: which parameters predict single actions best?"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from causal_openlock.cli.stopping import resumable

if TYPE_CHECKING:
    from causal_openlock.fitting.actions import ActionPlan


def fit_to(
    plan: ActionPlan, folder: Path, of: Sequence[str], each: bool, workers: int, out: Path
) -> None:
    """Fit a learner to recorded subjects, and write and print what was found."""
    from causal_openlock.comparison.console import Terminal, plain_table
    from causal_openlock.experiment.store import Store
    from causal_openlock.files.atomic import write_text
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.files.yaml_file import dump_yaml
    from causal_openlock.fitting.actions import fit_all, fit_table, jobs_of
    from causal_openlock.scoring.teacher_forcing import known_learners, recorded_subjects

    console = Terminal()
    record, played = Store(folder).record()
    known_learners(of, played.learners)
    jobs = jobs_of(recorded_subjects(record, played, of), plan, each)
    with resumable(), console.status(f"0 of {len(jobs)} fits") as status:
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
    if not each:
        label = f"{plan.space.learner.rpartition(':')[2]}_fitted"
        chosen = plan.space.parameters(fits[0].chosen)
        entry = {"learner": plan.space.learner, "name": label, "parameters": chosen}
        console.print_line("for an experiment file, under learners:")
        console.print(dump_yaml([entry]), highlight=False, markup=False, soft_wrap=True, end="")
    console.print_line(f"{out / 'fits.csv'} written")
