"""Exploration that shrinks as fast as people's attempts: does anything get learned?

The paper lets epsilon of its DDQN shrink by the decays that it fitted to people, and sees "no
meaningful learning". It does not say with what it shrinks, every action, attempt or trial, so an
experiment can try all of these; the section holds every learner whose epsilon shrinks in some way
against the paper's sentence, next to the fits of
:mod:`~causal_openlock.paper.exploration`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import mean_by_trial
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.table import Table
from causal_openlock.analysis.topic import Topic
from causal_openlock.analysis.topics.learning import FINDS_ALL, LEARNS, OPENS, progress
from causal_openlock.experiment.declare import HUMAN_PROTOCOL, PAPER_ACTION_LIMIT, Experiment
from causal_openlock.paper.references import people_beside
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world import facts

PAPER_MEDIAN, PAPER_MEAN = 0.548, 0.743
"""The paper's decays, of the median and of the mean of people's attempts."""
NEAR = 0.035
"""Fits this close to the paper's decay count as near it: people's means are no more exact."""
LEAST_TRIALS = 4
"""Three parameters fit any three points."""
_SEARCHED = (1e-3, 1.5)  # decays, for people and learners alike; above 1 attempts grow
_BELOW_ONE = 0.99  # with an offset, a decay of 1 is a straight line of any slope
USUAL = 0.99
"""Slower decays are what the paper calls typical, "to allow exploration for thousands of steps"."""
NONE, SOME, OPEN = "no meaningful learning", "meaningful learning", "undecided"
_PROSE = Prose(__name__)
_SCHEDULES = {
    **{"decay": "g", "after_trial": ".2g", "steps": ".0f", "all": ".1%"},
    **dict.fromkeys(("first_trial", "later_trial"), ".1f"),
    **dict.fromkeys(("door", "ci_low", "ci_high", "chance"), ".2%"),
}
_FITS = {"decay": ".3f", **dict.fromkeys(("scale", "offset", "error"), ".2f")}
_SCHEDULE = ("epsilon_start", "epsilon_min", "epsilon_decay", "epsilon_decays_with")
_AFTER = "epsilon_after_trial"


@dataclass(frozen=True)
class DecayFit:
    """A curve ``offset + scale * decay ** t`` over trials, t = 0 being the first.

    ``form`` is how it was fitted: ``exponential``, ``log-linear`` or ``with offset``; ``error`` is
    the root of the mean squared deviation, in attempts.
    """

    form: str
    scale: float
    decay: float
    offset: float
    error: float


def exponential_fit(values: Sequence[float] | FloatArray) -> DecayFit:
    """Least squares of ``a * d ** t`` through mean attempts in successive trials.

    >>> round(exponential_fit([8, 4, 2, 1]).decay, 6)
    0.5
    """
    return _least_squares("exponential", values, with_offset=False)


def log_linear_fit(values: Sequence[float] | FloatArray) -> DecayFit:
    """A straight line through the logarithms: ``a * d ** t``, small values weighing as much."""
    known = np.asarray(values, dtype=float)
    slope, intercept = np.polyfit(np.arange(len(known)), np.log(known), 1)
    scale, decay = math.exp(intercept), math.exp(slope)
    return DecayFit("log-linear", scale, decay, 0.0, _error(known, scale, decay, 0.0))


def offset_fit(values: Sequence[float] | FloatArray) -> DecayFit:
    """Least squares of ``c + a * d ** t``.

    NaN but for its error where the best decay is next to 0 or 1, as of a level curve or a straight
    line, which no such curve describes.
    """
    if np.ptp(values) == 0:  # any decay fits
        return DecayFit("with offset", math.nan, math.nan, math.nan, 0.0)
    found = _least_squares("with offset", values, with_offset=True)
    if _SEARCHED[0] * 2 < found.decay < _BELOW_ONE - 1e-3:
        return found
    return DecayFit(found.form, math.nan, math.nan, math.nan, found.error)


FITS = (exponential_fit, log_linear_fit, offset_fit)


def _least_squares(form: str, values: Sequence[float] | FloatArray, with_offset: bool) -> DecayFit:
    """Least-squares fit of a curve; linear for a given decay, so only the decay is searched."""
    from scipy.optimize import minimize_scalar

    known = np.asarray(values, dtype=float)
    trial = np.arange(len(known))

    def fit(decay: float) -> DecayFit:
        columns = [decay**trial, np.ones(len(known))][: 1 + with_offset]
        found = np.linalg.lstsq(np.stack(columns, axis=1), known, rcond=None)[0]
        scale, offset = float(found[0]), float(found[1]) if with_offset else 0.0
        return DecayFit(form, scale, decay, offset, _error(known, scale, decay, offset))

    low, high = _SEARCHED[0], _BELOW_ONE if with_offset else _SEARCHED[1]
    grid = np.linspace(low, high, 300)
    best = int(np.argmin(_squared_errors(known, grid[:, None] ** trial, with_offset)))
    bounds = (grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)])
    nearest = minimize_scalar(
        lambda decay: fit(float(decay)).error,
        bounds=bounds,
        method="bounded",
        options={"xatol": 1e-9},
    )
    return fit(float(nearest.x))


def _squared_errors(known: FloatArray, curves: FloatArray, with_offset: bool) -> FloatArray:
    """Squared errors of each curve's best multiple, plus the best offset (linear regression)."""
    if with_offset:
        known, curves = known - known.mean(), curves - curves.mean(axis=1, keepdims=True)
    scales = curves @ known / (curves**2).sum(axis=1)
    return ((known - scales[:, None] * curves) ** 2).sum(axis=1)


