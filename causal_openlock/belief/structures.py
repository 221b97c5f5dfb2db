"""Causal structures as arrays: many gate-DAGs at once, and what they do.

A *structure* on n levers gives, for each lever and for the door, its causes as a bit mask and the
threshold of how many of them must be pushed (1 is ``any``, all of them is ``all``, 0 is a free
lever). It is a :class:`~causal_openlock.world.schema.Schema` without names and strengths; M
structures are two small arrays, so that thousands are compared at once.

Derived here for all of them together: which sets of levers unlock the door, which of these are
minimal (the solutions), and which levers are inert. Structures that do the same in every attempt
have the same *behaviour*, and no learner can distinguish them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import product
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.lever_sets import Families, meeting, members, minimal, with_lever
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

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
        """Some of the elements, in any order and also repeatedly."""
        return type(self)(*(getattr(self, name)[chosen] for name in self.__dataclass_fields__))

    @classmethod
    def joined(cls, parts: Sequence[Self]) -> Self:
        """The elements of several."""

        def column(name: str) -> Any:
            values = [getattr(part, name) for part in parts]
            rows = isinstance(values[0], Rows)
            return values[0].joined(values) if rows else np.concatenate(values)

        return cls(*map(column, cls.__dataclass_fields__))


@dataclass(frozen=True, eq=False)
class Structures(Rows):
    """M gate-DAGs on n levers; the last node is the door.

    Attributes:
        causes: ``[M, n + 1]`` for each node the set of levers that enable it, as a bit mask.
        threshold: ``[M, n + 1]`` how many of them must be pushed; 0 for a free lever.

    Example:
        A chain: the first lever enables the second, and that one unlocks the door.

        >>> chain = Structures(np.array([[0b00, 0b01, 0b10]], np.uint16),
        ...                    np.array([[0, 1, 1]], np.uint8))
        >>> np.flatnonzero(chain.solutions()[0])  # the set of both levers, as a bit mask
        array([3])
    """

    causes: Masks
    threshold: Counts

    @property
    def levers(self) -> int:
        """Number of levers, n."""
        return self.causes.shape[1] - 1

    @classmethod
    def none(cls, levers: int) -> Structures:
        """No structure on so many levers."""
        causes = np.zeros((0, levers + 1), dtype=np.uint16)
        return cls(causes, causes.astype(np.uint8))

    def labels(self) -> NDArray[np.uint8]:
        """``[M, W]`` bytes that are equal exactly for equal structures."""
        return np.concatenate([self.causes.view(np.uint8), self.threshold], axis=1)

    def holds(self, pushed: int) -> BoolArray:
        """``[M, n + 1]`` whether the gate of each node holds while ``pushed`` are pushed."""
        return np.bitwise_count(self.causes & np.uint16(pushed)) >= self.threshold

    def solutions(self) -> BoolArray:
        """``[M, 2^n]`` whether this set of levers is a solution: it works, and no subset does."""
        return members(self.solving(), self.levers)

    def solving(self) -> Families:
        """``[M, W]`` the solutions of each structure, a bit for each set of levers."""
        return minimal(self.working(), self.levers)

    def working(self) -> Families:
        """``[M, W]`` the sets that unlock the door.

        A set works if every gate in it, and the door's, is met by the set itself; as causes come
        before effects, its levers can then be pushed one after another.
        """
        n = self.levers
        meets, lacks = meeting(n), ~with_lever(n)
        works = meets[self.causes[:, n], self.threshold[:, n]]
        for lever in range(n):
            works &= meets[self.causes[:, lever], self.threshold[:, lever]] | lacks[lever]
        return works

    def inert(self) -> Masks:
        """``[M]`` the levers from which no path leads to the door."""
        n = self.levers
        useful = self.causes[:, n].copy()
        for _ in range(n):
            for lever in range(n):
                useful |= np.where(useful >> np.uint16(lever) & 1, self.causes[:, lever], 0)
        return (~useful & np.uint16((1 << n) - 1)).astype(np.uint16)

    def relabelled(self, order: IntArray) -> Structures:
        """All structures with lever i called ``order[i]``."""
        n = self.levers
        causes, threshold = np.empty_like(self.causes), np.empty_like(self.threshold)
        where = [*order, n]
        causes[:, where] = renamed(self.causes, order)
        threshold[:, where] = self.threshold
        return Structures(causes, threshold)

    def behaviour(self, action_limit: int, uncertain: bool = False) -> NDArray[np.uint8]:
        """``[M, W]`` bytes that are equal exactly for structures of equal behaviour.

        Two structures behave alike if in every state that an attempt can reach they agree on which
        levers move, on whether the door is unlocked, and on which solution opening it completes.

        Args:
            action_limit: Actions in an attempt.
            uncertain: Whether enabled levers move only with some probability, which depends on
                how many causes are pushed, so that this number matters too.
        """
        n = self.levers
        # No more levers can be pushed than there were actions.
        sets = [pushed for pushed in range(1 << n) if pushed.bit_count() <= action_limit]
        inert, solutions = self.inert(), self.solutions()
        reached = np.zeros((1 << n, len(self)), dtype=bool)
        reached[0] = True
        parts: list[NDArray[Any]] = []
        for action in range(action_limit + 1):
            before = reached.copy()
            for pushed in sets if action < action_limit else ():
                if pushed.bit_count() > action:
                    continue  # so many actions push no more levers
                holds = self.holds(pushed)
                for lever in range(n):
                    reached[pushed ^ 1 << lever] |= before[pushed] & holds[:, lever]
            if action == action_limit - 1:
                acting = before  # states in which there is an action left
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


def behaviour_bytes(levers: int, action_limit: int) -> int:
    """Bytes that describe a behaviour, for each node and each set that can be pushed."""
    sets = sum(math.comb(levers, pushed) for pushed in range(min(levers, action_limit) + 1))
    return sets * (levers + 3)


def renamed(sets: Masks, names: IntArray) -> Masks:
    """``[...]`` sets of levers after lever i is renamed to ``names[..., i]``."""
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


@cache
def gate_dags(levers: int) -> Structures:
    """Every labelled gate-DAG on so many levers, with every threshold gate.

    >>> [len(gate_dags(levers)) for levers in (1, 2, 3)]  # 43,168 for four, millions for five
    [1, 12, 408]
    """
    options = [
        [
            (mask, k)
            for mask in range(1 << levers)
            if not mask >> lever & 1
            for k in (range(1, mask.bit_count() + 1) if mask else (0,))
        ]
        for lever in range(levers)
    ]
    chosen = np.array(list(product(*options)), dtype=np.int64).reshape(-1, levers, 2)
    causes = np.pad(chosen[..., 0].astype(np.uint16), ((0, 0), (0, 1)))
    chosen = chosen[linear_extensions(causes) > 0]  # a graph with a cycle has none
    door = np.array(
        [(mask, k) for mask in range(1, 1 << levers) for k in range(1, mask.bit_count() + 1)]
    )
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
