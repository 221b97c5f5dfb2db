"""The trial that ``trace`` and ``film`` show: one subject of one learner plays up to it."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from causal_openlock.contract.learner import Learner
    from causal_openlock.experiment.protocol import Condition, Protocol


def one_trial(
    condition: str,
    learner: str,
    trial: int,
    subject: int,
    seed: int | None,
    protocol: str | None,
    experiment: str,
) -> tuple[tuple[Learner, Condition, Protocol], dict[str, Any]]:
    """The arguments of a function that plays up to a trial: positional ones, and named ones."""
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
