"""Whether two groups of subjects differ by more than noise.

The difference of two means comes with an interval and a test. The interval is a percentile
bootstrap: each group is resampled by itself, and what is reported is where the middle 95% of the
differences lie. The test is Welch's, which does not take the groups for equally scattered.

Both take the groups for independent. With equal seeds they are not: subjects of the same number
share their rooms and their random numbers, so that what differs between runs differs by less than
the test supposes. There both are conservative: they find too little rather than too much.

Attempts take few different values, and a resample of a group is fully told by how often it has
each of them. So resamples are drawn as these counts (a multinomial draw), which takes as long for
a million subjects as for forty.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.statistics import RESAMPLES, SEED, percentile_interval
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.randomness import generators


class Difference(NamedTuple):
    """How two groups differ.

    Attributes:
        value: Mean of the first less that of the second.
        low: Lower end of its 95% bootstrap interval; NaN if a group has one subject.
        high: Upper end.
        p: Probability of such a difference, either way, if there were none; NaN if a group has
            one subject.
    """

    value: float
    low: float
    high: float
    p: float


def resampled_means(values: FloatArray, key: str, resamples: int = RESAMPLES) -> FloatArray:
    """``[resamples]`` means of a group resampled with replacement.

    Args:
        values: ``[n]`` one for each subject.
        key: What the group is; the draws depend on it and on nothing else, so that a comparison
            does not depend on what else a report compares.
        resamples: How many.
    """
    (generator,) = generators(SEED, f"resampled/{key}", [0])
    distinct, counts = np.unique(values, return_counts=True)
    drawn = generator.multinomial(len(values), counts / len(values), resamples)
    means: FloatArray = drawn @ distinct / len(values)
    return means


def difference(first: FloatArray, second: FloatArray, keys: tuple[str, str]) -> Difference:
    """How far the mean of one group is from that of another, and whether that is noise.

    Args:
        first: ``[n]`` a value for each subject of one group.
        second: ``[m]`` and of the other, taken for other subjects even where seeds are equal.
        keys: What the groups are, as for :func:`resampled_means`; not the same twice.
    """
    value = float(first.mean() - second.mean())
    if min(len(first), len(second)) < 2:
        return Difference(value, math.nan, math.nan, math.nan)
    resampled = [
        resampled_means(values, key) for values, key in zip((first, second), keys, strict=True)
    ]
    low, high = percentile_interval(resampled[0] - resampled[1])
    return Difference(value, low, high, _p_value(first, second))


def _p_value(first: FloatArray, second: FloatArray) -> float:
    """Welch's test; where nobody differs within either group, how few permutations part them."""
    from scipy.stats import ttest_ind

    if np.ptp(first) == 0 and np.ptp(second) == 0:
        if first[0] == second[0]:
            return 1.0
        return min(1.0, 2 / math.comb(len(first) + len(second), len(first)))
    return float(ttest_ind(first, second, equal_var=False).pvalue)
