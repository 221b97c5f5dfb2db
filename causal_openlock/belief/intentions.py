"""Thompson sampling: intentions that a subject may have, given what it did.

*Thompson sampling* draws a hypothesis from the posterior and carries out a solution of it, lever by
lever, until the door or until a lever does not move. Each hypothesis is acted on with its posterior
probability (probability matching), so a subject explores exactly as much as it is uncertain. The
alternative without weights draws any solution that some hypothesis still allows.

Nobody sees which solution was drawn, so the probability of the next action is a mean over every
intention that the subject may have, given what it did since. :class:`Intentions` keeps these
probabilities; they are exact, and nothing is drawn.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.planning import Situation, achievable
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.fsm import FloatArray, IntArray

Plan = tuple[int, ...] | None
"""Slots to push, in order; None where there is none."""


class Intention(NamedTuple):
    """An intention of a subject."""

    plan: Plan = None  #: the solution that it carries out
    tried: int = 0  #: how many of its levers it has pushed, the last one perhaps without effect

    def missing(self, pushed: int) -> list[int]:
        """The levers of the plan that are not pushed yet."""
        return [slot for slot in self.plan or () if not pushed >> slot & 1]

    def failed(self, pushed: int) -> bool:
        """Whether there is no plan, or the lever tried last is not pushed."""
        return self.plan is None or len(self.plan) - len(self.missing(pushed)) < self.tried

    def continued(
        self, situation: Situation, positions: int
    ) -> Iterator[tuple[float, int, Intention]]:
        """What may come next: its probability, the slot pushed (P is the door), what is in mind."""
        missing = self.missing(situation.pushed)
        if self.plan is None or not (missing or situation.unlocked):
            for slot in range(positions):  # any lever
                yield 1.0 / positions, slot, Intention()
        elif missing:
            yield 1.0, missing[0], Intention(self.plan, len(self.plan) - len(missing) + 1)
        else:
            yield 1.0, positions, self


class Intentions:
    """The probabilities of a subject's possible intentions.

    A share ``lapse`` of what it does is random, any of the ``actions``, and leaves its intention.
    """

    def __init__(self, lapse: float, actions: int) -> None:
        self._lapse, self._actions = lapse, actions
        self._shares: Mapping[Intention, float] = {Intention(): 1.0}
        self._courses: list[tuple[Intention, float, int, Intention]] = []

    def next(
        self, situation: Situation, positions: int, draw: Callable[[], list[tuple[float, Plan]]]
    ) -> FloatArray:
        """``[P + 1]`` the probability of pushing each slot, and the door, but for lapses.

        ``draw`` gives what the subject may draw if it has no plan, or if its plan has failed.
        """
        drawn: list[tuple[float, Plan]] = []
        self._courses = []
        for mind, share in self._shares.items():
            carried_out = [(1.0, mind)]
            if mind.failed(situation.pushed):
                drawn = drawn or draw()
                carried_out = [(chance, Intention(plan)) for chance, plan in drawn]
            for chance, intention in carried_out:
                for then, slot, after in intention.continued(situation, positions):
                    self._courses.append((mind, share * chance * then, slot, after))
        odds = np.zeros(positions + 1)
        for _, chance, slot, _ in self._courses:
            odds[slot] += chance
        return odds

    def acted(self, slot: int | None, over: bool) -> None:
        """Update by an action: a push of a slot, or another; and by whether the attempt is over."""
        shares: defaultdict[Intention, float] = defaultdict(float)
        for mind, chance, pushed, after in self._courses if not over else ():
            if pushed == slot:
                shares[after] += (1.0 - self._lapse) * chance
            if self._lapse:
                shares[mind] += self._lapse / self._actions * chance
        total = sum(shares.values())
        # What no intention leads to leaves none.
        self._shares = {Intention(): 1.0}
        if total:
            self._shares = {mind: share / total for mind, share in shares.items()}
        self._courses = []


def drawn_solutions(
    hypotheses: Hypotheses, weight: FloatArray, situation: Situation, by_weight: bool
) -> list[tuple[float, Plan]]:
    """The plans that a subject may draw, with their probabilities.

    With ``by_weight`` it draws one of the hypotheses by their ``weight``, ``[h]``, and then a
    solution of it; otherwise any solution that some hypothesis allows.
    """
    possible, found = (weight > 0)[:, None], situation.found
    fitting = achievable(hypotheses, situation.pushed, situation.left, found) & possible
    if not fitting.any():
        # No solution can be completed in this attempt any more; begin one all the same.
        fitting = achievable(hypotheses, 0, hypotheses.causes.shape[1] + 1, found) & possible
        if not fitting.any():
            return [(1.0, None)]
    which, column = np.nonzero(fitting)
    solution = hypotheses.solutions[which, column].astype(np.int64)
    if by_weight:
        chance = weight[which] / fitting.sum(axis=1)[which]
    else:
        # Any solution as likely; then a hypothesis that allows it, by its probability. One may
        # list a solution twice, and is still one hypothesis.
        _, first = np.unique(np.stack([which, solution]), axis=1, return_index=True)
        which, solution = which[first], solution[first]
        values, number = np.unique(solution, return_inverse=True)
        chance = weight[which] / np.bincount(number, weight[which])[number] / len(values)
    orders = in_order(hypotheses, which, solution, situation.pushed)
    # The orders as numbers: sorting these takes a hundredth of the time.
    base = hypotheses.causes.shape[1] + 1
    code = (base ** np.arange(len(orders))) @ (orders + 1).astype(np.int64)
    _, first, number = np.unique(code, return_index=True, return_inverse=True)
    chances = np.bincount(number, chance) / chance.sum()
    return [
        (share, tuple(slot for slot in order if slot >= 0))
        for share, order in zip(chances.tolist(), orders.T[first].tolist(), strict=True)
        if share > 0
    ]


def in_order(
    hypotheses: Hypotheses, which: IntArray, solution: IntArray, pushed: int
) -> NDArray[np.int8]:
    """``[k, n]`` the levers of solutions still to be pushed, causes before effects; then -1.

    Each ``solution``, ``[n]``, is ordered by the hypothesis ``which``, ``[n]``; these sets of slots
    and ``pushed``, what is pushed already, are bit masks.
    """
    missing = (solution & ~pushed).astype(np.uint16)
    most = int(np.bitwise_count(missing).max(initial=0))
    causes, threshold = hypotheses.causes.T[:-1, which], hypotheses.threshold.T[:-1, which]
    done = np.full(len(which), pushed, dtype=np.uint16)
    orders = np.zeros((most, len(which)), dtype=np.int8)
    for order in orders:
        ready = np.zeros_like(missing)
        for slot in range(len(causes)):
            able = np.bitwise_count(causes[slot] & done) >= threshold[slot]
            ready |= able.astype(np.uint16) << np.uint16(slot)
        open_ = np.where(ready & missing, ready & missing, missing)
        first = open_ & (~open_ + np.uint16(1))  # the lowest bit
        order[:] = np.where(first, np.bitwise_count(first - np.uint16(1)), -1)
        missing, done = missing & ~first, done | first
    return orders
