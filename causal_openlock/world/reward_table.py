"""A reward over the tables of all rooms: what makes rewards as fast as a lookup.

Almost every reward is a function of the row and the action alone, so it is evaluated once for each
and looked up. Only where the action before or the solutions found before make a difference is the
reward function evaluated again, for those rooms alone.

No reward depends on where the levers are, so it is evaluated for the listed rows alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.reward_events import Events, RewardFunction
from causal_openlock.world.tables import RoomTables

IF_FOUND, IF_REPEATED, ALWAYS = 1, 2, 4
"""Bits of :attr:`RewardTable.matters`: when the reward may differ from the one in the table."""
PASTS = 8
"""How many pasts an action can have, given how many solutions are found: whether it repeats the
action before it, is about a solution that is found, retraces one that is found."""
AT_ONCE = 1 << 16
"""How many actions are evaluated at once: what happened in one takes a few dozen bytes."""


class RewardTable:
    """The rewards of one reward function in the rooms of some tables; M listed rows, W columns.

    Args:
        reward: The reward function.
        tables: The rooms; :meth:`fill` takes in those added later.

    Attributes:
        paid: ``[M * W]`` the reward of every action that takes effect, with nothing gone before;
            waiting, and putting a room back, pays nothing.
        matters: ``[M * W]`` what makes a difference to it: solutions found before (``IF_FOUND``),
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
        parts = [(self.paid, self.matters)]
        step = max(1, AT_ONCE // tables.columns)
        for room in range(self._rooms, len(tables.rooms)):
            if tables.twin[room] == room:
                mine = tables.rows_of(room)
                for first in range(mine.start, mine.stop, step):
                    parts.append(self._evaluated(np.arange(first, min(first + step, mine.stop))))
        self.paid, self.matters = (np.concatenate(part) for part in zip(*parts, strict=True))
        self._rooms = len(tables.rooms)

    def _evaluated(self, rows: IntArray) -> tuple[FloatArray, NDArray[np.uint8]]:
        """Rewards at some rows, and what matters there; ``[rows * W]`` each."""
        tables, function = self.tables, self.reward
        row = rows.repeat(tables.columns)
        action = np.tile(np.arange(tables.columns), len(rows))
        events = Events.of(tables, row, action, tables.after(row, action))
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
        return paid, matters

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
