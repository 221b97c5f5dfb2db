"""Power: from how many units on a study can decide its claims.

A margin can be decided where the interval reaches no farther, to either side, than the margin: a
true difference of nothing is then told from one of twice the margin. A claim from a bound has no
margin; there it is the difference that was seen. How wide an interval of other numbers of units is
follows from :mod:`~causal_openlock.evidence.verdicts` and from how much units differ. That is
measured as soon as there are three of them; before, a contrast may state it, from a pilot.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable

import numpy as np

from causal_openlock.evidence.study import ATTEMPTS, Contrast, Selection, Study
from causal_openlock.evidence.units import Selected
from causal_openlock.evidence.verdicts import EQUIVALENCE, LEAST, LEVEL, Estimate, mean_of

MOST = 100_000
"""Units beyond which no number is sought."""


def decides_at(found: Callable[[float], Estimate], contrast: Contrast) -> int | None:
    """The least number of units, on each side, that can decide a contrast.

    Args:
        found: From :func:`~causal_openlock.evidence.verdicts.compared`, or :func:`as_stated`.
        contrast: What is compared.

    Returns:
        The number; None if fewer than three units are known, or it is above :data:`MOST`.

    >>> of = Selection(learner="bayes", condition="CC4")
    >>> asked = Contrast(measure="solved", of=of, minus=0.9, expected="same", smallest=0.1)
    >>> decides_at(lambda times: mean_of(Selected(np.ones(10)), times), asked)
    29
    """
    now = found(1.0)
    margin = contrast.smallest or abs(now.value)
    level = EQUIVALENCE if contrast.expected == "same" else LEVEL
    size = min(now.units)

    def decides(units: int) -> bool:
        low, high = found(units / size).intervals[level]
        return max(now.value - low, high - now.value) <= margin

    if math.isnan(now.interval[0]) or not decides(MOST):
        return None
    return LEAST + bisect_left(range(LEAST, MOST), True, key=decides)


def as_stated(contrast: Contrast, study: Study) -> Callable[[float], Estimate] | None:
    """No difference, of units that differ as the contrast states; None if it does not."""
    if contrast.spread is None or study.file.published:
        return None
    limit = max(protocol.attempt_limit for protocol in study.asked.protocols)
    reach = limit - 1.0 if contrast.measure in ATTEMPTS else 1.0
    pilot = Selected(contrast.spread * np.array([-1.0, 0.0, 1.0]), least=-reach, most=reach)
    return lambda times: mean_of(pilot, times)


def planned(study: Study, contrast: Contrast) -> int:
    """The number of units that a study asks for on the smaller side of a contrast."""
    if study.file.networks:
        return len(study.file.networks.seeds)
    sides = [side for side in (contrast.of, contrast.minus) if isinstance(side, Selection)]
    sizes = [
        sum(
            cell.subjects
            for cell in study.asked.cells()
            if cell.spec.name == side.learner and cell.condition.name == side.condition
        )
        for side in sides
    ]
    return min((size for size in sizes if size), default=0)  # 0 of a learner that is not played
