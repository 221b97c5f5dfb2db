"""The hypotheses about one room, and their prior.

A hypothesis states which levers are active, the gate-DAG on them and the door, and the strength:
the probability that an enabled lever moves. How the active levers are marked is also unknown:
a *rule* may go by colour (the grey ones, or the white ones) or by position. The prior is

    P(h) = P(active levers | rule) P(rule) P(structure | class) P(class) P(strength)

summed over rules and classes. Rules, classes and strengths are learned across rooms
(:mod:`causal_openlock.belief.knowledge`); which lever does what is learned in each room.

**Strength.** Each of m pushed causes transmits independently with probability s, and a push takes
effect if at least k of them transmit, k being the threshold of the gate (a noisy-OR for k = 1, a
noisy-AND for all):

    P(takes effect) = sum over j >= k of C(m, j) s^j (1 - s)^(m - j)

This is a polynomial in s, so integrals over a Beta prior are sums over G Gauss-Jacobi nodes, exact
up to degree 2G - 1, that is for about 2G pushes; beyond that the nodes approximate the conjugate
Beta posterior.

Rooms that look alike share their hypotheses. To this end levers are numbered by *slot*: the grey
ones first, then the white ones, each in the order of their positions.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS, HYPOTHESES, Catalogue, catalogue
from causal_openlock.belief.structures import NEVER, Hypotheses, Masks, gate_dags
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import MAX_LEVERS

STRENGTH_ALPHA, STRENGTH_BETA = 4.0, 1.0
"""The Beta prior of the strength."""
STRENGTH_NODES = 10
RULES = ("grey", "white", "position")
"""Rules by which active levers may be marked."""


class RoomSight(NamedTuple):
    """Features that distinguish rooms before anything is tried."""

    positions: int  #: levers of the room, P
    grey: int  #: how many of them are grey
    solutions: int  #: solutions that the console shows
    action_limit: int  #: actions in an attempt


@dataclass(frozen=True, eq=False)
class Strengths:
    """The possible strengths; the first is certainty."""

    value: FloatArray  #: ``[G]`` the strengths
    prior: FloatArray  #: ``[G]`` their probabilities
    #: ``[G, P + 1, 16]`` :func:`at_least` of each strength: by pushed causes, by threshold
    chance: FloatArray

    @property
    def typical(self) -> float:
        """The mean strength if levers may fail to move; 1 if they may not."""
        if len(self) == 1:
            return 1.0
        return float(np.average(self.value[1:], weights=self.prior[1:]))

    def __len__(self) -> int:
        return len(self.value)


@cache
def strengths(noise: float, nodes: int = STRENGTH_NODES) -> Strengths:
    """Certainty, and the nodes of the Beta prior.

    ``noise`` is the prior probability that levers may fail to move; at 0 there is certainty alone.

    Example:
        >>> strengths(0.5, nodes=2).value.round(2).tolist()
        [1.0, 0.53, 0.9]
    """
    value, prior = np.ones(1), np.ones(1)
    if noise > 0:
        from scipy.special import roots_sh_jacobi

        at, weight = roots_sh_jacobi(nodes, STRENGTH_ALPHA + STRENGTH_BETA - 1, STRENGTH_ALPHA)
        value = np.concatenate([value, at])
        prior = np.concatenate([[1.0 - noise], noise * weight / weight.sum()])
    return Strengths(value, prior, np.stack([at_least(s) for s in value]))


def at_least(strength: float) -> FloatArray:
    """``[P + 1, 16]`` probability that at least ``k`` of ``m`` pushed causes transmit.

    >>> at_least(0.5)[2, :3].tolist()  # of two causes none, one, both
    [1.0, 0.75, 0.25]
    """
    exactly = np.zeros((MAX_LEVERS + 1, int(NEVER) + 1))
    exactly[0, 0] = 1.0
    for pushed in range(MAX_LEVERS):
        exactly[pushed + 1] = exactly[pushed] * (1.0 - strength)
        exactly[pushed + 1, 1:] += exactly[pushed, :-1] * strength
    more: FloatArray = exactly[:, ::-1].cumsum(axis=1)[:, ::-1]
    return np.clip(more, 0.0, 1.0)


@dataclass(frozen=True, eq=False, repr=False)
class Space:
    """Every hypothesis about rooms of one appearance, block by block."""

    sight: RoomSight  #: what these rooms look like
    strengths: Strengths  #: the possible strengths
    blocks: tuple[tuple[tuple[int, ...], Catalogue], ...]  #: active slots, and what those may do

    def __len__(self) -> int:
        return len(self.hypotheses)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Space({self.sight}, {len(self):,} hypotheses)"

    @cached_property
    def hypotheses(self) -> Hypotheses:
        """All of them, in the order of the blocks; each behaviour with each strength."""
        positions = self.sight.positions
        nothing = Hypotheses.of(gate_dags(1)[:0]).on_slots((0,), positions)
        placed = [listed.behaviours.on_slots(slots, positions) for slots, listed in self.blocks]
        return Hypotheses.joined([nothing, *placed]).repeated(len(self.strengths))

    @cached_property
    def active(self) -> Masks:
        """``[V]`` the active slots of each block."""
        masks = [sum(1 << slot for slot in slots) for slots, _ in self.blocks]
        return np.array(masks, dtype=np.uint16)

    @cached_property
    def ends(self) -> IntArray:
        """``[V]`` where the hypotheses of each block end."""
        return np.cumsum([len(listed) * len(self.strengths) for _, listed in self.blocks])

    def marked(self, in_slots: FloatArray) -> FloatArray:
        """``[V, 3]`` probability of each set of active levers under each rule.

        ``in_slots``, ``[P]``, is the probability that each slot is active, under the rule by
        position.
        """
        positions, grey = self.sight.positions, self.sight.grey
        bits = self.active[:, None] >> np.arange(positions) & 1 == 1
        by_position = np.where(bits, in_slots, 1.0 - in_slots).prod(axis=1)
        all_grey = (1 << grey) - 1
        all_white = (1 << positions) - 1 - all_grey
        return np.stack([self.active == all_grey, self.active == all_white, by_position], axis=1)

    def prior(
        self, classes: FloatArray, rules: FloatArray, in_slots: FloatArray, strengths: FloatArray
    ) -> FloatArray:
        """``[H]`` prior probability of each hypothesis.

        They add up to less than one: the rest is the probability that the console shows something
        else, and that of hypotheses that are not enumerated. Given are the probabilities of
        ``[C + 1]`` schema classes, ``[3]`` rules, ``[G]`` strengths, and ``[P]`` that the lever in
        each slot is active, under the rule by position.
        """
        priors = {own: own.prior(classes) for own in {own for _, own in self.blocks}}
        parts = zip(self.blocks, self.marked(in_slots) @ rules, strict=True)
        return np.concatenate(
            [np.outer(priors[listed] * marked, strengths).ravel() for (_, listed), marked in parts]
        )


def enumerate_space(sight: RoomSight, strengths: Strengths, simplicity: float) -> Space:
    """The space of a room: grey levers, white levers, and then any few levers.

    Sets of levers that no colour marks are added, the smallest first, up to about
    :data:`~causal_openlock.belief.catalogue.HYPOTHESES`, strengths aside. For ``simplicity`` see
    :func:`~causal_openlock.belief.grammar.class_prior`.

    Example:
        >>> enumerate_space(RoomSight(7, 3, 2, 3), strengths(0.0), 0.7)
        Space(RoomSight(positions=7, grey=3, solutions=2, action_limit=3), 4,278 hypotheses)
    """
    every = tuple(range(sight.positions))
    groups = [[every[: sight.grey]], [every[sight.grey :]]]
    for levers in range(1, min(FREE_FORM_LEVERS, sight.positions) + 1):
        groups.append([*combinations(every, levers)])
    blocks: dict[tuple[int, ...], Catalogue] = {}
    taken = 0
    for group in groups:
        levers = len(group[0]) or 1
        uncertain = len(strengths) > 1
        listed = catalogue(levers, sight.solutions, sight.action_limit, uncertain, simplicity)
        # Grey levers always; all sets of a size or none, so that no position is preferred.
        if group is groups[0] or taken + len(listed) * len(group) <= HYPOTHESES:
            new = [slots for slots in group if slots and slots not in blocks and len(listed)]
            blocks |= dict.fromkeys(new, listed)
            taken += len(listed) * len(new)
    return Space(sight, strengths, tuple(blocks.items()))
