"""How often each subject opened the door, and how that changed over the course of a phase.

Under protocols with many attempts a trial does not end when it is solved, so "attempts to solve"
says little; what says much is how often attempts open the door and in how many visits every
solution was found. A subject's visits to rooms are cut, in the order of time, into a few equal
parts, and each part has these two shares: one number for each subject, so that intervals are over
subjects.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL, START, SUBJECT, at_places
from causal_openlock.analysis.statistics import (
    LEAST_UNITS,
    LEVEL,
    student,
)
from causal_openlock.experiment.declare import Experiment
from causal_openlock.schemas.fsm import FloatArray

PARTS = 5
"""Into how many parts a phase is cut: the paper's Figure 6 has five blocks."""

OPENS, FINDS_ALL, ELSE = "opens", "finds_all", "else"
"""Measures of a part: the shares of attempts that open the door, of visits in which every
solution is found, and of attempts that neither unlock nor open the door."""

UNLOCKS, FOUND = "unlocks", "found"
"""Also measured: the share of attempts that unlock the door and do not open it, and how many of a
room's solutions are found in a visit, as a share."""

LEAST_SUBJECTS = LEAST_UNITS
"""Fewer subjects are not judged."""


class Group(NamedTuple):
    """Subjects that are compared: a learner in a condition under a protocol."""

    learner: str
    condition: str
    protocol: str


def shares(trials: pd.DataFrame, parts: int = PARTS) -> pd.DataFrame:
    """The shares of every subject in each part of a phase.

    A subject's visits in a phase are cut into ``parts`` shares that are equal up to one visit; a
    phase of fewer visits has a part for each.

    Returns:
        One row for each subject, phase and part (from 1): the columns of a cell and of a subject,
        ``phase``, ``part``, ``visits``, ``attempts`` and the shares :data:`OPENS`,
        :data:`FINDS_ALL`, :data:`ELSE`, :data:`UNLOCKS` and :data:`FOUND`.
    """
    by = [*CELL, "phase", *SUBJECT]
    whole = trials.groupby(by, sort=False, observed=True)
    number, total = whole.cumcount(), whole["trial"].transform("size")
    tally = trials.assign(
        part=number * np.minimum(parts, total) // total + 1,
        visits=1,
        attempts=trials["last_attempt"],
        opened=trials[["open1", "open2", "open3"]].sum(axis=1),
        found=trials["solutions_found"] / trials["solutions"],
    )
    added = tally.groupby([*by, "part"], sort=True, observed=True)
    table = (
        added[["visits", "attempts", "opened", "solved", "neither", "unlock", FOUND]]
        .sum()
        .reset_index()
    )
    table[OPENS] = table["opened"] / table["attempts"]
    table[ELSE] = table["neither"] / table["attempts"]
    table[FINDS_ALL] = table["solved"] / table["visits"]
    table[UNLOCKS] = table["unlock"] / table["attempts"]
    table[FOUND] /= table["visits"]
    return table.drop(columns=["opened", "solved", "neither", "unlock"])


def starts(trials: pd.DataFrame) -> pd.DataFrame:
    """Measures of every subject at the start of training.

    Returns:
        One row for each subject: the columns of a cell and of a subject, ``opens``, at the
        :data:`~causal_openlock.analysis.measures.START` of its first visit, and ``finds_all``, 0 or
        1, in that visit.
    """
    by = [*CELL, *SUBJECT]
    first = trials[trials["phase"] == "train"].groupby(by, sort=False, observed=True).head(1)
    opened = first["opened_at_start"] / np.maximum(first["last_attempt"] // START, 1)
    return first[by].assign(**{OPENS: opened, FINDS_ALL: first["solved"].astype(float)})


def each_group(
    table: pd.DataFrame, phase: str | None = None
) -> Iterator[tuple[Group, pd.DataFrame]]:
    """The rows of every learner, protocol and condition (of one phase), in the order of names."""
    kept = table if phase is None else table[table["phase"] == phase]
    by = ["learner", "protocol", "condition"]
    for (learner, protocol, condition), rows in kept.groupby(by, observed=True):
        yield Group(learner, condition, protocol), rows


def matrix(rows: pd.DataFrame, measure: str) -> FloatArray:
    """``[n, P]`` a measure of n subjects in each of the parts that all of them have."""
    values, _ = at_places(rows, ["part"], measure)
    return values[:, ~np.isnan(values).any(axis=0)]


def interval(values: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Student's bounds of the mean of ``[n]`` subjects for a verdict, also where all are equal."""
    low, high = student(len(values), values.mean(), values.var(ddof=1), 0, level)
    return float(low), float(high)


def many_attempts(experiment: Experiment) -> set[str]:
    """Names of the protocols whose trials continue after they are solved."""
    stops = {one.name for one in experiment.protocols if one.stop_when_solved}
    return {one.name for one in experiment.protocols} - stops


def going_on(trials: pd.DataFrame, experiment: Experiment) -> pd.DataFrame:
    """The trials under protocols that continue after a trial is solved."""
    return trials[trials["protocol"].isin(many_attempts(experiment))]
