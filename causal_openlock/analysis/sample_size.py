"""How many subjects a comparison of two means needs, before they are recruited or played.

Three numbers hang together in a t test: subjects, the difference of means and the power, which is
the probability that the test is significant if the difference is real. Two of them give the third.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Sequence
from numbers import Real
from typing import NamedTuple

import numpy as np

from causal_openlock.analysis.effects import ALPHA
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import whole_number

LEAST_ALPHA = 1e-12
POWER = 0.8  #: wanted probability of finding a difference that exists
MOST_SUBJECTS = 1_000_000  #: the largest group whose power is computed


class SampleSize(NamedTuple):
    """A planned t test: subjects in each group (or pairs), difference of means, power."""

    subjects: int
    difference: float
    power: float

    def __repr__(self) -> str:
        """Three digits of each number."""
        size = f"subjects={self.subjects}, difference={self.difference:.3g}"
        return f"SampleSize({size}, power={self.power:.2f})"


def sample_size(
    difference: float | None = None,
    *,
    sd: float | Sequence[float],
    subjects: int | None = None,
    power: float | None = None,
    alpha: float = ALPHA,
    paired: bool = False,
) -> SampleSize:
    """Return what is missing of subjects, difference and power of a two-sided t test.

    The paper has 40 people in each condition. With a standard deviation of 5 attempts that is
    enough to find, four times in five, a difference of 3.2 attempts; one of 2 needs 100 people:

    >>> sample_size(sd=5, subjects=40)
    SampleSize(subjects=40, difference=3.17, power=0.80)
    >>> sample_size(2, sd=5)
    SampleSize(subjects=100, difference=2, power=0.80)
    >>> sample_size(2, sd=5, subjects=40)
    SampleSize(subjects=40, difference=2, power=0.42)

    Args:
        difference: Difference of the means, in attempts or whatever ``sd`` is in; without it, the
            smallest that is found with this power is returned.
        sd: Standard deviation within a group, or values of a pilot study to take it from. Of
            paired subjects: that of the differences in pairs.
        subjects: In each group, or pairs; without it, the fewest with this power are returned.
        power: Wanted power, by default 0.8; with both ``difference`` and ``subjects`` it is what
            is returned.
        alpha: Significance level; divide it by the number of tests that are corrected together.
        paired: Whether subjects are compared in pairs, as learners that meet the same rooms are.

    Raises:
        OpenLockError: If numbers are missing or not possible, or more than a million are needed.
    """
    from scipy.optimize import brentq
    from scipy.special import nctdtr, stdtrit

    spread = _spread(sd)
    if difference is None and subjects is None:
        raise OpenLockError("give the difference that matters, or the number of subjects")
    if None not in (difference, subjects, power):
        raise OpenLockError("difference, subjects and power: give two, and the third is returned")
    distance = abs(difference) if isinstance(difference, Real) else difference
    for name, value, low, high in (
        ("sd", spread, 0, math.inf),
        ("alpha", alpha, LEAST_ALPHA, POWER if power is None else 1),
        ("power", power, alpha, 1),
        ("difference", distance, 0, math.inf),
    ):
        needed = value is not None or name == "alpha"
        if needed and not (isinstance(value, Real) and low < value < high):
            most = f" and less than {high:g}" if high < math.inf else ""
            raise OpenLockError(f"{name} has to be more than {low:g}{most}, not {value!r}")
    if subjects is not None:
        subjects = whole_number(subjects, "subjects", 2)
    wanted = POWER if power is None else power

    def power_at(distance: float, many: int) -> float:
        df = many - 1 if paired else 2 * many - 2
        away = abs(distance) / spread * np.sqrt(many if paired else many / 2)
        critical = stdtrit(df, 1 - alpha / 2)
        # SciPy has NaN for probabilities below 1e-15.
        below, above = np.nan_to_num(nctdtr(df, away, [critical, -critical]))
        return float(1 - below + above)

    if difference is None:
        assert subjects is not None
        known, high = subjects, spread
        while power_at(high, known) < wanted:
            high *= 2
        smallest = brentq(lambda distance: power_at(distance, known) - wanted, 0.0, high)
        return SampleSize(subjects, float(smallest), wanted)
    if subjects is None:
        sizes = range(2, MOST_SUBJECTS + 1)
        place = bisect_left(sizes, wanted, key=lambda size: power_at(difference, size))
        if place == len(sizes):
            raise OpenLockError(
                f"a difference of {difference:g} needs more than {MOST_SUBJECTS:,} subjects; ask "
                "for a larger one"
            )
        subjects = sizes[place]
    return SampleSize(subjects, difference, power_at(difference, subjects))


def _spread(sd: float | Sequence[float]) -> float:
    """A standard deviation, perhaps that of values."""
    try:
        values = np.asarray(sd, float).ravel()
    except (TypeError, ValueError):
        values = np.zeros(0)
    if len(values) < 2 and not isinstance(sd, Real):
        raise OpenLockError(f"sd is a number, or the values of two or more subjects, not {sd!r}")
    return float(values.std(ddof=1) if len(values) > 1 else values[0])
