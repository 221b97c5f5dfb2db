"""The hypotheses about one room, and how probable they are before anything is tried.

A hypothesis says which levers are active, how they and the door hang together, and how surely an
enabled lever moves. What marks the active levers is unknown too: a *rule* may go by colour (the
grey ones, or the white ones) or by position (some places more often than others). Rules, classes
of schemas and strengths are learned across rooms (:mod:`causal_openlock.belief.knowledge`); which
lever does what starts afresh in each.

Rooms that look alike share their hypotheses. To this end levers are numbered by *slot*: the grey
ones first, then the white ones, each in the order of their positions.
"""

from __future__ import annotations

import math
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
from causal_openlock.belief.structures import NEVER, Counts, Masks, renamed
from causal_openlock.world.fsm import FloatArray, IntArray

RULES = ("grey", "white", "position")
"""What may mark the active levers."""


class RoomSight(NamedTuple):
    """What tells rooms apart before anything is tried.

    Attributes:
        positions: Levers of the room, P.
        grey: How many of them are grey.
        solutions: Solutions that the console promises.
        action_limit: Actions in an attempt.
    """

    positions: int
    grey: int
    solutions: int
    action_limit: int


@dataclass(frozen=True, eq=False)
class Hypotheses:
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

    def __len__(self) -> int:
        return len(self.inert)

    def __getitem__(self, chosen: IntArray) -> Hypotheses:
        """Some of the hypotheses."""
        return Hypotheses(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

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

    @classmethod
    def joined(cls, parts: list[Hypotheses]) -> Hypotheses:
        """All hypotheses of several."""
        return cls(
            *(np.concatenate([getattr(part, name) for part in parts])
              for name in cls.__dataclass_fields__)
        )  # fmt: skip

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
        catalogue: What these levers may do.
    """

    active: int
    catalogue: Catalogue

    @property
    def slots(self) -> list[int]:
        """The active slots in ascending order."""
        return [slot for slot in range(16) if self.active >> slot & 1]


@dataclass(frozen=True, eq=False, repr=False)
class Space:
    """Every hypothesis about rooms of one sight, block by block.

    Attributes:
        sight: What these rooms look like.
        strengths: How surely levers may move.
        blocks: Sets of active levers, and what these may do.
        hypotheses: Them all, in the order of the blocks; each behaviour once with each strength.
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
            places: ``[B, P]`` probability that the lever in each slot is active, going by position.
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
        """``[B, H]`` probability of each hypothesis for B subjects; rows need not add up to one.

        What is missing to one is the probability that the console had shown something else, and
        that of hypotheses beyond what is enumerated.

        Args:
            classes: ``[B, C + 1]`` of each schema class.
            rules: ``[B, 3]`` of each rule.
            places: ``[B, P]`` that the lever in each slot is active, going by position.
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
    """The space of a sight: grey levers, white levers, and then any few levers.

    Args:
        sight: What the rooms look like.
        strengths: How surely levers may move.
        simplicity: As for :func:`~causal_openlock.belief.grammar.class_prior`.
        limit: About how many hypotheses, strengths aside, there may be. Sets of levers that no
            colour marks are taken in, the smallest first, as long as they fit.
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
    parts = [placed(block, positions, sight.solutions) for block in blocks]
    joined = Hypotheses.joined(parts or [Hypotheses.none(positions, sight.solutions)])
    return Space(sight, strengths, tuple(blocks), joined.repeated(len(strengths)))


def placed(block: Block, positions: int, solutions: int) -> Hypotheses:
    """The behaviours of a block, each as its first structure, on the room's slots."""
    own = block.catalogue
    slots = block.slots
    names = np.array(slots)
    causes = np.zeros((len(own), positions + 1), dtype=np.uint16)
    threshold = np.full((len(own), positions + 1), NEVER, dtype=np.uint8)
    where = [*slots, positions]
    structures = own.members[own.first]
    causes[:, where] = renamed(structures.causes, names)
    threshold[:, where] = structures.threshold
    return Hypotheses(
        causes,
        threshold,
        renamed(own.inert, names) | np.uint16(((1 << positions) - 1) ^ block.active),
        renamed(own.solutions, names).reshape(-1, solutions),
        np.zeros(len(own), dtype=np.uint8),
    )
