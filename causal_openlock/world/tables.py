"""Many rooms as one table, which environments and sessions step by lookups.

:class:`RoomTables` stacks the unrolled attempts of all rooms in use
(:func:`causal_openlock.world.fsm.unroll`), re-indexed by position, into flat arrays. A room at some
moment of an attempt is then a single integer, its *row*; what is seen, what is unlocked, and
whether the attempt is over are lookups by row (:mod:`causal_openlock.world.batch`).

Where actions lead does not depend on where the levers are. Rooms that differ by the layout alone
share one *list* of it, which stays in the processor's nearest cache however many layouts there are:
``4 * W`` bytes a row, 3 kB for the paper's schemas, 5 MB for twelve free levers in attempts of
thirteen actions.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.world.fsm import (
    FSM,
    Attempt,
    BoolArray,
    FloatArray,
    IntArray,
    compile_schema,
    unroll,
)
from causal_openlock.world.room import Layout, Room
from causal_openlock.world.schema import Schema

UNLOCKED, OPENED, ACTIONS_LEFT = np.uint8(64), np.uint8(128), np.uint8(63)
"""Bits of :attr:`RoomTables.status`: at least UNLOCKED is unlocked, at least OPENED is open."""
RoomKey = tuple[Schema, tuple[int, ...], int]
"""What distinguishes stacked rooms: the schema, the places of its levers, the action limit."""


class RoomTables:
    """Stacked tables of rooms with the same number of positions.

    R rows (a room's moments of an attempt), M listed rows (those of the first room of each schema
    and action limit), P positions, A = 2P + 1 actions, W = A + 2 columns, G rooms, K solutions of
    the room that has most. The columns are the actions, and after them :attr:`failed`, an action
    that could have moved something and did not, and :attr:`wait`, no action at all.

    Args:
        positions: P.

    Attributes:
        effect: ``[M * W]`` the listed row after an action that takes effect; where the attempt is
            over, any action puts the room back to its start.
        chance: ``[M * W]`` the probability that an action takes effect; empty as long as no room
            leaves anything to chance.
        listed: ``[R]`` the listed row of each row.
        column: ``[G * W]`` the column of an action of each room in its list: the action there that
            is aimed at the same lever, or at an inactive one.
        shift: ``[G]`` how far the listed rows of each room are behind its rows.
        observation: ``[R, 2P + 2]`` what is seen, int8.
        over: ``[R]`` whether the attempt is over.
        used: ``[R]`` actions used so far in the attempt.
        status: ``[R]`` the actions left (0 if the attempt is over) plus :data:`UNLOCKED`, plus
            :data:`OPENED` where it is that too, in one byte.
        state: ``[R]`` state of the room's machine.
        unlocked: ``[R]`` whether the door is unlocked.
        opened: ``[R]`` whether the door is open.
        solution: ``[R]`` which solution is pushed, -1 for none.
        on_path: ``[R]`` whether the actions so far are the beginning of some solution.
        begun: ``[M, K]`` whether the actions so far are the beginning of solution *k*.
        room: ``[R]`` index of the room.
        start: ``[G]`` the row at which each room's attempts begin.
        solutions: ``[G]`` how many solutions each room has.
        action_limit: ``[G]`` how many actions an attempt has in each room.
        twin: ``[G]`` the first room of the same schema and action limit, whose rows are listed:
            they are the same, in the same order, and only its levers are elsewhere.
        rooms: The rooms themselves.
        stochastic: Whether any room leaves something to chance.

    Example:
        >>> from causal_openlock import Layout, find_schema
        >>> tables = RoomTables(positions=7)
        >>> tables.add([(find_schema("CC3"), Layout((0, 1, 2)), 3)])
        array([0])
        >>> after = tables.after(tables.start, np.array([0]))  # push the lever at position 0
        >>> tables.observation[after, :7]
        array([[1, 0, 0, 0, 0, 0, 0]], dtype=int8)
    """

    def __init__(self, positions: int) -> None:
        self.positions = positions
        self.actions = 2 * positions + 1
        self.columns = self.actions + 2
        self.failed, self.wait = self.actions, self.actions + 1
        self.rooms: list[Room] = []
        self.stochastic = False
        self._index: dict[RoomKey, int] = {}
        self._twins: dict[tuple[Schema, int], tuple[int, int]] = {}  # and its first listed row
        self._attempts: list[Attempt] = []  # of each room; twins share one
        self._machines: dict[Schema, FSM] = {}
        width = 2 * positions + 2
        self.effect: NDArray[np.int32] = np.zeros(0, np.int32)
        self.chance: FloatArray = np.zeros(0)
        self.observation: NDArray[np.int8] = np.zeros((0, width), np.int8)
        self.over: BoolArray = np.zeros(0, bool)
        self.used: IntArray = np.zeros(0, np.int64)
        self.status: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self.state: IntArray = np.zeros(0, np.int64)
        self.unlocked: BoolArray = np.zeros(0, bool)
        self.opened: BoolArray = np.zeros(0, bool)
        self.solution: IntArray = np.zeros(0, np.int64)
        self.on_path: BoolArray = np.zeros(0, bool)
        self.listed: IntArray = np.zeros(0, np.int64)
        self.column: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self.shift: IntArray = np.zeros(0, np.int64)
        self.begun: BoolArray = np.zeros((0, 0), bool)
        self.room: IntArray = np.zeros(0, np.int64)
        self.start: IntArray = np.zeros(0, np.int64)
        self.solutions: IntArray = np.zeros(0, np.int64)
        self.action_limit: IntArray = np.zeros(0, np.int64)
        self.twin: IntArray = np.zeros(0, np.int64)

    @property
    def rows(self) -> int:
        """Number of rows, R."""
        return len(self.over)

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take."""
        return sum(held.nbytes for held in vars(self).values() if isinstance(held, np.ndarray))

    def rows_of(self, room: int) -> slice:
        """The rows of a room."""
        first = int(self.start[room])
        return slice(first, first + len(self._attempts[room].state))

    def add(self, rooms: list[tuple[Schema, Layout, int]]) -> IntArray:
        """Stack rooms that are not there yet.

        Args:
            rooms: Schema, layout and action limit of each.

        Returns:
            ``[len(rooms)]`` index of each room in :attr:`rooms`.

        Raises:
            ValueError: If a layout is of another room or schema, or an attempt longer than 63.
        """
        for schema, layout, limit in rooms:
            if layout.positions != self.positions:
                raise ValueError(f"{layout} is not of a room of {self.positions} positions")
            if len(layout.places) != len(schema.levers):
                raise ValueError(f"{layout} does not place the levers of {schema}")
            if not 0 < limit <= ACTIONS_LEFT:
                raise ValueError(f"an attempt has 1 to {ACTIONS_LEFT} actions, not {limit}")
        keys: list[RoomKey] = [(schema, layout.places, limit) for schema, layout, limit in rooms]
        new: list[tuple[RoomKey, Layout]] = []
        for key, (_, layout, _) in zip(keys, rooms, strict=True):
            if key not in self._index:
                self._index[key] = len(self._index)
                new.append((key, layout))
        if new:
            self._stack(new)
        return np.array([self._index[key] for key in keys], dtype=np.int64)

    def _stack(self, new: list[tuple[RoomKey, Layout]]) -> None:
        since, first, listed = len(self.rooms), self.rows, len(self.begun)
        starts, twins, shifts, columns = [], [], [], []
        for (schema, _, limit), layout in new:
            room = len(self.rooms)
            twin, first_listed = self._twins.setdefault((schema, limit), (room, listed))
            if twin < room:
                attempt = self._attempts[twin]
            else:
                if schema not in self._machines:
                    self._machines[schema] = compile_schema(schema)
                attempt = unroll(self._machines[schema], limit)
                listed += len(attempt.state)
            self._attempts.append(attempt)
            shifts.append(first_listed - first)
            self.rooms.append(Room(attempt.fsm, layout))
            columns.append(_same_columns(self.rooms[twin].layout, layout))
            starts.append(first)
            twins.append(twin)
            first += len(attempt.state)
        solutions = [len(schema.solutions) for (schema, *_), _ in new]
        limits = [limit for (*_, limit), _ in new]
        self.start = np.concatenate([self.start, starts])
        self.twin = np.concatenate([self.twin, twins])
        self.shift = np.concatenate([self.shift, shifts])
        self.column = np.concatenate([self.column, *columns])
        self.solutions = np.concatenate([self.solutions, solutions])
        self.action_limit = np.concatenate([self.action_limit, limits])
        self.stochastic |= not all(schema.deterministic for (schema, *_), _ in new)
        everyone = range(since, len(self.rooms))
        for name, part in _PARTS.items():
            self._extend(name, part, everyone, first)
        heads = [room for room in everyone if self.twin[room] == room]
        if heads:
            most = int(self.solutions.max())
            begins = [self.begun, *(self._attempts[room].begins for room in heads)]
            self.begun = np.concatenate([_widen(part, most) for part in begins])
            self._extend("effect", _effect, heads, listed * self.columns)
        if self.stochastic:
            # With the first room that leaves something to chance, those before get chances too.
            if not len(self.chance):
                heads = [room for room in range(len(self.rooms)) if self.twin[room] == room]
            self._extend("chance", _chance, heads, listed * self.columns)

    def _extend(self, name: str, part: Part, rooms: Iterable[int], length: int) -> None:
        """Lengthen an array by the parts of some rooms.

        One array after the other and one room after the other: parts can be large.
        """
        kept = getattr(self, name)
        grown = np.empty((length, *kept.shape[1:]), kept.dtype)
        grown[: len(kept)] = kept
        filled = len(kept)
        for room in rooms:
            added = part(self, room)
            grown[filled : filled + len(added)] = added
            filled += len(added)
        setattr(self, name, grown)

    def choice(self, row: IntArray, action: IntArray) -> IntArray:
        """``[B]`` where :attr:`effect` and :attr:`chance` say what B actions do at B rows."""
        column = self.column[self.room[row] * self.columns + action]
        return self.listed[row] * self.columns + column

    def after(self, row: IntArray, action: IntArray) -> IntArray:
        """``[B]`` the row after each of B actions at B rows, if it takes effect."""
        return self.effect[self.choice(row, action)] - self.shift[self.room[row]]

    def begins(self, row: IntArray) -> BoolArray:
        """``[B, K]`` whether the actions so far, at B rows, begin solution *k*."""
        return self.begun.take(self.listed.take(row), axis=0)


