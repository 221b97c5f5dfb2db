"""Many rooms as one table, so that environments and sessions step them by lookups.

:class:`RoomTables` stacks the unrolled attempts of all rooms in use
(:func:`causal_openlock.schemas.fsm.unroll`), re-indexed by position, into flat arrays. So the
situation of a room in an attempt is a single integer, its *row*. The observation, whether the door
is unlocked, and whether the attempt is over are looked up by row
(:mod:`causal_openlock.world.batch`).

The effects of actions do not depend on the positions of the levers. So rooms with the same schema
and action limit share one *list* of effects, which stays in the processor's first-level cache
however many layouts there are: ``4 * W`` bytes a row, 3 kB for the paper's schemas, 5 MB for twelve
free levers in attempts of thirteen actions.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import (
    FSM,
    Attempt,
    BoolArray,
    FloatArray,
    IntArray,
    compile_schema,
    unroll,
)
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout, Room

UNLOCKED, OPENED, ACTIONS_LEFT = np.uint8(64), np.uint8(128), np.uint8(63)
"""Bits of :attr:`RoomTables.status`: from UNLOCKED up it is unlocked, from OPENED up open."""
LISTED, OVER, STATUS = np.uint32((1 << 23) - 1), np.uint32(1 << 23), np.uint32(24)
"""Parts of a word (:meth:`RoomTables.words`): the bits of a listed row, the bit for the end of the
attempt, and the first bit of the status."""
WITH_UNLOCKED, WITH_OPENED = int(UNLOCKED) << 24, int(OPENED) << 24
"""Words from these up are those of an unlocked and of an open door."""
RoomKey = tuple[Schema, tuple[int, ...], int]
"""Identifies a stacked room: the schema, the places of its levers, the action limit."""


class RoomTables:
    """Stacked tables of rooms with the same number of positions.

    R rows, M listed rows (those of the first room of each schema and action limit), P positions,
    A = 2P + 1 actions, W = A + 2 columns, G rooms, K solutions of the room with the most. The
    columns are the actions, then :attr:`failed`, an action that had a chance and moved nothing, and
    :attr:`wait`, no action at all.

    Args:
        positions: P.

    Attributes:
        effect: ``[M * W]`` the listed row after an action that takes effect; where the attempt is
            over, any action resets the room.
        chance: ``[M * W]`` the probability that an action takes effect; empty as long as all rooms
            are deterministic.
        listed: ``[R]`` the listed row of each row.
        column: ``[G * W]`` for each column of each room, the one of the same lever in its list.
        shift: ``[G]`` what to add to a row of each room to get its listed row.
        observation: ``[R, 2P + 2]`` the observation, int8.
        over: ``[R]`` whether the attempt is over.
        used: ``[R]`` actions used so far in the attempt.
        status: ``[R]`` the actions left (0 if the attempt is over), plus :data:`UNLOCKED` if the
            door is unlocked, plus :data:`OPENED` if it is open, in one byte.
        state: ``[R]`` state of the room's machine.
        unlocked: ``[R]`` whether the door is unlocked.
        opened: ``[R]`` whether the door is open.
        solution: ``[R]`` the solution whose levers are pushed, -1 for none.
        on_path: ``[R]`` whether the actions so far are the beginning of some solution.
        begun: ``[M, K]`` whether the actions so far are the beginning of solution *k*.
        room: ``[R]`` index of the room.
        start: ``[G]`` the first row of each room, where its attempts begin.
        solutions: ``[G]`` how many solutions each room has.
        action_limit: ``[G]`` how many actions an attempt has in each room.
        twin: ``[G]`` the first room of the same schema and action limit: its rows are listed, and
            are the same in the same order except for the positions of the levers.
        rooms: The rooms themselves.
        stochastic: Whether any room has actions that can fail by chance.

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
        """Size of the arrays in bytes."""
        return sum(held.nbytes for held in vars(self).values() if isinstance(held, np.ndarray))

    def rows_of(self, room: int) -> slice:
        """The rows of a room."""
        first = int(self.start[room])
        return slice(first, first + len(self._attempts[room].state))

    def add(self, rooms: list[tuple[Schema, Layout, int]]) -> IntArray:
        """Stack those of some rooms that are not stacked yet.

        Args:
            rooms: Schema, layout and action limit of each.

        Returns:
            ``[len(rooms)]`` index of each room in :attr:`rooms`.

        Raises:
            ValueError: If a layout does not fit, or an attempt has more than 63 actions.
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
            same = layout.actions_in(self.rooms[twin].layout)
            columns.append(np.append(same, [self.failed, self.wait]).astype(np.uint8))
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
        added = range(since, len(self.rooms))
        attempts = self._attempts[since:]
        for name, parts in {
            "observation": (
                self.rooms[room].layout.observations(attempt.fsm, attempt.state)
                for room, attempt in zip(added, attempts, strict=True)
            ),
            "over": (attempt.over for attempt in attempts),
            "used": (attempt.used for attempt in attempts),
            "status": (_status(attempt) for attempt in attempts),
            "state": (attempt.state for attempt in attempts),
            "unlocked": (attempt.fsm.unlocked[attempt.state] for attempt in attempts),
            "opened": (attempt.fsm.opened[attempt.state] for attempt in attempts),
            "solution": (attempt.fsm.solution[attempt.state] for attempt in attempts),
            "on_path": (attempt.begins.any(axis=1) for attempt in attempts),
            "listed": (self._rows(room) + self.shift[room] for room in added),
            "room": (np.full(len(self._rows(room)), room) for room in added),
        }.items():
            self._extend(name, parts, first)
        heads = [room for room in added if self.twin[room] == room]
        if heads:
            most = int(self.solutions.max())
            begins = [self.begun, *(self._attempts[room].begins for room in heads)]
            wide = [np.pad(part, ((0, 0), (0, most - part.shape[1]))) for part in begins]
            self.begun = np.concatenate(wide)
            self._extend("effect", map(self._effect, heads), listed * self.columns)
        if self.stochastic:
            # With the first room that is not deterministic, those before get chances too.
            if not len(self.chance):
                heads = [room for room in range(len(self.rooms)) if self.twin[room] == room]
            self._extend("chance", map(self._chance, heads), listed * self.columns)

    def _extend(self, name: str, parts: Iterable[Any], length: int) -> None:
        """Extend an array by the part of each room; only one part at a time is in memory."""
        kept = getattr(self, name)
        grown = np.empty((length, *kept.shape[1:]), kept.dtype)
        grown[: len(kept)] = kept
        filled = len(kept)
        for part in parts:
            grown[filled : filled + len(part)] = part
            filled += len(part)
        setattr(self, name, grown)

    def _rows(self, room: int) -> IntArray:
        rows = self.rows_of(room)
        return np.arange(rows.start, rows.stop)

    def _effect(self, room: int) -> NDArray[np.int32]:
        attempt = self._attempts[room]
        effect = np.where(attempt.over[:, None], 0, attempt.effect).astype(np.int32)
        actions = effect[:, self.rooms[room].layout.role_actions()]
        waits = np.arange(len(effect), dtype=np.int32)
        first = np.int32(self.start[room] + self.shift[room])
        return (np.column_stack([actions, effect[:, -1], waits]) + first).ravel()

    def _chance(self, room: int) -> FloatArray:
        chance = self._attempts[room].chance[:, self.rooms[room].layout.role_actions()]
        return np.pad(chance, ((0, 0), (0, 2))).ravel()

    def choice(self, row: IntArray, action: IntArray) -> IntArray:
        """``[B]`` index into :attr:`effect` and :attr:`chance` of B actions at B rows."""
        column = self.column[self.room[row] * self.columns + action]
        return self.listed[row] * self.columns + column

    def after(self, row: IntArray, action: IntArray) -> IntArray:
        """``[B]`` the row after each of B actions at B rows, if it takes effect."""
        return self.effect[self.choice(row, action)] - self.shift[self.room[row]]

    def words(self, put_back: bool) -> NDArray[np.uint32]:
        """``[M * W]`` where each action leads, in one word that a step looks up.

        A word has the listed row of the next action, whether the attempt is over, the actions left
        at that row, and whether the action left the door unlocked and open.

        Args:
            put_back: Whether the room is reset where the attempt is over.

        Raises:
            ValueError: If there are more than 2 ** 23 listed rows.
        """
        if len(self.begun) > LISTED:
            raise ValueError(f"rooms have {len(self.begun):,} rows in all, more than {LISTED:,}")
        status = self.by_listed(self.status)
        over = (status & ACTIONS_LEFT == 0)[self.effect]
        # Any action resets a room whose attempt is over, also the first.
        then = np.where(over & put_back, self.effect[self.effect * self.columns], self.effect)
        bits = (status[self.effect] & ~ACTIONS_LEFT) | (status[then] & ACTIONS_LEFT)
        return then.astype(np.uint32) | OVER * over | bits.astype(np.uint32) << STATUS

    def by_listed(self, by_row: NDArray[Any]) -> NDArray[Any]:
        """``[M]`` of what every row has, ``[R]``, and rooms of one list have in common."""
        found = np.zeros(len(self.begun), by_row.dtype)
        found[self.listed] = by_row
        return found

    def begins(self, row: IntArray) -> BoolArray:
        """``[B, K]`` whether the actions so far, at B rows, are the beginning of solution *k*."""
        return self.begun.take(self.listed.take(row), axis=0)


def _status(attempt: Attempt) -> NDArray[np.uint8]:
    fsm, state = attempt.fsm, attempt.state
    left = np.where(attempt.over, 0, attempt.action_limit - attempt.used).astype(np.uint8)
    return left | UNLOCKED * fsm.unlocked[state] | OPENED * fsm.opened[state]
