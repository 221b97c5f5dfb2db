"""What in an experiment is the paper's own, so that published results can stand beside it.

A record holds names only, and nothing keeps a schema of one's own from being called ``CC4``. What
the names stood for is in the description of the experiment: there the rooms and the budgets are
compared with the paper's, and where they differ no published result is shown.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

from causal_openlock.analysis.results.description import mappings_with
from causal_openlock.experiment.protocol import PAPER_CONDITIONS, PROTOCOLS, Condition
from causal_openlock.formats.schema_file import bundled_schemas

HUMAN_PROTOCOL = "human"
"""The only protocol under which learners and people can be compared."""

Pairs = Collection[tuple[str, str]]
"""Labels of learners, each with the name of a condition that it played."""


def comparable(experiment: Mapping[str, Any]) -> Pairs | None:
    """Who did what people did.

    Args:
        experiment: As :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it.

    Returns:
        Each learner that plays under the protocol ``human``, as this package has it, with each
        condition that has the paper's rooms, as many of them and in random order; None if the
        description has another form and does not tell, so that only names are left to go by.
    """
    learners: Any = experiment.get("learners")
    rooms = paper_conditions(experiment)
    if rooms is None or not mappings_with(learners, {"name", "protocol"}):
        return None
    human = PROTOCOLS[HUMAN_PROTOCOL].as_dict()
    alike = [
        one["name"]
        for one in experiment["conditions"]
        if one["name"] in rooms and _has_trials_of_people(one)
    ]
    return frozenset(
        (one["name"], condition)
        for one in learners
        if one["protocol"] == human
        for condition in alike
    )


def paper_conditions(experiment: Mapping[str, Any]) -> Collection[str] | None:
    """Which conditions are the paper's by their schemas and not by their name alone.

    Args:
        experiment: As :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it.

    Returns:
        Their names; None if the description has another form and does not tell.
    """
    conditions: Any = experiment.get("conditions")
    if not mappings_with(conditions, {"name", "train"}):
        return None
    schemas = bundled_schemas()
    return frozenset(
        one["name"]
        for one in conditions
        if one["name"] in PAPER_CONDITIONS
        and _schemas(one) == _schemas(Condition.named(one["name"], schemas.__getitem__).as_dict())
    )


def _has_trials_of_people(condition: Mapping[str, Any]) -> bool:
    human = PROTOCOLS[HUMAN_PROTOCOL]
    train = human.training_trials if condition.get("test") else human.baseline_trials
    return all(
        trials.get("layouts") in (None, "published")
        and trials.get("number") in (None, number)
        and trials.get("shuffle", True)
        for phase, number in (("train", train), ("test", human.test_trials))
        for trials in condition.get(phase) or ()
    )


def _schemas(condition: Mapping[str, Any]) -> list[list[dict[str, Any]]]:
    """The schemas of each phase, without their titles, which change nothing."""
    return [
        [
            {key: value for key, value in (trials.get("schema") or {}).items() if key != "title"}
            for trials in condition.get(phase) or ()
        ]
        for phase in ("train", "test")
    ]
