"""A reward over the tables of all rooms: what makes rewards as fast as a gather.

Almost every reward is a function of the row and the action alone, so it is evaluated once for each
and looked up. Only where the action before, the solutions found before or luck make a difference
is the reward function asked again, for those subjects alone.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from causal_openlock.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.rewards import Events, RewardFunction
from causal_openlock.tables import RoomTables


class RewardTable:
    """The rewards of one reward function in the rooms of some tables.

    Args:
        reward: The reward function.
        tables: The rooms; those added later are taken in when they are first needed.
    """

    def __init__(self, reward: RewardFunction, tables: RoomTables) -> None:
        self.reward = reward
        self.tables = tables
        self._rows = 0

    def table(self) -> FloatArray:
        """``[R * A]`` the reward of every action that takes effect, with nothing gone before."""
        if self._rows < self.tables.rows:
            self._fill()
        return self._paid

    def _fill(self) -> None:
        """Evaluate the reward for every row and action."""
        tables = self.tables
        row, action = np.divmod(np.arange(tables.rows * tables.actions), tables.actions)
        self._events = Events.of(tables, row, action, tables.effect)
        self._paid = self.reward.pay(self._events)
        # Does it matter here what was found before? Ask for the other extreme and compare.
        events = replace(
            self._events,
            new=np.zeros(len(row), dtype=bool),
            retraced=self._events.on_path,
            found=np.ones(len(row), dtype=np.int64),
        )
        more = replace(self._events, found=np.ones(len(row), dtype=np.int64))
        self._heeds = (self.reward.pay(events) != self._paid) | (
            self.reward.pay(more) != self._paid
        )
        self._paid[tables.over[row]] = 0.0  # putting a room back pays nothing
        self._rows = tables.rows

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
        again = experienced
        if len(again):
            again = again[self._heeds[choice[again]]]
        if reward.heeds_repeats:
            again = np.union1d(again, np.flatnonzero(choice % tables.actions == previous))
        if tables.stochastic:
            again = np.union1d(again, np.flatnonzero(after != tables.effect.take(choice)))
        if len(again):
            choice, after = choice[again], after[again]
            row, action = np.divmod(choice, tables.actions)
            if tables.stochastic:
                events = Events.of(tables, row, action, after)
            else:
                events = self._events.at(choice)
            events = events.with_history(tables, after, action == previous[again], found[again])
            paid[again] = np.where(tables.over[row], 0.0, reward.pay(events))
        return paid
