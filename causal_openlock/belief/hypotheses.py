"""The hypotheses about one room, and their prior.

A hypothesis states which levers are active, the gate-DAG on them and the door, and the strength:
the probability that an enabled lever moves. What marks the active levers is unknown, too: a *rule*
may go by colour (the grey ones, or the white ones) or by position. The prior is

    P(h) = P(active levers | rule) P(rule) P(structure | class) P(class) P(strength)

summed over rules and classes. Rules, classes and strengths are learned across rooms
(:mod:`causal_openlock.belief.knowledge`); which lever does what is learned anew in each.

Rooms that look alike share their hypotheses. To this end levers are numbered by *slot*: the grey
ones first, then the white ones, each in the order of their positions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.catalogue import (
    FREE_FORM_LEVERS,
    Catalogue,
    catalogue,
    feasible,
)
from causal_openlock.belief.strength import Strengths
from causal_openlock.belief.structures import NEVER, Counts, Masks, Rows, renamed
from causal_openlock.world.fsm import FloatArray, IntArray

RULES = ("grey", "white", "position")
"""What may mark the active levers."""


class RoomSight(NamedTuple):
    """What distinguishes rooms before anything is tried.

    Attributes:
        positions: Levers of the room, P.
        grey: How many of them are grey.
        solutions: Solutions that the console shows.
        action_limit: Actions in an attempt.
    """

    positions: int
    grey: int
    solutions: int
    action_limit: int


@dataclass(frozen=True, eq=False)
class Hypotheses(Rows):
    """H hypotheses about P levers by slot and a door, as arrays; the door is the last node.

    Attributes:
        causes: ``[H, P + 1]`` which slots enable each node, as a bit mask.
        threshold: ``[H, P + 1]`` how many of them must be pushed.
        inert: ``[H]`` slots that do nothing for the door.
        solutions: ``[H, K]`` the solutions as sets of slots.
        strength: ``[H]`` index of the strength.
    """

    causes: Masks
    threshold: Counts
    inert: Masks
    solutions: Masks
    strength: Counts

    @classmethod
    def none(cls, positions: int, solutions: int) -> Hypotheses:
        """No hypothesis, in the shape of others."""
        return cls(
            np.zeros((0, positions + 1), dtype=np.uint16),
            np.zeros((0, positions + 1), dtype=np.uint8),
            np.zeros(0, dtype=np.uint16),
            np.zeros((0, solutions), dtype=np.uint16),
            np.zeros(0, dtype=np.uint8),
        )

    def on_slots(self, slots: Sequence[int], positions: int) -> Hypotheses:
        """Hypotheses about n levers, as hypotheses about a room in which all others are inactive.

        Args:
            slots: The slot of each lever.
            positions: Levers of the room.
        """
        names = np.array(slots)
        causes = np.zeros((len(self), positions + 1), dtype=np.uint16)
        threshold = np.full((len(self), positions + 1), NEVER, dtype=np.uint8)
        nodes = [*slots, positions]
        causes[:, nodes], threshold[:, nodes] = renamed(self.causes, names), self.threshold
        inactive = (1 << positions) - 1 - sum(1 << slot for slot in slots)
        inert = renamed(self.inert, names) | np.uint16(inactive)
        return Hypotheses(causes, threshold, inert, renamed(self.solutions, names), self.strength)

    def repeated(self, strengths: int) -> Hypotheses:
        """Each hypothesis once with each strength, strengths fastest."""
        many = self[np.repeat(np.arange(len(self)), strengths)]
        strength = np.tile(np.arange(strengths, dtype=np.uint8), len(self))
        return Hypotheses(many.causes, many.threshold, many.inert, many.solutions, strength)


@dataclass(frozen=True, eq=False)
class Block:
    """The hypotheses that make the same levers active.

    Attributes:
        active: The active slots, as a bit mask.
        catalogue: The possible behaviours of these levers.
    """

    active: int
    catalogue: Catalogue

    @property
    def slots(self) -> list[int]:
        """The active slots in ascending order."""
        return [slot for slot in range(16) if self.active >> slot & 1]


@dataclass(frozen=True, eq=False, repr=False)
class Space:
    """Every hypothesis about rooms of one appearance, block by block.

    Attributes:
        sight: What these rooms look like.
        strengths: The possible strengths.
        blocks: Sets of active levers and their possible behaviours.
        hypotheses: All of them, in the order of the blocks; each behaviour with each strength.
    """

    sight: RoomSight
    strengths: Strengths
    blocks: tuple[Block, ...]
    hypotheses: Hypotheses

    def __len__(self) -> int:
        return len(self.hypotheses)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Space({self.sight}, {len(self):,} hypotheses)"

    @cached_property
    def active(self) -> Masks:
        """``[V]`` the active slots of each block."""
        return np.array([block.active for block in self.blocks], dtype=np.uint16)

    @cached_property
    def ends(self) -> IntArray:
        """``[V]`` where the hypotheses of each block end."""
        sizes = [len(block.catalogue) * len(self.strengths) for block in self.blocks]
        return np.cumsum(sizes)

    def marked(self, places: FloatArray) -> FloatArray:
        """``[B, V, 3]`` probability of each set of active levers under each rule.

        Args:
            places: ``[B, P]`` probability that each slot is active, under the rule by position.
        """
        positions, grey = self.sight.positions, self.sight.grey
        bits = (self.active[:, None] >> np.arange(positions) & 1).astype(bool)
        by_place = np.where(bits, places[:, None], 1.0 - places[:, None]).prod(axis=2)
        all_grey = (1 << grey) - 1
        all_white = (1 << positions) - 1 - all_grey
        by_colour = [np.broadcast_to(self.active == colour, by_place.shape)
                     for colour in (all_grey, all_white)]  # fmt: skip
        return np.stack([*by_colour, by_place], axis=2).astype(float)

    def prior(
        self, classes: FloatArray, rules: FloatArray, places: FloatArray, strengths: FloatArray
    ) -> FloatArray:
        """``[B, H]`` prior probability of each hypothesis for B subjects.

        Rows add up to less than one: the rest is the probability that the console shows something
        else, and that of hypotheses that are not enumerated.

        Args:
            classes: ``[B, C + 1]`` of each schema class.
            rules: ``[B, 3]`` of each rule.
            places: ``[B, P]`` that the lever in each slot is active, under the rule by position.
            strengths: ``[B, G]`` of each strength.
        """
        marked = (self.marked(places) * rules[:, None]).sum(axis=2)
        known: dict[int, FloatArray] = {}
        parts = []
        for index, block in enumerate(self.blocks):
            own = block.catalogue
            if id(own) not in known:
                possible = classes * feasible(own.members.levers)
                possible /= possible.sum(axis=1, keepdims=True)
                known[id(own)] = own.prior(possible)
            of_block = known[id(own)] * marked[:, [index]]
            parts.append((of_block[:, :, None] * strengths[:, None]).reshape(len(of_block), -1))
        return np.concatenate(parts, axis=1)


def enumerate_space(sight: RoomSight, strengths: Strengths, simplicity: float, limit: int) -> Space:
    """The space of a room: grey levers, white levers, and then any few levers.

    Args:
        sight: What the rooms look like.
        strengths: The possible strengths.
        simplicity: As for :func:`~causal_openlock.belief.grammar.class_prior`.
        limit: About how many hypotheses, strengths aside, there may be. Sets of levers that no
            colour marks are added, the smallest first, as long as they fit.

    Example:
        >>> from causal_openlock.belief.strength import strengths
        >>> certain = strengths(0.0, 1.0, 1.0, 1)
        >>> enumerate_space(RoomSight(7, 3, 2, 3), certain, math.log(2), 20_000)
        Space(RoomSight(positions=7, grey=3, solutions=2, action_limit=3), 4,278 hypotheses)
    """
    positions, grey = sight.positions, sight.grey
    uncertain = len(strengths) > 1
    all_levers = (1 << positions) - 1
    all_grey = (1 << grey) - 1
    blocks: list[Block] = []
    taken = 0

    def take(active: int, always: bool) -> None:
        nonlocal taken
        levers = active.bit_count()
        if not levers or any(block.active == active for block in blocks):
            return
        own = catalogue(levers, sight.solutions, sight.action_limit, uncertain, simplicity, limit)
        if len(own) and (always or taken + len(own) <= limit):
            blocks.append(Block(active, own))
            taken += len(own)

    take(all_grey, always=True)
    take(all_levers ^ all_grey, always=False)
    for levers in range(1, min(FREE_FORM_LEVERS, positions) + 1):
        # All sets of a size or none, so that no position is preferred.
        own = catalogue(levers, sight.solutions, sight.action_limit, uncertain, simplicity, limit)
        if taken + len(own) * math.comb(positions, levers) <= limit:
            for slots in combinations(range(positions), levers):
                take(sum(1 << slot for slot in slots), always=True)
    parts = [placed(block, positions) for block in blocks]
    joined = Hypotheses.joined(parts or [Hypotheses.none(positions, sight.solutions)])
    return Space(sight, strengths, tuple(blocks), joined.repeated(len(strengths)))


def placed(block: Block, positions: int) -> Hypotheses:
    """The behaviours of a block, each as its first structure, on the room's slots."""
    own = block.catalogue
    structures = own.members[own.first]
    strength = np.zeros(len(own), dtype=np.uint8)
    hypotheses = Hypotheses(
        structures.causes, structures.threshold, own.inert, own.solutions, strength
    )
    return hypotheses.on_slots(block.slots, positions)
