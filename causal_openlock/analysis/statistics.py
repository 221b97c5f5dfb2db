"""How certain a mean over subjects is: bootstrap intervals.

A percentile bootstrap draws as many subjects as there are, with replacement, over and over, and
reports between which values the middle 95% of the means lie. It assumes no distribution, which
suits attempts: they are bounded by a limit that many subjects hit. A stratified one draws within
each of several groups, for whatever is computed from all of them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import pandas as pd

from causal_openlock.world.fsm import FloatArray

LEVEL = 0.95
RESAMPLES = 2000
SEED = 2018
"""Seed of the resampling unless told; the same for every table, so that tables agree."""

_BATCH = 4_000_000  # resampled values in memory at once: 32 MB


def mean_interval(
    samples: FloatArray,
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[FloatArray, FloatArray]:
    """Percentile bootstrap interval of the mean, for many groups of equal size at once.

    Every group is resampled with the same indices, so a group's interval does not depend on which
    other groups it shares the call with.

    Args:
        samples: ``[G, n]`` one value for each subject of each of G groups.
        rng: Where the resampling takes its random numbers from.
        level: Probability that the interval is to cover.
        resamples: How many times to resample.

    Returns:
        ``[G]`` low and ``[G]`` high. A group whose values are all equal has an interval of that
        value alone; groups of fewer than two subjects have NaN.
    """
    from scipy.stats import bootstrap

    groups, subjects = samples.shape
    if subjects < 2 or not groups:
        return np.full(groups, np.nan), np.full(groups, np.nan)
    result = bootstrap(
        (samples,),
        np.mean,
        axis=-1,
        vectorized=True,
        method="percentile",
        confidence_level=level,
        n_resamples=resamples,
        batch=max(1, _BATCH // samples.size),
        rng=rng,
    )
    low, high = result.confidence_interval
    # Means of equal values may differ in the last digit.
    constant = (samples == samples[:, :1]).all(axis=1)
    return np.where(constant, samples[:, 0], low), np.where(constant, samples[:, 0], high)


def mean_intervals(
    frame: pd.DataFrame,
    by: Sequence[str],
    value: str,
    *,
    generator: Callable[[], np.random.Generator] = lambda: np.random.default_rng(SEED),
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> pd.DataFrame:
    """Bootstrap intervals of the mean of ``value`` in every group.

    Args:
        frame: One row for each subject of each group, subjects in a fixed order.
        by: Columns that make up a group.
        value: The column to average.
        generator: Makes the generator to resample with, afresh for each size of group.
        level: Probability that an interval is to cover.
        resamples: How many times to resample.

    Returns:
        One row for each group, sorted: ``by``, ``ci_low`` and ``ci_high``.
    """
    grouped = frame.groupby(list(by), observed=True, sort=True)
    sizes = grouped.size()
    number = grouped.ngroup().to_numpy()
    values = frame[value].to_numpy(dtype=float)[np.argsort(number, kind="stable")]
    size = sizes.to_numpy()
    first = np.cumsum(size) - size
    low, high = np.empty(len(size)), np.empty(len(size))
    for subjects in np.unique(size):
        which = np.flatnonzero(size == subjects)
        samples = values[first[which, None] + np.arange(subjects)]
        low[which], high[which] = mean_interval(
            samples, generator(), level=level, resamples=resamples
        )
    result = sizes.reset_index()[list(by)]
    return result.assign(ci_low=low, ci_high=high)


def stratified_interval(
    strata: Sequence[FloatArray],
    statistic: Callable[[Sequence[FloatArray]], FloatArray],
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[float, float]:
    """Percentile bootstrap interval of what is computed from several independent groups.

    Args:
        strata: ``[n_g]`` values of the subjects of each group, who are resampled among themselves.
        statistic: From ``[R, n_g]`` values of each group to ``[R]``.
        rng: Where the resampling takes its random numbers from.
        level: Probability that the interval is to cover.
        resamples: How many times to resample.

    Returns:
        Low and high; NaN if a group has fewer than two subjects. Where all subjects of every group
        are equal both are the statistic itself.
    """
    if not strata or min(map(len, strata)) < 2:
        return float("nan"), float("nan")
    values = [np.asarray(one, float) for one in strata]
    if all((one == one[0]).all() for one in values):
        alone = float(statistic([one[None] for one in values])[0])
        return alone, alone
    batch = max(1, _BATCH // sum(map(len, values)))
    drawn = [
        statistic([one[rng.integers(len(one), size=(count, len(one)))] for one in values])
        for count in np.diff([*range(0, resamples, batch), resamples])
    ]
    return percentile_interval(np.concatenate(drawn), level)


def percentile_interval(drawn: FloatArray, level: float = LEVEL) -> tuple[float, float]:
    """Between which values the middle of ``[R]`` resampled values lies."""
    low, high = np.quantile(drawn, [(1 - level) / 2, (1 + level) / 2])
    return float(low), float(high)
