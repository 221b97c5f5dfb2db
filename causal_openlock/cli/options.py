"""Arguments and options that several commands have, and the trial that some commands name."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from causal_openlock.cli.terminal import say
from causal_openlock.files.atomic import folder_at

if TYPE_CHECKING:
    from causal_openlock.contract.learner import Learner
    from causal_openlock.experiment.declare import Condition, Protocol

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
    Path, typer.Argument(help="Folder that compare or play wrote to.", parser=folder_at)
]
LearnerName = Annotated[str, typer.Option("--learner", "-l", help="The learner that plays.")]
TrialNumber = Annotated[
    int, typer.Option("--trial", min=1, help="The trial, counted over the whole condition.")
]
SubjectNumber = Annotated[
    int, typer.Option("--subject", min=0, max=2**31 - 1, help="Number of the subject.")
]
Seed = Annotated[int | None, typer.Option(min=0, max=2**63 - 1, help="Seed of all randomness.")]
Budgets = Annotated[str, typer.Option("--protocol", help="human, rl or rl_2020: the budgets.")]
ProtocolName = Annotated[
    str | None, typer.Option(help="human, rl, rl_2020, or one that the experiment declares.")
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
Output = Annotated[
    Path | None, typer.Option("--out", "-o", help="File to write, in the form of its suffix.")
]
PictureSize = Annotated[int, typer.Option(min=120, max=2160, help="Height in pixels.")]


def one_trial(
    condition: str,
    learner: str,
    trial: int,
    subject: int,
    seed: int | None,
    protocol: str | None,
    experiment: str,
) -> tuple[tuple[Learner, Condition, Protocol], dict[str, Any]]:
    """The arguments of ``play_trial`` and ``trace_trial``: positional ones, and named ones."""
    from causal_openlock.contract.checks import failures_of
    from causal_openlock.contract.registry import create
    from causal_openlock.experiment.making import Changes, find_experiment, read_experiment

    changes = Changes([condition], [learner], protocol, None, seed)
    chosen = read_experiment(
        find_experiment(experiment), changes, lambda line: say(line, error=True)
    )
    (entry,), (played,) = chosen.learners, chosen.conditions
    with failures_of(entry.name):
        player = create(entry.learner, entry.parameters)
    return (player, played, entry.protocol), {
        "trial": trial,
        "subject": subject,
        "seed": chosen.seed,
        "reward": entry.reward,
        "label": entry.name,
    }
