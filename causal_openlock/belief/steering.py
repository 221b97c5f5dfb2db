"""Structures that keep the console's promise, where hardly any draw does: found by small changes.

Of a thousand structures drawn for twelve levers, two have the eight solutions that the console
promises. Instead of drawing on, the draws that come nearest are changed, one gate at a time or two
neighbours in the order of the levers, by the Metropolis rule: a gate is proposed as the evidence
has it, and accepted surely if it brings the structure nearer to the promise, rarely if farther
away. How far away it is counts as ``exp(-PULL * distance)``, the same for all that keep the
promise: in the long run these come up as probable as they are. The runs are short.

All chains take the same counted steps: what comes out does not depend on the speed of the machine.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from causal_openlock.belief.catalogue import distance
from causal_openlock.belief.structures import Structures
from causal_openlock.world.fsm import IntArray

PULL = 1.5
"""What a solution too many or too few costs, in nats."""
LOOKS = 8
"""How often, in the second half of the steps, those that keep the promise are taken."""


def steered(
    guess: Callable[[IntArray, np.random.Generator], tuple[IntArray, IntArray]],
    start: Structures,
    order: IntArray,
    promise: tuple[int, int],
    steps: int,
    generator: np.random.Generator,
) -> Structures:
    """Structures that keep the promise, reached from others in so many steps.

    Args:
        guess: Draws causes and threshold of a gate for each of some nodes, as the evidence has it.
        start: ``[D]`` where the chains begin.
        order: ``[D, n]`` the levers of each, causes before effects.
        promise: Solutions, and the actions of an attempt that each has to fit into.
        steps: Steps that each chain takes.
        generator: Draws.
    """
    n, rows = start.levers, np.arange(len(start))
    now, order = Structures(start.causes.copy(), start.threshold.copy()), order.copy()
    away = distance(now, *promise)
    taken = [now[:0]]
    looks = {steps - 1 - look * steps // (2 * LOOKS) for look in range(LOOKS)}
    for step in range(steps):
        place = generator.integers(n + 1, size=len(rows))
        swap = generator.integers(n - 1, size=len(rows))
        of_door = place == n
        at = np.minimum(place, n - 1)
        bits = np.left_shift(1, order)
        before = np.where(of_door, (1 << n) - 1, (bits.cumsum(axis=1) - bits)[rows, at])
        node = np.where(of_door, n, order[rows, at])
        causes, threshold = guess(node, generator)
        able = np.flatnonzero(causes & ~before == 0)
        changed = now[able]
        changed.causes[np.arange(len(able)), node[able]] = causes[able]
        changed.threshold[np.arange(len(able)), node[able]] = threshold[able]
        then = distance(changed, *promise)
        farther = np.maximum(then - away[able], 0)
        accepted = generator.random(len(able)) < np.exp(-PULL * farther)
        who = able[accepted]
        now.causes[who], now.threshold[who] = changed.causes[accepted], changed.threshold[accepted]
        away[who] = then[accepted]

        first, second = order[rows, swap], order[rows, swap + 1]
        free = np.flatnonzero(now.causes[rows, second] >> first.astype(np.uint16) & 1 == 0)
        order[free, swap[free]], order[free, swap[free] + 1] = second[free], first[free]
        if step in looks:
            taken.append(now[away == 0])
    return Structures.joined(taken)
