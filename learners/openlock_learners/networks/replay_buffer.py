"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Observations
from causal_openlock.schemas.fsm import FloatArray, IntArray


class ObservationTable:
    """The distinct observations met so far, numbered in order of appearance."""

    def __init__(self, size: int) -> None:
        self.rows: NDArray[np.float32] = np.zeros((0, size), dtype=np.float32)
        self._weights = 1 << np.arange(size, dtype=np.int64)
        self._numbers: dict[int, int] = {}

    def number(self, observations: Observations) -> IntArray:
        """``[B]`` the number of each observation; those not met before are added."""
        keys = (observations @ self._weights).tolist()
        numbers = self._numbers
        known = len(numbers)
        found = np.array([numbers.setdefault(key, len(numbers)) for key in keys], dtype=np.int64)
        if len(numbers) > known:
            first = [int(np.argmax(found == new)) for new in range(known, len(numbers))]
            self.rows = np.concatenate([self.rows, observations[first].astype(np.float32)])
        return found


class Batch(NamedTuple):
    """Transitions: a minibatch of M for each of N agents, every part ``[N, M]``, or one of each."""

    before: IntArray  # number of the observation that the action was taken in
    action: IntArray
    after: IntArray  # number of the observation that followed
    reward: Any
    not_done: Any  # 1 where the value of what followed counts, 0 where the TD target is the reward


class ReplayBuffer:
    """B rings of transitions, one for each subject; a full one overwrites its oldest."""

    def __init__(self, subjects: int, capacity: int) -> None:
        self.capacity = capacity
        self.length: IntArray = np.zeros(subjects, dtype=np.int64)  #: ``[B]`` transitions held
        self._next: IntArray = np.zeros(subjects, dtype=np.int64)
        self._begins: IntArray = np.arange(subjects)[:, None] * capacity
        # One array takes one call to write or to read; double precision holds all integers here.
        #: ``[5, B, capacity]`` the parts of the transitions, in an order that checkpoints rely on
        self.rings: FloatArray = np.zeros((5, subjects, capacity))

    def add(self, who: IntArray, transition: Batch) -> None:
        """Add a transition, with parts of ``[n]``, for each of n subjects ``who``."""
        slot = self._next[who]
        self.rings[:, who, slot] = transition
        self._next[who] = (slot + 1) % self.capacity
        self.length[who] = np.minimum(self.length[who] + 1, self.capacity)

    def sample(self, uniform: FloatArray) -> Batch:
        """Transitions drawn with replacement, for each subject from its own ring.

        ``uniform`` are the ``[B, M]`` numbers in [0, 1) that they are drawn by.
        """
        slots = (uniform * self.length[:, None]).astype(np.int64)
        held = self.rings.reshape(5, -1).take(slots + self._begins, axis=1)
        before, action, after = held[:3].astype(np.int64)
        return Batch(before, action, after, reward=held[3], not_done=held[4])
