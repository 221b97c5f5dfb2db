"""Which learners and conditions of an experiment can be compared with published results.

A record holds names only, and a schema of one's own may be called ``CC4`` too. So the rooms and
budgets of the experiment are compared with the paper's; where they differ, no published result is
shown.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PAPER_CONDITIONS, PROTOCOLS, Condition
from causal_openlock.formats.schema_file import bundled_schemas

HUMAN_PROTOCOL = "human"
"""The only protocol under which learners and people can be compared."""

Pairs = Collection[tuple[str, str]]
"""Labels of learners, each with the name of a condition that it played."""


def comparable(experiment: Experiment) -> Pairs:
    """The learners, each with a condition, that played as people did.

    Returns:
        Each learner that plays under the protocol ``human``, as this package has it, with each
        condition that has the paper's rooms, as many of them and in random order.
    """
    rooms = paper_conditions(experiment)
    return frozenset(
        (spec.name, condition.name)
        for spec in experiment.learners
        if spec.protocol == PROTOCOLS[HUMAN_PROTOCOL]
        for condition in experiment.conditions
        if condition.name in rooms and _has_trials_of_people(condition)
    )


def paper_conditions(experiment: Experiment) -> Collection[str]:
    """Names of the conditions that are the paper's by their schemas, not by their name alone."""
    schemas = bundled_schemas()
    return frozenset(
        one.name
        for one in experiment.conditions
        if one.name in PAPER_CONDITIONS
        and _schemas(one) == _schemas(Condition.named(one.name, schemas.__getitem__))
    )


def _has_trials_of_people(condition: Condition) -> bool:
    human = PROTOCOLS[HUMAN_PROTOCOL]
    train = human.training_trials if condition.test else human.baseline_trials
    return all(
        trials.layouts in (None, "published") and trials.number in (None, number) and trials.shuffle
        for group, number in ((condition.train, train), (condition.test, human.test_trials))
        for trials in group
    )


def _schemas(condition: Condition) -> list[list[dict[str, Any]]]:
    """The schemas of each phase, without their titles, which change nothing."""
    return [
        [{**trials.schema.as_dict(), "title": ""} for trials in group]
        for group in (condition.train, condition.test)
    ]
