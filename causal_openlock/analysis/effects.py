"""How large an effect is, and how many subjects it takes to see it.

Whether a difference is more than chance depends on the number of subjects; how large it is does
not. Learners can be given as many subjects as one likes, so that the smallest difference becomes
significant: what compares them with people are sizes of effects.

Comparisons of learners follow Agarwal et al., *Deep Reinforcement Learning at the Edge of the
Statistical Precipice* (NeurIPS 2021): the interquartile mean, which a few hopeless subjects do not
move, and the probability of improvement, which depends only on which of two subjects was better.
"""

from __future__ import annotations

import gc
import math
from bisect import bisect_left
from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.statistics import RESAMPLES, SEED, bootstrap_interval
from causal_openlock.world.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import generators

ALPHA = 0.05
"""Significance level."""

POWER = 0.8
"""Wanted probability of finding an effect that exists."""

MOST_SUBJECTS = 1_000_000
"""The largest group whose power is computed."""


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
    from statsmodels.stats.multitest import multipletests

    defined = ~np.isnan(p)
    corrected = np.full(len(p), np.nan)
    if defined.any():
        gc.freeze()  # multipletests collects garbage, 0.1 s each time where much is loaded
        corrected[defined] = multipletests(p[defined], method="holm")[1]
        gc.unfreeze()
    return corrected


def interquartile_mean(scores: FloatArray) -> FloatArray:
    """Mean of the middle half of ``[..., N]`` values: a quarter is left out at either end.

    >>> float(interquartile_mean(np.array([1.0, 4, 5, 6, 7, 30, 30, 30])))
    12.0
    """
    from scipy.stats import trim_mean

    mean: FloatArray = np.asarray(trim_mean(scores, 0.25, axis=-1))
    return mean


def interquartile_interval(
    strata: Sequence[FloatArray], rng: np.random.Generator, *, resamples: int = RESAMPLES
) -> tuple[FloatArray, FloatArray]:
    """Bootstrap interval of the interquartile mean of ``[n_g]`` values of several groups together.

    It is stratified: the subjects of each group are resampled among themselves. NaN if a group has
    fewer than two.
    """
    values = np.unique(np.concatenate(strata))
    many = sum(map(len, strata))
    cut = many // 4

    def middle(*counts: IntArray) -> FloatArray:
        reached = np.clip(np.cumsum(sum(counts), axis=-1), cut, many - cut)
        mean: FloatArray = np.diff(reached, axis=-1, prepend=cut) @ values / (many - 2 * cut)
        return mean

    groups = [_counts(one, values) for one in strata]
    return bootstrap_interval(middle, groups, rng, counted=True, resamples=resamples)


def probability_of_improvement(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> float:
    """How probable it is that a subject of one learner scores more than one of another.

    >>> probability_of_improvement([np.array([3, 5])], [np.array([1, 5])])
    0.625

    Args:
        first: ``[n_c]`` scores of one learner in each of C conditions; more is better.
        second: ``[m_c]`` scores of the other in the same conditions.

    Returns:
        P(first > second), ties counting half, averaged over conditions; 0.5 for equals.
    """
    return float(_mean_wins(*_counted(first, second)))


def improvement_interval(
    first: Sequence[FloatArray],
    second: Sequence[FloatArray],
    rng: np.random.Generator,
    *,
    resamples: int = RESAMPLES,
) -> tuple[FloatArray, FloatArray]:
    """Bootstrap interval of :func:`probability_of_improvement`, stratified over conditions.

    NaN where a learner has fewer than two subjects in a condition.
    """
    groups = _counted(first, second)
    return bootstrap_interval(_mean_wins, groups, rng, counted=True, resamples=resamples)


def _counted(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> list[IntArray]:
    """``[U]`` counts of both learners in each condition, of the U scores that occur there."""
    return [
        _counts(scores, np.unique(np.concatenate(both)))
        for both in zip(first, second, strict=True)
        for scores in both
    ]


def _counts(scores: FloatArray, values: FloatArray) -> IntArray:
    """``[U]`` how often each of U sorted values occurs."""
    counts = np.bincount(np.searchsorted(values, scores), minlength=len(values))
    return counts.astype(np.int64)


def _mean_wins(*counts: IntArray) -> FloatArray:
    """``[...]`` share of pairs in which the first is larger, the mean over pairs of groups."""
    shares = [
        (one * (np.cumsum(other, axis=-1) - other / 2)).sum(axis=-1)
        / (one.sum(axis=-1) * other.sum(axis=-1))
        for one, other in zip(counts[::2], counts[1::2], strict=True)
    ]
    mean: FloatArray = np.asarray(sum(shares) / len(shares))
    return mean


def power_of_t(d: float, subjects: int) -> float:
    """Probability that a two-sided t test of two groups, at least 2 subjects each, finds Cohen's d.

    >>> round(power_of_t(0.5, 64), 2)
    0.8
    """
    from statsmodels.stats.power import TTestIndPower

    return float(TTestIndPower().power(abs(d), subjects, ALPHA))


def power_of_contrast(noncentrality: float, subjects: int, groups: int) -> float:
    """Probability that the F test of a contrast, such as an interaction, finds an effect.

    Args:
        noncentrality: The F that the effect has on average for each subject of a group: F / n.
        subjects: In each group, at least 2.
        groups: How many groups the contrast is among.
    """
    from statsmodels.stats.power import ftest_power_f2

    error = groups * (subjects - 1)
    f2 = noncentrality * subjects / (error + 2)
    return float(ftest_power_f2(f2, 1, error, ALPHA, ncc=1))


def subjects_needed(d: float) -> int | None:
    """The fewest subjects in each group with which a t test of Cohen's d has :data:`POWER`.

    >>> subjects_needed(0.8)
    26

    None if that is beyond :data:`MOST_SUBJECTS`, as for no effect at all, or if d is NaN.
    """
    return None if np.isnan(d) else _fewest(lambda n: power_of_t(d, n))


def contrast_subjects_needed(noncentrality: float, groups: int) -> int | None:
    """The fewest subjects in each group for a contrast; see :func:`power_of_contrast`."""
    if np.isnan(noncentrality):
        return None
    return _fewest(lambda n: power_of_contrast(noncentrality, n, groups))


def _fewest(power_at: Callable[[int], float]) -> int | None:
    sizes = range(2, MOST_SUBJECTS + 1)
    place = bisect_left(sizes, POWER, key=power_at)
    return sizes[place] if place < len(sizes) else None


class Difference(NamedTuple):
    """How the means of two groups differ, with its 95% bootstrap interval and the p of a test.

    NaN, but for the value, if a group has one subject.
    """

    value: float
    low: float
    high: float
    p: float


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
    from scipy.stats import ttest_ind

    if min(len(first), len(second)) < 2:
        return math.nan
    if np.ptp(first) == 0 and np.ptp(second) == 0:
        if first[0] == second[0]:
            return 1.0
        return min(1.0, 2 / math.comb(len(first) + len(second), len(first)))
    return float(ttest_ind(first, second, equal_var=False).pvalue)
