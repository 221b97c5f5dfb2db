"""``causal-openlock score``: which learner predicts what subjects did, action by action."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any

import typer

from causal_openlock.cli.options import Workers
from causal_openlock.comparison.progress_bar import counting, shown_steps
from causal_openlock.errors import StoreError
from causal_openlock.scoring import LAPSE
from causal_openlock.wording import counted, joined


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
    fits: Annotated[
        list[Path] | None,
        typer.Option(help="Let what was fitted predict: a folder that fit NAME --to wrote."),
    ] = None,
    of: Annotated[
        list[str] | None, typer.Option("--of", help="Predict these learners' subjects only.")
    ] = None,
    lapse: Annotated[
        float, typer.Option(min=0, max=1, help="Share of actions that are taken to be random.")
    ] = LAPSE,
    draws: Annotated[
        int | None,
        typer.Option(
            min=1,
            help="Most copies to ask of a learner without probabilities; by default actions / "
            "lapse. With it llm is asked in words, not in letters.",
        ),
    ] = None,
    workers: Workers = None,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder; by default FOLDER/scores.")
    ] = None,
) -> None:
    """Score learners on every action of every subject.

    Each learner sees what a subject saw, says how likely each action is, and is then shown what the
    subject did. Written are scores/actions.parquet, a row an action; scores/subjects.csv, a row a
    subject and learner; and scores/followed.csv, which of them each subject follows. Printed is the
    ranking, in bits per action.
    """
    from causal_openlock.analysis.statistics import too_few
    from causal_openlock.analysis.table import p_value
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.experiment.making import find_experiment, read_experiment
    from causal_openlock.fitting.predicting import score_folder
    from causal_openlock.running.workers import available_cores
    from causal_openlock.scoring.scores import FOLDER, Scores
    from causal_openlock.scoring.scores_section import FORMATS, HEADS, ranked
    from causal_openlock.scoring.teacher_forcing import known_learners

    console = Terminal()
    predicting: Sequence[Any] = learner or ()
    if experiment:
        asked = read_experiment(find_experiment(experiment), tell=console.print_line).learners
        predicting = known_learners(learner, asked) if learner else asked
    with shown_steps("score") as begin:
        begin("no part is scored yet")
        scores = score_folder(
            folder,
            predicting,
            fits=fits or (),
            of=of or (),
            lapse=lapse,
            draws=draws,
            workers=workers or available_cores(),
            report=counting(begin, "parts are scored"),
        )
    out, before = out or folder / FOLDER, []
    with suppress(StoreError):
        before = Scores.read(out).actions["scored"].unique().tolist()
    files = scores.save(out)
    table = ranked(scores)
    frame = table.assign(p=table["p"].map(p_value))[[*HEADS]].rename(columns=HEADS)
    console.print_table(frame, FORMATS)
    subjects, number = scores.subjects, int(table["subjects"].iloc[0])
    who = [counted(subjects[name].nunique(), name) for name in ("learner", "condition")]
    console.print_line(
        f"n = {number} subjects, of {who[0]} in {who[1]}; {lapse:g} of all actions are taken to be "
        "random; a learner that knows nothing needs log2 of the number of actions; low and high: "
        "the 95% interval of more than the best"
    )
    if few := too_few(number):
        console.warn(few)
    priced = scores.actions.groupby("scored", observed=True)["price"].any()
    for label in [fit.resolve().name for fit in fits or ()]:
        by = "each action by what was fitted without it"
        if priced[label]:
            by = "what it was fitted to; parameters have a price only in “followed by”"
        console.print_line(f"{label} predicts {by}")
    for remark in [remark for account in scores.accounts for remark in account.remarks]:
        console.warn(remark)
    drawn = subjects[subjects["standard_error"] > 0]
    for name, own in drawn.groupby("scored", observed=True):
        how = "estimates its probabilities from draws"
        if own["expected"].isna().all():
            how = "gives no probabilities: it was asked by inverse binomial sampling"
        error = f"{own['standard_error'].mean():.1f} nats for a subject"
        console.print_line(f"{name} {how}, with a standard error of {error}")
        if at_limit := own["at_limit"].sum():
            console.print_line(
                f"{name}: of {own['actions'].sum():,} actions, {at_limit:,} were not hit before "
                "the limit of draws, so their log-probabilities are biased, mostly too low; "
                "--draws raises the limit"
            )
    if gone := [name for name in before if name not in set(table["scored"])]:
        console.print_line(f"the scores of {joined(gone)}, which were there, are replaced")
    console.print_line(f"which of them each subject follows: {files[2]}")
    console.print_line(f"{files[0]} and subjects.csv written")
