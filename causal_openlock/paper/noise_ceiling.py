"""Noise ceiling and null models, to judge a distance from people.

Fourteen means of forty people each are not what people do, but a measurement of it. Four things say
what a distance from them is worth:

* The *noise ceiling*: how far a perfect model would be, as people's means and its own are off by
  their standard errors. Numbers that were fitted to the means follow people's error.
* The *misfit*: whether these errors explain the distance. A model may be near where means are
  uncertain and many standard errors off where they are known well. So each squared deviation is
  divided by its variance, and the sum is compared with χ².
* The *null curve*: four numbers fitted to the same means. Attempts fall exponentially with the
  rooms that were played before, ``last + gain · exp(-rooms / rate)``; the fourth number is added in
  common effect rooms and, once more, in tests after training with the other structure.
* *The difference of two models* with its interval. Where that includes zero, people's own sampling
  error could have put the models in the other order, and they are not ranked.

Trials are treated as independent: how one person's vary together is not known.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import at_places, by_subject
from causal_openlock.analysis.statistics import LEVEL, SEED
from causal_openlock.paper.likeness import (
    TRAINING_MODEL,
    Likeness,
    distance,
    points_of_people,
    training_points_of,
    training_points_of_model,
)
from causal_openlock.paper.significance import p_in_words
from causal_openlock.schemas.fsm import FloatArray

PERFECT = "perfect model"
CURVE, CURVE_NUMBERS = "curve of 4 numbers", 4
RESAMPLES = 2000
"""Studies of people, and of subjects, that are drawn."""


class Ceiling(NamedTuple):
    """The distance of a perfect model from people, in attempts (root mean square)."""

    people: float  #: due to people's sampling error
    low: float  #: between this and ``high`` it is in 95 of 100 such studies of people
    high: float
    both: float  #: due to people's sampling error and that of the learner's own means


class Misfit(NamedTuple):
    """How well sampling error explains a distance from people."""

    chi2: float  #: sum of squared deviations, each divided by the variance of the difference
    df: float
    p: float  #: probability of as large a sum for a perfect model; NaN without points

    @property
    def in_words(self) -> str:
        """The sum, its degrees of freedom and p; empty without points.

        >>> Misfit(32.49, 14, 0.0034).in_words
        'χ²(14) = 32.5, p = .003'
        """
        if self.df <= 0:
            return ""
        return f"χ²({self.df:.3g}) = {self.chi2:,.1f}, {p_in_words(self.p)}"


def misfit(points: pd.DataFrame, fitted: int = 0) -> Misfit:
    """Test whether sampling error explains a model's distance from people's means.

    >>> from causal_openlock.paper.likeness import points_of_model
    >>> misfit(points_of_model()).in_words
    'χ²(14) = 62.3, p < .001'

    Args:
        points: As for :func:`noise_ceiling`.
        fitted: Numbers that were fitted to these means. Each takes away people's share in the
            variances from the degrees of freedom: none was fitted to the learner's own error.
    """
    from scipy.special import chdtrc

    off = (points["mean"] - points["people_mean"]).to_numpy(float)
    theirs, own = _error(points, "people_") ** 2, _error(points) ** 2
    if points.empty or not np.all(theirs + own):  # of a single subject no error is known
        return Misfit(float("nan"), 0.0, float("nan"))
    size = float((off**2 / (theirs + own)).sum())
    freedom = len(points) - fitted * float((theirs / (theirs + own)).mean())
    return Misfit(size, freedom, float(chdtrc(freedom, size)))


def noise_ceiling(points: pd.DataFrame, fitted: int = 0) -> Ceiling:
    """Distance of a perfect model from people's means.

    >>> from causal_openlock.paper.likeness import points_of_model
    >>> found = noise_ceiling(points_of_model())
    >>> f"{found.people:.2f}, with 40 subjects of its own {found.both:.2f}"
    '1.21, with 40 subjects of its own 1.34'

    Args:
        points: Of one learner, from :func:`~causal_openlock.paper.likeness.points_of`; all is NaN
            without points.
        fitted: Numbers that were fitted to these means. With k of N points, squares of people's
            part are (N - k)/N times as large, which is exact where errors are alike and the model
            is linear in these numbers.
    """
    if points.empty:
        return Ceiling(*[float("nan")] * 4)
    left = np.sqrt(max(1 - fitted / len(points), 0))
    theirs, own = left * _error(points, "people_"), _error(points)
    drawn = np.random.default_rng(SEED).normal(0.0, theirs, (RESAMPLES, len(points)))
    low, high = np.quantile(np.sqrt((drawn**2).mean(axis=1)), _TAILS).tolist()
    people, both = (float(np.sqrt(squares.mean())) for squares in (theirs**2, theirs**2 + own**2))
    return Ceiling(people, low, high, both)


_TAILS = [(1 - LEVEL) / 2, (1 + LEVEL) / 2]


def _error(points: pd.DataFrame, whose: str = "") -> FloatArray:
    """``[N]`` standard errors, by n − 1 where error bars have n; those of a curve are 0."""
    size = points[f"{whose}subjects"]
    errors = points[f"{whose}se"].fillna(0.0) * np.sqrt(size / (size - 1).clip(lower=1))
    return errors.to_numpy(float)


@cache
def null_curve() -> pd.DataFrame:
    """The points of the null curve, fitted to people's fourteen means by least squares.

    Nobody may change them.

    >>> round(distance(null_curve())[0], 2)
    0.68
    """
    from scipy.optimize import curve_fit

    points = points_of_people()
    test = points["phase"] == "test"
    common_effect = points["condition"].str.endswith("CE4")
    other = test & (points["condition"].str[:2] != points["condition"].str[4:6])
    rooms = np.where(test, 6, points["trial"] - 1)
    harder = common_effect.astype(int) + other

    def curve(_: object, last: float, gain: float, rate: float, cost: float) -> pd.Series[float]:
        return last + gain * np.exp(-rooms / rate) + cost * harder

    numbers, _ = curve_fit(curve, rooms, points["people_mean"], (6.0, 14.0, 2.0, 2.0))
    return points.assign(learner=CURVE, mean=curve(None, *numbers), se=np.nan)


class Difference(NamedTuple):
    """Difference of two models' distances from people, with its 95% interval."""

    difference: float  #: of their RMSEs, in attempts; negative if the first is nearer
    low: float
    high: float
    verdict: str  #: on the first: nearer, farther, or not ranked, if the interval includes 0


