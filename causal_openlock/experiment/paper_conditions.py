"""Conditions of an experiment that are the paper's: by their rooms, not by their names alone.

A record holds names, and a schema of one's own may also be called ``CC4``.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import Any

from causal_openlock.experiment.declare import (
    PAPER_CONDITIONS,
    Condition,
    Experiment,
    find_condition,
)
from causal_openlock.schemas.finding import bundled_schemas


def paper_conditions(experiment: Experiment) -> Collection[str]:
    """Names of the conditions that are the paper's."""
    return frozenset(one.name for one in experiment.conditions if is_of_paper(one))


def is_of_paper(condition: Condition) -> bool:
    """Whether a condition is the paper's of that name."""
    if condition.name not in PAPER_CONDITIONS:
        return False
    known = bundled_schemas()
    paper = find_condition([known[name] for name in condition.name.split("-")])
    return _schemas(condition) == _schemas(paper)


def _schemas(condition: Condition) -> list[list[dict[str, Any]]]:
    """The schemas of each phase, without their titles, which change nothing."""
    return [
        [{**trials.schema.as_dict(), "title": ""} for trials in group]
        for group in (condition.train, condition.test)
    ]
