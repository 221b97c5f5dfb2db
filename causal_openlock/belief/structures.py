"""Causal structures as arrays: many gate-DAGs at once, and what they do.

A *structure* on n levers gives, for each lever and for the door, its causes as a bit mask and the
threshold of how many of them must be pushed (1 is ``any``, all of them is ``all``, 0 is a free
lever). Structures that do the same in every attempt have the same *behaviour*, and no learner can
distinguish them.

Four containers hold gate-DAGs: :class:`Structures`, any of them on *levers* 0, 1, ...; a
:class:`~causal_openlock.belief.catalogue.Catalogue`, those of a size by behaviour, with the schema
classes that generate them; :class:`Hypotheses`, behaviours in the *slots* of a room; and a
:class:`~causal_openlock.belief.hypotheses.Space`, all hypotheses about rooms of one appearance. A
*node* is a lever or the door, a *position* is where a lever is in the room.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

Masks = NDArray[np.uint16]
Counts = NDArray[np.uint8]

NEVER = np.uint8(15)
"""Threshold of a lever that never moves: more causes than any lever has."""


class Rows:
    """Base of dataclasses whose fields are arrays with a row for each element."""

    __dataclass_fields__: ClassVar[dict[str, Any]]

    def __len__(self) -> int:
        return len(getattr(self, next(iter(self.__dataclass_fields__))))

    def __getitem__(self, chosen: IntArray | BoolArray | slice) -> Self:
        """Select elements, in any order and also repeatedly."""
        return type(self)(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The elements of several; empty parts may have other columns."""
        parts = [part for part in parts if len(part)] or parts[:1]
        names = cls.__dataclass_fields__
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


