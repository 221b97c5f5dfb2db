"""A candidate's distance from people: on the points that it is fitted to, and on the others.

A fit that is judged by what it was fitted to says little. So some of people's fourteen points are
held out of the search, which plays only the conditions that it needs:

* ``transfer``: fitted to the ten points of the baselines; the four transfer tests are predicted.
* ``none``: fitted to all.

Of a theory that claims to be the published model one may ask instead whether it *is* that model:
with the target ``model`` the fourteen means are those that were published of it.

All candidates meet the same rooms and the same random numbers, so that their parameters alone make
the difference.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import TRANSFERS, attempts_to_solve
from causal_openlock.analysis.results.references import POINT
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import (
    PAPER_CONDITIONS,
    PROTOCOLS,
    find_condition,
)
from causal_openlock.experiment.session import Session
from causal_openlock.paper.likeness import (
    distance,
    published_points,
)
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.wording import nearest

HOLD_OUT = ("transfer", "none")
TARGETS = {"people": "people", "model": "the published model"}
"""Targets of a fit, in words: whose published means it is fitted to."""
CHUNK = 40
"""Subjects that are played at once."""


def held_out(points: pd.DataFrame, how: str) -> BoolArray:
    """``[N]`` which points are held out of a fit.

    Args:
        points: Rows with the columns of
            :data:`~causal_openlock.paper.published.POINT`.
        how: One of :data:`HOLD_OUT`.

    Raises:
        OpenLockError: If there is no such way.
    """
    if how not in HOLD_OUT:
        raise OpenLockError(f"points cannot be held out by {how!r}; {nearest(how, HOLD_OUT)}")
    tests: BoolArray = points["condition"].isin(list(TRANSFERS)).to_numpy(bool)
    return tests & (how == "transfer")


def conditions_to_fit(how: str) -> tuple[str, ...]:
    """The conditions that have any point to fit."""
    points = published_points()
    fitted = points[~held_out(points, how)]
    return tuple(name for name in PAPER_CONDITIONS if (fitted["condition"] == name).any())


@dataclass(frozen=True)
class Job:
    """Subjects of one candidate in one of the paper's conditions, from number ``first`` on.

    ``parameters`` are those that differ from the learner's defaults.
    """

    learner: str
    parameters: dict[str, Any]
    condition: str
    first: int
    subjects: int
    seed: int


def jobs(
    learner: str, parameters: dict[str, Any], conditions: tuple[str, ...], subjects: int, seed: int
) -> list[Job]:
    """The jobs of one candidate."""
    return [
        Job(learner, parameters, name, first, min(CHUNK, subjects - first), seed)
        for name in conditions
        for first in range(0, subjects, CHUNK)
    ]


def play(job: Job) -> pd.DataFrame:
    """Play under the human protocol.

    Returns:
        As :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives it.
    """
    session = Session(
        find_condition(job.condition),
        PROTOCOLS["human"],
        range(job.first, job.first + job.subjects),
        seed=job.seed,
        learner=job.learner,
        experiment="fit",
    )
    return attempts_to_solve(session.play(create(job.learner, job.parameters)))


def joined(played: list[pd.DataFrame]) -> pd.DataFrame:
    """The trials of several jobs of one candidate."""
    parts = [
        part.astype(dict.fromkeys(("learner", "condition", "protocol", "phase"), str))
        for part in played
    ]
    return pd.concat(parts, ignore_index=True)


@dataclass(frozen=True)
class Score:
    """Distance of a candidate from people, in attempts."""

    fitted: float  #: on the points that it is fitted to
    held_out: float  #: on the others; NaN if it did not play them
    all: float


def towards(points: pd.DataFrame, target: str) -> pd.DataFrame:
    """The points, with what the target did in the place of what people did.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        target: One of :data:`TARGETS`.

    Raises:
        OpenLockError: If there is no such target.
    """
    if target not in TARGETS:
        raise OpenLockError(f"a fit has no target {target!r}; {nearest(target, TARGETS)}")
    names = {f"{target}_{one}": f"people_{one}" for one in ("subjects", "mean", "se")}
    theirs = published_points()[[*POINT, *names]].rename(columns=names)
    return points.drop(columns=[*names.values()]).merge(theirs, on=POINT, how="left")


def score(points: pd.DataFrame, how: str, target: str = "people") -> Score:
    """Distance of one learner from people, or from the published model.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        how: One of :data:`HOLD_OUT`.
        target: One of :data:`TARGETS`.
    """
    points = towards(points, target)
    out = held_out(points, how)
    return Score(*(distance(part)[0] for part in (points[~out], points[out], points)))
