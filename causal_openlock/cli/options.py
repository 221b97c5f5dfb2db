"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from causal_openlock.files.atomic import folder_at

ConditionName = Annotated[str, typer.Argument(help="What is played: CC4, CC3-CC4, my.yaml, ...")]
SchemaName = Annotated[str, typer.Argument(help="Name of a schema, or path of a file.")]
BesideFolders = Annotated[
    list[Path] | None,
    typer.Option(
        "--beside",
        help="Another results folder: its people stand where the paper's do, and its learners "
        "beside the others.",
    ),
]
Exclude = Annotated[
    Literal["completed no trial"] | None,
    typer.Option(
        help="Leave out people by this rule, as the paper does; the report says how many."
    ),
]
ResultsFolder = Annotated[
    Path, typer.Argument(help="Folder that compare or play wrote to.", callback=folder_at)
]
SubjectNumber = Annotated[
    int, typer.Option("--subject", min=0, max=2**31 - 1, help="Number of the subject.")
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="Seed of all randomness.")]
Budgets = Annotated[str, typer.Option("--protocol", help="human, rl or rl_2020: the budgets.")]
ProtocolName = Annotated[
    str | None, typer.Option(help="human, rl, rl_2020, or one that the experiment declares.")
]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")]
Output = Annotated[
    Path | None, typer.Option("--out", "-o", help="File to write, in the form of its suffix.")
]
