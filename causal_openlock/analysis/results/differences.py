"""Whether two groups of subjects differ by more than noise.

The difference of two means comes with a bootstrap interval, each group resampled by itself, and
with Welch's test, which does not suppose that both groups are equally scattered.

Both take the groups for independent. With equal seeds they are not: subjects of the same number
share their rooms and their random numbers, so that results of two runs differ by less than the test
supposes. Both are conservative then: they find too little rather than too much.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.statistics import SEED, bootstrap_interval
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


def difference(first: FloatArray, second: FloatArray, keys: tuple[str, str]) -> Difference:
    """How far the mean of one group is from that of another, and whether that is noise.

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
    from scipy.stats import ttest_ind

    if min(len(first), len(second)) < 2:
        return math.nan
    if np.ptp(first) == 0 and np.ptp(second) == 0:
        if first[0] == second[0]:
            return 1.0
        return min(1.0, 2 / math.comb(len(first) + len(second), len(first)))
    return float(ttest_ind(first, second, equal_var=False).pvalue)
