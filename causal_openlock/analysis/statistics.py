"""How certain a mean over subjects is: the one interval of every table and figure.

A mean has Student's interval. It has none over fewer than :data:`LEAST_UNITS` subjects, and none
where nearly all subjects have the same value, as those that never solve a room within the limit:
their spread says little about the next subject. What stands there instead is how many have that
value, with Wilson's interval of their share.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from causal_openlock.schemas.fsm import BoolArray, FloatArray
from causal_openlock.wording import counted

FEW_SUBJECTS = 20  #: groups of fewer subjects than this are warned about
LEAST_UNITS = 5  #: means over fewer subjects have no interval
APPROXIMATE = 10  #: intervals over fewer subjects are marked as approximate
MOST_ALIKE = 0.9  #: a mean has no interval where this share of the subjects has the same value
LEVEL = 0.95
SEED = 2018  #: seed of whatever a table draws at random, so that tables agree


def too_few(subjects: int, to: str = "rank learners") -> str:
    """Say that subjects are too few ``to`` conclude something; empty if there are enough.

    >>> too_few(2), too_few(FEW_SUBJECTS)
    ('2 subjects are too few to rank learners', '')
    """
    if subjects >= FEW_SUBJECTS:
        return ""
    are = "is" if subjects == 1 else "are"
    return f"{counted(subjects, 'subject')} {are} too few to {to}"


def sizes(rows: pd.DataFrame) -> str:
    """How many subjects rows of means are of: ``n = 40``, or ``n = 20 to 40`` if they differ."""
    low, high = int(rows["subjects"].min()), int(rows["subjects"].max())
    return f"n = {low}" if low == high else f"n = {low} to {high}"


def mean_intervals(frame: pd.DataFrame, by: Sequence[str], value: str) -> pd.DataFrame:
    """Student's intervals of the mean of ``value`` in every group of ``by``.

    >>> frame = pd.DataFrame({"learner": ["a"] * 6, "attempts": [3.0, 4, 3, 5, 4, 4]})
    >>> mean_intervals(frame, ["learner"], "attempts").round(2).values.tolist()
    [['a', 3.04, 4.62, 4.0, 3]]

    The frame has one row for each subject of each group.

    Returns:
        One row for each group, sorted: ``by``; ``ci_low`` and ``ci_high``, NaN where the mean has
        no interval; ``mode``, the most common value, and ``at_mode``, how many have it.
    """
    values = frame[[*by]].assign(value=frame[value].round(9))
    counts = values.groupby([*by, "value"], observed=True).size().rename("at_mode").reset_index()
    modes = counts.sort_values("at_mode", kind="stable").groupby([*by], observed=True).last()
    table = values.groupby([*by], observed=True)["value"].agg(["size", "mean", "var"])
    modes = modes.reindex(table.index)
    low, high = student(table["size"], table["mean"], table["var"], modes["at_mode"])
    table = table.assign(ci_low=low, ci_high=high, mode=modes["value"], at_mode=modes["at_mode"])
    return table.reset_index()[[*by, "ci_low", "ci_high", "mode", "at_mode"]]


def mode(values: FloatArray) -> tuple[float, int]:
    """The most common of ``[n]`` values, and how many have it.

    >>> mode(np.array([30.0, 12, 30, 30]))
    (30.0, 3)
    """
    found, counts = np.unique(values.round(9), return_counts=True)
    most = counts.argmax()
    return float(found[most]), int(counts[most])


def alike(size: ArrayLike, at_mode: ArrayLike) -> BoolArray:
    """Whether so many have the most common value that their mean has no interval.

    >>> alike([40, 40], [36, 35]).tolist()
    [True, False]
    """
    return np.asarray(at_mode) >= MOST_ALIKE * np.asarray(size) - 1e-9


def student(
    size: ArrayLike,
    mean: ArrayLike,
    variance: ArrayLike,
    at_mode: ArrayLike,
    level: float = LEVEL,
) -> tuple[FloatArray, FloatArray]:
    """Student's intervals of means, ``[...]`` low and high, NaN for those that have none.

    Args:
        size: ``[...]`` how many subjects each mean is over.
        mean: ``[...]`` the means.
        variance: ``[...]`` variances of the subjects, with size − 1 in the denominator.
        at_mode: ``[...]`` how many subjects have the most common value.
        level: How often the interval is to cover.
    """
    from scipy.special import stdtrit

    size, mean = np.asarray(size), np.asarray(mean)
    half = stdtrit(np.maximum(size - 1, 1), (1 + level) / 2) * np.sqrt(variance / size)
    half = np.where((size < LEAST_UNITS) | alike(size, at_mode), np.nan, half)
    return mean - half, mean + half


def beside_mean(low: float, high: float, subjects: int, mode: float, at_mode: int) -> str:
    """What stands next to a mean: its interval, or how many subjects have the most common value.

    >>> beside_mean(3.5, 3.9, 20, 4.0, 9), beside_mean(3.5, 3.9, 6, 4.0, 2)
    ('3.50–3.90', '≈ 3.50–3.90')
    >>> beside_mean(np.nan, np.nan, 40, 30.0, 38), beside_mean(np.nan, np.nan, 4, 30.0, 4)
    ('38 of 40 at 30 (83% to 99%)', '')
    """
    if subjects < LEAST_UNITS:
        return ""
    if not np.isnan(low):
        return f"{'≈ ' if subjects < APPROXIMATE else ''}{low:.2f}–{high:.2f}"
    least, most = share_interval(at_mode / subjects, subjects)
    return f"{at_mode} of {subjects} at {mode:.4g} ({least:.0%} to {most:.0%})"


def share_interval(
    share: ArrayLike, size: ArrayLike, level: float = LEVEL
) -> tuple[FloatArray, FloatArray]:
    """Wilson's interval of a share of ``size`` subjects, ``[...]`` low and high; NaN for too few.

    >>> [round(float(end), 3) for end in share_interval(38 / 40, 40)]
    [0.835, 0.986]
    """
    from scipy.special import ndtri

    share, size = np.asarray(share), np.asarray(size)
    z = ndtri((1 + level) / 2)
    middle = share + z**2 / (2 * size)
    half = z * np.sqrt(share * (1 - share) / size + (z / (2 * size)) ** 2)
    whole = np.where(size < LEAST_UNITS, np.nan, 1 + z**2 / size)
    return (middle - half) / whole, (middle + half) / whole


def median_interval(values: FloatArray) -> tuple[float, float]:
    """Exact interval of the median of ``[n]`` subjects, from the sign test; NaN for too few.

    >>> median_interval(np.array([5.0, 3, 4, 9, 7, 30]))
    (3.0, 30.0)
    """
    from scipy.special import bdtr  # scipy.stats, which has this interval, takes longer to load

    size = len(values)
    outside = int((bdtr(np.arange(size), size, 0.5) <= (1 - LEVEL) / 2).sum())
    if not outside:
        return np.nan, np.nan
    ordered = np.sort(values)
    return float(ordered[outside - 1]), float(ordered[size - outside])
