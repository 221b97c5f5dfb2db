"""Experience replay for B subjects at once.

Each subject has a ring of its own. A transition holds no observation but its number in a table of
distinct observations, which all subjects share: the room shows a few dozen.

Transitions are drawn uniformly, or by :class:`PrioritisedReplay` the more often the more there was
to learn from them.
"""

from __future__ import annotations

import copy
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from causal_openlock.contract.learner import Observations
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from learners.networks import kernels

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

    def state_dict(self) -> dict[str, Any]:
        """The table, for a checkpoint."""
        return {"rows": self.rows, "numbers": dict(self._numbers)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.rows, self._numbers = state["rows"], dict(state["numbers"])


class Batch(NamedTuple):
    """A minibatch of M transitions for each of N agents; every part is ``[N, M]``.

    Attributes:
        before: Number of the observation that the action was taken in.
        action: The action.
        reward: Its reward.
        after: Number of the observation that followed.
        goes_on: 1 where a value follows, 0 where the target ends.
        weight: How much the transition counts in the loss.
        slot: Where in its ring it is.
    """

    before: Tensor
    action: Tensor
    reward: Tensor
    after: Tensor
    goes_on: Tensor
    weight: Tensor
    slot: Tensor


class Replay:
    """B rings of transitions, one for each subject, drawn from uniformly.

    Args:
        subjects: B.
        capacity: Transitions that each ring holds; a new one then overwrites the oldest.
        device: Where the rings are kept.

    Attributes:
        length: ``[B]`` transitions that each ring holds now.
        rings: ``[5, B, capacity]`` number of the observation before, action, number of the
            observation after, reward, and whether a value follows. One piece takes one call to
            write or to read; double precision holds all integers here.
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
        goes_on: BoolArray,
    ) -> Tensor:
        """Add one transition for each of the subjects ``who``; all arguments are as long.

        Returns:
            Where they are in the flattened rings.
        """
        slot = self._next[who]
        where = who * self.capacity + slot
        told = np.array([before, action, after, reward, goes_on], dtype=np.float64)
        self._next[who] = (slot + 1) % self.capacity
        self.length[who] = np.minimum(self.length[who] + 1, self.capacity)
        rings = self.rings.view(5, -1)
        if rings.is_cuda:
            places, columns = torch.from_numpy(where).to(rings.device), torch.from_numpy(told)
            rings.index_copy_(1, places, columns.to(rings.device))
            return places
        rings.numpy()[:, where] = told
        return torch.from_numpy(where)

    def sample(self, luck: FloatArray) -> Batch:
        """Transitions drawn with replacement, for each subject from its own ring.

        Args:
            luck: ``[B, M]`` uniform numbers in [0, 1).
        """
        slots = torch.from_numpy((luck * self.length[:, None]).astype(np.int64))
        slots = slots.to(self.rings.device)
        return self._at(slots, torch.ones(slots.shape, device=slots.device))

    def _at(self, slots: Tensor, weight: Tensor) -> Batch:
        if self.rings.is_cuda:
            places = slots + torch.from_numpy(self._begins).to(slots.device)
            held = self.rings.view(5, -1).index_select(1, places.flatten()).view(5, *slots.shape)
            before, action, after = held[:3].long()
            reward, goes_on = held[3:].to(weight.dtype)
        else:
            parts = kernels.gather(self.rings.numpy(), slots.numpy(), weight.numpy())
            before, action, after, reward, goes_on = map(torch.from_numpy, parts)
        return Batch(before, action, reward, after, goes_on, weight, slots)

    def state_dict(self) -> dict[str, Any]:
        """The rings as they are now, for a checkpoint."""
        return copy.deepcopy(vars(self))

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        for name, value in copy.deepcopy(state).items():
            held = vars(self)[name]
            # Tensors stay on the device where they are, whichever the checkpoint comes from.
            vars(self)[name] = value.to(held) if isinstance(held, Tensor) else value


class PrioritisedReplay(Replay):
    """Rings drawn from in proportion to priorities (Schaul et al. 2016, "proportional").

    The priority of a transition is its last absolute TD error to the power alpha; a new one has
    the highest priority of its ring so far, so that it is soon drawn. To undo the bias that this
    brings, a transition drawn with probability P from a ring of n weighs (n P)^-beta, relative to
    the heaviest of its minibatch. Each of the M transitions comes from one Mth of the ring's
    total priority.

    Args:
        subjects: As for :class:`Replay`, with the two others.
        capacity: Transitions that each ring holds.
        device: Where the rings are kept.
        alpha: 0 draws uniformly, 1 in proportion to the error.
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

    def add(
        self,
        who: IntArray,
        before: IntArray,
        action: IntArray,
        reward: FloatArray,
        after: IntArray,
        goes_on: BoolArray,
    ) -> Tensor:
        """As for :class:`Replay`."""
        where = super().add(who, before, action, reward, after, goes_on)
        self.priority.view(-1)[where] = self._highest[where // self.capacity]
        return where

    def sample(self, luck: FloatArray, beta: FloatArray | float = 1.0) -> Batch:
        """Transitions drawn by priority, for each subject from its own ring.

        Args:
            luck: ``[B, M]`` uniform numbers in [0, 1).
            beta: How much of the bias is undone, by subject (``[B]``) or for all: 0 nothing,
                1 all of it.
        """
        device = self.rings.device
        stratum = (np.arange(luck.shape[1]) + luck) / luck.shape[1]
        upto = self.priority.cumsum(dim=1)
        total = upto[:, -1:]
        slots = torch.searchsorted(upto, torch.from_numpy(stratum).to(device) * total, right=True)
        length = torch.from_numpy(self.length).to(device)[:, None]
        slots = torch.minimum(slots, length - 1).clamp_(min=0)
        chance = self.priority.gather(1, slots) / total
        exponent = np.broadcast_to(beta, self.length.shape)[:, None]
        weight = _power(length * chance, -exponent)
        weight /= weight.amax(dim=1, keepdim=True)
        return self._at(slots, weight.to(torch.get_default_dtype()))

    def reprioritise(self, slots: Tensor, errors: Tensor, who: BoolArray) -> None:
        """Set the priorities of transitions whose TD errors were seen anew.

        Args:
            slots: ``[B, M]`` where they are.
            errors: ``[B, M]`` their TD errors.
            who: ``[B]`` whose priorities to set.
        """
        mine = torch.from_numpy(np.flatnonzero(who)).to(slots.device)
        priority = _power(errors[mine].abs().double() + LEAST_PRIORITY, self.alpha)
        self.priority[mine[:, None], slots[mine]] = priority
        self._highest[mine] = torch.maximum(self._highest[mine], priority.amax(dim=1))


def _power(base: Tensor, exponent: FloatArray | float) -> Tensor:
    """``base ** exponent``, each number by itself.

    On a CPU, torch takes another formula for the last few numbers of a piece, and which these are
    depends on how many subjects there are. NumPy does not.
    """
    if base.device.type == "cpu":
        return torch.from_numpy(base.numpy() ** exponent)
    return base ** torch.as_tensor(exponent, dtype=base.dtype, device=base.device)
