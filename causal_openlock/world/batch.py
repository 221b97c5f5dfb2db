"""Many rooms during their trials: the bookkeeping of sessions, environments and meta-training.

An action moves a room to another row of its table and pays a reward. An attempt is over when the
door is open or no action is left. A trial is over when every solution is found or no attempt is
left; then the caller begins another one (:meth:`RoomBatch.begin_trials`).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.files.compiling import direct
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.reward_table import (
    ALWAYS,
    IF_FOUND,
    IF_REPEATED,
    PASTS,
    RewardFunction,
    RewardTable,
)
from causal_openlock.world.tables import LISTED, RoomTables

_ROW, _COUNT, _FLAG = np.dtype(np.int64), np.dtype(np.uint8), np.dtype(np.bool_)
_NO_LUCK: FloatArray = np.zeros(0)
_NO_ROWS: IntArray = np.zeros(0, np.int64)
_UNSEEN: NDArray[np.int8] = np.zeros((0, 16), np.int8)
KEPT_REWARDS = 1 << 20
"""The most rewards that depend on the past to keep in memory: 8 MB."""

KEPT_ARRAYS = 3
"""Spare arrays to keep: results are often held until the next ones are there."""
LARGE = 1 << 15
"""Bytes from which an array is used again: fresh memory for it can cost more than a step."""


class Spare:
    """Arrays of one shape for results, each used again when nobody refers to it any more.

    The operating system hands out large pieces of memory page by page, as they are first written
    to. So a new array of a few hundred kilobytes for each step takes longer than the step.

    Args:
        shape: Their shape.
        dtype: Their type.

    Example:
        >>> spare = Spare((1 << 20,), np.dtype(float))
        >>> first = spare.array()
        >>> second = spare.array()
        >>> np.shares_memory(first, second)
        False
    """

    def __init__(self, shape: tuple[int, ...], dtype: np.dtype[Any]) -> None:
        self._shape, self._dtype = shape, dtype
        self._large = math.prod(shape) * dtype.itemsize >= LARGE
        self._kept: list[NDArray[Any]] = []

    def array(self) -> NDArray[Any]:
        """An array of this shape, with whatever is in it."""
        if not self._large:
            return np.empty(self._shape, self._dtype)
        # What is handed out are views, each of which refers to the array kept here.
        for index in range(len(self._kept)):
            if _references(self._kept, index) == _UNUSED:
                return self._kept[index].view()
        new = np.empty(self._shape, self._dtype)
        self._kept = [new, *self._kept[: KEPT_ARRAYS - 1]]
        return new.view()


def _references(arrays: list[NDArray[Any]], index: int) -> int:
    return sys.getrefcount(arrays[index])


_UNUSED = _references([np.zeros(0)], 0)


class BatchStep(NamedTuple):
    """Results of one action in each of B rooms.

    Attributes:
        after: ``[B]`` the row that the action led to; empty if what is seen was asked for instead.
        actions_left: ``[B]`` actions left then; in the next attempt, if the room was reset.
        reward: ``[B]`` the reward.
        attempt_over: ``[B]`` whether the attempt ended.
        trial_over: ``[B]`` whether the trial ended with it.
        new_solution: ``[B]`` whether it found a solution for the first time in the trial.
        any_attempt_over: Whether any attempt ended.
        any_trial_over: Whether any trial ended.
        any_new_solution: Whether any solution was new.
    """

    after: IntArray
    actions_left: NDArray[np.uint8]
    reward: FloatArray
    attempt_over: BoolArray
    trial_over: BoolArray
    new_solution: BoolArray
    any_attempt_over: bool
    any_trial_over: bool
    any_new_solution: bool


class RoomBatch:
    """B rooms, each somewhere in an attempt and a trial.

    Args:
        tables: The rooms there are; more can be added at any time.
        rewards: Reward functions; each room is paid by one of them.
        size: B.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        put_back: Whether a room is reset as soon as its attempt is over; otherwise its next action
            resets it and does nothing else.

    Attributes:
        room: ``[B]`` index of each room in the tables.
        found: ``[B, K]`` which solutions are found.
        attempt: ``[B]`` number of the attempt, from 1.
        found_count: ``[B]`` solutions found.
        solutions: ``[B]`` solutions of the room.
        previous: ``[B]`` the last action in the attempt, -1 for none; only kept up to date if a
            reward depends on it.
        reward: ``[B]`` index of the reward function.

    Example:
        >>> from causal_openlock import Layout, find_schema
        >>> from causal_openlock.world.rewards import find_reward
        >>> tables = RoomTables(positions=7)
        >>> rooms = tables.add([(find_schema("CC3"), Layout((0, 1, 2)), 3)])
        >>> batch = RoomBatch(tables, [find_reward("basic")], size=1, attempt_limit=30)
        >>> batch.begin_trials([0], rooms)
        >>> [batch.step(np.array([action])).reward.item() for action in (0, 1, 14)]
        [0.0, 10.0, 50.0]
    """

    def __init__(
        self,
        tables: RoomTables,
        rewards: Sequence[RewardFunction],
        size: int,
        attempt_limit: int,
        *,
        stop_when_solved: bool = True,
        put_back: bool = True,
    ) -> None:
        self.attempt_limit = attempt_limit
        self.stop_when_solved = stop_when_solved
        self.put_back = put_back
        self._functions = tuple(rewards)
        self._history = any(one.depends_on_found for one in rewards) * IF_FOUND
        self._history += any(one.depends_on_repeats for one in rewards) * IF_REPEATED
        self.use(tables)
        self.room = np.zeros(size, dtype=np.int64)
        self._at = np.zeros(size, dtype=np.uint32)  # the word of its last action
        self._row: IntArray | None = None
        self.found = np.zeros((size, 0), dtype=bool)
        self._counts = np.zeros((5, size), dtype=np.int64)
        self._name_counts()
        self._judged = np.zeros((5, size), dtype=np.int64)
        self._spare_rewards = Spare((size,), np.dtype(np.float64))

    def _name_counts(self) -> None:
        self.attempt, self.found_count, self.solutions, self.previous, self.reward = self._counts

    def __getstate__(self) -> dict[str, Any]:
        kept = {name: value for name, value in vars(self).items() if name != "_kernel"}
        return kept | {"_rooms": 0}  # so a copy looks for it

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._name_counts()  # a copy's arrays are parts of one another again

    def use(self, tables: RoomTables) -> None:
        """Replace the tables of the rooms."""
        self.tables = tables
        self._rewards = [RewardTable(function, tables) for function in self._functions]
        self._rooms = 0

    @property
    def row(self) -> IntArray:
        """``[B]`` the row of each room in the tables; a new array after every step."""
        if self._row is None:
            self._row = (self._at & LISTED) - self.tables.shift.take(self.room)
        return self._row

    @row.setter
    def row(self, row: IntArray) -> None:
        self._at[:], self._row = self.tables.listed[row], None

    def begin_trials(self, which: IntArray | Sequence[int] | slice, room: IntArray) -> None:
        """Begin a trial for some of the rooms.

        Args:
            which: Indices of n of the B rooms.
            room: ``[n]`` index in the tables of the room of each trial.
        """
        self._widen()
        self.room[which] = room
        self._at[which], self._row = self.tables.listed[self.tables.start[room]], None
        self.found[which] = False
        self.attempt[which] = 1
        self.found_count[which] = 0
        self.solutions[which] = self.tables.solutions[room]
        self.previous[which] = -1

    def _widen(self) -> None:
        """Give :attr:`found` a column for each solution of the room with the most."""
        size, known = self.found.shape
        if (most := int(self.tables.solutions.max(initial=0))) > known:
            self.found = np.hstack([self.found, np.zeros((size, most - known), dtype=bool)])

    def step(
        self,
        action: IntArray,
        luck: FloatArray | None = None,
        seen: NDArray[np.int8] | None = None,
        legal: int | None = None,
    ) -> BatchStep:
        """Take one action in each room.

        Args:
            action: ``[B]`` actions; ``tables.wait`` leaves a room as it is.
            luck: ``[B]`` numbers in [0, 1), needed if ``tables.stochastic``: an action takes effect
                if its chance is above its number.
            seen: ``[B, 2P + 2]`` where to write what is seen at the rows of the next actions.
            legal: Refuse actions that are not from 0 to ``legal`` - 1; by default, what is not a
                column of the tables.

        Raises:
            IndexError: If an action is refused; nothing has changed then.
        """
        tables, size = self.tables, len(self._at)
        if tables.stochastic and luck is None:
            raise ValueError("these rooms are not deterministic; pass luck")
        if self._rooms < len(tables.rooms):
            self._add_rooms()
        if legal is None:
            legal = tables.columns
        if action.dtype is not _ROW or not action.flags.carray:
            action = np.array(action, _ROW)
        after = np.empty(size, _ROW) if seen is None else _NO_ROWS
        reward = self._spare_rewards.array()
        actions_left, attempt_over = np.empty(size, _COUNT), np.empty(size, _FLAG)
        trial_over, new_solution = np.empty(size, _FLAG), np.empty(size, _FLAG)
        ended, finished, found_new, unknown = self._kernel(
            self._at,
            action,
            _NO_LUCK if luck is None else np.ascontiguousarray(luck, float),
            after,
            seen if self._in_words and seen is not None else _UNSEEN,
            actions_left,
            reward,
            attempt_over,
            trial_over,
            new_solution,
            *self._arguments,
            legal,
        )
        self._row = None
        if unknown < 0:
            raise IndexError(f"an action is not from 0 to {legal - 1}")
        if unknown:
            self._judge(unknown, action, new_solution, reward)
        if seen is not None and not self._in_words:
            tables.observation.take(self.row, axis=0, out=seen, mode="clip")
        return BatchStep(
            after,
            actions_left,
            reward,
            attempt_over,
            trial_over,
            new_solution,
            ended,
            finished,
            found_new,
        )

    def _add_rooms(self) -> None:
        from causal_openlock.world.kernel import step

        tables = self.tables
        self._widen()
        for table in self._rewards:
            table.fill()
        paid = np.stack([table.paid for table in self._rewards])
        matters = np.stack([table.matters for table in self._rewards])
        self._in_words = tables.observation.shape[1] == _UNSEEN.shape[1]
        # For each action whose reward depends on the past, a place for each past.
        remembered = (matters > 0) & (matters < ALWAYS)
        each = PASTS * (self.found.shape[1] + 1)
        if remembered.sum() * each > KEPT_REWARDS:
            remembered[:] = False
        case = np.where(remembered, (remembered.cumsum() - 1).reshape(remembered.shape), -1)
        past = 8 * case * np.where(remembered, each, 1) + matters
        self._known = np.full(remembered.sum() * each, np.nan)
        self._rooms = len(tables.rooms)
        self._arguments = (
            self.room,
            tables.shift,
            tables.column,
            np.stack([tables.words(self.put_back), tables.effect.astype(np.uint32)]),
            tables.chance,
            (tables.observation if self._in_words else _UNSEEN).view(np.complex128)[:, 0],
            tables.by_listed(tables.solution),
            tables.begun.view(np.uint8),
            paid,
            past,
            self._known,
            self._counts,
            self.found.view(np.uint8),
            self._judged,
            self.attempt_limit,
            self.stop_when_solved,
            self._history,
        )
        nobody = (np.zeros(0, kind) for kind in (np.uint8, float, bool, bool, bool))
        action, seen = np.zeros(0, _ROW), np.zeros((0, 16), np.int8)
        nothing = self._at[:0], action, _NO_LUCK, _NO_ROWS, seen, *nobody
        self._kernel = direct(step, *nothing, *self._arguments, tables.columns)

    def _judge(self, many: int, action: IntArray, new: BoolArray, reward: FloatArray) -> None:
        """Evaluate the rewards that depend on the past and are not known yet."""
        which, repeated, place, *listed = self._judged[:, :many]
        row, after = (one - self.tables.shift[self.room[which]] for one in listed)
        found = self.found[which]
        fresh = np.flatnonzero(new[which])
        found[fresh, self.tables.solution[after[fresh]]] = False  # before this action
        by = self.reward[which]
        for index, table in enumerate(self._rewards):
            own = np.flatnonzero(by == index)
            rooms = which[own]
            reward[rooms] = table.judge(
                row[own], action[rooms], after[own], repeated[own] == 1, found[own]
            )
        remembered = place >= 0
        self._known[place[remembered]] = reward[which[remembered]]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """The state of every room, for a checkpoint, to be copied from and into; then set `row`."""
        return {"room": self.room, "row": self.row, "found": self.found, "counts": self._counts}
