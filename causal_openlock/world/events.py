"""Events of actions, and the rewards that they are paid.

A reward (:mod:`causal_openlock.world.rewards`) is a function of :class:`Events`, for many actions
at once. There are few different events, so each function is evaluated once for all of them
(:func:`rewards_by_event`) and looked up from then on.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world import kernel
from causal_openlock.world.kernel import IDLE, NEW, ON_PATH, REPEATED, RETRACED, UNLOCKED, WORDS


@dataclass(frozen=True)
class Events:
    """Events of N actions; every field is ``[N]``.

    Example:
        >>> Events.of(np.array([kernel.FIRST, kernel.OPENS]), np.array([0, 2])).opens
        array([False,  True])
    """

    first: BoolArray  #: it was the attempt's first action
    last: BoolArray  #: the attempt is over
    inactive: BoolArray  #: it was aimed at an inactive lever
    changed: BoolArray  #: something moved, so the observation changed
    unlocks: BoolArray  #: it unlocked the door
    unlocked: BoolArray  #: the door is unlocked now
    opens: BoolArray  #: it opened the door
    on_path: BoolArray  #: the actions so far are the beginning of a solution, or all of it
    repeated: BoolArray  #: it was the same action as the one before it in the attempt
    new: BoolArray  #: the levers of a solution are pushed that is not yet found in this trial
    retraced: BoolArray  #: the actions so far are the beginning of a solution already found
    found: IntArray  #: solutions found in earlier attempts of the trial

    @classmethod
    def of(cls, words: IntArray, found: IntArray) -> Events:
        """The events of N words of the kernel, ``[N]``, after ``[N]`` solutions found before."""
        facts = [name for name in cls.__dataclass_fields__ if name != "found"]
        return cls(
            **{name: words & getattr(kernel, name.upper()) != 0 for name in facts}, found=found
        )


class RewardFunction(ABC):
    """The reward of actions."""

    name: str  #: of a preset, or another description
    is_own: ClassVar[bool] = False  #: whether it is code of a user

    @abstractmethod
    def pay(self, events: Events) -> FloatArray:
        """``[N]`` the reward of each action."""

    def as_dict(self) -> dict[str, Any]:
        """The reward as plain data: its fields."""
        return {**vars(self)}

    def written(self) -> Any:
        """The reward in the form of an experiment file; see ``rewards.find_reward``."""
        return self.name


def rewards_by_event(
    rewards: Sequence[RewardFunction], words: NDArray[Any], solutions: int
) -> FloatArray:
    """``[F, WORDS, solutions + 1]`` what F rewards pay for each event, by solutions found before.

    Args:
        rewards: The reward functions.
        words: The events that there are, without the bits that depend on the past.
        solutions: The most that can be found.

    Example:
        >>> from causal_openlock.world.rewards import find_reward
        >>> opens = np.array([kernel.OPENS | UNLOCKED])
        >>> rewards_by_event([find_reward("basic")], opens, 1)[0, opens]
        array([[50., 50.]])
    """
    # Every event with every past that it can have, and every number of solutions found before.
    pasts = [sum(bits) for bits in product((0, REPEATED), (0, NEW), (0, RETRACED))]
    some = np.unique(words[words & IDLE == 0] & (IDLE - 1)).astype(np.int64)
    word, found = np.meshgrid(np.add.outer(some, pasts), np.arange(solutions + 1), indexing="ij")
    can_be_new = (word & UNLOCKED != 0) & (found < solutions)
    can_retrace = (word & ON_PATH != 0) & (found > 0)
    can_be = (can_be_new | (word & NEW == 0)) & (can_retrace | (word & RETRACED == 0))
    word, found = word[can_be], found[can_be]
    paid = np.zeros((len(rewards), WORDS, solutions + 1))
    for by_event, reward in zip(paid, rewards, strict=True):
        by_event[word, found] = reward.pay(Events.of(word, found))
    return paid
