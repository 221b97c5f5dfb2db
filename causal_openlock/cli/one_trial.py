"""What ``trace`` and ``film`` have in common: one subject of one learner, up to one trial."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any

import typer

if TYPE_CHECKING:
    from causal_openlock.contract.learner import Learner
    from causal_openlock.experiment.protocol import Condition, Protocol

ConditionName = Annotated[str, typer.Argument(help="What is played: CC4, CC3-CC4, my.yaml, ...")]
Subject = Annotated[int, typer.Option(min=0, help="Number of the subject.")]
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


def one_trial(
    condition: str,
    learner: str,
    trial: int,
    subject: int,
    seed: int | None,
    protocol: str | None,
    experiment: str,
) -> tuple[tuple[Learner, Condition, Protocol], dict[str, Any]]:
    """The arguments, in order and by name, of whatever lets a subject play up to a trial."""
    from functools import partial

    from causal_openlock.cli.terminal import say
    from causal_openlock.contract.registry import create
    from causal_openlock.experiment.file import Changes, find_experiment, read_experiment

    changes = Changes([condition], [learner], protocol, None, seed)
    tell = partial(say, error=True)
    chosen = read_experiment(find_experiment(experiment), changes, tell)
    (entry,), (played,) = chosen.learners, chosen.conditions
    who = (create(entry.learner, entry.parameters), played, entry.protocol)
    return who, {
        "trial": trial,
        "subject": subject,
        "seed": chosen.seed,
        "reward": entry.reward,
        "label": entry.name,
    }