# What a room contributes to each array.
Part = Callable[[RoomTables, int], Any]


def _status(attempt: Attempt) -> NDArray[np.uint8]:
    fsm, state = attempt.fsm, attempt.state
    left = np.where(attempt.over, 0, attempt.action_limit - attempt.used).astype(np.uint8)
    return left | UNLOCKED * fsm.unlocked[state] | OPENED * fsm.opened[state]


def _of_attempt(tell: Callable[[Attempt], Any]) -> Part:
    return lambda tables, room: tell(tables._attempts[room])


def _effect(tables: RoomTables, room: int) -> NDArray[np.int32]:
    attempt = tables._attempts[room]
    effect = np.where(attempt.over[:, None], 0, attempt.effect).astype(np.int32)
    actions = effect[:, tables.rooms[room].layout.role_actions()]
    waits = np.arange(len(effect), dtype=np.int32)
    first = np.int32(tables.listed[tables.start[room]])
    return (np.column_stack([actions, effect[:, -1], waits]) + first).ravel()


def _chance(tables: RoomTables, room: int) -> FloatArray:
    chance = tables._attempts[room].chance[:, tables.rooms[room].layout.role_actions()]
    return np.pad(chance, ((0, 0), (0, 2))).ravel()


def _observation(tables: RoomTables, room: int) -> NDArray[np.int8]:
    attempt = tables._attempts[room]
    return tables.rooms[room].layout.observations(attempt.fsm, attempt.state)


