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

Intervals are those of every report (:mod:`~causal_openlock.analysis.statistics`): Student's of
pairs, Welch's of two groups, Wilson's of a share of units, Fisher's of a correlation. Where nine of
ten units, or pairs, have one value, there is none, and an exact test decides on which side of a
margin the difference lies: the sign test of pairs, a permutation test of groups. Fewer than five
units decide nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import pandas as pd
from scipy import stats

from causal_openlock.analysis.effects import ALPHA, Group, weighted_difference
from causal_openlock.analysis.statistics import (
    LEAST_UNITS,
    LEVEL,
    beside_mean,
    mode,
    share_interval,
)
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.published_units import published_units
from causal_openlock.evidence.study import (
    CORRELATION,
    PUBLISHED,
    Contrast,
    Expected,
    Selection,
)
from causal_openlock.evidence.units import selected
from causal_openlock.schemas.fsm import FloatArray

Verdict = Literal["holds", "in part", "does not hold", "undecided"]
Ends = tuple[float, float]

EQUIVALENCE = 0.90
"""Level of the interval that must lie within both margins: two tests at 5%."""
LEVELS = (LEVEL, EQUIVALENCE)
NO_ENDS = (np.nan, np.nan)


@dataclass(frozen=True)
class Estimate:
    """A mean, or a difference of means, with what it rests on.

    Attributes:
        value: The estimate.
        intervals: By level, the ends of the interval that covers the true value with that
            probability; NaN where there is none.
        units: How many units each side has: one number where they are paired or compared with a
            known number.
        groups: What was compared; none of a correlation.
    """

    value: float
    intervals: Mapping[float, Ends]
    units: tuple[int, ...]
    groups: tuple[Group, ...] = ()

    @property
    def interval(self) -> Ends:
        """The ends of the 95% interval."""
        return self.intervals[LEVEL]

    @property
    def n(self) -> str:
        """Number of units on each side, in words."""
        return " and ".join(map(str, self.units))

    @property
    def alike(self) -> str:
        """How many units of each side have its most common value, where there is no interval."""
        told = [
            beside_mean(*NO_ENDS, group.size, *mode(group.values))
            for group in self.groups
            if group.values is not None
        ]
        return " and ".join(filter(None, told)) or "no interval: fewer than five units"

    def beyond(self, margin: float, alpha: float = ALPHA) -> int:
        """Which side of a margin the difference lies on by an exact test: 1 above, −1 below, or 0.

        A difference of exactly the margin counts as above it.
        """
        first, *others = self.groups
        assert first.values is not None
        exactly = 1e-9 if margin > 0 else -1e-9 if margin < 0 else 0.0
        values = first.values - margin + exactly
        found = weighted_difference([Group.of(values, first.weight), *others])
        side = found.value if others else np.median(values)  # of pairs the test counts signs
        return int(np.sign(side)) if found.p < alpha else 0


def estimate(groups: Sequence[Group], units: tuple[int, ...]) -> Estimate:
    """The sum of the weighted means of groups, with its intervals."""
    by_level = {level: weighted_difference(groups, level=level) for level in LEVELS}
    ends = {level: (found.low, found.high) for level, found in by_level.items()}
    return Estimate(by_level[LEVEL].value, ends, units, tuple(groups))


def mean_of(values: FloatArray, known: float = 0.0) -> Estimate:
    """The mean of ``[n]`` units, from a known number on.

    >>> low, high = mean_of(np.array([3.0, 4, 5, 4, 4])).interval
    >>> round(low, 2), round(high, 2)
    (3.12, 4.88)
    """
    found = estimate([Group.of(values - known)], (len(values),))
    if len(values) < LEAST_UNITS or not np.isin(values, (0.0, 1.0)).all():
        return found
    share = float(np.mean(values))  # of units that did it
    ends = {}
    for level in LEVELS:
        low, high = share_interval(share, len(values), level)
        ends[level] = float(low) - known, float(high) - known
    return Estimate(share - known, ends, found.units, found.groups)


