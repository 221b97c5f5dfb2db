"""A reward over the tables of all rooms: what makes rewards as fast as a gather.

Almost every reward is a function of the row and the action alone, so it is evaluated once for each
and looked up. Only where the action before, the solutions found before or luck make a difference
is the reward function asked again, for those subjects alone.

No reward depends on where the levers stand. So it is evaluated for the first room of each schema
and action limit, and the others are told the same of the actions that aim at the same lever.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.rewards import Events, RewardFunction
from causal_openlock.world.room import Layout
from causal_openlock.world.tables import RoomTables

AT_ONCE = 1 << 16
"""How many actions are judged at once: what happened in one takes a few dozen bytes."""


class RewardTable:
    """The rewards of one reward function in the rooms of some tables.

    Args:
        reward: The reward function.
        tables: The rooms; those added later are taken in when they are first needed.
    """

    def __init__(self, reward: RewardFunction, tables: RoomTables) -> None:
        self.reward = reward
        self.tables = tables
        self._rooms = 0
        # [R, A] the reward with nothing gone before, and whether what was found matters to it.
        self._paid: FloatArray = np.zeros((0, tables.actions))
        self._heeds: BoolArray = np.zeros((0, tables.actions), dtype=bool)

    def table(self) -> FloatArray:
        """``[R * A]`` the reward of every action that takes effect, with nothing gone before."""
        if self._rooms < len(self.tables.rooms):
            self._fill()
        return self._paid.reshape(-1)

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take."""
        return self._paid.nbytes + self._heeds.nbytes

    def _fill(self) -> None:
        """Take in the rooms added since the last time."""
        tables = self.tables
        self._paid = _lengthened(self._paid, tables.rows)
        if self.reward.heeds_found:
            self._heeds = _lengthened(self._heeds, tables.rows)
        for room in range(self._rooms, len(tables.rooms)):
            twin, mine = int(tables.twin[room]), tables.rows_of(room)
            if twin == room:
                step = max(1, AT_ONCE // tables.actions)
                for first in range(mine.start, mine.stop, step):
                    self._evaluate(slice(first, min(first + step, mine.stop)))
                continue
            same = _same_actions(tables.rooms[twin].layout, tables.rooms[room].layout)
            self._paid[mine] = self._paid[tables.rows_of(twin)][:, same]
            if self.reward.heeds_found:
                self._heeds[mine] = self._heeds[tables.rows_of(twin)][:, same]
        self._rooms = len(tables.rooms)

    def _evaluate(self, rows: slice) -> None:
        """Ask for the reward of every action at some rows."""
        tables, pay = self.tables, self.reward.pay
        choice = np.arange(rows.start * tables.actions, rows.stop * tables.actions)
        row, action = np.divmod(choice, tables.actions)
        events = Events.of(tables, row, action, tables.effect(choice))
        paid = pay(events)
        shape = (-1, tables.actions)
        if self.reward.heeds_found:
            # Does it matter here what was found before? Ask for the other extreme and compare.
            more = replace(events, found=np.ones(len(row), dtype=np.int64))
            all_of_it = replace(more, new=np.zeros(len(row), dtype=bool), retraced=more.on_path)
            self._heeds[rows] = ((pay(more) != paid) | (pay(all_of_it) != paid)).reshape(shape)
        paid[tables.over[row]] = 0.0  # putting a room back pays nothing
        self._paid[rows] = paid.reshape(shape)

    def pay(
        self,
        choice: IntArray,
        after: IntArray,
        previous: IntArray,
        found: BoolArray,
        experienced: IntArray,
    ) -> FloatArray:
        """``[B]`` the rewards of B actions.

        Args:
            choice: ``[B]`` what was done where, from :meth:`RoomTables.choice`.
            after: ``[B]`` where each room is then.
            previous: ``[B]`` the action before it in the attempt, -1 for none.
            found: ``[B, K]`` which solutions are found already.
            experienced: Indices of the subjects whose door is unlocked then and who have found
                something before: nobody else's reward depends on what was found.
        """
        tables, reward = self.tables, self.reward
        paid: FloatArray = self.table().take(choice)
        again = experienced if reward.heeds_found else _NOBODY
        if reward.heeds_everything:
            again = np.arange(len(choice))
        elif len(again):
            again = again[self._heeds.reshape(-1)[choice[again]]]
        if reward.heeds_repeats:
            again = np.union1d(again, np.flatnonzero(choice % tables.actions == previous))
        if tables.stochastic:
            again = np.union1d(again, np.flatnonzero(after != tables.effect(choice)))
        if len(again):
            row, action = np.divmod(choice[again], tables.actions)
            after = after[again]
            events = Events.of(tables, row, action, after)
            events = events.with_history(tables, after, action == previous[again], found[again])
            paid[again] = np.where(tables.over[row], 0.0, reward.pay(events))
        return paid


_NOBODY: IntArray = np.zeros(0, dtype=np.int64)


def _lengthened(table: NDArray[Any], rows: int) -> NDArray[Any]:
    longer = np.empty((rows, table.shape[1]), table.dtype)
    longer[: len(table)] = table
    return longer


def _same_actions(there: Layout, here: Layout) -> IntArray:
    """``[A]`` for each action here one there that aims at the same lever, or at an inactive one."""
    roles = there.role_actions()
    action_of = np.zeros(roles.max() + 2, dtype=np.int64)
    action_of[roles] = np.arange(len(roles))
    same: IntArray = action_of[here.role_actions()]
    return same