def drawn_means(
    points: pd.DataFrame, trials: pd.DataFrame | None, rng: np.random.Generator
) -> FloatArray:
    """``[R, N]`` a learner's means at its N points, as other subjects might have given them.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        trials: What its subjects did; they are resampled. Without it, means are drawn by their
            standard errors.
        rng: Generator of the resampling.
    """
    if trials is None:
        error = _error(points)
        return rng.normal(points["mean"].to_numpy(float), error, (RESAMPLES, len(points)))
    drawn = np.empty((RESAMPLES, len(points)))
    each = by_subject(trials, ["phase", "trial"])
    for condition, own in points.reset_index(drop=True).groupby("condition", sort=False):
        values, places = at_places(each[each["condition"] == condition])
        wanted = zip(own["phase"], own["trial"], strict=True)
        values = values[:, [places.index(place) for place in wanted]]
        subjects = rng.integers(len(values), size=(RESAMPLES, len(values)))
        drawn[:, own.index] = values[subjects].mean(axis=1)
    return drawn


def rmse_difference(
    points: tuple[pd.DataFrame, pd.DataFrame],
    drawn: tuple[FloatArray, FloatArray],
    rng: np.random.Generator,
) -> Difference:
    """The difference of two models' distances from people, with a verdict.

    People's means are drawn anew, the same for both models, whose own are :func:`drawn_means`. In
    the difference of mean squares people's sampling error has no bias, as it is in both terms; the
    interval is computed there and divided by the sum of the two RMSEs.
    """
    people = rng.normal(points[0]["people_mean"], _error(points[0], "people_"), drawn[0].shape)
    squares = [((own - people) ** 2).mean(axis=1) - own.var(axis=0).mean() for own in drawn]
    rmse = [distance(own)[0] for own in points]
    scale = max(sum(rmse), np.finfo(float).tiny)
    low, high = (np.quantile(squares[0] - squares[1], _TAILS) / scale).tolist()
    verdict = "nearer" if high < 0 else "farther" if low > 0 else "not ranked"
    return Difference(rmse[0] - rmse[1], low, high, verdict)


def beside_null_models(
    like: Likeness, trials: pd.DataFrame, fitted: Mapping[str, int] = MappingProxyType({})
) -> pd.DataFrame:
    """Distances from people, next to the noise ceiling and null models.

    Args:
        like: The learners, from :func:`~causal_openlock.paper.likeness.likeness`.
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        fitted: How many numbers were fitted to these means, of learners of which any were.

    Returns:
        A row for each learner, the published models, the null curve and a perfect model, the
        nearest first: ``learner``; distances in attempts, ``rmse`` over all points, ``baselines``,
        ``tests`` and ``all`` (in training in three-lever rooms), each followed by its misfit in
        words (``misfit``, ``misfit_baselines``, ...); ``ceiling`` (of a perfect model with as many
        subjects and fitted numbers), and against the nearest learner ``difference``, ``low``,
        ``high``, ``verdict``.
    """
    rng = np.random.default_rng(SEED)
    played = {str(name): own for name, own in trials.groupby("learner", observed=True)}
    drawn = {name: drawn_means(own, played.get(name), rng) for name, own in like.points.items()}
    nearest = next(name for name in like.points if name in played)
    people, in_training = points_of_people(), training_points_of(trials)
    models = {
        name: (own, in_training[in_training["learner"] == name], fitted.get(name, 0))
        for name, own in like.points.items()
    }
    models[CURVE] = null_curve(), people[:0], CURVE_NUMBERS
    models[TRAINING_MODEL] = people[:0], training_points_of_model(), 0
    # A perfect model deviates by people's standard errors alone.
    perfect = [own.assign(mean=own["people_mean"] + _error(own, "people_"))
               for own in (people, training_points_of_model())]  # fmt: skip
    models[PERFECT] = *perfect, 0
    rows = []
    for name, (points, training, numbers) in models.items():
        test = points["phase"] == "test"
        parts = {"rmse": points, "baselines": points[~test], "tests": points[test], "all": training}
        row: dict[str, object] = {"learner": name}
        for part, own in parts.items():
            # How many of the fitted numbers count in a part of the points is not known.
            known = name != PERFECT and (not numbers or part in ("rmse", "all"))
            fit = misfit(own, numbers if part == "rmse" else 0).in_words if known else ""
            row |= {part: distance(own)[0], f"misfit_{part}": fit or None}
        row["ceiling"] = None if name == PERFECT else noise_ceiling(points, numbers).both
        if name in drawn and name != nearest:
            pair = (points, like.points[nearest]), (drawn[name], drawn[nearest])
            row |= rmse_difference(*pair, rng)._asdict()
        rows.append(row)
    table = pd.DataFrame(rows).rename(columns={"misfit_rmse": "misfit"})
    return table.sort_values("rmse", kind="stable", ignore_index=True)
