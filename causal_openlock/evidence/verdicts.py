"""Verdicts by rule: what follows from an interval and the smallest difference that matters.

A contrast is a difference between two means over units, with a 95% interval. It is *paired* where
both sides are of the same units: subjects of one condition, who meet the same rooms whatever their
learner, or one network under two conditions. The sign is turned so that the difference that a claim
expects is positive. With the smallest difference that matters, ``m``:

============== ====================================== =========================================
verdict        of "more" or "less"                    of "the same"
============== ====================================== =========================================
holds          the interval lies above m              the 90% interval lies within -m to m
in part        it lies above 0, and reaches below m
does not hold  it lies below m                        the 95% interval lies outside -m to m
undecided      everything else                        everything else
============== ====================================== =========================================

That the 90% interval lies within both margins is the two one-sided tests of equivalence at the 5%
level (Schuirmann, 1987).

A claim holds if all its contrasts do. One that does not hold refutes it; else one that is undecided
leaves it so; else it holds in part. No verdict is corrected for the number of others.

An interval has two parts. The first is Student's t, of two independent groups Welch's: how much the
units that were drawn differ. The second is what they cannot show. A value that a trial takes with a
probability of up to ``1 - 0.025 ** (1 / n)`` is missed by n trials in one of forty studies; this
share of trials may be as far off as can be. Without it, forty subjects who all need four attempts
would exclude that one in fifty needs thirty. With it, intervals of shares of 0 or 1 have at least
the coverage of Clopper and Pearson's, and all change continuously with the data. Of two independent
groups the second parts are put together as in Newcombe (1998).

Where a unit is a mean over many trials, n counts these. That a whole unit comes out otherwise is
not covered by few units: five networks miss in six of ten studies that one in ten fails.

Intervals of correlations are Fisher's. Fewer than three units decide nothing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from scipy import stats
from scipy.special import stdtrit

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.published_units import published_units
from causal_openlock.evidence.study import (
    CORRELATION,
    PUBLISHED,
    Contrast,
    Expected,
    Selection,
)
from causal_openlock.evidence.units import Selected, selected

Verdict = Literal["holds", "in part", "does not hold", "undecided"]
Ends = tuple[float, float]

LEVEL = 0.95
LEAST = 3
"""Fewer units have no interval, and decide nothing."""
EQUIVALENCE = 0.90
"""Level of the interval that must lie within both margins: two tests at 5%."""
LEVELS = (LEVEL, EQUIVALENCE)


@dataclass(frozen=True)
class Estimate:
    """A mean, or a difference of means, with what it rests on.

    Attributes:
        value: The estimate.
        intervals: By level, the ends of the interval that covers the true value with that
            probability; NaN if it is not known how much units differ.
        units: How many units each side has: one number where they are paired or compared with a
            known number.
    """

    value: float
    intervals: Mapping[float, Ends]
    units: tuple[int, ...]

    @property
    def interval(self) -> Ends:
        """The ends of the 95% interval."""
        return self.intervals[LEVEL]

    @property
    def n(self) -> str:
        """Number of units on each side, in words."""
        return " and ".join(map(str, self.units))


def mean_of(found: Selected) -> Estimate:
    """The mean of some units.

    >>> low, high = mean_of(Selected(np.array([3.0, 4, 5, 4]), least=3, most=5)).interval
    >>> float(low), float(high)
    (3.0, 5.0)
    """
    n, mean = len(found.values), float(np.mean(found.values))
    ends = {}
    for level in LEVELS:
        half = math.sqrt(_squared_error(found)) * _students(level, n - 1)
        below, above = _missed(found, level)
        low, high = max(found.least, mean - half - below), min(found.most, mean + half + above)
        ends[level] = (low, high) if n >= LEAST else (np.nan, np.nan)
    return Estimate(mean, ends, (n,))


def difference(of: Selected, minus: Selected) -> Estimate:
    """The difference of the means of two independent groups of units."""
    sides = (of, minus)
    units = (len(of.values), len(minus.values))
    value = float(np.mean(of.values) - np.mean(minus.values))
    errors = [_squared_error(side) for side in sides]
    # Welch's degrees of freedom; where no unit differs from another, there is nothing to scale.
    each = [e**2 / (n - 1) for e, n in zip(errors, units, strict=True) if n >= LEAST]
    freedom = sum(errors) ** 2 / sum(each) if sum(each) else math.inf
    ends = {}
    for level in LEVELS:
        half = math.sqrt(sum(errors)) * _students(level, freedom)
        (below, above), (under, over) = (_missed(side, level) for side in sides)
        low, high = value - half - math.hypot(below, over), value + half + math.hypot(above, under)
        reach = (max(low, of.least - minus.most), min(high, of.most - minus.least))
        ends[level] = reach if min(units) >= LEAST else (np.nan, np.nan)
    return Estimate(value, ends, units)


def gaps(of: Selected, minus: Selected) -> Selected:
    """The differences between pairs of units."""
    return replace(
        of,
        values=of.values - minus.values,
        least=of.least - minus.most,
        most=of.most - minus.least,
    )


def _squared_error(found: Selected) -> float:
    """The squared standard error of a mean."""
    n = len(found.values)
    return float(np.var(found.values, ddof=1)) / n if n >= LEAST else math.nan


def _students(level: float, freedom: float) -> float:
    return float(stdtrit(max(freedom, 1.0), (1 + level) / 2))  # as stats.t.ppf, which takes longer


def _missed(found: Selected, level: float) -> Ends:
    """How far below and above the mean what was missed can bring it."""
    trials = max(found.trials, len(found.values))
    share, mean = 1 - ((1 - level) / 2) ** (1 / trials), float(np.mean(found.values))
    return share * (mean - found.least), share * (found.most - mean)


def correlation(units: pd.DataFrame, selection: Selection) -> Estimate:
    """The correlation of a parameter with what is fitted, over sets, with Fisher's interval.

    Raises:
        EvidenceError: If the parameter was not recovered, of too few sets, or comes out the same
            in all of them.
    """
    known = {"learner", "parameter", "true", "fitted"} <= set(units)
    rows = units[
        (units["learner"] == selection.learner) & (units["parameter"] == selection.parameter)
    ] if known else units[:0]  # fmt: skip
    if rows.empty:
        raise EvidenceError(f"{selection.parameter} of {selection.learner} was not recovered")
    values = rows[["true", "fitted"]].to_numpy(float).T
    if len(rows) <= LEAST:
        raise EvidenceError(f"{selection.parameter} was recovered of too few sets")
    if np.ptp(values, axis=1).min() == 0:
        raise EvidenceError(f"{selection.parameter} comes out the same, whatever made subjects")
    found = stats.pearsonr(*values)
    ends = {level: found.confidence_interval(level) for level in (LEVEL, EQUIVALENCE)}
    intervals = {level: (float(one.low), float(one.high)) for level, one in ends.items()}
    return Estimate(float(found.statistic), intervals, (len(rows),))


def of_side(
    units: pd.DataFrame, selection: Selection, measure: str
) -> tuple[Estimate, Selected | None]:
    """The mean of a selection and its units; for ``r`` the correlation, which is not a mean.

    Raises:
        EvidenceError: If it has not been run.
    """
    if measure == CORRELATION:
        return correlation(units, selection), None
    found = selected(units, selection, measure)
    return mean_of(found), found


def compared(
    units: pd.DataFrame, contrast: Contrast, unit: str, same: Mapping[str, str] | None = None
) -> Estimate:
    """The difference that a contrast asks for.

    Args:
        units: From :mod:`~causal_openlock.evidence.units`.
        contrast: What is compared.
        unit: ``"subject"`` or ``"network"``.
        same: Of learners that play with the networks of another one, its label.

    Raises:
        EvidenceError: If a side has not been run.
    """
    known = contrast.minus
    found, of = of_side(units, contrast.of, contrast.measure)
    if of is None:  # a correlation
        assert not isinstance(known, Selection)
        return from_known(found, known)
    if not isinstance(known, Selection):
        return from_known(mean_of(of), known)
    if known.learner in PUBLISHED:
        there = selected(published_units(), known, contrast.measure)
        error = 0.0  # that of shares is not known
        if contrast.measure == "attempts":
            error = float(selected(published_units(), known, "error").values.mean())
        mean = float(there.values.mean())
        return from_known(mean_of(of), mean, error, there.trials)
    minus = selected(units, known, contrast.measure)
    if not paired(contrast.of, known, unit, same or {}):
        return difference(of, minus)
    both = np.intersect1d(of.units, minus.units)
    if not len(both):
        raise EvidenceError("no unit has been run on both sides")
    return mean_of(gaps(of.only(both), minus.only(both)))


def from_known(found: Estimate, known: float, error: float = 0.0, draws: int = 2) -> Estimate:
    """The difference to a known number, or to a published mean.

    Args:
        found: An estimate.
        known: The number.
        error: The standard error of a published mean.
        draws: How many people, or agents, that mean is of.
    """
    ends = {}
    for level, (low, high) in found.intervals.items():
        theirs = float(stats.t.ppf((1 + level) / 2, draws - 1)) * error if error else 0.0
        ends[level] = (
            found.value - known - float(np.hypot(found.value - low, theirs)),
            found.value - known + float(np.hypot(high - found.value, theirs)),
        )
    return Estimate(found.value - known, ends, found.units)


def paired(one: Selection, other: Selection, unit: str, same: Mapping[str, str]) -> bool:
    """Whether two selections are of the same units."""
    if unit == "network":
        names = (same.get(side.learner, side.learner) for side in (one, other))
        return len(set(names)) == 1
    return one.condition == other.condition


def verdict(found: Estimate, expected: Expected, smallest: float) -> Verdict:
    """Verdict that follows from an estimate.

    >>> found = mean_of(Selected(np.array(10 * [2.0, 3.0])))
    >>> verdict(found, "more", smallest=1), verdict(found, "less", smallest=1)
    ('holds', 'does not hold')
    """
    low, high = found.interval
    if np.isnan(low):
        return "undecided"
    if expected == "same":
        inner = found.intervals[EQUIVALENCE]
        if -smallest <= inner[0] and inner[1] <= smallest:
            return "holds"
        return "does not hold" if low > smallest or high < -smallest else "undecided"
    if expected == "less":
        low, high = -high, -low
    if low >= smallest:
        return "holds"
    if high < smallest:
        return "does not hold"
    return "in part" if low > 0 else "undecided"


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on a claim from those on its contrasts, each of which can refute it.

    >>> mixed: list[Verdict] = ["holds", "does not hold"]
    >>> together(mixed)
    'does not hold'
    """
    found = list(verdicts)
    if "does not hold" in found:
        return "does not hold"
    if not found or "undecided" in found:
        return "undecided"
    return "holds" if found.count("holds") == len(found) else "in part"