@dataclass(frozen=True, eq=False)
class Structures(Rows):
    """M gate-DAGs on n levers; the last node is the door.

    Example:
        A chain: the first lever enables the second, and that one unlocks the door.

        >>> chain = Structures(np.array([[0b00, 0b01, 0b10]], np.uint16),
        ...                    np.array([[0, 1, 1]], np.uint8))
        >>> np.flatnonzero(chain.solutions()[0])  # the set of both levers, as a bit mask
        array([3])
    """

    causes: Masks  #: ``[M, n + 1]`` for each node the set of levers that enable it, as a bit mask
    threshold: Counts  #: ``[M, n + 1]`` how many of them must be pushed; 0 for a free lever

    @property
    def levers(self) -> int:
        """Number of levers, n."""
        return self.causes.shape[1] - 1

    def labels(self) -> NDArray[np.uint8]:
        """``[M, W]`` bytes that are equal exactly for equal structures."""
        return np.concatenate([self.causes.view(np.uint8), self.threshold], axis=1)

    def holds(self, pushed: int) -> BoolArray:
        """``[M, n + 1]`` whether the gate of each node holds while ``pushed`` are pushed."""
        return np.bitwise_count(self.causes & np.uint16(pushed)) >= self.threshold

    def solutions(self) -> BoolArray:
        """``[M, 2^n]`` whether this set of levers is a solution: it works, and no subset does."""
        works = self.working().T
        subsets = works.astype(np.uint16)  # how many subsets of each set work, itself among them
        for lever in range(self.levers):
            pairs = subsets.reshape(len(works) >> lever + 1, 2, 1 << lever, len(self))
            pairs[:, 1] += pairs[:, 0]  # sets with the lever, and the same sets without it
        return (works & (subsets == 1)).T

    def working(self) -> BoolArray:
        """``[M, 2^n]`` whether this set of levers unlocks the door.

        A set works if every gate in it, and the door's, is met by the set itself; as causes come
        before effects, its levers can then be pushed one after another.
        """
        sets = np.arange(1 << self.levers, dtype=np.uint16)
        works = self._met_by(sets, self.levers)
        for lever in range(self.levers):
            having = np.flatnonzero(sets >> np.uint16(lever) & 1)
            works[having] &= self._met_by(sets[having], lever)
        return works.T

    def _met_by(self, sets: Masks, node: int) -> BoolArray:
        """``[S, M]`` whether the gate of a node holds while a set of levers is pushed."""
        live: Masks = self.causes[:, node] & sets[:, None]
        return np.asarray(np.bitwise_count(live) >= self.threshold[:, node])

    def inert(self) -> Masks:
        """``[M]`` the levers from which no path leads to the door."""
        n = self.levers
        useful = self.causes[:, n].copy()
        for _ in range(n):
            for lever in range(n):
                useful |= np.where(useful >> np.uint16(lever) & 1, self.causes[:, lever], 0)
        return (~useful & np.uint16((1 << n) - 1)).astype(np.uint16)

    def on_slots(self, slots: Sequence[int] | IntArray, positions: int) -> Structures:
        """Lever i called ``slots[i]``; all other slots of a room are levers that never move."""
        causes = np.zeros((len(self), positions + 1), dtype=np.uint16)
        threshold = np.full((len(self), positions + 1), NEVER, dtype=np.uint8)
        nodes = [*slots, positions]
        causes[:, nodes], threshold[:, nodes] = renamed(self.causes, slots), self.threshold
        return Structures(causes, threshold)

    def behaviour(self, action_limit: int, uncertain: bool = False) -> NDArray[np.uint8]:
        """``[M, W]`` bytes that are equal exactly for structures of equal behaviour.

        Two structures behave alike if in every state that an attempt can reach they agree on which
        levers move, on whether the door is unlocked, and on which solution opening it completes.
        If ``uncertain``, enabled levers move only with some probability, which depends on the
        number of pushed causes, so that this number also matters.
        """
        n = self.levers
        # No more levers can be pushed than there were actions.
        sets = [pushed for pushed in range(1 << n) if pushed.bit_count() <= action_limit]
        inert, solutions = self.inert(), self.solutions()
        reached = np.zeros((1 << n, len(self)), dtype=bool)
        reached[0] = True
        for _ in range(action_limit):
            acting = reached.copy()  # in the end, the states in which there is an action left
            for pushed in sets:
                if acting[pushed].any():
                    moves = acting[pushed, :, None] & self.holds(pushed)
                    for lever in range(n):
                        reached[pushed ^ 1 << lever] |= moves[:, lever]
        parts: list[NDArray[Any]] = []
        for pushed in sets:
            holds = self.holds(pushed)
            # Above 0 also for a free lever, to distinguish it from one that cannot move.
            how = 1 + np.bitwise_count(self.causes & np.uint16(pushed)) + 16 * self.threshold
            moves = np.where(holds, how if uncertain else 1, 0).astype(np.uint8)
            moves[:, n] = np.where(acting[pushed] | ~holds[:, n], moves[:, n], 1)
            moves[:, :n] *= acting[pushed, :, None]
            moves[:, n] *= reached[pushed]
            relevant = np.uint16(pushed) & ~inert
            credited = solutions[np.arange(len(self)), relevant] & holds[:, n] & acting[pushed]
            parts += [moves, np.where(credited, relevant, 0).astype(np.uint16)[:, None]]
        return np.concatenate([part.view(np.uint8) for part in parts], axis=1)


