"""Intentions that a subject may have, given what it did.

A subject that acts on one hypothesis at a time draws a solution and carries it out, lever by lever,
until the door or until a lever does not move. Nobody sees which solution it drew. So the
probability of its next action is a mean over all that it may have in mind: every intention that it
could have drawn, with what it did since. :class:`Intentions` keeps these probabilities; they are
exact, and nothing is drawn.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.planning import Situation, fitting_solutions
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.schemas.fsm import FloatArray, IntArray

DENSE = 4096
"""Number of plan codes up to which they need no sorting."""
Plan = tuple[int, ...] | None
"""Slots to push, in order; None where there is none."""


class Intention(NamedTuple):
    """An intention of a subject.

    Attributes:
        plan: The solution that it carries out.
        tried: How many of its levers it has pushed, the last one perhaps without effect.
    """

    plan: Plan = None
    tried: int = 0


class Course(NamedTuple):
    """A continuation of an intention.

    Attributes:
        chance: Its probability.
        slot: What is pushed; P is the door.
        then: What the subject has in mind after it.
    """

    chance: float
    slot: int
    then: Intention


def courses(
    intention: Intention,
    situation: Situation,
    positions: int,
    draw: Callable[[], Iterable[tuple[float, Plan]]],
) -> Iterator[Course]:
    """The continuations of an intention.

    Args:
        intention: What the subject has in mind.
        situation: Where its attempt stands.
        positions: Slots of the room, P.
        draw: What it may draw if it has no plan, or if its plan has failed; with probabilities.
    """
    plan, tried = intention
    missing = _missing(plan, situation)
    # If the lever tried last is not pushed, the plan has failed.
    if plan is None or len(plan) - len(missing) < tried:
        for chance, new in draw():
            yield from _on(chance, Intention(new), list(new or ()), situation, positions)
    else:
        yield from _on(1.0, intention, missing, situation, positions)


def _missing(plan: Plan, situation: Situation) -> list[int]:
    return [slot for slot in plan or () if not situation.pushed >> slot & 1]


def _on(
    chance: float, mind: Intention, missing: list[int], situation: Situation, positions: int
) -> Iterator[Course]:
    if mind.plan is None or not (missing or situation.unlocked):
        for slot in range(positions):  # any lever
            yield Course(chance / positions, slot, Intention())
    elif not missing:
        yield Course(chance, positions, mind)
    else:
        tried = len(mind.plan) - len(missing) + 1
        yield Course(chance, missing[0], Intention(mind.plan, tried))


class Intentions:
    """The probabilities of a subject's possible intentions.

    Args:
        lapse: The share of its actions that are random and leave its intention as it is.
        actions: How many actions there are.
    """

    def __init__(self, lapse: float, actions: int) -> None:
        self._lapse, self._actions = lapse, actions
        self._known: Mapping[Intention, float] = {Intention(): 1.0}
        self._courses: list[tuple[Intention, Course]] = []

    def next(
        self, situation: Situation, positions: int, draw: Callable[[], Iterable[tuple[float, Plan]]]
    ) -> FloatArray:
        """``[P + 1]`` the probability of pushing each slot, and the door, but for lapses."""
        drawn: list[tuple[float, Plan]] = []

        def once() -> list[tuple[float, Plan]]:
            drawn.extend(draw() if not drawn else ())
            return drawn

        self._courses = [
            (mind, Course(share * course.chance, course.slot, course.then))
            for mind, share in self._known.items()
            for course in courses(mind, situation, positions, once)
        ]
        odds = np.zeros(positions + 1)
        for _, course in self._courses:
            odds[course.slot] += course.chance
        return odds

    def acted(self, slot: int | None, over: bool) -> None:
        """Update by an action: a push of a slot, or another; and by whether the attempt is over."""
        known: defaultdict[Intention, float] = defaultdict(float)
        if not over:
            for mind, course in self._courses:
                if course.slot == slot:
                    known[course.then] += (1.0 - self._lapse) * course.chance
                if self._lapse:
                    known[mind] += self._lapse / self._actions * course.chance
        total = sum(known.values())
        # What no intention leads to leaves none.
        self._known = (
            {mind: share / total for mind, share in known.items()} if total else {Intention(): 1.0}
        )
        self._courses = []


def drawn_solutions(
    hypotheses: Hypotheses, weight: FloatArray, situation: Situation, by_weight: bool
) -> list[tuple[float, Plan]]:
    """The plans that :func:`~causal_openlock.belief.planning.sample_solution` draws, with chances.

    Args:
        hypotheses: ``[h]`` the possible hypotheses.
        weight: ``[h]`` their probabilities.
        situation: Where the attempt stands.
        by_weight: As there.
    """
    fitting = fitting_solutions(hypotheses, weight, situation)
    if fitting is None:
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
    # The rows as numbers: sorting these takes a hundredth of the time, and few need no sorting.
    base = hypotheses.causes.shape[1] + 1
    wide = np.int64 if base ** len(orders) < 2**62 else object
    code = (base ** np.arange(len(orders), dtype=wide)) @ (orders + 1).astype(wide)
    if base ** len(orders) <= DENSE:
        codes, number = np.arange(base ** len(orders)), code
    else:
        codes, number = np.unique(code, return_inverse=True)
    chances = np.bincount(number, chance, len(codes)) / chance.sum()
    some = np.flatnonzero(chances)
    return [(float(chances[place]), _decoded(int(codes[place]), base)) for place in some.tolist()]


def _decoded(code: int, base: int) -> tuple[int, ...]:
    """The slots of a plan, from its number.

    >>> _decoded(1 + 8 * 4, 8)
    (0, 3)
    """
    slots = []
    while code:
        code, digit = divmod(code, base)
        slots.append(digit - 1)
    return tuple(slots)


def in_order(
    hypotheses: Hypotheses, which: IntArray, solution: IntArray, pushed: int
) -> NDArray[np.int8]:
    """``[k, n]`` the levers of solutions still to be pushed, causes before effects; then -1.

    Args:
        hypotheses: ``[h]`` hypotheses.
        which: ``[n]`` which of them orders the levers.
        solution: ``[n]`` a solution, as a bit mask of slots.
        pushed: What is pushed already, likewise.
    """
    missing = (solution & ~pushed).astype(np.uint16)
    most = int(np.bitwise_count(missing).max(initial=0))
    causes, threshold = hypotheses.causes.T[:-1, which], hypotheses.threshold.T[:-1, which]
    done = np.full(len(which), pushed, dtype=np.uint16)
    orders = np.zeros((most, len(which)), dtype=np.int8)
    for place, order in enumerate(orders, start=1):
        open_ = missing
        if place < most:  # of the last there is one at most
            ready = np.zeros_like(missing)
            for slot in range(len(causes)):
                able = np.bitwise_count(causes[slot] & done) >= threshold[slot]
                ready |= able.astype(np.uint16) << np.uint16(slot)
            ready &= missing
            open_ = np.where(ready, ready, missing)
        first = open_ & (~open_ + np.uint16(1))  # the lowest bit
        order[:] = np.where(first, np.bitwise_count(first - np.uint16(1)), -1)
        missing, done = missing & ~first, done | first
    return orders