def difference(of: FloatArray, minus: FloatArray) -> Estimate:
    """The difference of the means of two independent groups of units."""
    return estimate([Group.of(of), Group.of(minus, -1.0)], (len(of), len(minus)))


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
    if len(rows) < LEAST_UNITS:
        raise EvidenceError(f"{selection.parameter} was recovered of too few sets")
    if np.ptp(values, axis=1).min() == 0:
        raise EvidenceError(f"{selection.parameter} comes out the same, whatever made subjects")
    found = stats.pearsonr(*values)
    ends = {level: found.confidence_interval(level) for level in (LEVEL, EQUIVALENCE)}
    intervals = {level: (float(one.low), float(one.high)) for level, one in ends.items()}
    return Estimate(float(found.statistic), intervals, (len(rows),))


def of_side(
    units: pd.DataFrame, selection: Selection, measure: str
) -> tuple[Estimate, FloatArray | None]:
    """The mean of a selection and its units; for ``r`` the correlation, which is not a mean.

    Raises:
        EvidenceError: If it has not been run.
    """
    if measure == CORRELATION:
        return correlation(units, selection), None
    values = selected(units, selection, measure).to_numpy(float)
    return mean_of(values), values


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
    known, measure = contrast.minus, contrast.measure
    if measure == CORRELATION:
        assert not isinstance(known, Selection)
        found = correlation(units, contrast.of)
        by_level = found.intervals.items()
        ends = {level: (low - known, high - known) for level, (low, high) in by_level}
        return Estimate(found.value - known, ends, found.units)
    mine = selected(units, contrast.of, measure)
    of = mine.to_numpy(float)
    if not isinstance(known, Selection):
        return mean_of(of, known)
    if known.learner in PUBLISHED:
        there = published_units()
        mean = float(selected(there, known, measure).mean())
        if measure != "attempts":  # the error of shares is not known
            return mean_of(of, mean)
        error = float(selected(there, known, "error").mean())
        people = int(selected(there, known, "trials").mean())
        theirs = Group(people, mean, people * error**2, -1.0)
        return estimate([Group.of(of), theirs], (len(of),))
    minus = selected(units, known, measure)
    if not paired(contrast.of, known, unit, same or {}):
        return difference(of, minus.to_numpy(float))
    pairs = (mine - minus).dropna()
    if pairs.empty:
        raise EvidenceError("no unit has been run on both sides")
    return mean_of(pairs.to_numpy(float))


def paired(one: Selection, other: Selection, unit: str, same: Mapping[str, str]) -> bool:
    """Whether two selections are of the same units."""
    if unit == "network":
        names = (same.get(side.learner, side.learner) for side in (one, other))
        return len(set(names)) == 1
    return one.condition == other.condition


def verdict(found: Estimate, expected: Expected, smallest: float) -> Verdict:
    """Verdict that follows from an estimate.

    >>> found = mean_of(np.array(10 * [2.0, 3.0]))
    >>> verdict(found, "more", smallest=1), verdict(found, "less", smallest=1)
    ('holds', 'does not hold')
    """
    low, high = found.interval
    if np.isnan(low):
        few = min(found.units) < LEAST_UNITS or not found.groups
        return "undecided" if few else _exactly(found, expected, smallest)
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


def _exactly(found: Estimate, expected: Expected, smallest: float) -> Verdict:
    """Verdict by exact tests, where units are so alike that there is no interval."""
    if expected == "same":
        within = found.beyond(smallest, 2 * ALPHA) < 0 < found.beyond(-smallest, 2 * ALPHA)
        if within:
            return "holds"
        outside = found.beyond(smallest) > 0 or found.beyond(-smallest) < 0
        return "does not hold" if outside else "undecided"
    sign = -1 if expected == "less" else 1
    side = sign * found.beyond(sign * smallest)
    if side:
        return "holds" if side > 0 else "does not hold"
    return "in part" if smallest and sign * found.beyond(0.0) > 0 else "undecided"


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
