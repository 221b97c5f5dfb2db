"""What one action led to, and what may be paid for it.

Rewards (:mod:`causal_openlock.world.rewards`) are functions of events, for many actions at once.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from causal_openlock.world.tables import RoomTables


@dataclass(frozen=True)
class Events:
    """What N actions led to; every field is ``[N]``.

    Attributes:
        first: It was the attempt's first action.
        last: The attempt is over.
        inactive: It was aimed at an inactive lever.
        changed: Something moved, so the observation changed.
        unlocks: The door was locked before and is unlocked now.
        unlocked: The door is unlocked now.
        opens: The door was opened.
        on_path: The attempt's actions so far are the beginning of a solution, or all of it.
        repeated: It was the same action as the one before it in the attempt.
        new: A solution stands pushed, or was completed, that is not yet found in this trial.
        retraced: The attempt's actions so far begin a solution that is found already.
        found: Solutions found in earlier attempts of the trial.
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
    def of(
        cls,
        tables: RoomTables,
        row: IntArray,
        action: IntArray,
        after: IntArray,
    ) -> Events:
        """Read off the tables what N actions led to, as if nothing had gone before.

        Args:
            tables: The rooms.
            row: ``[N]`` where each room was.
            action: ``[N]`` what was done.
            after: ``[N]`` where each room is then.
        """
        positions = tables.positions
        lever = action < 2 * positions
        # Beside what is pushed, an observation shows what is active.
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
        """The same events, given what went before.

        Args:
            tables: The rooms.
            after: ``[N]`` where each room is then.
            repeated: ``[N]`` whether the action before it was the same.
            found: ``[N, K]`` which solutions are found already.
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
        return Events(**{field.name: getattr(self, field.name)[which] for field in _FIELDS})


_FIELDS = fields(Events)


class RewardFunction(ABC):
    """What actions pay."""

    name: str
    depends_on_everything: ClassVar[bool] = False
    """Whether it may depend on all that an event tells, so that it is asked for every action."""

    @abstractmethod
    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""

    @property
    @abstractmethod
    def depends_on_repeats(self) -> bool:
        """Whether it depends on the action before."""

    @property
    @abstractmethod
    def depends_on_found(self) -> bool:
        """Whether it depends on which solutions are found already."""

    @abstractmethod
    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data."""

    @abstractmethod
    def written(self) -> Any:
        """The reward as an experiment file says it; see :func:`find_reward`."""
