"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen.
"""

from __future__ import annotations

import copy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.learner import Observations


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

    def state_dict(self) -> dict[str, Any]:
        """The table, for a checkpoint."""
        return {"rows": self.rows, "numbers": dict(self._numbers)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.rows, self._numbers = state["rows"], dict(state["numbers"])


class Replay:
    """B rings of transitions, one for each subject.

    Args:
        subjects: B.
        capacity: Transitions that each ring holds; a new one then overwrites the oldest.

    Attributes:
        length: ``[B]`` transitions that each ring holds now.
    """

    def __init__(self, subjects: int, capacity: int) -> None:
        self.capacity = capacity
        self.length: IntArray = np.zeros(subjects, dtype=np.int64)
        self._next: IntArray = np.zeros(subjects, dtype=np.int64)
        self.before = np.zeros((subjects, capacity), dtype=np.int64)
        self.action = np.zeros((subjects, capacity), dtype=np.int64)
        self.reward = np.zeros((subjects, capacity), dtype=np.float32)
        self.after = np.zeros((subjects, capacity), dtype=np.int64)
        self.goes_on = np.zeros((subjects, capacity), dtype=np.float32)

    def add(
        self,
        who: IntArray,
        before: IntArray,
        action: IntArray,
        reward: FloatArray,
        after: IntArray,
        goes_on: BoolArray,
    ) -> None:
        """Add one transition for each of the subjects ``who``; all arguments are as long."""
        slot = self._next[who]
        self.before[who, slot] = before
        self.action[who, slot] = action
        self.reward[who, slot] = reward
        self.after[who, slot] = after
        self.goes_on[who, slot] = goes_on
        self._next[who] = (slot + 1) % self.capacity
        self.length[who] = np.minimum(self.length[who] + 1, self.capacity)

    def sample(self, luck: FloatArray) -> tuple[NDArray[Any], ...]:
        """Transitions drawn with replacement, for each subject from its own ring.

        Args:
            luck: ``[B, M]`` uniform numbers in [0, 1).

        Returns:
            ``before``, ``action``, ``reward``, ``after`` and ``goes_on``, each ``[B, M]``.
        """
        slots = (luck * self.length[:, None]).astype(np.int64)
        rings = (self.before, self.action, self.reward, self.after, self.goes_on)
        return tuple(np.take_along_axis(ring, slots, axis=1) for ring in rings)

    def state_dict(self) -> dict[str, Any]:
        """The rings as they are now, for a checkpoint."""
        return copy.deepcopy(vars(self))

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        vars(self).update(copy.deepcopy(state))
