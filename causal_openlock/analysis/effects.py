"""How large an effect is, and how many subjects it takes to see it.

Whether a difference is more than chance depends on the number of subjects; how large it is does
not. Learners can be given as many subjects as one likes, so that the smallest difference becomes
significant: what compares them with people are sizes of effects.

Comparisons of learners follow Agarwal et al., *Deep Reinforcement Learning at the Edge of the
Statistical Precipice* (NeurIPS 2021): the interquartile mean, which a few hopeless subjects do not
move, and the probability of improvement, which asks nothing but who was better.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Sequence

import numpy as np

from causal_openlock.analysis.statistics import LEVEL, RESAMPLES, percentile_interval
from causal_openlock.world.fsm import FloatArray, IntArray

ALPHA = 0.05
"""Significance level."""

POWER = 0.8
"""Probability with which an effect that exists is to be found."""

MOST_SUBJECTS = 1_000_000
"""More subjects in a group than this are not looked for."""


def hedges_g(d: float, df: int) -> float:
    """Hedges' g: Cohen's d without the bias that it has in small samples.

    Args:
        d: Cohen's d.
        df: Degrees of freedom of the standard deviation, n + m − 2.

    Returns:
        NaN for fewer than 2 degrees of freedom, with which the bias is not defined.
    """
    from scipy.special import gammaln

    if df < 2:
        return float("nan")
    return float(d * np.exp(gammaln(df / 2) - gammaln((df - 1) / 2)) / np.sqrt(df / 2))


def partial_eta_squared(f: float, df_effect: int, df_error: int) -> float:
    """Partial η² of an F: the share of the variance left by other effects that this one explains.

    Of the multivariate test of trials it is 1 − Wilks' Λ.
    """
    return float(f * df_effect / (f * df_effect + df_error))


def holm(p: FloatArray) -> FloatArray:
    """Holm's correction: p values such that in a whole family the first error has the usual odds.

    Args:
        p: ``[N]`` p values of a family of tests; NaN for those that are not defined, which do not
            count as tests.

    Returns:
        ``[N]`` corrected, at most 1.
    """
    p = np.asarray(p, float)
    defined = np.flatnonzero(~np.isnan(p))
    order = defined[np.argsort(p[defined], kind="stable")]
    steps = p[order] * np.arange(len(order), 0, -1)
    corrected = np.full(len(p), np.nan)
    corrected[order] = np.minimum(1, np.maximum.accumulate(steps))
    return corrected


def interquartile_mean(scores: FloatArray) -> FloatArray:
    """Mean of the middle half: a quarter of the values is left out at either end.

    Args:
        scores: ``[..., N]`` values; where N is no multiple of four, fewer are left out.

    Returns:
        ``[...]`` means.
    """
    from scipy.stats import trim_mean

    mean: FloatArray = np.asarray(trim_mean(scores, 0.25, axis=-1))
    return mean


def interquartile_interval(
    strata: Sequence[FloatArray],
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[float, float]:
    """Bootstrap interval of the interquartile mean of several groups together, stratified.

    As :func:`~causal_openlock.analysis.statistics.stratified_interval` would give it. Only how
    often each value was drawn matters, so that is what is drawn.

    Args:
        strata: ``[n_g]`` values of the subjects of each group, who are resampled among themselves.
        rng: Where the resampling takes its random numbers from.
        level: Probability that the interval is to cover.
        resamples: How many times to resample.

    Returns:
        Low and high; NaN if a group has fewer than two subjects.
    """
    if not strata or min(map(len, strata)) < 2:
        return float("nan"), float("nan")
    values = np.unique(np.concatenate(strata))
    counts = sum(_drawn(_counts(one, values), rng, resamples) for one in strata)
    many = sum(map(len, strata))
    cut = many // 4
    reached = np.clip(np.cumsum(counts, axis=-1), cut, many - cut)
    kept = np.diff(reached, axis=-1, prepend=cut)
    return percentile_interval(kept @ values / (many - 2 * cut), level)


def probability_of_improvement(first: Sequence[FloatArray], second: Sequence[FloatArray]) -> float:
    """How probable it is that a subject of one learner scores more than one of another.

    Args:
        first: ``[n_c]`` scores of one learner in each of C conditions; more is better.
        second: ``[m_c]`` scores of the other in the same conditions.

    Returns:
        P(first > second), ties counting half, averaged over conditions; 0.5 for equals.
    """
    return float(
        np.mean([_wins(*_counted(a, b)) for a, b in zip(first, second, strict=True)], dtype=float)
    )


def improvement_interval(
    first: Sequence[FloatArray],
    second: Sequence[FloatArray],
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[float, float]:
    """Bootstrap interval of :func:`probability_of_improvement`, stratified over conditions.

    The subjects of each learner in each condition are resampled among themselves. Only how often
    each score was drawn matters, so that is what is drawn.

    Args:
        first: As there.
        second: As there.
        rng: Where the resampling takes its random numbers from.
        level: Probability that the interval is to cover.
        resamples: How many times to resample.

    Returns:
        Low and high; NaN where a learner has fewer than two subjects in a condition.
    """
    if min(len(scores) for scores in (*first, *second)) < 2:
        return float("nan"), float("nan")
    total = np.zeros(resamples)
    for scores in zip(first, second, strict=True):
        total += _wins(*(_drawn(counts, rng, resamples) for counts in _counted(*scores)))
    return percentile_interval(total / len(first), level)


def _counted(first: FloatArray, second: FloatArray) -> tuple[IntArray, IntArray]:
    """``[U]`` how often each of the U values that occur is taken, for either group."""
    values = np.unique(np.concatenate([first, second]))
    return _counts(first, values), _counts(second, values)


def _counts(scores: FloatArray, values: FloatArray) -> IntArray:
    """``[U]`` how often each of U sorted values is taken."""
    counts = np.bincount(np.searchsorted(values, scores), minlength=len(values))
    return counts.astype(np.int64)


def _drawn(counts: IntArray, rng: np.random.Generator, resamples: int) -> IntArray:
    """``[R, U]`` how often each value is taken when subjects are drawn with replacement."""
    return rng.multinomial(counts.sum(), counts / counts.sum(), size=resamples)


def _wins(first: IntArray, second: IntArray) -> FloatArray:
    """``[...]`` share of pairs in which the first is larger, from ``[..., U]`` counts."""
    below = np.cumsum(second, axis=-1) - second / 2
    pairs = first.sum(axis=-1) * second.sum(axis=-1)
    share: FloatArray = (first * below).sum(axis=-1) / pairs
    return share


def power_of_t(d: float, subjects: int, *, alpha: float = ALPHA) -> float:
    """Probability that a two-sided t test of two groups finds an effect.

    Args:
        d: Cohen's d of the effect.
        subjects: In each of the two groups, at least 2.
        alpha: Significance level.
    """
    from statsmodels.stats.power import TTestIndPower

    return float(TTestIndPower().power(abs(d), subjects, alpha))


def power_of_contrast(
    noncentrality: float, subjects: int, groups: int, *, alpha: float = ALPHA
) -> float:
    """Probability that the F test of a contrast, such as an interaction, finds an effect.

    Args:
        noncentrality: The F that the effect has on average for each subject of a group: F / n.
        subjects: In each group, at least 2.
        groups: How many groups the contrast is among.
        alpha: Significance level.
    """
    from scipy.stats import f, ncf

    df = (1, groups * (subjects - 1))
    return float(ncf.sf(f.isf(alpha, *df), *df, noncentrality * subjects))


def subjects_needed(d: float, *, power: float = POWER, alpha: float = ALPHA) -> int | None:
    """The fewest subjects in each group with which a t test has the wanted power.

    Args:
        d: Cohen's d of the effect.
        power: Probability with which it is to be found.
        alpha: Significance level.

    Returns:
        The number, or None if it is beyond :data:`MOST_SUBJECTS`, as for no effect at all, or if
        the effect is not known (NaN).
    """
    if np.isnan(d):
        return None
    sizes = range(2, MOST_SUBJECTS + 1)
    place = bisect_left(sizes, power, key=lambda size: power_of_t(d, size, alpha=alpha))
    return sizes[place] if place < len(sizes) else None


def contrast_subjects_needed(
    noncentrality: float, groups: int, *, power: float = POWER, alpha: float = ALPHA
) -> int | None:
    """The fewest subjects in each group for a contrast; see :func:`power_of_contrast`."""
    if np.isnan(noncentrality):
        return None
    sizes = range(2, MOST_SUBJECTS + 1)
    place = bisect_left(
        sizes,
        power,
        key=lambda size: power_of_contrast(noncentrality, size, groups, alpha=alpha),
    )
    return sizes[place] if place < len(sizes) else None
