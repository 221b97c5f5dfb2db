"""Thompson sampling: draw a hypothesis from the posterior and carry out a solution of it.

Each hypothesis is acted on with its posterior probability (probability matching), so a subject
explores exactly as much as it is uncertain. The result is a plan for an attempt: levers to push,
one after another, and then the door. The alternative without weights draws any solution that some
hypothesis still allows.
"""

from __future__ import annotations

import numpy as np

from causal_openlock.belief.hypotheses import Hypotheses
from causal_openlock.belief.planning import Situation, achievable
from causal_openlock.world.fsm import BoolArray, FloatArray
from causal_openlock.world.randomness import pick


def sample_solution(
    hypotheses: Hypotheses,
    weight: FloatArray,
    situation: Situation,
    draws: tuple[float, float],
    by_weight: bool,
) -> tuple[int, ...] | None:
    """Levers to push for a new solution that some hypothesis allows.

    Args:
        hypotheses: ``[h]`` the possible hypotheses.
        weight: ``[h]`` their probabilities.
        situation: Where the attempt stands.
        draws: Two uniform numbers in [0, 1).
        by_weight: Whether to draw a hypothesis by its probability and then one of its solutions
            (Thompson), or uniformly any solution that some hypothesis allows.

    Returns:
        Slots in an order that works; None if no hypothesis has a solution left to find.
    """
    possible = (weight > 0)[:, None]
    found = situation.found
    fitting = achievable(hypotheses, situation.pushed, situation.left, found) & possible
    if not fitting.any():
        # No solution can be completed in this attempt any more; begin one all the same.
        fitting = achievable(hypotheses, 0, hypotheses.causes.shape[1] + 1, found) & possible
        if not fitting.any():
            return None
    if by_weight:
        which = pick(weight * _any_of(fitting), draws[0])
        solution = int(hypotheses.solutions[which, pick(fitting[which] * 1.0, draws[1])])
    else:
        choices = np.unique(hypotheses.solutions[fitting])
        solution = int(choices[int(draws[0] * len(choices))])
        allows = _any_of(fitting & (hypotheses.solutions == solution))
        which = pick(weight * allows, draws[1])
    return _in_order(hypotheses, which, solution, situation.pushed)


def _any_of(table: BoolArray) -> BoolArray:
    """``[h]`` ``table.any(axis=1)``, faster for few columns."""
    found: BoolArray = np.logical_or.reduce(np.ascontiguousarray(table.T))
    return found


def _in_order(hypotheses: Hypotheses, which: int, solution: int, pushed: int) -> tuple[int, ...]:
    """The levers of a solution that are still to be pushed, causes before effects."""
    causes, threshold = hypotheses.causes[which], hypotheses.threshold[which]
    order: list[int] = []
    missing = {slot for slot in range(len(causes) - 1) if (solution & ~pushed) >> slot & 1}
    while missing:
        ready = [
            slot for slot in sorted(missing)
            if (int(causes[slot]) & pushed).bit_count() >= threshold[slot]
        ] or sorted(missing)  # fmt: skip
        order.append(ready[0])
        missing.discard(ready[0])
        pushed |= 1 << ready[0]
    return tuple(order)
