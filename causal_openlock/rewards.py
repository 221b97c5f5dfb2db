"""Rewards: terms that add up, judged on what one action led to.

The paper words seven reward functions as changes to a basic one, so each is a *term* here and a
reward is the sum of its terms (paper, "Reward Functions"). A term is a pure function of
:class:`Events`, what happened in one action, for many actions at once:

======================= ==========================================================================
``basic``               10 on the action that unlocks the door, 50 on the one that opens it.
``unique_solutions``    Takes both back unless the solution is new in this trial.
``state_change``        0.5 if the observation changed.
``negative_immovable``  -0.5 if the action moved nothing, levers and door alike.
``negative_repeat``     -0.25 if the action equals the one before it in the attempt.
``partial_sequence``    1 if the attempt's first action begins a solution; in place of
                        ``state_change`` there.
``solution_multiplier`` Multiplies both 10 and 50 of a new solution by 1.5 for each solution found
                        before it: 60, 90, 135.
======================= ==========================================================================

What the authors' program of January 2018 paid differs from the text. Its rewards are a ladder,
not a sum: the first rung that fits pays and the rest does not count. They are the presets
``authors_2018_*``, so that one can ask which of the two a result depends on.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.errors import RewardError, nearest
from causal_openlock.fsm import BoolArray, FloatArray, IntArray

if TYPE_CHECKING:
    from causal_openlock.tables import RoomTables

UNLOCK, OPEN = 10.0, 50.0
MULTIPLIER = 1.5


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

    def paid(self) -> FloatArray:
        """``[N]`` what ``basic`` pays."""
        return UNLOCK * self.unlocks + OPEN * self.opens


_FIELDS = fields(Events)


@dataclass(frozen=True)
class Reward:
    """A reward function of the paper: a sum of terms.

    Attributes:
        name: A preset's name, or the terms joined by ``+``.
        terms: Names of terms, in :data:`TERMS`.
    """

    name: str
    terms: tuple[str, ...]

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""
        total = np.zeros(len(events.first))
        for term in self.terms:
            total += TERMS[term](events, self.terms)
        return total

    @property
    def heeds_repeats(self) -> bool:
        """Whether it depends on the action before."""
        return "negative_repeat" in self.terms

    @property
    def heeds_found(self) -> bool:
        """Whether it depends on which solutions are found already."""
        return not {"unique_solutions", "solution_multiplier"}.isdisjoint(self.terms)


def _basic(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return events.paid()


def _unique_solutions(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return np.where(events.new, 0.0, -events.paid())


def _state_change(events: Events, terms: tuple[str, ...]) -> FloatArray:
    instead = events.first & events.on_path if "partial_sequence" in terms else False
    return np.where(events.changed & ~np.asarray(instead), 0.5, 0.0)


def _negative_immovable(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return np.where(events.changed, 0.0, -0.5)


def _negative_repeat(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return np.where(events.repeated, -0.25, 0.0)


def _partial_sequence(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return np.where(events.first & events.on_path, 1.0, 0.0)


def _solution_multiplier(events: Events, terms: tuple[str, ...]) -> FloatArray:
    return (MULTIPLIER**events.found - 1.0) * events.paid() * events.new


TERMS: dict[str, Callable[[Events, tuple[str, ...]], FloatArray]] = {
    "basic": _basic,
    "unique_solutions": _unique_solutions,
    "state_change": _state_change,
    "negative_immovable": _negative_immovable,
    "negative_repeat": _negative_repeat,
    "partial_sequence": _partial_sequence,
    "solution_multiplier": _solution_multiplier,
}


@dataclass(frozen=True)
class AuthorsReward:
    """A reward of the authors' program of January 2018: the first rung that fits pays.

    Attributes:
        name: The preset's name.
        unique: Unlocking and opening pay only on the way to a solution not yet found.
        multiplier: A new solution pays 1, 1.5, 3.0, ... times as much, growing linearly.
        partial: 1 while the attempt's actions begin a solution and the door is still locked.
        change: 0.5 for a change of the observation.
        immovable: -0.5 for an inactive lever; a locked active one costs nothing.
        repeat: -0.25 for the same action twice in a row.
    """

    name: str
    unique: bool = False
    multiplier: bool = False
    partial: bool = False
    change: bool = False
    immovable: bool = False
    repeat: bool = False

    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""
        # With all actions used, unique is what completes a new solution; before that, whatever
        # does not retrace a found one.
        unique = np.where(events.last, events.opens & events.new, ~events.retraced)
        factor = np.maximum(1.0, MULTIPLIER * events.found) if self.multiplier else 1.0
        bonus = np.where(unique, factor, 1.0)
        due = unique if self.unique else np.ones_like(unique)
        never = np.zeros_like(unique)
        return np.select(
            [
                events.opens & due,
                events.unlocked & due,
                events.on_path if self.partial else never,
                events.changed if self.change else never,
                events.repeated if self.repeat else never,
                events.inactive if self.immovable else never,
            ],
            [OPEN * bonus, UNLOCK * bonus, 1.0, 0.5, -0.25, -0.5],
            default=0.0,
        )

    @property
    def heeds_repeats(self) -> bool:
        """Whether it depends on the action before."""
        return self.repeat

    @property
    def heeds_found(self) -> bool:
        """Whether it depends on which solutions are found already."""
        return self.unique or self.multiplier


RewardFunction = Reward | AuthorsReward

BASIC_REWARD = "basic"
"""The plain reward, and the default of environments."""
PAPER_REWARD = "paper"
"""The paper's best combination, and the default of sessions and experiments."""


