"""A candidate's distance from people: on the points that it is fitted to, and on the others.

A fit that is judged by what it was fitted to says little. So some of people's fourteen points are
held out of the search, which plays only the conditions that it needs:

* ``transfer``: fitted to the ten points of the baselines; the four transfer tests are predicted.
* ``alternate``: fitted to every other point, seven of them.
* ``none``: fitted to all.

Of a theory that claims to be the published model one may ask instead whether it *is* that model:
with the target ``model`` the fourteen means are those that were published of it.

All candidates meet the same rooms and the same random numbers, so that their parameters alone make
the difference.

Distance is that of the means (``means``), or that of the means and of the standard deviations over
subjects (``means_and_spreads``): people differ among themselves more than the subjects of a learner
that is near their means.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
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
from causal_openlock.fitting.search import Kind
from causal_openlock.paper.likeness import (
    distance,
    distance_with_spreads,
    published_points,
)
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.wording import nearest

HOLD_OUT = ("transfer", "alternate", "none")
OBJECTIVES: Mapping[str, Callable[[pd.DataFrame], float]] = {
    "means": lambda points: distance(points)[0],
    "means_and_spreads": distance_with_spreads,
}
"""Distances from people that can be made small, in attempts."""
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
    if how == "transfer":
        return tests
    every_other = published_points()[POINT].iloc[1::2].apply(tuple, axis=1)
    odd: BoolArray = points[POINT].apply(tuple, axis=1).isin(every_other).to_numpy(bool)
    return odd & (how == "alternate")


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


def jobs(kinds: Sequence[Kind], conditions: tuple[str, ...], seed: int) -> list[Job]:
    """The jobs of one candidate."""
    found = []
    for name in conditions:
        for kind in kinds:
            end = kind.first + kind.subjects
            for first in range(kind.first, end, CHUNK):
                subjects = min(CHUNK, end - first)
                found.append(Job(kind.learner, kind.parameters, name, first, subjects, seed))
    return found


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
    """The trials of several jobs of one candidate, whatever the kind of its subjects."""
    parts = [
        part.astype(dict.fromkeys(("learner", "condition", "protocol", "phase"), str))
        for part in played
    ]
    whole = pd.concat(parts, ignore_index=True)
    return whole.assign(learner=whole["learner"].iloc[0])


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


def score(
    points: pd.DataFrame, how: str, objective: str = "means", target: str = "people"
) -> Score:
    """Distance of one learner from people, or from the published model.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        how: One of :data:`HOLD_OUT`.
        objective: One of :data:`OBJECTIVES`.
        target: One of :data:`TARGETS`.
    """
    points = towards(points, target)
    out, far = held_out(points, how), objective_called(objective)
    return Score(far(points[~out]), far(points[out]), far(points))


def objective_called(name: str) -> Callable[[pd.DataFrame], float]:
    """One of :data:`OBJECTIVES`.

    Raises:
        OpenLockError: If there is none of that name.
    """
    if name not in OBJECTIVES:
        raise OpenLockError(f"a fit has no objective {name!r}; {nearest(name, OBJECTIVES)}")
    return OBJECTIVES[name]
