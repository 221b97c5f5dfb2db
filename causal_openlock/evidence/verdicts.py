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

A claim is about *every* one of its contrasts, which leaves room for no exception, or about the
*whole*, which leaves room for half of them. The first of these that applies is its verdict:

============== ==================================================================================
verdict        of a claim
============== ==================================================================================
does not hold  more contrasts than there is room for do not hold
undecided      together with the undecided ones they are more than there is room for
holds          all contrasts hold
in part        everything else
============== ==================================================================================

What this costs in chance findings is counted in :mod:`~causal_openlock.evidence.multiplicity`.

Intervals are Student's t; of two independent groups Welch's; of correlations Fisher's. Fewer than
three units decide nothing. There are two exceptions. Of shares of which each subject, or group of
a recovery, has 0 or 1 they are Clopper and Pearson's (1934). And where units are all equal, at the
limit of attempts for instance, they cover what n draws can miss: a fraction of
``1 - 0.025 ** (1 / n)``, each as far off as the measure reaches; a network counts for as many draws
as it had subjects. Differences with such a side are put together from the intervals of both
(Newcombe, 1998).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
import pandas as pd
from scipy import stats

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.published_units import published_units
from causal_openlock.evidence.study import (
    CORRELATION,
    PUBLISHED,
    About,
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

    >>> low, high = mean_of(Selected(np.array([3.0, 4, 5, 4]))).interval
    >>> round(low, 2), round(high, 2)
    (2.7, 5.3)
    """
    values, mean = found.values, float(np.mean(found.values))
    return Estimate(
        mean, {level: _ends(found, level) for level in (LEVEL, EQUIVALENCE)}, (len(values),)
    )


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


def _ends(found: Selected, level: float) -> Ends:
    values, n = found.values, len(found.values)
    if n < LEAST:
        return np.nan, np.nan
    mean, tail = float(np.mean(values)), (1 - level) / 2
    if found.binary:
        ones = int(values.sum())
        low = float(stats.beta.ppf(tail, ones, n - ones + 1)) if ones else 0.0
        high = float(stats.beta.ppf(1 - tail, ones + 1, n - ones)) if ones < n else 1.0
        return low, high
    if np.ptp(values) < 1e-12:
        missed = (1 - tail ** (1 / max(found.draws, n))) * found.reach
        return mean - missed, mean + missed
    half = float(stats.t.ppf(1 - tail, n - 1) * stats.sem(values))
    return mean - half, mean + half


def difference(of: Selected, minus: Selected) -> Estimate:
    """The difference of the means of two independent groups of units."""
    one, two = mean_of(of), mean_of(minus)
    value, units = one.value - two.value, (*one.units, *two.units)
    binary = of.binary and minus.binary
    equal = min(np.ptp(of.values), np.ptp(minus.values)) < 1e-12
    if min(units) >= LEAST and not binary and not equal:
        test = stats.ttest_ind(of.values, minus.values, equal_var=False)
        ends = {level: test.confidence_interval(level) for level in one.intervals}
        return Estimate(value, {k: (float(e.low), float(e.high)) for k, e in ends.items()}, units)
    return Estimate(value, _together(one, two), units)


def _together(one: Estimate, two: Estimate) -> dict[float, Ends]:
    """Intervals of a difference from those of both sides (Newcombe, 1998)."""
    ends = {}
    for level, (low, high) in one.intervals.items():
        other_low, other_high = two.intervals[level]
        value = one.value - two.value
        ends[level] = (
            value - float(np.hypot(one.value - low, other_high - two.value)),
            value + float(np.hypot(high - one.value, two.value - other_low)),
        )
    return ends


def estimate(
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
    if not isinstance(known, Selection):
        return from_known(of_side(units, contrast.of, contrast.measure)[0], known)
    of = selected(units, contrast.of, contrast.measure)
    if known.learner in PUBLISHED:
        there = selected(published_units(), known, contrast.measure)
        error = 0.0  # that of shares is not known
        if contrast.measure == "attempts":
            error = float(selected(published_units(), known, "error").values.mean())
        return from_known(mean_of(of), float(there.values.mean()), error, there.draws)
    minus = selected(units, known, contrast.measure)
    if not paired(contrast.of, known, unit, same or {}):
        return difference(of, minus)
    both = np.intersect1d(of.units, minus.units)
    if not len(both):
        raise EvidenceError("no unit has been run on both sides")
    one, two = of.only(both), minus.only(both)
    if one.binary and two.binary:
        # Without what pairing would gain: cautious.
        return replace(difference(one, two), units=(len(both),))
    # Not the rule for shares of 0 or 1: these are differences, and reach twice as far.
    gaps = one.values - two.values
    return mean_of(replace(one, values=gaps, share=False, reach=2.0 * one.reach))


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

    >>> found = mean_of(Selected(np.array([2.0, 3, 2, 3])))
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


def together(verdicts: Iterable[Verdict], about: About = "every") -> Verdict:
    """The verdict on a claim from those on its contrasts.

    >>> mixed: list[Verdict] = ["holds", "does not hold"]
    >>> together(mixed), together(mixed, about="whole")
    ('does not hold', 'in part')
    """
    found = list(verdicts)
    exceptions = len(found) / 2 if about == "whole" else 0
    against, unclear = found.count("does not hold"), found.count("undecided")
    if against > exceptions:
        return "does not hold"
    if not found or against + unclear > exceptions:
        return "undecided"
    return "holds" if found.count("holds") == len(found) else "in part"