def _presets() -> dict[str, RewardFunction]:
    presets: dict[str, RewardFunction] = {
        # Each builds on the basic reward, as the paper words it.
        name: Reward(name, ("basic",) if name == "basic" else ("basic", name))
        for name in TERMS
    }
    presets["partial_sequence"] = Reward(
        "partial_sequence", ("basic", "state_change", "partial_sequence")
    )
    presets[PAPER_REWARD] = Reward(
        PAPER_REWARD, ("basic", "negative_immovable", "partial_sequence", "solution_multiplier")
    )
    for short, rungs in {
        "basic": "",
        "change_state": "change",
        "unique_solutions": "unique",
        "change_state_unique_solutions": "unique change",
        "negative_immovable": "immovable",
        "negative_immovable_unique_solutions": "unique immovable",
        "negative_immovable_negative_repeat": "immovable repeat",
        "negative_immovable_partial_action_seq": "immovable partial",
        "negative_immovable_solution_multiplier": "immovable multiplier",
        "negative_immovable_partial_action_seq_solution_multiplier": (
            "immovable partial multiplier"
        ),
    }.items():
        name = f"authors_2018_{short}"
        presets[name] = AuthorsReward(name, **dict.fromkeys(rungs.split(), True))
    presets["authors_2018"] = AuthorsReward(
        "authors_2018", immovable=True, partial=True, multiplier=True
    )
    return presets


PRESETS = _presets()


def find_reward(reward: str | Iterable[str] | RewardFunction) -> RewardFunction:
    """A reward by the name of a preset, or as a list of terms that add up.

    Raises:
        RewardError: If there is none of that name, or a term is unknown or listed twice.
    """
    if isinstance(reward, Reward | AuthorsReward):
        return reward
    if isinstance(reward, str):
        if reward not in PRESETS:
            raise RewardError(f"there is no reward {reward!r}; {nearest(reward, PRESETS)}")
        return PRESETS[reward]
    terms = tuple(reward)
    for index, term in enumerate(terms):
        if term not in TERMS:
            raise RewardError(f"there is no reward term {term!r}; {nearest(str(term), TERMS)}")
        if term in terms[:index]:
            raise RewardError(f"the reward term {term} is listed twice; remove one of them")
    if not terms:
        raise RewardError(f"a reward needs at least one term; known: {', '.join(TERMS)}")
    return Reward("+".join(terms), terms)
