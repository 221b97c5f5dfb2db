"""How large an effect is, and how likely chance alone makes one as large.

Whether a difference is more than chance depends on the number of subjects; how large it is does
not. Learners can be given as many subjects as one likes, so that the smallest difference becomes
significant: what compares them with people are sizes of effects.

An estimate comes with its interval first, and with the p of a test second. Means are compared, and
not interquartile means: of attempts, which are small integers that many subjects share, the middle
half is often a single number, so that its interval would have no width where learners differ.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.statistics import LEVEL, SEED, bootstrap_interval
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.world.randomness import generators

ALPHA = 0.05
"""Significance level."""


def hedges_g(d: float, df: int) -> float:
    """Hedges' g: Cohen's d without its bias in small samples, for n + m − 2 degrees of freedom.

    >>> round(hedges_g(0.8, 10), 3)
    0.738

    NaN for fewer than 2 degrees of freedom, with which the bias is not defined.
    """
    from scipy.special import gammaln

    if df < 2:
        return float("nan")
    return float(d * np.exp(gammaln(df / 2) - gammaln((df - 1) / 2)) / np.sqrt(df / 2))


def partial_eta_squared(f: float, df_effect: int, df_error: int) -> float:
    """Partial η² of an F: the share of the variance left by other effects that this one explains.

    Of the multivariate test of trials it is 1 − Wilks' Λ.

    >>> round(partial_eta_squared(24.94, 1, 156), 3)
    0.138
    """
    return float(f * df_effect / (f * df_effect + df_error))


def holm(p: FloatArray) -> FloatArray:
    """Holm's correction of the p values of a family of tests; NaN for those that are not defined.

    >>> holm(np.array([0.04, 0.01, np.nan])).tolist()
    [0.04, 0.02, nan]
    """
    corrected = np.full(len(p), np.nan)
    order = np.argsort(p)[: np.count_nonzero(~np.isnan(p))]  # NaN are sorted to the end
    times = len(order) - np.arange(len(order))
    corrected[order] = np.minimum(np.maximum.accumulate(p[order] * times), 1.0)
    return corrected


class Difference(NamedTuple):
    """How means differ, with the 95% interval and the p of a test that they do not.

    NaN, but for the value, if a group has one subject.
    """

    value: float
    low: float
    high: float
    p: float


class Group(NamedTuple):
    """Summary of a group of subjects, or of differences of pairs, from which means are compared.

    ``variance`` has size − 1 in the denominator, and is 0 for a single subject; the ``weight`` is
    that of the group's mean.
    """

    size: int
    mean: float
    variance: float
    weight: float = 1.0

    @classmethod
    def of(cls, values: FloatArray, weight: float = 1.0) -> Group:
        """The group of ``[n]`` values, one for each of at least one subject."""
        alike = bool(np.ptp(values) == 0)  # means of equal values may differ in the last digit
        mean = float(values[0] if alike else values.mean())
        return cls(len(values), mean, 0.0 if alike else float(values.var(ddof=1)), weight)

    @classmethod
    def published(cls, mean: float, se: float, size: int) -> Group:
        """The group behind a published mean and its error bar, population SD / √n."""
        return cls(size, mean, se**2 * size**2 / (size - 1) if size > 1 else 0.0)


def weighted_difference(groups: Sequence[Group], pooled: bool = False) -> Difference:
    """A weighted sum of the means of independent groups, with the interval and test of t.

    A group of weight 1 is a one-sample t-test, two of weights 1 and −1 are Welch's, and several
    conditions have the mean of their differences. Groups need not be equally scattered: the degrees
    of freedom are Welch's and Satterthwaite's, or with ``pooled`` variances Student's, N − G.

    >>> found = weighted_difference([Group.of(np.array([1.0, 2, 3, 2]))])
    >>> [round(number, 2) for number in found]
    [2.0, 0.7, 3.3, 0.02]

    Returns:
        NaN without groups. The interval is NaN if a group has one subject, and also if nobody
        differs: an interval without a width would claim that no other subject could. p is then the
        chance that all N signs agree, 2 / 2ᴺ, or 1 where there is no difference.
    """
    from scipy.special import stdtr, stdtrit

    if not groups:
        return Difference(math.nan, math.nan, math.nan, math.nan)
    size, mean, variance, weight = np.array(groups, float).T
    value = math.fsum(weight * mean)  # what is equal has no difference of the last digits
    if size.min() < 2:
        return Difference(value, math.nan, math.nan, math.nan)
    freedom = size.sum() - len(size)
    if pooled:
        variance = np.full(len(size), (size - 1) @ variance / freedom)
    spread = weight**2 * variance / size
    error = math.sqrt(spread.sum())
    if error == 0:
        sides = [size[side].sum() for side in (weight > 0, weight < 0) if side.any()]
        agree = float(min(1.0, 2.0 ** (1 - min(sides))))
        return Difference(value, math.nan, math.nan, agree if value else 1.0)
    df = freedom if pooled else spread.sum() ** 2 / (spread**2 / (size - 1)).sum()
    half = error * float(stdtrit(df, (1 + LEVEL) / 2))
    return Difference(value, value - half, value + half, float(2 * stdtr(df, -abs(value) / error)))


def difference(first: FloatArray, second: FloatArray, keys: tuple[str, str]) -> Difference:
    """How far the mean of one group is from that of another, and whether that is noise.

    The difference comes with a bootstrap interval, each group resampled by itself, and with Welch's
    test, which does not suppose that both groups are equally scattered. Both take the groups for
    independent. With equal seeds they are not: subjects of the same number share their rooms and
    their random numbers, so that results of two runs differ by less than the test supposes. Both
    are conservative then: they find too little rather than too much.

    >>> found = difference(np.array([5.0, 6, 7]), np.array([3.0, 3, 4]), ("first", "second"))
    >>> round(found.value, 2), round(found.p, 2)
    (2.67, 0.02)

    Args:
        first: ``[n]`` a value for each subject of one group.
        second: ``[m]`` and of the other, taken for other subjects even where seeds are equal.
        keys: What the groups are, not the same twice. The resamples of a group depend on its key
            and on nothing else, so that a comparison does not depend on what else is compared.
    """
    (one, first_counts), (other, second_counts) = (
        np.unique(values, return_counts=True) for values in (first, second)
    )
    low, high = bootstrap_interval(
        lambda a, b: a @ one / len(first) - b @ other / len(second),
        [first_counts, second_counts],
        [generators(SEED, f"resampled/{key}", [0])[0] for key in keys],
        counted=True,
    )
    value = float(first.mean() - second.mean())
    return Difference(value, float(low), float(high), _p_value(first, second))


def _p_value(first: FloatArray, second: FloatArray) -> float:
    """Welch's test; where nobody differs within either group, how few permutations part them."""
    if min(len(first), len(second)) < 2:
        return math.nan
    if np.ptp(first) == 0 and np.ptp(second) == 0:
        if first[0] == second[0]:
            return 1.0
        return min(1.0, 2 / math.comb(len(first) + len(second), len(first)))
    return weighted_difference([Group.of(first), Group.of(second, -1.0)]).p