@dataclass(frozen=True, eq=False)
class Hypotheses(Rows):
    """H hypotheses about P levers by slot and a door, as arrays; the door is the last node."""

    causes: Masks  #: ``[H, P + 1]`` which slots enable each node, as a bit mask
    threshold: Counts  #: ``[H, P + 1]`` how many of them must be pushed
    inert: Masks  #: ``[H]`` slots that do nothing for the door
    solutions: Masks  #: ``[H, K]`` the solutions as sets of slots
    strength: Counts  #: ``[H]`` index of the strength

    @property
    def structures(self) -> Structures:
        """``[H]`` their structures."""
        return Structures(self.causes, self.threshold)

    @classmethod
    def of(cls, structures: Structures) -> Hypotheses:
        """Structures with equally many solutions, each lever in the slot of its number."""
        many, solutions = len(structures), np.nonzero(structures.solutions())[1]
        return cls(
            structures.causes,
            structures.threshold,
            structures.inert(),
            solutions.reshape(many, -1 if many else 0).astype(np.uint16),
            np.zeros(many, dtype=np.uint8),
        )

    def on_slots(self, slots: Sequence[int], positions: int) -> Hypotheses:
        """Lever i called ``slots[i]``; all other slots of a room are inactive."""
        placed = self.structures.on_slots(slots, positions)
        inactive = (1 << positions) - 1 - sum(1 << slot for slot in slots)
        inert = renamed(self.inert, slots) | np.uint16(inactive)
        solutions = renamed(self.solutions, slots)
        return Hypotheses(placed.causes, placed.threshold, inert, solutions, self.strength)

    def repeated(self, strengths: int) -> Hypotheses:
        """Each hypothesis once with each strength, strengths fastest."""
        many = self[np.repeat(np.arange(len(self)), strengths)]
        return replace(many, strength=np.tile(np.arange(strengths, dtype=np.uint8), len(self)))


def renamed(sets: Masks, names: Sequence[int] | IntArray) -> Masks:
    """``[...]`` sets of levers after lever i is renamed to ``names[..., i]``."""
    names = np.asarray(names)
    result = np.zeros(np.broadcast_shapes(sets.shape, names.shape[:-1]), dtype=np.uint16)
    for lever in range(names.shape[-1]):
        holds = sets >> np.uint16(lever) & np.uint16(1)
        result |= np.left_shift(holds, names[..., lever].astype(np.uint16))
    return result


def merge(rows: NDArray[np.uint8]) -> tuple[IntArray, IntArray]:
    """``[U]`` the first of each group of equal rows of bytes, and ``[M]`` the group of each row."""
    whole = np.ascontiguousarray(rows).view(np.dtype((np.void, rows.shape[1]))).ravel()
    _, first, group = np.unique(whole, return_index=True, return_inverse=True)
    return first, group.reshape(-1)


def gate_options(levers: int, node: int) -> list[tuple[int, int]]:
    """Causes and threshold of every gate of a lever, or of the door as node ``levers``."""
    return [
        (mask, enough)
        for mask in range(1 if node == levers else 0, 1 << levers)
        if not mask >> node & 1
        for enough in (range(1, mask.bit_count() + 1) if mask else (0,))
    ]


@cache
def gate_dags(levers: int) -> Structures:
    """Every labelled gate-DAG on a number of levers, with every threshold gate.

    >>> [len(gate_dags(levers)) for levers in (1, 2, 3)]  # 43,168 for four, millions for five
    [1, 12, 408]
    """
    options = [gate_options(levers, lever) for lever in range(levers)]
    chosen = np.array(list(product(*options)), dtype=np.int64).reshape(-1, levers, 2)
    causes = np.pad(chosen[..., 0].astype(np.uint16), ((0, 0), (0, 1)))
    chosen = chosen[linear_extensions(causes) > 0]  # a graph with a cycle has none
    door = np.array(gate_options(levers, levers))
    many, doors = len(chosen), len(door)
    nodes = np.concatenate(
        [np.repeat(chosen, doors, axis=0), np.tile(door, (many, 1))[:, None]], axis=1
    )
    return Structures(nodes[..., 0].astype(np.uint16), nodes[..., 1].astype(np.uint8))


def linear_extensions(causes: Masks) -> FloatArray:
    """``[M]`` number of orders of the levers with causes before effects."""
    n = causes.shape[1] - 1
    ways = np.zeros((len(causes), 1 << n))
    ways[:, 0] = 1.0
    for listed in range(1 << n):
        for lever in range(n):
            if not listed >> lever & 1:
                ready = causes[:, lever] & ~np.uint16(listed) == 0
                ways[:, listed | 1 << lever] += np.where(ready, ways[:, listed], 0.0)
    return ways[:, -1]
