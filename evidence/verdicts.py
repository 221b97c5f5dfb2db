"""Verdicts by rule: what follows from an interval and the smallest difference that matters.

The rules, and which intervals there are, are in ``evidence/README.md``. That the 90% interval lies
within both margins is the two one-sided tests of equivalence at the 5% level (Schuirmann, 1987). A
difference of exactly the margin matters.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy import stats

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.statistics import (
    LEAST_UNITS,
    LEVEL,
    beside_mean,
    mode,
    share_interval,
)
from causal_openlock.errors import EvidenceError
from causal_openlock.schemas.fsm import FloatArray
from evidence.published import PUBLISHED
from evidence.study import CORRELATION, Contrast, Networks, selection
from evidence.units import selected

Verdict = Literal["holds", "in part", "does not hold", "undecided"]
Ends = tuple[float, float]

EQUIVALENCE = 0.90
"""Level of the interval that must lie within both margins: two tests at 5%."""


@dataclass(frozen=True)
class Estimate:
    """A mean, or a difference of means, with what it rests on."""

    value: float
    ends: Callable[[float], Ends]  #: of the interval of a level; NaN where there is none
    units: tuple[int, ...]  #: of each side, one number for pairs and beside a known number
    groups: tuple[Group, ...] = ()  #: what was compared; none of a share or a correlation

    @property
    def interval(self) -> Ends:
        """The ends of the 95% interval."""
        return self.ends(LEVEL)

    @property
    def n(self) -> str:
        """Number of units on each side, in words."""
        return " and ".join(map(str, self.units))

    @property
    def alike(self) -> str:
        """How many units of each side have its most common value, where there is no interval."""
        values = [group.values for group in self.groups if len(group.values)]
        shares = [beside_mean(np.nan, np.nan, len(side), *mode(side)) for side in values]
        return " and ".join(filter(None, shares)) or "no interval: fewer than five units"

    def side(self, margin: float, level: float = LEVEL) -> int:
        """On which side of a margin the difference lies: 1 above, −1 below, or 0 if it may be both.

        A difference of exactly the margin lies beyond it, as seen from 0.
        """
        edge = margin - 1e-9 * np.sign(margin)
        low, high = self.ends(level)
        if not np.isnan(low):
            return int(low > edge) - int(high < edge)
        first, *others = self.groups
        values = first.values - edge
        found = weighted_difference([Group.of(values, first.weight), *others])
        side = found.value if others else np.median(values)  # of pairs the test counts signs
        return int(np.sign(side)) if found.p < 1 - level else 0


def estimate(*groups: Group) -> Estimate:
    """The sum of the weighted means of groups, with its intervals; published ones have no units."""

    def ends(level: float) -> Ends:
        return weighted_difference(groups, level=level)[1:3]

    units = tuple(group.size for group in groups if len(group.values))
    return Estimate(weighted_difference(groups).value, ends, units, groups)


def mean_of(values: FloatArray, known: float = 0.0) -> Estimate:
    """The mean of ``[n]`` units, from a known number on.

    >>> low, high = mean_of(np.array([3.0, 4, 5, 4, 4])).interval
    >>> round(low, 2), round(high, 2)
    (3.12, 4.88)
    """
    if len(values) < LEAST_UNITS or not np.isin(values, (0.0, 1.0)).all():
        return estimate(Group.of(values - known))
    share, size = float(np.mean(values)), len(values)  # of units that did it
    return _from(known, share, lambda level: share_interval(share, size, level), size)


def _from(known: float, value: float, of: Callable[[float], Any], units: int) -> Estimate:
    """An estimate from a known number on."""

    def ends(level: float) -> Ends:
        low, high = of(level)
        return float(low) - known, float(high) - known

    return Estimate(value - known, ends, (units,))


def mean_selected(units: pd.DataFrame, words: str, measure: str, known: float = 0.0) -> Estimate:
    """The mean of a selection from a known number on; for ``r`` a correlation over sets.

    Raises:
        EvidenceError: If it has not been run, or is a correlation of too few sets.
    """
    if measure != CORRELATION:
        return mean_of(selected(units, words, measure).to_numpy(float), known)
    true, fitted = (selected(units, words, name) for name in ("true", "fitted"))
    if len(true) < LEAST_UNITS or min(np.ptp(true), np.ptp(fitted)) == 0:
        raise EvidenceError(f"{words} was recovered of too few sets, or comes out always the same")
    found = stats.pearsonr(true, fitted)
    return _from(known, float(found.statistic), found.confidence_interval, len(true))


def compared(units: pd.DataFrame, contrast: Contrast, networks: Networks | None) -> Estimate:
    """The difference that a contrast asks for; with ``networks`` these are the units.

    Raises:
        EvidenceError: If a side has not been run.
    """
    side, measure = contrast.minus, contrast.measure
    if not isinstance(side, str):
        return mean_selected(units, contrast.of, measure, side)
    first, second = (selected(units, words, measure) for words in (contrast.of, side))
    of, minus = first.to_numpy(float), second.to_numpy(float)
    one, other = selection(contrast.of), selection(side)
    (learner,) = other["learner"]
    if learner in PUBLISHED:
        if measure != "attempts":  # the error of shares is not known
            return mean_of(of, float(minus.mean()))
        bar, size = (selected(units, side, name).mean() for name in ("se", "subjects"))
        people = Group.published(float(minus.mean()), float(bar), int(size))._replace(weight=-1.0)
        return estimate(Group.of(of), people)
    if networks:
        paired = networks.played_by(one["learner"][0]) == networks.played_by(learner)
    else:
        paired = one.get("condition") == other.get("condition")
    if not paired:
        return estimate(Group.of(of), Group.of(minus, -1.0))
    pairs = (first - second).dropna()
    if pairs.empty:
        raise EvidenceError("no unit has been run on both sides")
    return mean_of(pairs.to_numpy(float))


def verdict(found: Estimate, expected: str, smallest: float) -> Verdict:
    """Verdict that follows from an estimate.

    >>> found = mean_of(np.array(10 * [2.0, 3.0]))
    >>> verdict(found, "more", smallest=1), verdict(found, "less", smallest=1)
    ('holds', 'does not hold')
    """
    if min(found.units) < LEAST_UNITS:
        return "undecided"
    if expected == "same":
        if found.side(smallest, EQUIVALENCE) < 0 < found.side(-smallest, EQUIVALENCE):
            return "holds"
        outside = found.side(smallest) > 0 or found.side(-smallest) < 0
        return "does not hold" if outside else "undecided"
    sign = -1 if expected == "less" else 1
    if side := sign * found.side(sign * smallest):
        return "holds" if side > 0 else "does not hold"
    return "in part" if sign * found.side(0.0) > 0 else "undecided"


def together(verdicts: Iterable[Verdict]) -> Verdict:
    """The verdict on a claim from those on its contrasts, each of which can refute it.

    >>> mixed: list[Verdict] = ["holds", "does not hold"]
    >>> together(mixed)
    'does not hold'
    """
    found = list(verdicts)
    first: tuple[Verdict, ...] = ("does not hold", "undecided", "in part", "holds")
    return next((said for said in first if said in found), "undecided")
