"""Markov chains to structures that have the solutions that the console shows.

Of a thousand structures drawn for twelve levers, two have the right number of solutions. Instead of
drawing on, the nearest draws are changed step by step by the Metropolis rule. A step proposes
another gate for one node, drawn from its posterior, and accepts it with probability

    min(1, exp(-PULL (d' - d)))

where d and d' are the distances before and after: solutions too many, too few or too long. It also
swaps two neighbours in the order of the levers. All structures at distance 0 have the same factor,
so in the long run they appear in proportion to their posterior probability; the chains are short.

All chains take a fixed number of steps, so the result does not depend on the machine's speed.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from causal_openlock.belief.catalogue import distance
from causal_openlock.belief.structures import Structures
from causal_openlock.world.fsm import IntArray

PULL = 1.5
"""Cost of each unit of distance, in nats."""
LOOKS = 8
"""How often, in the second half of the steps, the structures at distance 0 are collected."""


def metropolis(
    guess: Callable[[IntArray, np.random.Generator], tuple[IntArray, IntArray]],
    start: Structures,
    order: IntArray,
    required: tuple[int, int],
    steps: int,
    generator: np.random.Generator,
) -> Structures:
    """Structures at distance 0 that the chains reach.

    Args:
        guess: Draws causes and threshold of a gate for each of some nodes, from its posterior.
        start: ``[D]`` where the chains begin.
        order: ``[D, n]`` the levers of each, causes before effects.
        required: The number of solutions, and the action limit that each has to fit.
        steps: Steps of each chain.
        generator: Source of randomness.
    """
    n, rows = start.levers, np.arange(len(start))
    current, order = Structures(start.causes.copy(), start.threshold.copy()), order.copy()
    away = distance(current, *required)
    taken = [current[:0]]
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
        changed = current[able]
        changed.causes[np.arange(len(able)), node[able]] = causes[able]
        changed.threshold[np.arange(len(able)), node[able]] = threshold[able]
        then = distance(changed, *required)
        farther = np.maximum(then - away[able], 0)
        accepted = generator.random(len(able)) < np.exp(-PULL * farther)
        moved = able[accepted]
        current.causes[moved] = changed.causes[accepted]
        current.threshold[moved] = changed.threshold[accepted]
        away[moved] = then[accepted]

        first, second = order[rows, swap], order[rows, swap + 1]
        free = np.flatnonzero(current.causes[rows, second] >> first.astype(np.uint16) & 1 == 0)
        order[free, swap[free]], order[free, swap[free] + 1] = second[free], first[free]
        if step in looks:
            taken.append(current[away == 0])
    return Structures.joined(taken)
