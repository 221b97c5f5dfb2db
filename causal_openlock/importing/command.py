"""``causal-openlock import``: data from elsewhere as a results folder."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from causal_openlock.cli.options import Seed
from causal_openlock.cli.terminal import say
from causal_openlock.wording import counted


def import_(
    files: Annotated[
        list[Path], typer.Argument(help="CSV (.csv, .csv.gz), or what jsPsych saves.")
    ],
    out: Annotated[Path, typer.Option("--out", "-o", help="Folder to write; it must be new.")],
    experiment: Annotated[
        str | None,
        typer.Option("--from", help="Experiment with conditions or protocols of one's own."),
    ] = None,
    protocol: Annotated[
        str, typer.Option(help="The budgets, where the files do not name them.")
    ] = "human",
    seed: Seed = None,
    learner: Annotated[
        str, typer.Option("--learner", "-l", help="Label of who played, where files name none.")
    ] = "person",
    layouts: Annotated[
        Literal["named", "drawn"],
        typer.Option(help="Whether files name layouts, or rooms are those that the seed draws."),
    ] = "named",
) -> None:
    """Make a results folder from data of your own.

    Commands such as report and score read it. Every action is repeated in its room; a row that
    could not have happened is named with its file and line, and nothing is written.
    """
    from causal_openlock.importing.folder import import_files

    made = import_files(
        files, out, experiment=experiment, protocol=protocol, seed=seed or 0, learner=learner,
        layouts=layouts, tell=say,
    )  # fmt: skip
    subjects, attempts = counted(made.subjects, "subject"), counted(made.attempts, "attempt")
    say(f"{out} written: {subjects}, {attempts}; causal-openlock report {out}")
    for sentence in made.warnings:
        say(f"warning: {sentence}", error=True)
