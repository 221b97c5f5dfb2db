"""Structures of the free form, drawn from their posterior where there are too many to list.

Five levers have seventeen million gate-DAGs, seven more than 10^12. But given an order of the
levers, each lever's gate is independent of the others', in the prior (it chooses its causes among
the levers before it) and in the posterior: an action tells about the gate of the lever that was
pushed, and the lock about the door's. So the evidence of an order is a product over the levers,
sums over all orders are a recursion over sets of levers, and exact, independent draws need no
Markov chain: first an order, last lever first, then each lever's gate (dynamic programming over
orders, as for Bayesian networks by Friedman and Koller, 2003, and Koivisto and Sood, 2004).

What does not factorise, the number of solutions that the console promises and which combinations it
counted, is for rejection: draws that do not fit it are thrown away, and how many were is the
probability of fitting.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from causal_openlock.belief.catalogue import Catalogue, fits, gate_weight
from causal_openlock.belief.evidence import DOOR
from causal_openlock.belief.grammar import schema_classes
from causal_openlock.belief.space import Block, Hypotheses, RoomSight, Space, placed
from causal_openlock.belief.strength import at_least
from causal_openlock.belief.structures import Counts, Masks, Structures, merge
from causal_openlock.fsm import FloatArray, IntArray

Happened = tuple[int, int, bool, bool]
"""What matters of an event to single gates: slot, pushed before, took effect, unlocked after."""
ROUNDS = 12
DRAWS = 4000


@dataclass(frozen=True, eq=False)
class Gates:
    """Every gate that one node can have; O of them.

    Attributes:
        causes: ``[O]`` as bit masks.
        threshold: ``[O]`` how many must be pushed.
        weight: ``[O]`` what the prior and the evidence say of it.
    """

    causes: IntArray
    threshold: IntArray
    weight: FloatArray

    @classmethod
    def of(cls, levers: int, node: int, simplicity: float) -> Gates:
        """All gates of a lever, or of the door if ``node`` is the number of levers."""
        options = [
            (mask, enough)
            for mask in range(1 << levers)
            if not mask >> node & 1
            for enough in range(1 if mask else 0, mask.bit_count() + 1)
            if mask or node < levers
        ]
        causes, threshold = np.array(options, dtype=np.int64).T
        weight = gate_weight(np.bitwise_count(causes), threshold, simplicity)
        return cls(causes, threshold, weight)

    def holding(self, pushed: int, chance: FloatArray) -> FloatArray:
        """``[O]`` probability that as many causes transmit as the gate asks for."""
        return chance[np.bitwise_count(self.causes & pushed), self.threshold]


class Sampler:
    """Draws structures of the free form, given what happened.

    Args:
        levers: Active levers, n.
        simplicity: As for :func:`~causal_openlock.belief.catalogue.gate_weight`.
        strength: How surely a pushed cause transmits.
        happened: The events of the trial, and how often each.
    """

    def __init__(
        self,
        levers: int,
        simplicity: float,
        strength: float,
        happened: Iterable[tuple[Happened, int]] = (),
    ) -> None:
        self.levers = levers
        chance, surely = at_least(strength), at_least(1.0)
        self._gates = [Gates.of(levers, node, simplicity) for node in range(levers + 1)]
        prior = self._orders([gates.weight for gates in self._gates])
        happened = tuple(happened)
        weights = [gates.weight.copy() for gates in self._gates]
        for (slot, pushed, took_effect, unlocked), times in happened:
            after = pushed ^ (took_effect << slot) if slot != DOOR else pushed
            node = self._node(slot)
            if node is None:  # white levers have no gate, and never move
                weights[levers] *= not took_effect
            else:
                works = self._gates[node].holding(pushed, chance)
                weights[node] *= (works if took_effect else 1.0 - works) ** times
            weights[levers] *= (self._gates[levers].holding(after, surely) > 0) == unlocked
        self._happened = happened
        self._chance = chance
        self._weights = weights
        self._sums = self._subset_sums(weights)
        self._ways = self._recursion(self._sums)
        self.evidence = self._total(self._ways, weights) / prior
        """Probability of what happened to single gates, in the free form."""

    def _node(self, slot: int) -> int | None:
        """Whose gate a push of a slot is up to; grey levers come first."""
        if slot == DOOR:
            return self.levers
        return slot if slot < self.levers else None

    def _orders(self, weights: list[FloatArray]) -> float:
        return self._total(self._recursion(self._subset_sums(weights)), weights)

    @staticmethod
    def _total(ways: FloatArray, weights: list[FloatArray]) -> float:
        return float(ways[-1] * weights[-1].sum())

    def _subset_sums(self, weights: list[FloatArray]) -> FloatArray:
        """``[n, 2^n]`` for each lever, the weight of all its gates with causes in a set."""
        sums = np.zeros((self.levers, 1 << self.levers))
        for lever in range(self.levers):
            gates = self._gates[lever]
            sums[lever] = np.bincount(gates.causes, weights[lever], minlength=sums.shape[1])
            for other in range(self.levers):
                halves = sums[lever].reshape(-1, 2, 1 << other)
                halves[:, 1] += halves[:, 0]
        return sums

    def _recursion(self, sums: FloatArray) -> FloatArray:
        """``[2^n]`` the weight of all orders in which exactly these levers come first."""
        ways = np.zeros(1 << self.levers)
        ways[0] = 1.0
        for listed in range(1, 1 << self.levers):
            for lever in range(self.levers):
                if listed >> lever & 1:
                    before = listed ^ 1 << lever
                    ways[listed] += ways[before] * sums[lever, before]
        return ways

    def draw(self, number: int, generator: np.random.Generator) -> Structures:
        """So many structures, independent of one another; none if nothing is possible."""
        n = self.levers
        causes = np.zeros((number, n + 1), dtype=np.uint16)
        threshold = np.zeros((number, n + 1), dtype=np.uint8)
        if not self.evidence > 0:
            return Structures(causes[:0], threshold[:0])
        left = np.full(number, (1 << n) - 1)
        for _ in range(n):
            ladder = np.empty((number, n))
            for lever in range(n):
                before = left & ~(1 << lever)
                is_left = left >> lever & 1
                ladder[:, lever] = is_left * self._ways[before] * self._sums[lever, before]
            last = _pick(ladder.cumsum(axis=1), generator.random(number))
            left &= ~np.left_shift(1, last)
            for lever in range(n):
                self._choose(
                    lever, np.flatnonzero(last == lever), left, generator, causes, threshold
                )
        everyone = np.arange(number)
        self._choose(n, everyone, np.full(number, (1 << n) - 1), generator, causes, threshold)
        return Structures(causes, threshold)

    def likelihood(self, structures: Structures) -> FloatArray:
        """``[M]`` probability of what happened to single gates, but for the lock: it is certain."""
        result = np.ones(len(structures))
        for (slot, pushed, took_effect, _), times in self._happened:
            node = self._node(slot)
            if node is not None:
                live = np.bitwise_count(structures.causes[:, node] & np.uint16(pushed))
                works = self._chance[live, structures.threshold[:, node]]
                result *= (works if took_effect else 1.0 - works) ** times
        return result

    def _choose(
        self,
        node: int,
        who: IntArray,
        before: IntArray,
        generator: np.random.Generator,
        causes: Masks,
        threshold: Counts,
    ) -> None:
        """A gate of a node for some of the draws, its causes among the levers before it."""
        gates = self._gates[node]
        draws = generator.random(len(who))
        for allowed in np.unique(before[who]):
            mine = before[who] == allowed
            options = np.flatnonzero(gates.causes & ~allowed == 0)
            ladder = self._weights[node][options].cumsum()
            hit = options[_pick(ladder[None], draws[mine])]
            causes[who[mine], node] = gates.causes[hit]
            threshold[who[mine], node] = gates.threshold[hit]


def _pick(ladder: FloatArray, draws: FloatArray) -> IntArray:
    """One index for each draw, as probable as its step on the ladder is high."""
    if len(ladder) == 1:
        at = np.searchsorted(ladder[0], draws * ladder[0, -1], side="right")
        return np.minimum(at, ladder.shape[1] - 1)
    at = (ladder <= (draws * ladder[:, -1])[:, None]).sum(axis=1)
    return np.minimum(at, ladder.shape[1] - 1)


def sampled(
    sampler: Sampler, sight: RoomSight, wanted: int, generator: np.random.Generator
) -> Catalogue:
    """A catalogue of structures of the free form that fit what the console promises.

    Structures are drawn from the posterior, and their chances are those of the prior: weighted by
    the likelihood of what happened, they estimate the posterior, and their sum its evidence.

    Args:
        sampler: Draws structures.
        sight: What the room looks like.
        wanted: How many draws to accept.
        generator: Draws.
    """
    # Solutions are found set by set, which takes long with many levers.
    draws = max(50, DRAWS >> max(0, sampler.levers - 7))
    kept: list[Structures] = []
    accepted = tried = 0
    while accepted < wanted and tried < ROUNDS * draws:
        drawn = sampler.draw(draws, generator)
        if not len(drawn):
            break
        drawn = drawn[fits(drawn, sight.solutions, sight.action_limit)]
        kept.append(drawn[: wanted - accepted])
        tried += (
            draws
            if accepted + len(drawn) <= wanted
            else round(draws * (wanted - accepted) / len(drawn))
        )
        accepted += len(kept[-1])
    levers = sampler.levers
    empty = Structures(
        np.zeros((0, levers + 1), dtype=np.uint16), np.zeros((0, levers + 1), dtype=np.uint8)
    )
    everything = [empty, *kept]
    causes = np.concatenate([part.causes for part in everything])
    threshold = np.concatenate([part.threshold for part in everything])
    first, member = merge(np.concatenate([causes.view(np.uint8), threshold], axis=1))
    times = np.bincount(member, minlength=len(first))
    members = Structures(causes[first], threshold[first])
    chance = times * sampler.evidence / max(tried, 1) / sampler.likelihood(members)
    return listed(members, chance)


def listed(members: Structures, chance: FloatArray) -> Catalogue:
    """A catalogue of structures of the free form, each a behaviour of its own.

    Args:
        members: ``[M]`` the structures.
        chance: ``[M]`` what their probabilities in the free form are estimated to be.
    """
    index = np.arange(len(members))
    kind = np.full(len(members), len(schema_classes()))
    return Catalogue(members, index, index, kind, chance, free_form=True)


def with_sampled(space: Space, own: Catalogue) -> Space:
    """The space with sampled structures of the grey levers as one more block, the last."""
    block = Block((1 << space.sight.grey) - 1, own)
    size = space.sight.positions, space.sight.solutions
    more = placed(block, *size) if len(own) else Hypotheses.none(*size)
    joined = Hypotheses.joined([space.hypotheses, more.repeated(len(space.strengths))])
    return Space(space.sight, space.strengths, (*space.blocks, block), joined)