def _error(values: FloatArray, scale: float, decay: float, offset: float) -> float:
    curve = offset + scale * decay ** np.arange(len(values))
    return float(np.sqrt(np.mean((values - curve) ** 2)))


def people_over_trials() -> dict[str, list[float]]:
    """People's mean attempts in successive trials, by what they played.

    Training means are of all people of a condition; ``CC3 and CE3`` is the average of both. The
    paper's own four-lever baselines are included.
    """
    known = facts.results()
    training = {name: own["mean"] for name, own in known["cogsci2019"]["human"]["all"].items()}
    both = np.mean([training["CC3"], training["CE3"]], axis=0).round(6).tolist()
    baseline = known["cogsci2018"]["human"]["baseline"]
    return {
        "CC3 training": list(training["CC3"]),
        "CE3 training": list(training["CE3"]),
        "CC3 and CE3 training": both,
        "CC4 baseline": list(baseline["CC4"]["mean"]),
        "CE4 baseline": list(baseline["CE4"]["mean"]),
    }


def fitted(curves: Mapping[str, Sequence[float]]) -> pd.DataFrame:
    """Every curve fitted in every way.

    Args:
        curves: Mean attempts in successive trials, by name.

    Returns:
        One row for each curve of at least :data:`LEAST_TRIALS` trials and each way: ``curve``,
        ``trials``, ``form``, ``scale``, ``decay``, ``offset``, ``error``, and ``near``, whether the
        decay is within :data:`NEAR` of the paper's .743.
    """
    rows = [
        (name, len(values), *vars(found).values(), abs(found.decay - PAPER_MEAN) <= NEAR)
        for name, values in curves.items()
        if len(values) >= LEAST_TRIALS
        for found in (fit(values) for fit in FITS)
    ]
    columns = ["curve", "trials", "form", "scale", "decay", "offset", "error", "near"]
    return pd.DataFrame(rows, columns=columns)


def learning_curves(trials: pd.DataFrame, protocol: str) -> dict[tuple[str, str], list[float]]:
    """Learners' mean attempts in successive trials before the test, by learner and condition.

    Loops of the protocol follow one another.
    """
    chosen = trials[(trials["protocol"] == protocol) & (trials["phase"] == "train")]
    means = mean_by_trial(chosen, ["loop", "trial"])
    return {
        (str(learner), str(condition)): rows["mean"].tolist()
        for (learner, condition), rows in means.groupby(["learner", "condition"], observed=True)
    }


