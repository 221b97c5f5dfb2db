"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen. Transitions are drawn
uniformly, or by :class:`PrioritisedReplayBuffer` in proportion to their last TD error.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Observations
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

LEAST_PRIORITY = 1e-6
"""Added to every TD error, so that a transition without one can still be drawn."""


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
    """A minibatch of M transitions for each of N agents.

    Every part is ``[N, M]``: an array, or a tensor on the device that needs one.

    Attributes:
        before: Number of the observation that the action was taken in.
        action: The action.
        reward: Its reward.
        after: Number of the observation that followed.
        not_done: 1 where the value of what followed counts, 0 where the TD target is the reward.
        weight: How much the transition counts in the loss.
        slot: Where in its ring it is.
    """

    before: Any
    action: Any
    reward: Any
    after: Any
    not_done: Any
    weight: Any
    slot: Any


class ReplayBuffer:
    """B rings of transitions, one for each subject, drawn from uniformly.

    Args:
        subjects: B.
        capacity: Transitions that each ring holds; a new one then overwrites the oldest.

    Attributes:
        length: ``[B]`` transitions that each ring holds now.
        rings: ``[5, B, capacity]`` number of the observation before, action, number of the
            observation after, reward, and ``not_done``. One array takes one call to write or to
            read; double precision holds all integers here.
    """

    def __init__(self, subjects: int, capacity: int) -> None:
        self.capacity = capacity
        self.length: IntArray = np.zeros(subjects, dtype=np.int64)
        self._next: IntArray = np.zeros(subjects, dtype=np.int64)
        self._begins: IntArray = np.arange(subjects)[:, None] * capacity
        self.rings: FloatArray = np.zeros((5, subjects, capacity))

    def add(
        self,
        who: IntArray,
        before: IntArray,
        action: IntArray,
        reward: FloatArray,
        after: IntArray,
        not_done: BoolArray,
    ) -> IntArray:
        """Add a transition for each of the subjects ``who``; return its slot in each one's ring."""
        slot = self._next[who]
        self.rings[:, who, slot] = before, action, after, reward, not_done
        self._next[who] = (slot + 1) % self.capacity
        self.length[who] = np.minimum(self.length[who] + 1, self.capacity)
        return slot

    def sample(self, uniform: FloatArray, beta: FloatArray | float = 1.0) -> Batch:
        """Transitions drawn with replacement, for each subject from its own ring.

        Args:
            uniform: ``[B, M]`` numbers in [0, 1) that they are drawn by.
            beta: By subject, ``[B]``, or for all: how much of the bias of priorities is undone,
                from 0 to 1.
        """
        slots = (uniform * self.length[:, None]).astype(np.int64)
        return self._at(slots, np.ones(slots.shape))

    def differing(self) -> FloatArray:
        """``[2, B]`` shares of what each ring holds with more than one reward.

        The first row is of the pairs of observation and action in the ring, the second of its
        transitions: those whose pair also stands there with another reward. An empty ring has
        none.
        """
        shares = np.zeros((2, len(self.length)))
        for subject, length in enumerate(self.length):
            before, action, _, reward, _ = self.rings[:, subject, :length]
            _, pair, count = np.unique(
                np.stack([before, action]), axis=1, return_inverse=True, return_counts=True
            )
            rewards = np.unique(np.stack([pair.ravel(), reward]), axis=1)[0].astype(np.int64)
            differ = np.bincount(rewards, minlength=len(count)) > 1
            if length:
                shares[:, subject] = differ.mean(), count[differ].sum() / length
        return shares

    def _at(self, slots: IntArray, weight: FloatArray) -> Batch:
        held = self.rings.reshape(5, -1).take(slots + self._begins, axis=1)
        before, action, after = held[:3].astype(np.int64)
        return Batch(before, action, held[3], after, held[4], weight, slots)


class PrioritisedReplayBuffer(ReplayBuffer):
    """Rings drawn from in proportion to priorities (Schaul et al. 2016, "proportional").

    The priority of a transition is its last absolute TD error to the power alpha; a new one has
    the highest priority of its ring so far, so that it is soon drawn. To undo the bias that this
    brings, a transition drawn with probability P from a ring of n weighs (n P)^-beta, relative to
    the heaviest of its minibatch. Each of the M transitions comes from one Mth of the ring's
    total priority.

    Args:
        alpha: 0 draws uniformly, 1 in proportion to the error; the others as before.
    """

    def __init__(self, subjects: int, capacity: int, alpha: float) -> None:
        super().__init__(subjects, capacity)
        self.alpha = alpha
        self.priority: FloatArray = np.zeros((subjects, capacity))
        self._highest: FloatArray = np.ones(subjects)

    def add(self, who: IntArray, *transition: Any) -> IntArray:
        """See :class:`ReplayBuffer`."""
        slot = super().add(who, *transition)
        self.priority[who, slot] = self._highest[who]
        return slot

    def sample(self, uniform: FloatArray, beta: FloatArray | float = 1.0) -> Batch:
        """Transitions drawn by priority, for each subject from its own ring."""
        stratum = (np.arange(uniform.shape[1]) + uniform) / uniform.shape[1]
        upto = self.priority.cumsum(axis=1)
        total = upto[:, -1:]
        drawn = zip(upto, stratum * total, strict=True)
        slots = np.array([np.searchsorted(own, share, side="right") for own, share in drawn])
        slots = np.maximum(np.minimum(slots, self.length[:, None] - 1), 0)
        exponent = np.broadcast_to(beta, self.length.shape)[:, None]
        with np.errstate(invalid="ignore"):  # an empty ring has no total
            probability = np.take_along_axis(self.priority, slots, axis=1) / total
            weight = (self.length[:, None] * probability) ** -exponent
        return self._at(slots, weight / weight.max(axis=1, keepdims=True))

    def update_priorities(self, slots: IntArray, errors: FloatArray, who: BoolArray) -> None:
        """Set those of transitions, ``[B, M]``, by their errors, for the subjects ``who``."""
        mine = np.flatnonzero(who)
        priority = (np.abs(errors[mine], dtype=np.float64) + LEAST_PRIORITY) ** self.alpha
        self.priority[mine[:, None], slots[mine]] = priority
        self._highest[mine] = np.maximum(self._highest[mine], priority.max(axis=1))
