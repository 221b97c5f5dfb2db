"""Conditions of an experiment that are the paper's: by their rooms, not by their names alone.

A record holds names, and a schema of one's own may also be called ``CC4``.
"""

from __future__ import annotations

from typing import Any

from causal_openlock.experiment.declare import PAPER_CONDITIONS, Condition, find_condition
from causal_openlock.schemas.finding import bundled_schemas


def is_of_paper(condition: Condition) -> bool:
    """Whether a condition has the rooms of the paper's of that name."""
    if condition.name not in PAPER_CONDITIONS:
        return False
    schemas = [bundled_schemas()[name] for name in condition.name.split("-")]
    return _schemas(condition) == _schemas(find_condition(schemas))


def _schemas(condition: Condition) -> list[list[Any]]:
    """The schemas of both phases without their titles."""
    phases = (condition.train, condition.test)
    return [[{**trials.schema.as_dict(), "title": ""} for trials in phase] for phase in phases]
