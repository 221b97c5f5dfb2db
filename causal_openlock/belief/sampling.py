"""Structures of the free form, sampled from their posterior where there are too many to list.

Five levers have seventeen million gate-DAGs, seven more than 10^12. But given an order of the
levers, the gates are independent, in the prior (each lever chooses its causes among the levers
before it) and in the posterior: a push is evidence about the gate of that lever, and the lock about
the gate of the door. With W(i, S) the summed weight of the gates of lever i whose causes lie in S,
the weight of all orders in which exactly the levers of S come first is

    ways(S) = sum over i in S of ways(S - {i}) W(i, S - {i})

so exact, independent draws need no Markov chain: first an order, last lever first, then each
lever's gate (dynamic programming over orders, as for Bayesian networks by Friedman and Koller,
2003, and Koivisto and Sood, 2004).

The number of solutions that the console shows does not factorise: draws with another number are
rejected, and the share that is kept estimates the probability of that number. Where hardly any draw
fits, :func:`metropolis` takes over.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from causal_openlock.belief.catalogue import Catalogue, distance, gate_weight
from causal_openlock.belief.grammar import schema_classes
from causal_openlock.belief.hypotheses import RoomSight, at_least
from causal_openlock.belief.likelihoods import DOOR, Event
from causal_openlock.belief.structures import Structures, merge
from causal_openlock.schemas.fsm import FloatArray, IntArray

ROUNDS = 12
DRAWS = 4000
BATCH = 1000
EFFORT = 8_000
"""Structures looked at, at most, each time that hypotheses are sampled for many levers."""
CHAINS = 80
"""Markov chains, where too few draws have the right number of solutions."""
MANY_LEVERS = 8
"""Levers from which on few draws have the right number of solutions."""
PULL = 1.5
"""Cost of each unit of distance in a Markov chain, in nats."""
LOOKS = 8
"""Times that structures at distance 0 are collected, in the second half of the steps."""


class Sampler:
    """Draws structures of the free form on n active levers from their posterior.

    ``strength`` is the probability that a pushed cause transmits. Of the ``events`` of the trial,
    only what concerns single gates counts here, which leaves out solutions.
    """

    def __init__(
        self, levers: int, simplicity: float, strength: float, events: Sequence[Event] = ()
    ) -> None:
        self.levers = levers
        self._chance, self._events = at_least(strength), events
        sets = np.arange(1 << levers)
        prior, prior_of_all = _prior(levers, simplicity)
        weights = prior.copy()
        # Grey levers come first; the door, -1, is the last node.
        for slot, pushed, took_effect, unlocked, *_ in events:
            after = pushed ^ (took_effect << slot) if slot != DOOR else pushed
            if slot >= levers:  # white levers have no gate, and never move
                weights[levers] *= not took_effect
            else:
                works = self._chance[np.bitwise_count(sets & pushed), : levers + 1]
                weights[slot] *= works if took_effect else 1.0 - works
            pushed_causes = np.bitwise_count(sets & after)[:, None]
            weights[levers] *= (pushed_causes >= np.arange(levers + 1)) == unlocked
        self._gates = weights.cumsum(axis=2)
        self._ladders = weights.reshape(levers + 1, -1).cumsum(axis=1)
        self._sums, self._ways = _orders(weights)
        possible = float(self._ways[-1] * weights[levers, prior[levers] > 0].sum())
        self.evidence = possible / prior_of_all  #: probability of the events in the free form

    def draw(self, number: int, generator: np.random.Generator) -> tuple[Structures, IntArray]:
        """Independent structures, none if nothing is possible, and their orders ``[D, n]``."""
        n, levers = self.levers, np.arange(self.levers)
        number = number if self.evidence > 0 else 0
        order = np.zeros((number, n), dtype=np.int64)
        causes = np.zeros((number, n + 1), dtype=np.uint16)
        threshold = np.zeros((number, n + 1), dtype=np.uint8)
        left = np.full(number, (1 << n) - 1)
        for before in reversed(range(n)):
            others = left[:, None] & ~np.left_shift(1, levers)
            is_left = left[:, None] >> levers & 1
            ladder = (is_left * self._ways[others] * self._sums[levers, others]).cumsum(axis=1)
            last = _pick(ladder, generator.random(number) * ladder[:, -1])
            left &= ~np.left_shift(1, last)
            order[:, before] = last
            by_lever = np.argsort(last, kind="stable")
            chosen = self._gates_of(last[by_lever], left[by_lever], before, generator)
            causes[by_lever, last[by_lever]], threshold[by_lever, last[by_lever]] = chosen
        causes[:, n], threshold[:, n] = self.guess(np.full(number, n), generator)
        return Structures(causes, threshold), order

    def guess(self, node: IntArray, generator: np.random.Generator) -> tuple[IntArray, IntArray]:
        """``[D]`` causes and threshold of a gate of each node, without regard to the order."""
        draws, gate = generator.random(len(node)), np.zeros(len(node), dtype=np.int64)
        for index in np.unique(node).tolist():
            rows, ladder = np.flatnonzero(node == index), self._ladders[index]
            below = np.minimum(draws[rows] * ladder[-1], np.nextafter(ladder[-1], 0.0))
            gate[rows] = np.searchsorted(ladder, below, side="right")
        return np.divmod(gate, self.levers + 1)

    def _gates_of(
        self, lever: IntArray, before: IntArray, size: int, generator: np.random.Generator
    ) -> tuple[IntArray, IntArray]:
        """``[D]`` causes and threshold of each lever, its causes among the ``size`` before it."""
        rows, subsets = np.arange(len(lever)), _subsets(before, size, self.levers)
        ladder = self._gates[lever[:, None], subsets, -1].cumsum(axis=1)
        draws = generator.random(len(lever)) * ladder[:, -1]
        at = _pick(ladder, draws)
        rest = draws - np.where(at > 0, ladder[rows, at - 1], 0.0)
        causes = subsets[rows, at]
        return causes, _pick(self._gates[lever, causes], rest)

    def likelihood(self, structures: Structures) -> FloatArray:
        """``[M]`` likelihood of the levers' movements; that of the lock is 1 for all draws."""
        result = np.ones(len(structures))
        for slot, pushed, took_effect, *_ in self._events:
            if slot < self.levers:
                live = np.bitwise_count(structures.causes[:, slot] & np.uint16(pushed))
                works = self._chance[live, structures.threshold[:, slot]]
                result *= works if took_effect else 1.0 - works
        return result


