"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen. Transitions are drawn
uniformly, or by :class:`PrioritisedReplayBuffer` in proportion to their last TD error.
"""

from __future__ import annotations

from typing import Any, ClassVar, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causal_openlock.contract.learner import Observations
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from openlock_learners.checkpointed import Checkpointed

LEAST_PRIORITY = 1e-6
"""Added to every TD error, so that a transition without one can still be drawn."""


class ObservationTable(Checkpointed):
    """The distinct observations met so far, numbered in order of appearance."""

    checkpointed: ClassVar = {"rows": "rows", "numbers": "_numbers"}

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

    Every part is ``[N, M]``: a tensor, or an array for compiled code.

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


class ReplayBuffer(Checkpointed):
    """B rings of transitions, one for each subject, drawn from uniformly.

    Args:
        subjects: B.
        capacity: Transitions that each ring holds; a new one then overwrites the oldest.
        device: Where the rings are kept.

    Attributes:
        length: ``[B]`` transitions that each ring holds now.
        rings: ``[5, B, capacity]`` number of the observation before, action, number of the
            observation after, reward, and ``not_done``. One tensor takes one call to write or to
            read; double precision holds all integers here.
    """

    def __init__(
        self, subjects: int, capacity: int, device: torch.device | str | None = None
    ) -> None:
        self.capacity = capacity
        self.length: IntArray = np.zeros(subjects, dtype=np.int64)
        self._next: IntArray = np.zeros(subjects, dtype=np.int64)
        self._begins: IntArray = np.arange(subjects)[:, None] * capacity
        self.rings = torch.zeros(5, subjects, capacity, dtype=torch.float64, device=device)

    def add(
        self,
        who: IntArray,
        before: IntArray,
        action: IntArray,
        reward: FloatArray,
        after: IntArray,
        not_done: BoolArray,
    ) -> Tensor:
        """Add a transition for each of the subjects ``who``; return its place in the flat rings."""
        slot = self._next[who]
        new = np.array([before, action, after, reward, not_done], dtype=np.float64)
        self._next[who] = (slot + 1) % self.capacity
        self.length[who] = np.minimum(self.length[who] + 1, self.capacity)
        places = torch.from_numpy(who * self.capacity + slot).to(self.rings.device)
        self.rings.view(5, -1).index_copy_(1, places, torch.from_numpy(new).to(self.rings))
        return places

    def sample(self, uniform: FloatArray, beta: FloatArray | float = 1.0) -> Batch:
        """Transitions drawn with replacement, for each subject from its own ring.

        Args:
            uniform: ``[B, M]`` numbers in [0, 1) that they are drawn by.
            beta: By subject, ``[B]``, or for all: how much of the bias of priorities is undone,
                from 0 to 1.
        """
        slots = torch.from_numpy((uniform * self.length[:, None]).astype(np.int64))
        return self._at(slots.to(self.rings.device), torch.ones(slots.shape))

    def differing(self) -> FloatArray:
        """``[2, B]`` shares of what each ring holds with more than one reward.

        The first row is of the pairs of observation and action in the ring, the second of its
        transitions: those whose pair also stands there with another reward. An empty ring has
        none.
        """
        shares = np.zeros((2, len(self.length)))
        for subject, length in enumerate(self.length):
            before, action, _, reward, _ = self.rings[:, subject, :length].cpu().numpy()
            _, pair, count = np.unique(
                np.stack([before, action]), axis=1, return_inverse=True, return_counts=True
            )
            rewards = np.unique(np.stack([pair.ravel(), reward]), axis=1)[0].astype(np.int64)
            differ = np.bincount(rewards, minlength=len(count)) > 1
            if length:
                shares[:, subject] = differ.mean(), count[differ].sum() / length
        return shares

    def update_priorities(self, slots: Tensor, errors: Tensor, who: BoolArray) -> None:
        """Set the priorities of transitions, ``[B, M]``, of the subjects ``who``, ``[B]``."""

    def _at(self, slots: Tensor, weight: Tensor) -> Batch:
        places = slots + torch.from_numpy(self._begins).to(slots.device)
        held = self.rings.view(5, -1).index_select(1, places.flatten()).view(5, *slots.shape)
        before, action, after = held[:3].long()
        reward, not_done = held[3:].to(torch.get_default_dtype())
        weight = weight.to(reward)
        return Batch(before, action, reward, after, not_done, weight, slots)


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

    def __init__(
        self,
        subjects: int,
        capacity: int,
        alpha: float,
        device: torch.device | str | None = None,
    ) -> None:
        super().__init__(subjects, capacity, device)
        self.alpha = alpha
        # Sums of thousands of them are compared with each other: single precision will not do.
        self.priority = torch.zeros(subjects, capacity, dtype=torch.float64, device=device)
        self._highest = torch.ones(subjects, dtype=torch.float64, device=device)

    def add(self, who: IntArray, *transition: Any) -> Tensor:
        """See :class:`ReplayBuffer`."""
        where = super().add(who, *transition)
        self.priority.view(-1)[where] = self._highest[where // self.capacity]
        return where

    def sample(self, uniform: FloatArray, beta: FloatArray | float = 1.0) -> Batch:
        """Transitions drawn by priority, for each subject from its own ring."""
        device = self.rings.device
        stratum = (np.arange(uniform.shape[1]) + uniform) / uniform.shape[1]
        upto = self.priority.cumsum(dim=1)
        total = upto[:, -1:]
        slots = torch.searchsorted(upto, torch.from_numpy(stratum).to(device) * total, right=True)
        length = torch.from_numpy(self.length).to(device)[:, None]
        slots = torch.minimum(slots, length - 1).clamp_(min=0)
        probability = self.priority.gather(1, slots) / total
        exponent = np.broadcast_to(beta, self.length.shape)[:, None]
        weight = _power(length * probability, -exponent)
        weight /= weight.amax(dim=1, keepdim=True)
        return self._at(slots, weight)

    def update_priorities(self, slots: Tensor, errors: Tensor, who: BoolArray) -> None:
        """Set them by the new TD errors."""
        mine = torch.from_numpy(np.flatnonzero(who)).to(slots.device)
        priority = _power(errors[mine].abs().double() + LEAST_PRIORITY, self.alpha)
        self.priority[mine[:, None], slots[mine]] = priority
        self._highest[mine] = torch.maximum(self._highest[mine], priority.amax(dim=1))


def _power(base: Tensor, exponent: FloatArray | float) -> Tensor:
    """``base ** exponent``, each number by itself.

    On a CPU, torch takes another formula for the last few numbers of a tensor, and which these are
    depends on how many subjects there are. NumPy does not.
    """
    if base.device.type == "cpu":
        return torch.from_numpy(base.numpy() ** exponent)
    return base ** torch.as_tensor(exponent, dtype=base.dtype, device=base.device)
