"""Arguments and options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

ConditionName = Annotated[str, typer.Argument(help="What is played: CC4, CC3-CC4, my.yaml, ...")]
ResultsFolder = Annotated[Path, typer.Argument(help="Folder that compare or play wrote to.")]
SubjectNumber = Annotated[int, typer.Option("--subject", min=0, help="Number of the subject.")]
Seed = Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="Seed of all randomness.")]
ProtocolName = Annotated[
    str | None, typer.Option(help="human, rl, or one that the experiment declares.")
]
ExperimentName = Annotated[
    str,
    typer.Option(
        "--experiment",
        "-e",
        help="An experiment to take part in: its seed, its protocols, its learners by name.",
    ),
]
Workers = Annotated[int | None, typer.Option(min=1, help="Processes; default: one for each core.")]
PictureSize = Annotated[int, typer.Option(min=120, max=2160, help="Height in pixels.")]
