"""How certain a result over subjects is: percentile bootstrap intervals.

A bootstrap draws as many subjects as there are, with replacement, over and over, and reports
between which values the middle 95% of the results lie. It assumes no distribution, which suits
attempts: they are bounded by a limit that many subjects hit.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.wording import counted

FEW_SUBJECTS = 20
"""Groups of fewer subjects than this are warned about."""


def too_few(subjects: int, to: str = "rank learners", where: str = "") -> str:
    """Say that subjects are too few for a conclusion; empty if there are enough.

    >>> too_few(2), too_few(FEW_SUBJECTS)
    ('2 subjects are too few to rank learners', '')

    Args:
        subjects: How many there are.
        to: What they are too few to do.
        where: What they are the subjects of, with a space before it.
    """
    if subjects >= FEW_SUBJECTS:
        return ""
    are = "is" if subjects == 1 else "are"
    return f"{counted(subjects, 'subject')}{where} {are} too few to {to}"


LEVEL = 0.95
RESAMPLES = 2000
SEED = 2018
"""Default seed of the resampling; the same for every table, so that tables agree."""

_BATCH = 4_000_000  # resampled values in memory at once: 32 MB

Generators = np.random.Generator | Sequence[np.random.Generator]


def bootstrap_interval(
    statistic: Callable[..., FloatArray],
    groups: Sequence[FloatArray | IntArray],
    rng: Generators,
    *,
    counted: bool = False,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[FloatArray, FloatArray]:
    """Percentile bootstrap interval of what is computed from independent groups of subjects.

    The subjects of each group are resampled among themselves.

    >>> groups = [np.array([3.0, 5, 4, 6]), np.array([9.0, 8, 7])]
    >>> low, high = bootstrap_interval(
    ...     lambda a, b: a.mean(axis=-1) - b.mean(axis=-1), groups, np.random.default_rng(0)
    ... )
    >>> float(low) < 4.5 - 8 < float(high)
    True

    Args:
        statistic: From ``[..., R, n]`` resampled values of each group to ``[..., R]``.
        groups: ``[..., n]`` the values of each group's n subjects. All rows of leading axes are
            resampled with the same indices, so that a row's interval does not depend on the others.
        rng: A generator for all groups in turn, or one for each.
        counted: Whether groups are given as ``[U]`` counts instead: how many subjects have each of
            U values. Resamples are then drawn as such counts, ``[R, U]``, which takes as long for a
            million subjects as for forty.
        level: Probability that the interval is to cover.
        resamples: How many times to resample.

    Returns:
        ``[...]`` low and ``[...]`` high; NaN if a group has fewer than two subjects.
    """
    # Where all subjects of a group are equal, one of them stands for all, without rounding.
    alone = statistic(*(one[..., None, :] if counted else one[..., None, :1] for one in groups))
    if min(int(one.sum()) if counted else one.shape[-1] for one in groups) < 2:
        low, high = np.full((2, *alone.shape[:-1]), np.nan)
        return low, high
    each = [rng] * len(groups) if isinstance(rng, np.random.Generator) else rng
    draw = _resampled_counts if counted else _resampled
    batch = max(1, _BATCH // sum(one.size for one in groups))
    drawn = [
        statistic(*(draw(one, own, int(number)) for one, own in zip(groups, each, strict=True)))
        for number in np.diff([*range(0, resamples, batch), resamples])
    ]
    tail = (1 - level) / 2
    ordered = np.sort(np.concatenate(drawn, axis=-1), axis=-1)
    varies = ordered[..., 0] < ordered[..., -1]
    alike = counted | np.all([(one == one[..., :1]).all(axis=-1) for one in groups], axis=0)
    constant = np.where(alike, alone[..., 0], ordered[..., 0])
    low, high = np.where(varies, _quantiles(ordered, np.array([tail, 1 - tail])), constant)
    return low, high


def _resampled(values: Any, rng: np.random.Generator, number: int) -> Any:
    """``[..., number, n]`` values of subjects drawn with replacement."""
    subjects = values.shape[-1]
    return values[..., rng.integers(subjects, size=(number, subjects))]


def _resampled_counts(counts: Any, rng: np.random.Generator, number: int) -> Any:
    """``[number, U]`` how many of the subjects drawn have each value."""
    return rng.multinomial(counts.sum(), counts / counts.sum(), size=number)


def _quantiles(ordered: FloatArray, p: FloatArray) -> FloatArray:
    """``[2, ...]`` quantiles of ``[..., R]`` sorted values, for two p.

    Interpolated as SciPy 1.17 does: ``numpy.quantile`` differs in the last bit, which rounding to
    six digits can show.
    """
    place = p * ordered.shape[-1] + (1 - p)
    above, part = place.astype(int), place % 1
    ends = (1 - part) * ordered[..., above - 1] + part * ordered[..., above]
    return np.moveaxis(ends, -1, 0)


def error_of_bar(bar: pd.Series[float], subjects: pd.Series[int]) -> pd.Series[float]:
    """Standard errors with n − 1 in the denominator, ``[N]``, from error bars, which have n.

    >>> error_of_bar(pd.Series([1.2]), pd.Series([10])).round(3).tolist()
    [1.265]
    """
    return bar * np.sqrt(subjects / (subjects - 1).clip(lower=1))


def mean_interval(
    samples: FloatArray,
    rng: np.random.Generator,
    *,
    level: float = LEVEL,
    resamples: int = RESAMPLES,
) -> tuple[FloatArray, FloatArray]:
    """Bootstrap interval of the mean, for many groups of equal size at once.

    >>> low, high = mean_interval(np.array([[4.0, 4, 4], [3, 5, 10]]), np.random.default_rng(0))
    >>> low.tolist(), high.tolist()
    ([4.0, 3.0], [4.0, 10.0])

    Args:
        samples: ``[G, n]`` one value for each subject of each of G groups.
        rng: As in :func:`bootstrap_interval`, as the rest.
        level: As there.
        resamples: As there.

    Returns:
        ``[G]`` low and ``[G]`` high; NaN for fewer than two subjects.
    """
    return bootstrap_interval(
        lambda values: values.mean(axis=-1), [samples], rng, level=level, resamples=resamples
    )


def mean_intervals(frame: pd.DataFrame, by: Sequence[str], value: str) -> pd.DataFrame:
    """Bootstrap intervals of the mean of ``value`` in every group of ``by``.

    Args:
        frame: One row for each subject of each group, subjects in a fixed order.
        by: Columns that make up a group.
        value: The column to average.

    Returns:
        One row for each group, sorted: ``by``, ``ci_low`` and ``ci_high``.
    """
    grouped = frame.groupby(list(by), observed=True, sort=True)
    sizes = grouped.size()
    values = frame[value].to_numpy(float)[np.argsort(grouped.ngroup().to_numpy(), kind="stable")]
    size = sizes.to_numpy()
    first = np.cumsum(size) - size
    ends = np.empty((2, len(size)))
    for subjects in np.unique(size):
        which = np.flatnonzero(size == subjects)
        samples = values[first[which, None] + np.arange(subjects)]
        ends[:, which] = mean_interval(samples, np.random.default_rng(SEED))
    result = sizes.reset_index()[list(by)]
    return result.assign(ci_low=ends[0], ci_high=ends[1])
