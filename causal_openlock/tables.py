"""Many rooms as one table: the hot path.

Every environment and every session steps rooms by the same gather. :class:`RoomTables` stacks the
unrolled attempts of all rooms in use (:func:`causal_openlock.fsm.unroll`), re-indexed by position,
into flat arrays. A room at some moment of an attempt is then a single integer, its *row*, and one
step of B rooms is ``effect[row * A + action]``: what is seen, what is unlocked, and whether the
attempt is over are further gathers by the new row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causal_openlock.fsm import FSM, Attempt, BoolArray, FloatArray, IntArray, compile, unroll
from causal_openlock.room import Layout, Room
from causal_openlock.schema import Schema

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
        effect: ``[R * A]`` the row after an action that takes effect. Where the attempt is over,
            any action puts the room back to its start.
        chance: ``[R * A]`` the probability that it takes effect.
        idle: ``[R]`` the row after an action that moves nothing, likewise.
        observation: ``[R, 2P + 2]`` what is seen, int8.
        over: ``[R]`` whether the attempt is over.
        used: ``[R]`` actions used so far in the attempt.
        status: ``[R]`` what a step has to know at once, in one byte: the actions left (0 if the
            attempt is over) plus :data:`UNLOCKED`, plus :data:`OPENED` where it is that too.
        state: ``[R]`` state of the room's machine.
        unlocked: ``[R]`` whether the door is unlocked.
        opened: ``[R]`` whether the door is open.
        solution: ``[R]`` which solution is pushed, -1 for none.
        begins: ``[R, K]`` whether the actions so far begin solution *k*.
        room: ``[R]`` index of the room.
        start: ``[G]`` the row at which each room's attempts begin.
        solutions: ``[G]`` how many solutions each room has.
        action_limit: ``[G]`` how many actions an attempt has in each room.
        rooms: The rooms themselves.
        stochastic: Whether any room leaves something to chance.
    """

    def __init__(self, positions: int) -> None:
        self.positions = positions
        self.actions = 2 * positions + 1
        self.rooms: list[Room] = []
        self.stochastic = False
        self._index: dict[RoomKey, int] = {}
        self._attempts: dict[tuple[Schema, int], Attempt] = {}
        self._machines: dict[Schema, FSM] = {}
        width = 2 * positions + 2
        self.effect: IntArray = np.zeros(0, np.int64)
        self.chance: FloatArray = np.zeros(0)
        self.idle: IntArray = np.zeros(0, np.int64)
        self.observation: NDArray[np.int8] = np.zeros((0, width), np.int8)
        self.over: BoolArray = np.zeros(0, bool)
        self.used: IntArray = np.zeros(0, np.int64)
        self.status: NDArray[np.uint8] = np.zeros(0, np.uint8)
        # The row after an action and its status in one number, so that one gather finds both.
        self._leads: IntArray = np.zeros(0, np.int64)
        self.state: IntArray = np.zeros(0, np.int64)
        self.unlocked: BoolArray = np.zeros(0, bool)
        self.opened: BoolArray = np.zeros(0, bool)
        self.solution: IntArray = np.zeros(0, np.int64)
        self.begins: BoolArray = np.zeros((0, 0), bool)
        self.room: IntArray = np.zeros(0, np.int64)
        self.start: IntArray = np.zeros(0, np.int64)
        self.solutions: IntArray = np.zeros(0, np.int64)
        self.action_limit: IntArray = np.zeros(0, np.int64)

    @property
    def rows(self) -> int:
        """Number of rows, R."""
        return len(self.over)

    @property
    def active(self) -> BoolArray:
        """``[R, P]`` whether the lever at each position is active, as its colour shows."""
        return self.observation[:, self.positions : 2 * self.positions] == 1

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
        parts: dict[str, list[NDArray[np.generic]]] = {}
        first = self.rows
        starts, solutions, limits = [], [], []
        for key, layout in new:
            schema = key.schema
            fsm = self._machines.get(schema) or compile(schema)
            self._machines[schema] = fsm
            unrolled_as = (schema, key.action_limit)
            attempt = self._attempts.get(unrolled_as) or unroll(fsm, key.action_limit)
            self._attempts[unrolled_as] = attempt
            columns = layout.role_actions()
            rows = len(attempt.state)
            effect = np.where(attempt.over[:, None], 0, attempt.effect)
            status = _status(attempt)
            leads = first + effect[:, columns] << STATUS_BITS | status[effect[:, columns]]
            for name, part in (
                ("effect", (first + effect[:, columns]).ravel()),
                ("chance", attempt.chance[:, columns].ravel()),
                ("idle", first + effect[:, -1]),
                ("observation", layout.observations(fsm, attempt.state)),
                ("over", attempt.over),
                ("used", attempt.used),
                ("status", status),
                ("_leads", leads.ravel()),
                ("state", attempt.state),
                ("unlocked", fsm.unlocked[attempt.state]),
                ("opened", fsm.opened[attempt.state]),
                ("solution", fsm.solution[attempt.state]),
                ("room", np.full(rows, len(self.rooms))),
            ):
                parts.setdefault(name, []).append(part)
            parts.setdefault("begins", []).append(attempt.begins)
            self.rooms.append(Room(fsm, layout))
            starts.append(first)
            solutions.append(len(schema.solutions))
            limits.append(key.action_limit)
            self.stochastic |= not schema.deterministic
            first += rows
        most = max(self.begins.shape[1], *solutions)
        parts["begins"] = [_widen(part, most) for part in parts["begins"]]
        self.begins = _widen(self.begins, most)
        for name, pieces in parts.items():
            setattr(self, name, np.concatenate([getattr(self, name), *pieces]))
        self.start = np.concatenate([self.start, starts])
        self.solutions = np.concatenate([self.solutions, solutions])
        self.action_limit = np.concatenate([self.action_limit, limits])

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


def _status(attempt: Attempt) -> NDArray[np.uint8]:
    fsm, state = attempt.fsm, attempt.state
    left = np.where(attempt.over, 0, attempt.action_limit - attempt.used).astype(np.uint8)
    return left | UNLOCKED * fsm.unlocked[state] | OPENED * fsm.opened[state]


def _widen(begins: NDArray[np.generic], width: int) -> BoolArray:
    padded = np.zeros((len(begins), width), dtype=bool)
    padded[:, : begins.shape[1]] = begins
    return padded
