"""A reward over the tables of all rooms: what makes rewards as fast as a lookup.

Almost every reward is a function of the row and the action alone, so it is evaluated once for each
and looked up. Only where the action before or the solutions found before make a difference is the
reward function evaluated again, for those rooms alone.

No reward depends on where the levers are. So it is evaluated for the first room of each schema and
action limit, and copied to the others for the actions that aim at the same lever.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.reward_events import Events, RewardFunction
from causal_openlock.world.room import Layout
from causal_openlock.world.tables import RoomTables

IF_FOUND, IF_REPEATED, ALWAYS = 1, 2, 4
"""Bits of :attr:`RewardTable.matters`: when the reward may differ from the one in the table."""
AT_ONCE = 1 << 16
"""How many actions are evaluated at once: what happened in one takes a few dozen bytes."""


class RewardTable:
    """The rewards of one reward function in the rooms of some tables; R rows, W columns.

    Args:
        reward: The reward function.
        tables: The rooms; :meth:`fill` takes in those added later.

    Attributes:
        paid: ``[R * W]`` the reward of every action that takes effect, with nothing gone before;
            waiting, and putting a room back, pays nothing.
        matters: ``[R * W]`` what makes a difference to it: solutions found before (``IF_FOUND``),
            the same action as before (``IF_REPEATED``), or anything (``ALWAYS``).

    Example:
        >>> from causal_openlock import Layout, find_schema
        >>> from causal_openlock.world.rewards import find_reward
        >>> tables = RoomTables(positions=7)
        >>> room = tables.add([(find_schema("CC3"), Layout((0, 1, 2)), 3)])
        >>> table = RewardTable(find_reward("state_change"), tables)
        >>> table.paid[:4]  # in the first row, the push of each position's lever
        array([0.5, 0. , 0. , 0. ])
    """

    def __init__(self, reward: RewardFunction, tables: RoomTables) -> None:
        self.reward = reward
        self.tables = tables
        self._rooms = 0
        self.paid: FloatArray = np.zeros(0)
        self.matters: NDArray[np.uint8] = np.zeros(0, np.uint8)
        self.fill()

    @property
    def nbytes(self) -> int:
        """Bytes that the arrays take."""
        return self.paid.nbytes + self.matters.nbytes

    def fill(self) -> None:
        """Take in the rooms added since the last time."""
        tables = self.tables
        paid = _lengthened(self.paid, tables)
        matters = _lengthened(self.matters, tables)
        self.paid, self.matters = paid.reshape(-1), matters.reshape(-1)
        for room in range(self._rooms, len(tables.rooms)):
            twin, mine = int(tables.twin[room]), tables.rows_of(room)
            if twin == room:
                step = max(1, AT_ONCE // tables.columns)
                for first in range(mine.start, mine.stop, step):
                    rows = slice(first, min(first + step, mine.stop))
                    paid[rows], matters[rows] = self._evaluated(rows)
                continue
            same = _same_columns(tables.rooms[twin].layout, tables.rooms[room].layout)
            for table in (paid, matters):
                table[mine] = table[tables.rows_of(twin)][:, same]
        self._rooms = len(tables.rooms)

    def _evaluated(self, rows: slice) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Rewards at some rows, and what matters there; ``[rows, W]`` each."""
        tables, function = self.tables, self.reward
        row = np.arange(rows.start, rows.stop).repeat(tables.columns)
        action = np.tile(np.arange(tables.columns), rows.stop - rows.start)
        flat = slice(rows.start * tables.columns, rows.stop * tables.columns)
        events = Events.of(tables, row, action, tables.effect[flat].astype(np.int64))
        paid = function.pay(events)
        matters = np.zeros(len(row), np.uint8)
        if function.depends_on_found:
            # Does it matter here what was found before? Try the other extreme and compare.
            more = replace(events, found=np.ones(len(row), dtype=np.int64))
            all_of_it = replace(more, new=np.zeros(len(row), dtype=bool), retraced=more.on_path)
            matters[(function.pay(more) != paid) | (function.pay(all_of_it) != paid)] = IF_FOUND
        if function.depends_on_repeats:
            matters |= IF_REPEATED
        if function.depends_on_everything:
            matters |= ALWAYS
        nothing = tables.over[row] | (action == tables.wait)
        paid[nothing], matters[nothing] = 0.0, 0
        return paid.reshape(-1, tables.columns), matters.reshape(-1, tables.columns)

    def judge(
        self,
        row: IntArray,
        action: IntArray,
        after: IntArray,
        repeated: BoolArray,
        found: BoolArray,
    ) -> FloatArray:
        """``[N]`` the rewards of N actions, given what went before.

        Args:
            row: ``[N]`` where each room was; its attempt was not over.
            action: ``[N]`` what was done.
            after: ``[N]`` where each room is then.
            repeated: ``[N]`` whether the action before it was the same.
            found: ``[N, K]`` which solutions were found already.
        """
        events = Events.of(self.tables, row, action, after)
        return self.reward.pay(events.with_history(self.tables, after, repeated, found))


def _lengthened(table: NDArray[Any], tables: RoomTables) -> NDArray[Any]:
    longer = np.empty(tables.rows * tables.columns, table.dtype)
    longer[: len(table)] = table
    return longer.reshape(-1, tables.columns)


def _same_columns(there: Layout, here: Layout) -> IntArray:
    """``[W]`` for each action here one there that aims at the same lever, or at an inactive one."""
    roles = there.role_actions()
    action_of = np.zeros(roles.max() + 2, dtype=np.int64)
    action_of[roles] = np.arange(len(roles))
    failed = len(roles)
    return np.append(action_of[here.role_actions()], [failed, failed + 1])