def steps_until(decay: float, floor: float = 0.01, start: float = 1.0) -> int:
    """Number of times that a share must shrink by a factor below 1 until it is below ``floor``.

    >>> steps_until(0.5)
    7

    The paper counts exploration as over at less than one percent.
    """
    if not 0 < decay < 1:
        raise ValueError(f"a share that shrinks by {decay} never gets below {floor}")
    steps = max(0, math.floor(math.log(floor / start) / math.log(decay)) - 1)
    while start * decay**steps >= floor:
        steps += 1
    return steps


def random_actions(
    parameters: Mapping[str, Any], attempts: int, action_limit: int
) -> tuple[float, float]:
    """Expected random actions of an epsilon-greedy learner in its first trial, and in its second.

    Args:
        parameters: With ``epsilon_start``, ``epsilon_min``, ``epsilon_decay``,
            ``epsilon_decays_with`` and ``epsilon_after_trial``, as of
            :class:`openlock_learners.ddqn.DDQNParameters`.
        attempts: Attempts in a trial.
        action_limit: Actions in an attempt.
    """
    each = {"action": 1, "attempt": action_limit, "trial": attempts * action_limit}
    every = each[parameters["epsilon_decays_with"]]
    lowest, decay = parameters["epsilon_min"], parameters["epsilon_decay"]
    number = np.arange(attempts * action_limit) // every
    first = np.maximum(parameters["epsilon_start"] * decay**number, lowest)
    again = parameters["epsilon_after_trial"]
    if again is None:
        again = max(parameters["epsilon_start"] * decay ** (len(number) // every), lowest)
    # What a trial's end sets may lie below the minimum; the next step of decay lifts it.
    second = np.where(number == 0, again, np.maximum(again * decay**number, lowest))
    return float(first.sum()), float(second.sum())


def schedules(experiment: Experiment) -> pd.DataFrame:
    """Exploration schedules of every learner that has an epsilon.

    Returns:
        One row for each: ``learner``; ``decay``, ``shrinks_with`` and ``after_trial`` (NaN if
        nothing sets epsilon at a trial's end); ``steps``, how often epsilon shrinks until it is
        below one percent; ``first_trial`` and ``later_trial``, how many random actions are to be
        expected in the first trial and in the second.
    """
    rows = []
    for spec in experiment.learners:
        given = spec.parameters
        if given.keys() >= {*_SCHEDULE, _AFTER}:
            limit = spec.protocol.action_limit or PAPER_ACTION_LIMIT
            decay = float(given["epsilon_decay"])
            first, later = random_actions(given, spec.protocol.attempt_limit, limit)
            steps = float(steps_until(decay)) if 0 < decay < 1 else float("nan")
            after = float("nan") if given[_AFTER] is None else float(given[_AFTER])
            shrinks = given["epsilon_decays_with"]
            rows.append((spec.name, decay, shrinks, after, steps, first, later))
    columns = ["learner", "decay", "shrinks_with", "after_trial", "steps"]
    return pd.DataFrame(rows, columns=[*columns, "first_trial", "later_trial"])


def changing(explored: pd.DataFrame) -> bool:
    """Whether the epsilon of any schedule from :func:`schedules` shrinks."""
    return bool(((explored["decay"] != 1) | explored["after_trial"].notna()).any())


def beside_learning(explored: pd.DataFrame, progressed: pd.DataFrame) -> pd.DataFrame:
    """Schedules with what was learned under each.

    Returns:
        One row for each learner, condition and protocol that both tables have: the columns of
        ``explored``, ``condition``, ``protocol``, ``door`` with ``ci_low`` and ``ci_high`` (share
        of attempts that open the door in the last part of training), ``chance``, the ``verdict``
        on it, ``all`` (share of visits with every solution found, there) and ``all_verdict``.
    """
    key = ["learner", "condition", "protocol"]
    doors = progressed[progressed["measure"] == OPENS]
    doors = doors[[*key, "last", "ci_low", "ci_high", "chance", "verdict"]]
    alls = progressed.loc[progressed["measure"] == FINDS_ALL, [*key, "last", "verdict"]]
    alls = alls.rename(columns={"last": "all", "verdict": "all_verdict"})
    table = explored.merge(doors, on="learner", how="inner", sort=False)
    table = table.rename(columns={"last": "door"}).merge(alls, on=key, how="left", sort=False)
    first = ["learner", "condition", "decay", "shrinks_with", "door", "ci_low", "ci_high"]
    return table[[*first, *(name for name in table if name not in first)]]


def meanings(table: pd.DataFrame) -> pd.Series:
    """Whether each fast decay leads to meaningful learning; empty for usual decays.

    It takes a learner of a usual decay that learns in the same condition to say so. Learning with a
    fast decay is meaningful if the learner learns too and surely opens the door at least half as
    often, and it is not if it surely opens it less than half as often, by the interval of its
    share; else it is undecided.

    Args:
        table: From :func:`beside_learning`, with ``usual``, the share with a usual decay.
    """
    half = table["usual"] / 2
    some = (table["verdict"] == LEARNS) & (table["ci_low"] >= half)
    found = np.where(table["ci_high"] < half, NONE, np.where(some, SOME, OPEN))
    return pd.Series(np.where(table["decay"] > USUAL, "", found), table.index)


def _usual(table: pd.DataFrame) -> pd.Series:
    """Share of attempts in which the best learner of a usual decay opens the door, or NaN."""
    able = table["door"].where((table["decay"] > USUAL) & (table["verdict"] == LEARNS))
    return able.groupby([table["condition"], table["protocol"]]).transform("max")


def section(material: Material) -> Section | None:
    """Section: how fast people's attempts and learners' exploration shrink.

    Returns:
        None unless a learner's exploration shrinks, and learners differ in how it does or someone
        played enough trials under the protocol ``human`` for a curve to be fitted.
    """
    explored = schedules(material.experiment)
    several = len(explored[["decay", "shrinks_with"]].drop_duplicates()) > 1
    curves = {
        f"{learner}, {condition}": values
        for (learner, condition), values in learning_curves(material.trials, HUMAN_PROTOCOL).items()
        if len(values) >= LEAST_TRIALS
        and (learner, condition, HUMAN_PROTOCOL) in (people_beside(material).cells or ())
    }
    if not changing(explored) or not (several or curves):
        return None
    people = fitted({f"people, {name}": values for name, values in people_over_trials().items()})
    tables = [_fits("people_decay", people)]
    if curves:
        tables.append(_fits("learners_decay", fitted(curves)))
    learned = pd.DataFrame()
    if several:
        learned = beside_learning(explored, progress(material.trials, material.experiment))
    if len(learned):
        usual = _usual(learned)
        learned.insert(7, "meaning", meanings(learned.assign(usual=usual)))
        one = learned["protocol"].nunique() == 1
        shown = learned.drop(columns="protocol") if one else learned
        tables.insert(0, _PROSE.table("exploration", shown, _SCHEDULES, usual=USUAL))
        learned = learned.assign(usual=usual)[learned["decay"] <= USUAL]
    paper = people[people["curve"] == "people, CC3 and CE3 training"].set_index("form")["decay"]
    return _PROSE.section(
        "exploration",
        tables,
        mean=PAPER_MEAN,
        median=PAPER_MEDIAN,
        fits=paper.to_dict(),
        steps={d: steps_until(d) for d in (PAPER_MEAN, PAPER_MEDIAN, 0.995)} if several else {},
        learners=[own.to_dict("records") for _, own in learned.groupby("learner", sort=False)]
        if len(learned)
        else [],
    )


def _fits(name: str, table: pd.DataFrame) -> Table:
    frame = table.assign(near=np.where(table["near"], "yes", "no"))
    return _PROSE.table(name, frame, _FITS, mean=PAPER_MEAN)


TOPIC = Topic("exploration", 130, section)
