"""Verdicts by rule: what follows from an interval and the smallest difference that matters.

A contrast is a difference between two means over units, with a 95% interval of Student's t. It is
*paired* where both sides are of the same units: subjects of one condition, who meet the same rooms
whatever their learner, or one network under two conditions. Else it is Welch's. The sign is turned
so that the difference that a claim expects is positive. With the smallest difference that matters,
``m``:

============== ====================================== =========================================
verdict        of "more" or "less"                    of "the same"
============== ====================================== =========================================
holds          the interval lies above m              the 90% interval lies within -m to m
in part        it lies above 0, and reaches below m
does not hold  it lies below m                        the 95% interval lies outside -m to m
undecided      everything else, and fewer than two    everything else, and fewer than two
============== ====================================== =========================================

That the 90% interval lies within both margins is the two one-sided tests of equivalence at the 5%
level (Schuirmann, 1987). A claim of several contrasts holds if all of them do, which needs no
correction (each must pass its own test); it does not hold if none does, and is undecided as long as
one of those that matter is.

Where all units are equal Student's interval has no width, though the next unit may differ. Of
shares, the interval then covers what so many draws can miss: with n units a fraction of up to
``1 - 0.025 ** (1 / n)`` (Clopper and Pearson, 1934).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy import stats

from causal_openlock.evidence.published import PUBLISHED, published_units
from causal_openlock.evidence.study import Contrast, Expected, Selection
from causal_openlock.evidence.units import selected
from causal_openlock.world.fsm import FloatArray

Verdict = Literal["holds", "in part", "does not hold", "undecided"]

ALPHA = 0.05


@dataclass(frozen=True)
class Estimate:
    """A mean, or a difference of means, with what it rests on.

    Attributes:
        value: The estimate.
        error: Its standard error; NaN with fewer than two units.
        freedom: Degrees of freedom.
        units: How many units each side has: one number where they are paired or compared with a
            known number.
        slack: What is added to each side of an interval where all units of a share are equal.
    """

    value: float
    error: float
    freedom: float
    units: tuple[int, ...]
    slack: float = 0.0

    def interval(self, level: float = 1 - ALPHA) -> tuple[float, float]:
        """The interval that covers the true value with a probability of ``level``."""
        half = self.slack
        if self.error > 0:
            half += float(stats.t.ppf((1 + level) / 2, self.freedom)) * self.error
        elif np.isnan(self.error):
            half = np.nan
        return self.value - half, self.value + half


def mean_of(values: FloatArray, share: bool = False) -> Estimate:
    """The mean of some units.

    >>> low, high = mean_of(np.array([3.0, 4, 5, 4])).interval()
    >>> round(low, 2), round(high, 2)
    (2.7, 5.3)

    Args:
        values: ``[n]``, one for each unit.
        share: Whether they are shares, between 0 and 1.
    """
    n = len(values)
    error = float(np.std(values, ddof=1) / np.sqrt(n)) if n > 1 else np.nan
    equal = n > 1 and np.ptp(values) < 1e-12
    slack = 1 - (ALPHA / 2) ** (1 / n) if share and equal else 0.0
    return Estimate(float(np.mean(values)), 0.0 if equal else error, n - 1, (n,), slack)


def difference(of: FloatArray, minus: FloatArray, share: bool = False) -> Estimate:
    """The difference of the means of two independent groups of units (Welch, 1947)."""
    one, two = mean_of(of, share), mean_of(minus, share)
    squares = np.array([one.error**2, two.error**2])
    freedoms = np.array([one.freedom, two.freedom])
    total = float(squares.sum())
    freedom = 1.0
    if total > 0:
        freedom = total**2 / float((squares**2 / np.maximum(freedoms, 1)).sum())
    return Estimate(
        one.value - two.value,
        float(np.sqrt(total)),
        freedom,
        (*one.units, *two.units),
        max(one.slack, two.slack),
    )


def from_known(found: Estimate, known: float, error: float = 0.0) -> Estimate:
    """The difference to a known number, or to a published mean with its standard error."""
    both = float(np.hypot(found.error, error))
    freedom = found.freedom
    if both > 0:
        # People's error bars are of forty subjects.
        each = found.error**4 / max(found.freedom, 1) + error**4 / 39
        freedom = both**4 / each
    return replace(found, value=found.value - known, error=both, freedom=freedom)


def estimate(units: pd.DataFrame, contrast: Contrast, unit: str) -> Estimate:
    """The difference that a contrast asks for.

    Args:
        units: From :mod:`~causal_openlock.evidence.units`.
        contrast: What is compared.
        unit: ``"subject"`` or ``"network"``.

    Raises:
        EvidenceError: If a side has not been run.
    """
    share = contrast.measure != "attempts"
    of = selected(units, contrast.of, contrast.measure)
    known = contrast.minus
    if not isinstance(known, Selection):
        return from_known(mean_of(of.to_numpy(float), share), known)
    if known.learner in PUBLISHED:
        means = published_units()
        number = float(selected(means, known, contrast.measure).mean())
        error = float(selected(means, known, "error").mean())
        return from_known(mean_of(of.to_numpy(float), share), number, np.nan_to_num(error))
    minus = selected(units, known, contrast.measure)
    if paired(contrast.of, known, unit):
        together = of.index.intersection(minus.index)
        return mean_of((of[together] - minus[together]).to_numpy(float), share)
    return difference(of.to_numpy(float), minus.to_numpy(float), share)


def paired(one: Selection, other: Selection, unit: str) -> bool:
    """Whether two selections are of the same units."""
    if unit == "network":
        return one.learner == other.learner
    return one.condition == other.condition


def verdict(found: Estimate, expected: Expected, smallest: float) -> Verdict:
    """What follows from an estimate.

    >>> found = mean_of(np.array([2.0, 3, 2, 3]))
    >>> verdict(found, "more", smallest=1), verdict(found, "less", smallest=1)
    ('holds', 'does not hold')
    """
    if min(found.units) < 2 or np.isnan(found.error):
        return "undecided"
    low, high = found.interval()
    if expected == "same":
        inner = found.interval(1 - 2 * ALPHA)
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
    """The verdict on a claim from those on its contrasts.

    >>> together(["holds", "holds"]), together(["holds", "does not hold"])
    ('holds', 'in part')
    """
    found = set(verdicts)
    if len(found) == 1:
        return found.pop()
    return "undecided" if "undecided" in found else "in part"


def as_row(found: Estimate) -> dict[str, Any]:
    """An estimate as columns of a table."""
    low, high = found.interval()
    return {
        "effect": found.value,
        "ci_low": low,
        "ci_high": high,
        "n": " and ".join(map(str, found.units)),
    }
