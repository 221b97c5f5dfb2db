"""How fast attempts shrink from trial to trial, and how fast exploration shrinks.

The paper fits an exponential decay to people's attempts over the six training trials, gets 0.548
(median) and 0.743 (mean), and lets epsilon of a DDQN shrink by these factors: "no meaningful
learning". It does not say how it fitted, and people's attempts are published as means only, so
three usual ways to fit means here show the size of the numbers, and no more. Means of people in
training come from a later paper, *Decomposing Human Causal Learning* (Edmonds et al., CogSci 2019,
80 in each condition), those in the baseline from Figure 3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import mean_by_trial
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world import reference

PAPER_MEDIAN, PAPER_MEAN = 0.548, 0.743
"""The paper's decays, of the median and of the mean of people's attempts."""

NEAR = 0.035
"""Fits this close to the paper's decay count as near it: people's means are no more exact."""

LEAST_TRIALS = 4
"""Three parameters fit any three points."""

_SEARCHED = (1e-3, 1.5)  # decays, for people and learners alike; above 1 attempts grow
_BELOW_ONE = 0.99  # with an offset, a decay of 1 is a straight line of any slope


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
    """For a given decay the fit is linear, so only the decay is searched."""
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
    """Of the best multiple of each curve, plus the best offset: simple linear regressions."""
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
    paper's own four-lever baselines are beside them.
    """
    facts = reference.results()
    training = {name: own["mean"] for name, own in facts["cogsci2019"]["human"]["all"].items()}
    both = np.mean([training["CC3"], training["CE3"]], axis=0).round(6).tolist()
    baseline = facts["cogsci2018"]["human"]["baseline"]
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
    """How often a share must shrink by a factor below 1 until it is below ``floor``.

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
