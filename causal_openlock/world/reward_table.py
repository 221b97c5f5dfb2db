"""Events of actions, their rewards, and rewards as a table.

A reward (:mod:`causal_openlock.world.rewards`) is a function of :class:`Events`, for many actions
at once. Almost every reward depends on the row and the action alone, so :class:`RewardTable`
evaluates it once for each and looks it up. The function is evaluated again only where the action
before or the solutions found before make a difference.

No reward depends on where the levers are, so only the listed rows are evaluated.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.tables import RoomTables

IF_FOUND, IF_REPEATED, ALWAYS = 1, 2, 4
"""Bits of :attr:`RewardTable.matters`: when the reward may differ from the one in the table."""
PASTS = 8
"""Pasts that an action can have for each number of solutions found: whether it repeats the action
before it, whether its solution is already found, whether it retraces one already found."""
AT_ONCE = 1 << 16
"""Actions evaluated at once: the events of each take a few dozen bytes."""


@dataclass(frozen=True)
class Events:
    """Events of N actions; every field is ``[N]``.

    Attributes:
        first: It was the attempt's first action.
        last: The attempt is over.
        inactive: It was aimed at an inactive lever.
        changed: Something moved, so the observation changed.
        unlocks: It unlocked the door.
        unlocked: The door is unlocked now.
        opens: It opened the door.
        on_path: The attempt's actions so far are the beginning of a solution, or all of it.
        repeated: It was the same action as the one before it in the attempt.
        new: The levers of a solution are pushed that is not yet found in this trial.
        retraced: The attempt's actions so far are the beginning of a solution already found.
        found: Solutions found in earlier attempts of the trial.

    Example:
        >>> from causal_openlock import Layout, find_schema
        >>> tables = RoomTables(positions=7)
        >>> room = tables.add([(find_schema("CC3"), Layout((0, 1, 2)), 3)])
        >>> start = tables.start[room]
        >>> push = np.array([0])  # the lever at position 0
        >>> Events.of(tables, start, push, tables.effect[tables.choice(start, push)]).on_path
        array([ True])
    """

    first: BoolArray
    last: BoolArray
    inactive: BoolArray
    changed: BoolArray
    unlocks: BoolArray
    unlocked: BoolArray
    opens: BoolArray
    on_path: BoolArray
    repeated: BoolArray
    new: BoolArray
    retraced: BoolArray
    found: IntArray

    @classmethod
    def of(cls, tables: RoomTables, row: IntArray, action: IntArray, after: IntArray) -> Events:
        """Look up what N actions led to, as if no action and no solution had come before.

        Args:
            tables: The rooms.
            row: ``[N]`` where each room was.
            action: ``[N]`` the actions.
            after: ``[N]`` where each room is then.
        """
        positions = tables.positions
        lever = action < 2 * positions
        # An observation also shows which levers are active.
        active = tables.observation[row, positions + np.where(lever, action % positions, 0)] == 1
        never = np.zeros(len(row), dtype=bool)
        return cls(
            first=tables.used[row] == 0,
            last=tables.over[after],
            inactive=lever & ~active,
            changed=tables.state[row] != tables.state[after],
            unlocks=tables.unlocked[after] & ~tables.unlocked[row],
            unlocked=tables.unlocked[after],
            opens=tables.opened[after] & ~tables.opened[row],
            on_path=tables.on_path[after],
            repeated=never,
            new=tables.solution[after] >= 0,
            retraced=never,
            found=np.zeros(len(row), dtype=np.int64),
        )

    def with_history(
        self, tables: RoomTables, after: IntArray, repeated: BoolArray, found: BoolArray
    ) -> Events:
        """The same events after what came before in the attempt and the trial.

        Args:
            tables: The rooms.
            after: ``[N]`` where each room is then.
            repeated: ``[N]`` whether the action before it was the same.
            found: ``[N, K]`` which solutions are already found.
        """
        solution = tables.solution[after]
        known = found[np.arange(len(after)), solution] & (solution >= 0)
        return replace(
            self,
            repeated=repeated,
            new=self.new & ~known,
            retraced=np.logical_or.reduce(tables.begins(after) & found, axis=1),
            found=found.sum(axis=1),
        )

    def at(self, which: IntArray) -> Events:
        """The events of some of the actions."""
        return Events(**{field.name: getattr(self, field.name)[which] for field in fields(Events)})


class RewardFunction(ABC):
    """The reward of actions.

    Attributes:
        name: Name of a preset, or another description.
        depends_on_everything: Whether it may depend on every field of the events, so that it has to
            be evaluated for each action taken.
    """

    name: str
    depends_on_everything: ClassVar[bool] = False

    @abstractmethod
    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""

    @property
    def depends_on_repeats(self) -> bool:
        """Whether the reward depends on the action before."""
        return self.depends_on_everything

    @property
    def depends_on_found(self) -> bool:
        """Whether the reward depends on which solutions are already found."""
        return self.depends_on_everything

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data."""

    def written(self) -> Any:
        """The reward in the form of an experiment file; see ``rewards.find_reward``."""
        return self.name


class RewardTable:
    """The rewards of one reward function in the rooms of some tables; M listed rows, W columns.

    Args:
        reward: The reward function.
        tables: The rooms; :meth:`fill` adds those stacked later.

    Attributes:
        paid: ``[M * W]`` the reward of every action that takes effect, if no action and no solution
            came before; waiting, and resetting a room, pay nothing.
        matters: ``[M * W]`` what can change it: solutions found before (``IF_FOUND``), the same
            action as before (``IF_REPEATED``), or anything (``ALWAYS``).

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
        """Size of the arrays in bytes."""
        return self.paid.nbytes + self.matters.nbytes

    def fill(self) -> None:
        """Add the rooms that were stacked since the last call."""
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
        """:attr:`paid` and :attr:`matters` at some rows; ``[rows * W]`` each."""
        tables, function = self.tables, self.reward
        row = rows.repeat(tables.columns)
        action = np.tile(np.arange(tables.columns), len(rows))
        events = Events.of(tables, row, action, tables.after(row, action))
        paid = function.pay(events)
        matters = np.zeros(len(row), np.uint8)
        if function.depends_on_found:
            # Compare with the other extreme: a solution was found, and this is that solution.
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
        """``[N]`` the rewards of N actions after what came before in the attempt and the trial.

        Args:
            row: ``[N]`` where each room was; its attempt was not over.
            action: ``[N]`` the actions.
            after: ``[N]`` where each room is then.
            repeated: ``[N]`` whether the action before it was the same.
            found: ``[N, K]`` which solutions were already found.
        """
        events = Events.of(self.tables, row, action, after)
        return self.reward.pay(events.with_history(self.tables, after, repeated, found))
