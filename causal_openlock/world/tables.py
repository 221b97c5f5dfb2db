"""Many rooms as one table: the hot path.

Every environment and every session steps rooms by the same gather. :class:`RoomTables` stacks the
unrolled attempts of all rooms in use (:func:`causal_openlock.world.fsm.unroll`), re-indexed by
position, into flat arrays. A room at some moment of an attempt is then a single integer, its *row*,
and one step of B rooms is one gather at ``row * A + action``: what is seen, what is unlocked, and
whether the attempt is over are further gathers by the new row.

A room takes ``8 * A`` bytes a row for where actions lead and little else. That is 4 kB for the
paper's rooms and 9 MB for twelve free levers in attempts of thirteen actions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
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
STATUS_BITS = 8


@dataclass(frozen=True)
class RoomKey:
    """What tells two stacked rooms apart."""

    schema: Schema
    places: tuple[int, ...]
    action_limit: int


class RoomTables:
    """Stacked tables of rooms with the same number of positions.

    R rows (a room's moments of an attempt), P positions, A = 2P + 1 actions, G rooms, K solutions
    of the room that has most.

    Args:
        positions: P.

    Attributes:
        chance: ``[R * A]`` the probability that an action takes effect; empty as long as no room
            leaves anything to chance.
        idle: ``[R]`` the row after an action that moves nothing; where the attempt is over, the
            room is put back to its start.
        observation: ``[R, 2P + 2]`` what is seen, int8.
        over: ``[R]`` whether the attempt is over.
        used: ``[R]`` actions used so far in the attempt.
        status: ``[R]`` what a step has to know at once, in one byte: the actions left (0 if the
            attempt is over) plus :data:`UNLOCKED`, plus :data:`OPENED` where it is that too.
        state: ``[R]`` state of the room's machine.
        unlocked: ``[R]`` whether the door is unlocked.
        opened: ``[R]`` whether the door is open.
        solution: ``[R]`` which solution is pushed, -1 for none.
        on_path: ``[R]`` whether the actions so far are the beginning of some solution.
        room: ``[R]`` index of the room.
        start: ``[G]`` the row at which each room's attempts begin.
        solutions: ``[G]`` how many solutions each room has.
        action_limit: ``[G]`` how many actions an attempt has in each room.
        twin: ``[G]`` the first room of the same schema and action limit: its rows are the same,
            in the same order, and only its levers stand elsewhere.
        rooms: The rooms themselves.
        stochastic: Whether any room leaves something to chance.
    """

    def __init__(self, positions: int) -> None:
        self.positions = positions
        self.actions = 2 * positions + 1
        self.rooms: list[Room] = []
        self.stochastic = False
        self._index: dict[RoomKey, int] = {}
        self._twins: dict[tuple[Schema, int], int] = {}
        self._attempts: list[Attempt] = []  # of each room; twins share one
        self._machines: dict[Schema, FSM] = {}
        width = 2 * positions + 2
        self.chance: FloatArray = np.zeros(0)
        self.idle: IntArray = np.zeros(0, np.int64)
        self.observation: NDArray[np.int8] = np.zeros((0, width), np.int8)
        self.over: BoolArray = np.zeros(0, bool)
        self.used: IntArray = np.zeros(0, np.int64)
        self.status: NDArray[np.uint8] = np.zeros(0, np.uint8)
        # [R * A] the row after an action that takes effect and the status there in one number, so
        # that one gather finds both. Where the attempt is over, any action leads to the start.
        self._leads: IntArray = np.zeros(0, np.int64)
        self.state: IntArray = np.zeros(0, np.int64)
        self.unlocked: BoolArray = np.zeros(0, bool)
        self.opened: BoolArray = np.zeros(0, bool)
        self.solution: IntArray = np.zeros(0, np.int64)
        self.on_path: BoolArray = np.zeros(0, bool)
        # [R] where each row's line of _begins is: there can be hundreds of solutions, so twins
        # share theirs.
        self._line: IntArray = np.zeros(0, np.int64)
        self._begins: BoolArray = np.zeros((0, 0), bool)
        self._first_line: list[int] = []  # of each room
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
        keys = [RoomKey(schema, layout.places, limit) for schema, layout, limit in rooms]
        new: list[tuple[RoomKey, Layout]] = []
        for key, (_, layout, _) in zip(keys, rooms, strict=True):
            if key not in self._index:
                self._index[key] = len(self._index)
                new.append((key, layout))
        if new:
            self._stack(new)
        return np.array([self._index[key] for key in keys], dtype=np.int64)

    def _stack(self, new: list[tuple[RoomKey, Layout]]) -> None:
        since, first, lines = len(self.rooms), self.rows, len(self._begins)
        starts, twins, begins = [], [], [self._begins]
        for key, layout in new:
            twin = self._twins.setdefault((key.schema, key.action_limit), len(self.rooms))
            if twin < len(self.rooms):
                attempt = self._attempts[twin]
                self._first_line.append(self._first_line[twin])
            else:
                attempt = self._unrolled(key)
                self._first_line.append(lines)
                begins.append(attempt.begins)
                lines += len(attempt.begins)
            self._attempts.append(attempt)
            self.rooms.append(Room(attempt.fsm, layout))
            starts.append(first)
            twins.append(twin)
            first += len(attempt.state)
        solutions = [len(key.schema.solutions) for key, _ in new]
        limits = [key.action_limit for key, _ in new]
        self.start = np.concatenate([self.start, starts])
        self.twin = np.concatenate([self.twin, twins])
        self.solutions = np.concatenate([self.solutions, solutions])
        self.action_limit = np.concatenate([self.action_limit, limits])
        self.stochastic |= not all(key.schema.deterministic for key, _ in new)
        if len(begins) > 1:
            most = int(self.solutions.max())
            self._begins = np.concatenate([_widen(part, most) for part in begins])
        for name, part in _PARTS.items():
            self._extend(name, part, since)
        self._extend("_leads", _leads, since, self.actions)
        if self.stochastic:
            # The first room that leaves something to chance asks it of those before, too.
            self._extend("chance", _chance, since if len(self.chance) else 0, self.actions)

    def _unrolled(self, key: RoomKey) -> Attempt:
        if key.schema not in self._machines:
            self._machines[key.schema] = compile_schema(key.schema)
        return unroll(self._machines[key.schema], key.action_limit)

    def _extend(self, name: str, part: Part, since: int, each: int = 1) -> None:
        """Lengthen an array by the parts of the rooms from ``since`` on, ``each`` values a row.

        One array after the other and one room after the other: parts can be large.
        """
        kept = getattr(self, name)
        rows = self.rows_of(len(self.rooms) - 1).stop
        grown = np.empty((rows * each, *kept.shape[1:]), kept.dtype)
        grown[: len(kept)] = kept
        for room in range(since, len(self.rooms)):
            mine = self.rows_of(room)
            grown[mine.start * each : mine.stop * each] = part(self, room)
        setattr(self, name, grown)

    def begins(self, row: IntArray) -> BoolArray:
        """``[B, K]`` whether the actions so far, at B rows, begin solution *k*."""
        return self._begins.take(self._line.take(row), axis=0)

    def effect(self, choice: IntArray) -> IntArray:
        """``[B]`` the rows after actions that take effect.

        Args:
            choice: ``[B]`` what is done where, from :meth:`choice`.
        """
        led: IntArray = self._leads.take(choice) >> STATUS_BITS
        return led

    def choice(self, row: IntArray, action: IntArray) -> IntArray:
        """``[B]`` index of an action at a row into everything that is ``[R * A]``."""
        choice = row * self.actions
        choice += action
        return choice

    def step(
        self, choice: IntArray, luck: FloatArray | None = None
    ) -> tuple[IntArray, NDArray[np.uint8]]:
        """Take one action in each of B rooms.

        Args:
            choice: ``[B]`` what is done where, from :meth:`choice`.
            luck: ``[B]`` uniform numbers in [0, 1), needed where a room leaves something to
                chance: the action takes effect if its chance is above the number.

        Returns:
            ``[B]`` the row of each room then, and ``[B]`` its :attr:`status`.
        """
        after: IntArray = self._leads.take(choice)
        status = after.astype(np.uint8)
        after >>= STATUS_BITS
        if self.stochastic:
            if luck is None:
                raise ValueError("these rooms leave something to chance; pass luck")
            chance = self.chance.take(choice)
            fails = np.flatnonzero((luck >= chance) & (chance > 0.0))
            after[fails] = self.idle.take(choice[fails] // self.actions)
            status[fails] = self.status.take(after[fails])
        return after, status


# What a room contributes to each array.
Part = Callable[[RoomTables, int], Any]


def _status(attempt: Attempt) -> NDArray[np.uint8]:
    fsm, state = attempt.fsm, attempt.state
    left = np.where(attempt.over, 0, attempt.action_limit - attempt.used).astype(np.uint8)
    return left | UNLOCKED * fsm.unlocked[state] | OPENED * fsm.opened[state]


def _of_attempt(tell: Callable[[Attempt], Any]) -> Part:
    return lambda tables, room: tell(tables._attempts[room])


def _leads(tables: RoomTables, room: int) -> IntArray:
    attempt = tables._attempts[room]
    effect = np.where(attempt.over[:, None], 0, attempt.effect)
    leads = effect << STATUS_BITS | _status(attempt)[effect]
    leads += tables.start[room] << STATUS_BITS
    return leads[:, tables.rooms[room].layout.role_actions()].ravel()


def _chance(tables: RoomTables, room: int) -> FloatArray:
    chance = tables._attempts[room].chance
    return chance[:, tables.rooms[room].layout.role_actions()].ravel()


def _idle(tables: RoomTables, room: int) -> IntArray:
    attempt = tables._attempts[room]
    return np.where(attempt.over, 0, attempt.effect[:, -1]) + tables.start[room]


def _observation(tables: RoomTables, room: int) -> NDArray[np.int8]:
    attempt = tables._attempts[room]
    return tables.rooms[room].layout.observations(attempt.fsm, attempt.state)


_PARTS: dict[str, Part] = {
    "idle": _idle,
    "observation": _observation,
    "over": _of_attempt(lambda attempt: attempt.over),
    "used": _of_attempt(lambda attempt: attempt.used),
    "status": _of_attempt(_status),
    "state": _of_attempt(lambda attempt: attempt.state),
    "unlocked": _of_attempt(lambda attempt: attempt.fsm.unlocked[attempt.state]),
    "opened": _of_attempt(lambda attempt: attempt.fsm.opened[attempt.state]),
    "solution": _of_attempt(lambda attempt: attempt.fsm.solution[attempt.state]),
    "on_path": _of_attempt(lambda attempt: attempt.begins.any(axis=1)),
    "_line": lambda tables, room: (
        tables._first_line[room] + np.arange(len(tables._attempts[room].state))
    ),
    "room": lambda tables, room: room,
}


def _widen(begins: BoolArray, width: int) -> BoolArray:
    padded = np.zeros((len(begins), width), dtype=bool)
    padded[:, : begins.shape[1]] = begins
    return padded
