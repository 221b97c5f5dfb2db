"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen.
"""

from __future__ import annotations

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
    """B rings of transitions, filled in step.

    Args:
        subjects: B.
        capacity: Transitions that each ring holds.
    """

    def __init__(self, subjects: int, capacity: int) -> None:
        self.capacity = capacity
        self.length = 0
        self._next = 0
        self.before = np.zeros((subjects, capacity), dtype=np.int64)
        self.action = np.zeros((subjects, capacity), dtype=np.int64)
        self.reward = np.zeros((subjects, capacity), dtype=np.float32)
        self.after = np.zeros((subjects, capacity), dtype=np.int64)
        self.goes_on = np.zeros((subjects, capacity), dtype=np.float32)

    def add(
        self,
        before: IntArray,
        action: IntArray,
        reward: FloatArray,
        after: IntArray,
        goes_on: BoolArray,
    ) -> None:
        """Add one transition for each subject; all arguments are ``[B]``."""
        slot = self._next
        self.before[:, slot] = before
        self.action[:, slot] = action
        self.reward[:, slot] = reward
        self.after[:, slot] = after
        self.goes_on[:, slot] = goes_on
        self._next = (slot + 1) % self.capacity
        self.length = min(self.length + 1, self.capacity)

    def sample(self, luck: FloatArray) -> tuple[NDArray[Any], ...]:
        """Transitions drawn with replacement, for each subject from its own ring.

        Args:
            luck: ``[B, M]`` uniform numbers in [0, 1).

        Returns:
            ``before``, ``action``, ``reward``, ``after`` and ``goes_on``, each ``[B, M]``.
        """
        slots = (luck * self.length).astype(np.int64)
        rings = (self.before, self.action, self.reward, self.after, self.goes_on)
        return tuple(np.take_along_axis(ring, slots, axis=1) for ring in rings)

    def state_dict(self) -> dict[str, Any]:
        """The rings, for a checkpoint."""
        return dict(vars(self))

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        vars(self).update({key: np.copy(v) if np.ndim(v) else v for key, v in state.items()})