@lru_cache(maxsize=16)
def _prior(levers: int, simplicity: float) -> tuple[FloatArray, float]:
    """``[n + 1, 2^n, n + 1]`` weight of each gate by node, causes, threshold; that of all orders.

    The last node is the door. Gates that a node cannot have weigh nothing.
    """
    causes, threshold = np.arange(1 << levers)[:, None], np.arange(levers + 1)
    size = np.bitwise_count(causes)
    exists = (threshold <= size) & ((threshold > 0) == (size > 0))
    weights = np.tile(exists * gate_weight(size, threshold, simplicity), (levers + 1, 1, 1))
    for lever in range(levers):
        weights[lever, causes[:, 0] >> lever & 1 == 1] = 0.0  # no lever enables itself
    door = weights[levers]
    door[0] = 0.0  # the door is never free
    return weights, float(_orders(weights)[1][-1] * door[door > 0].sum())


def _orders(weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Summed weights of gates and of orders, by sets of levers.

    Returns:
        ``[n, 2^n]`` of each lever's gates with causes among these levers, and ``[2^n]`` of the
        orders in which exactly these levers come first.
    """
    levers = len(weights) - 1
    every = np.arange(1 << levers)
    sums: FloatArray = weights[:levers].cumsum(axis=2)[..., -1]
    for other in range(levers):
        halves = sums.reshape(levers, -1, 2, 1 << other)
        halves[:, :, 1] += halves[:, :, 0]
    ways = np.zeros(len(every))
    ways[0] = 1.0
    for size in range(1, levers + 1):
        listed = every[np.bitwise_count(every) == size]
        for lever in range(levers):
            having = listed[listed >> lever & 1 == 1]
            before = having ^ 1 << lever
            ways[having] += ways[before] * sums[lever, before]
    return sums, ways


def _subsets(sets: IntArray, size: int, levers: int) -> IntArray:
    """``[D, 2^size]`` every subset of each of D sets of ``size`` levers, in ascending order."""
    held = np.nonzero(sets[:, None] >> np.arange(levers) & 1)[1].reshape(len(sets), size)
    subsets = np.zeros((len(sets), 1), dtype=np.int64)
    for column in held.T:
        subsets = np.concatenate([subsets, subsets | np.left_shift(1, column)[:, None]], axis=1)
    return subsets


def _pick(ladder: FloatArray, value: FloatArray) -> IntArray:
    """``[D]`` the first step of each row of cumulative weights, ``[D, N]``, above a value."""
    below = np.minimum(value, np.nextafter(ladder[:, -1], 0.0))
    above: IntArray = (ladder <= below[:, None]).sum(axis=1)
    return above


def sampled(
    sampler: Sampler, sight: RoomSight, wanted: int, generator: np.random.Generator
) -> Catalogue:
    """A catalogue of sampled structures that have the solutions that the console shows.

    Structures are drawn from the posterior until ``wanted`` of them are accepted, and carry
    estimated prior probabilities (importance weights). From eight levers on, at most
    :data:`EFFORT` structures are looked at: a quarter drawn, the rest by :func:`metropolis`.
    """
    many = sampler.levers >= MANY_LEVERS
    most, batch = (EFFORT // 4, BATCH) if many else (ROUNDS * DRAWS, DRAWS)
    required = sight.solutions, sight.action_limit
    kept, draws = [], []
    accepted = tried = 0
    while accepted < wanted and tried < most:
        number, needed = min(batch, most - tried), wanted - accepted
        drawn, order = sampler.draw(number, generator)
        away = distance(drawn, *required)
        fitting = drawn[away == 0]
        kept.append(fitting[:needed])
        if not len(drawn):
            break
        draws.append((drawn, order, away))
        # Of the last draws, only as many count as were needed.
        tried += number if len(fitting) <= needed else round(number * needed / len(fitting))
        accepted += len(kept[-1])
    worth: float = max(tried, 1)
    if many and tried and accepted < wanted:
        structures, orders, distances = zip(*draws, strict=True)
        nearest = np.argsort(np.concatenate(distances), kind="stable")[:CHAINS]
        start, order = Structures.joined(structures)[nearest], np.concatenate(orders)[nearest]
        steps = 3 * EFFORT // 4 // len(start) - 1
        kept.append(metropolis(sampler, start, order, required, steps, generator))
        worth = sum(map(len, kept)) * tried / max(accepted, 0.5)
    every = Structures.joined(kept)
    first, member = merge(every.labels())
    index, members = np.arange(len(first)), every[first]
    kind = np.full(len(first), len(schema_classes()))
    chance = np.bincount(member, minlength=len(first)) * sampler.evidence / worth
    return Catalogue(members, index, index, kind, chance / sampler.likelihood(members))


def metropolis(
    sampler: Sampler,
    start: Structures,
    order: IntArray,
    required: tuple[int, int],
    steps: int,
    generator: np.random.Generator,
) -> Structures:
    """Structures with the solutions that the console shows, by Markov chains.

    Of a thousand structures drawn for twelve levers, two have the right number of solutions. So the
    nearest draws are changed step by step: a step proposes another gate for one node, drawn from
    its posterior, and accepts it with probability

        min(1, exp(-PULL (d' - d)))

    where d and d' are the distances before and after: solutions too many, too few or too long. It
    also swaps two neighbours in the order of the levers. In the long run structures at distance 0
    appear in proportion to their posterior probability; the chains are short.

    ``order``, ``[D, n]``, has the levers of each ``start``, causes before effects; ``required`` are
    the number of solutions, and the action limit that each has to fit.
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
        causes, threshold = sampler.guess(node, generator)
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
