"""Draws that a subject of the theory-based model may have made, given what it did.

The model acts on samples of its Dirichlet beliefs. How likely an action is, is how likely it is the
best one under such samples: the integral, over eleven dimensions in a room of the paper, of where
one sum of products of them is greater than all others. That has no closed form, and enumeration has
nothing to enumerate. So the integral is estimated by a particle filter: many subjects draw, and
those that would not have done what was done so far count no more. With n of them the standard error
of a probability p is that of a share, the root of p (1 - p) / n.

:class:`AttemptDraws` is for the model that decides action by action (AAAI 2020): all that is hidden
was drawn for the attempt. :class:`RoomDraws` is for the one that settles on whole chains (CogSci
2019): its local beliefs are also drawn, for a whole room.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

DRAWS = 2048
"""Draws at a time."""
ENOUGH, BATCHES = 256, 8
"""Draws below which more are made, and how often that may happen."""
LOCAL = 32
"""Local beliefs among the draws of a room."""
TIE = 1e-9


class Odds(NamedTuple):
    """Estimated probabilities.

    Attributes:
        of: ``[N]`` the probabilities.
        draws: Number of independent draws behind the probabilities.
    """

    of: FloatArray
    draws: float


class Moment(NamedTuple):
    """The decision at one moment of an attempt.

    Attributes:
        worth: Returns the ``[N, A]`` worth of each action, from draws of attributes and of schemas.
        schemas: Draws a given number of beliefs in schemas.
        removed: Identifies the chains removed until now. If it has not changed since the last
            moment, neither have the beliefs in schemas.
        possible: ``[A]`` which actions can be the best.
    """

    worth: Callable[[FloatArray, FloatArray], FloatArray]
    schemas: Callable[[int], FloatArray]
    removed: int
    possible: BoolArray


def best(worth: FloatArray) -> FloatArray:
    """``[N, A]`` probabilities of the best of each row, equals with equal ones.

    >>> best(np.array([[3.0, 1.0, 3.0]])).tolist()
    [[0.5, 0.0, 0.5]]
    """
    greatest = (worth >= worth.max(axis=1, keepdims=True) * (1 - TIE)).astype(float)
    greatest /= greatest.sum(axis=1, keepdims=True)
    return greatest


def independent(weight: FloatArray) -> float:
    """Effective number of draws of equal weight (Kish's effective sample size).

    >>> independent(np.array([2.0, 2.0, 0.0]))
    2.0
    """
    return float(weight.sum() ** 2 / (weight**2).sum()) if weight.any() else 0.0


def smoothed(shares: FloatArray, draws: float, possible: BoolArray) -> Odds:
    """Add one draw, divided equally among the possible actions, to the shares of the draws.

    >>> smoothed(np.array([1.0, 0.0, 0.0]), 3, np.array([True, True, False])).of.tolist()
    [0.875, 0.125, 0.0]
    """
    return Odds((draws * shares + possible / possible.sum()) / (draws + 1.0), draws)


class AttemptDraws:
    """Draws of a subject's beliefs in an attempt, weighted by how likely it acts as it did.

    Args:
        attributes: Draws a given number of beliefs in attributes.
        many: How many are drawn at a time.
    """

    def __init__(self, attributes: Callable[[int], FloatArray], many: int = DRAWS) -> None:
        self._attributes, self._many = attributes, many
        self._past: list[tuple[Moment, int]] = []
        self._drawn = self._batch()
        self._asked: tuple[Moment, FloatArray, FloatArray, Odds] | None = None

    def _batch(self) -> tuple[FloatArray, ...]:
        """New draws of attributes and of schemas, and their weights by what was done."""
        theta, weight = self._attributes(self._many), np.ones(self._many)
        belief = np.zeros((self._many, 0))
        before: Moment | None = None
        for moment, action in self._past:
            belief = _renewed(belief, moment, before)
            weight = weight * best(moment.worth(theta, belief))[:, action]
            before = moment
        return _left(theta, belief, weight)

    def ask(self, moment: Moment) -> Odds:
        """The probabilities of the actions now."""
        if self._asked:  # it was asked before
            return self._asked[-1]
        for _ in range(BATCHES):
            if independent(self._drawn[-1]) >= ENOUGH:
                break
            self._drawn = tuple(map(np.concatenate, zip(self._drawn, self._batch(), strict=True)))
        theta, belief, weight = self._drawn
        belief = _renewed(belief, moment, self._past[-1][0] if self._past else None)
        chosen = best(moment.worth(theta, belief))
        shares = weight @ chosen / max(weight.sum(), np.finfo(float).tiny)
        odds = smoothed(shares, independent(weight), moment.possible)
        self._asked = moment, belief, chosen, odds
        return odds

    def acted(self, action: int) -> None:
        """Weight the draws by the action that followed, unless that action was impossible."""
        if self._asked is None:
            return
        (moment, belief, chosen, _), self._asked = self._asked, None
        if action < len(moment.possible) and moment.possible[action]:
            theta, _, weight = self._drawn
            self._drawn = _left(theta, belief, weight * chosen[:, action])
            self._past.append((moment, action))


def _renewed(belief: FloatArray, moment: Moment, before: Moment | None) -> FloatArray:
    """Beliefs in schemas, drawn again where a chain was removed since the moment before."""
    same = before is not None and moment.removed == before.removed
    return belief if same else moment.schemas(len(belief))


def _left(*drawn: FloatArray) -> tuple[FloatArray, ...]:
    left = drawn[-1] > 0
    return tuple(part[left] for part in drawn)


class RoomDraws:
    """Draws of a subject's local beliefs in a room, if it settles on whole chains.

    Args:
        local: ``[L, K]`` draws of the local beliefs that the room began with.

    Attributes:
        settled: ``[L, C]`` probability, by local belief, that each chain was settled on and asks
            for the attempt up to now; None between attempts.
    """

    settled: FloatArray | None = None

    def __init__(self, local: FloatArray) -> None:
        self.local, self._each = local, 0
        self._weight = np.full(len(local), 1.0 / len(local))

    def settle(self, chosen: FloatArray, each: int, possible: BoolArray) -> None:
        """Begin an attempt.

        Args:
            chosen: ``[L, C]`` the shares of draws, by local beliefs, that settle on each chain.
            each: Number of draws behind each row of shares.
            possible: ``[C]`` which chains there are to settle on.
        """
        together = smoothed(self._weight @ chosen, each * len(chosen), possible).of
        self.settled, self._each = (each * chosen + together) / (each + 1.0), each

    def ask(self, now: IntArray) -> Odds:
        """The probabilities of the actions, from what each chain ``[C]`` does now."""
        assert self.settled is not None
        together = self._weight @ self.settled
        draws = independent(self._weight) * self._each * together.sum()
        return Odds(np.bincount(now, together) / together.sum(), draws)

    def acted(self, goes_on: BoolArray | bool, over: bool) -> None:
        """Learn what was done, which some chains ``[C]`` ask for, and whether that was all."""
        if self.settled is None:
            return
        if (left := self.settled * goes_on).any():
            self.settled = left
        if over:
            weight = self._weight * self.settled.sum(axis=1)
            self._weight, self.settled = weight / weight.sum(), None