_PARTS: dict[str, Part] = {
    "observation": _observation,
    "over": _of_attempt(lambda attempt: attempt.over),
    "used": _of_attempt(lambda attempt: attempt.used),
    "status": _of_attempt(_status),
    "state": _of_attempt(lambda attempt: attempt.state),
    "unlocked": _of_attempt(lambda attempt: attempt.fsm.unlocked[attempt.state]),
    "opened": _of_attempt(lambda attempt: attempt.fsm.opened[attempt.state]),
    "solution": _of_attempt(lambda attempt: attempt.fsm.solution[attempt.state]),
    "on_path": _of_attempt(lambda attempt: attempt.begins.any(axis=1)),
    "listed": lambda tables, room: (
        np.arange(len(tables._attempts[room].state)) + tables.start[room] + tables.shift[room]
    ),
    "room": lambda tables, room: np.full(len(tables._attempts[room].state), room),
}


def _same_columns(there: Layout, here: Layout) -> NDArray[np.uint8]:
    """``[W]`` for each action here, one there aimed at the same lever, or at an inactive one."""
    roles = there.role_actions()
    action_of = np.zeros(roles.max() + 2, dtype=np.int64)
    action_of[roles] = np.arange(len(roles))
    failed = len(roles)
    return np.append(action_of[here.role_actions()], [failed, failed + 1]).astype(np.uint8)


def _widen(begins: BoolArray, width: int) -> BoolArray:
    padded = np.zeros((len(begins), width), dtype=bool)
    padded[:, : begins.shape[1]] = begins
    return padded
