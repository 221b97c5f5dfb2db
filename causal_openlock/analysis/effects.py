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
import pandas as pd

from causal_openlock.analysis.statistics import LEAST_UNITS, LEVEL, SEED, alike, mode
from causal_openlock.schemas.fsm import FloatArray

ALPHA = 0.05  #: significance level
PERMUTATIONS = 9999  #: random permutations of a test


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
    """A difference of means, with its interval (95%) and the p of a test that there is none."""

    value: float
    low: float = math.nan
    high: float = math.nan
    p: float = math.nan

    def columns(self, name: str) -> dict[str, float]:
        """Columns of a table called after the difference: it, its interval and its p."""
        ends = {f"{name}_low": self.low, f"{name}_high": self.high}
        return {name: self.value, **ends, f"{name}_p": self.p}


class Group(NamedTuple):
    """Summary of a group of subjects, or of differences of pairs, from which means are compared.

    ``variance`` has size − 1 in the denominator, and is 0 for a single subject; the ``weight`` is
    that of the group's mean; ``values`` are empty of what is published.
    """

    size: int
    mean: float
    variance: float
    weight: float = 1.0
    values: FloatArray = np.empty(0)

    @classmethod
    def of(cls, values: FloatArray, weight: float = 1.0) -> Group:
        """The group of ``[n]`` values, one for each of at least one subject."""
        same = bool(np.ptp(values) == 0)  # means of equal values may differ in the last digit
        mean = float(values[0] if same else values.mean())
        return cls(len(values), mean, 0.0 if same else float(values.var(ddof=1)), weight, values)

    @classmethod
    def published(cls, mean: float, se: float, size: int) -> Group:
        """The group behind a published mean and its error bar, population SD / √n."""
        return cls(size, mean, se**2 * size**2 / (size - 1) if size > 1 else 0.0)


def weighted_difference(
    groups: Sequence[Group], pooled: bool = False, level: float = LEVEL
) -> Difference:
    """A weighted sum of the means of independent groups, with the interval and test of t.

    A group of weight 1 is a one-sample t-test, two of weights 1 and −1 are Welch's, and several
    conditions have the mean of their differences. Groups need not be equally scattered: the degrees
    of freedom are Welch's and Satterthwaite's, or with ``pooled`` variances Student's, N − G.

    >>> found = weighted_difference([Group.of(np.array([1.0, 2, 3, 2, 2]))])
    >>> [round(number, 3) for number in found]
    [2.0, 1.122, 2.878, 0.003]

    Returns:
        NaN without groups. Interval and p are NaN if there are fewer than
        :data:`~causal_openlock.analysis.statistics.LEAST_UNITS` subjects on one side. Where nearly
        all subjects have the most common value of their group there is no interval, and p is that
        of the sign test over pairs or, with groups on two sides, of a permutation test.
    """
    from scipy.special import stdtr, stdtrit

    if not groups:
        return Difference(math.nan)
    size, mean, variance, weight = np.array([group[:4] for group in groups], float).T
    value = math.fsum(weight * mean)  # what is equal has no difference of the last digits
    sides = [size[side].sum() for side in (weight > 0, weight < 0) if side.any()]
    if size.min() < 2 or min(sides) < LEAST_UNITS:
        return Difference(value)
    held = [group.values for group in groups]
    if all(map(len, held)) and alike(size.sum(), sum(mode(values)[1] for values in held)):
        return Difference(value, p=_exact_p(groups))
    freedom = size.sum() - len(size)
    if pooled:
        variance = np.full(len(size), (size - 1) @ variance / freedom)
    spread = weight**2 * variance / size
    error = math.sqrt(spread.sum())
    if not error > 0:  # published means without an error
        return Difference(value)
    df = freedom if pooled else spread.sum() ** 2 / (spread**2 / (size - 1)).sum()
    half = error * float(stdtrit(df, (1 + level) / 2))
    return Difference(value, value - half, value + half, float(2 * stdtr(df, -abs(value) / error)))


def contrast(first: pd.Series, second: pd.Series, weight: float = 1.0) -> list[Group]:
    """The groups whose :func:`weighted_difference` is first − second, by subject.

    Subjects of the same index have met the same rooms, and their differences are one group;
    subjects that share no rooms are two independent groups.
    """
    place = second.index.get_indexer(first.index)
    values, others = first.to_numpy(float), second.to_numpy(float)
    if (place >= 0).any():
        return [Group.of(values[place >= 0] - others[place[place >= 0]], weight)]
    return [Group.of(values, weight), Group.of(others, -weight)]


def _exact_p(groups: Sequence[Group]) -> float:
    """P of the sign test over pairs, or with groups on two sides of a permutation test.

    The first group of the one side is compared with the first of the other, and so on.
    """
    from scipy.special import bdtr

    more, less = ([one for one in groups if (one.weight > 0) == side] for side in (True, False))
    if not less:
        signs = np.sign(np.concatenate([one.values for one in more]))
        fewer, either = min((signs > 0).sum(), (signs < 0).sum()), (signs != 0).sum()
        return min(1.0, 2 * float(bdtr(fewer, either, 0.5))) if either else 1.0
    rng, drawn, value = np.random.default_rng(SEED), np.zeros(PERMUTATIONS), 0.0
    for one, other in zip(more, less, strict=True):
        value += one.weight * one.mean + other.weight * other.mean
        both = np.tile(np.concatenate([one.values, other.values]), (PERMUTATIONS, 1))
        mixed = rng.permuted(both, axis=1)
        drawn += one.weight * mixed[:, : one.size].mean(axis=1)
        drawn += other.weight * mixed[:, one.size :].mean(axis=1)
    as_large = (np.abs(drawn) >= abs(value) - 1e-9).sum()
    return float((1 + as_large) / (1 + PERMUTATIONS))
