"""``causal-openlock score``: which learner predicts what subjects did, action by action."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from causal_openlock.errors import OpenLockError

if TYPE_CHECKING:
    import pandas as pd
    from rich.table import Table


def score(
    folder: Annotated[Path, typer.Argument(help="Results folder: of learners, or of people.")],
    learner: Annotated[
        list[str] | None,
        typer.Option("--learner", "-l", help="Let this predict: bayes, my_learners:Mine, ..."),
    ] = None,
    experiment: Annotated[
        str | None,
        typer.Option("--from", help="Take learners from this experiment, with their settings."),
    ] = None,
    of: Annotated[
        list[str] | None, typer.Option("--of", help="Predict these learners' subjects only.")
    ] = None,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = 0.01,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default FOLDER/scores.")
    ] = None,
) -> None:
    """Score learners on every action of every subject of a results folder.

    Each learner sees what a subject saw, says how likely each action is, and is then told what the
    subject did. Written are scores/actions.parquet, a row an action, and scores/subjects.csv, a row
    a subject; printed is the ranking, in bits per action.
    """
    import pandas as pd
    import pyarrow as pa

    from causal_openlock.comparison.console import Terminal
    from causal_openlock.contract.registry import changed_parameters
    from causal_openlock.experiment.building import make_experiment
    from causal_openlock.experiment.file import find_experiment, read_experiment
    from causal_openlock.experiment.store import Store
    from causal_openlock.files.atomic import write_bytes, write_text
    from causal_openlock.files.checksums import table_bytes
    from causal_openlock.files.escaping import csv_of
    from causal_openlock.scoring.scores import by_subject, ranking
    from causal_openlock.scoring.teacher_forcing import known_learners, score_actions
    from causal_openlock.wording import counted

    console = Terminal()
    record, played = Store(folder).record()
    if experiment:
        asked = read_experiment(find_experiment(experiment), tell=console.print_line).learners
        predicting = known_learners(learner, asked) if learner else list(asked)
    elif learner:
        predicting = list(make_experiment(["CC4"], learner).learners)
    else:
        raise OpenLockError("name who predicts, with --learner or --from")
    if of:
        known_learners(of, played.learners)
        record = record.filter(pa.array([name in of for name in record["learner"].to_pylist()]))
    tables = []
    for spec in predicting:
        console.print_line(f"{spec.name} predicts")
        tables.append(score_actions(record, played, spec, lapse))
    actions = pd.concat(tables, ignore_index=True)
    chosen = {
        spec.name: len(changed_parameters(spec.learner, spec.parameters)) for spec in predicting
    }
    subjects = by_subject(actions, chosen)
    out = out or folder / "scores"
    write_bytes(out / "actions.parquet", table_bytes(pa.Table.from_pandas(actions)))
    write_text(out / "subjects.csv", csv_of(subjects.round(6)))
    ranked = ranking(subjects)
    console.print_whole(_table(ranked))
    who = [counted(subjects[name].nunique(), name) for name in ("learner", "condition")]
    console.print_line(
        f"n = {ranked['subjects'].iloc[0]} subjects, of {who[0]} in {who[1]}; {lapse:g} of all "
        "actions are taken to be random; log2 of the number of actions is what one needs who knows "
        "nothing"
    )
    console.print_line(f"{out / 'actions.parquet'} and subjects.csv written")


def _table(ranked: pd.DataFrame) -> Table:
    from causal_openlock.comparison.console import plain_table

    table = plain_table("", "bits/action", "95% interval", "more than the best", "", "best of")
    for row in ranked.itertuples():
        table.add_row(
            str(row.scored),
            f"{row.bits:.2f}",
            _range(row.low, row.high),
            "" if math.isnan(row.worse) else f"{row.worse:+.2f}",
            _range(row.worse_low, row.worse_high),
            str(row.best_of),
        )
    return table


def _range(low: float, high: float) -> str:
    return "" if math.isnan(low) else f"{low:.2f} to {high:.2f}"
