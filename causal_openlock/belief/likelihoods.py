"""Observations, and their likelihood under each hypothesis.

An :class:`Event` is one action and its result: whether the lever moved, whether the door was
unlocked afterwards, whether it opened, and whether the console counted a new solution. The
likelihood of an event under hypothesis h is

    P(event | h) = P(took effect | h) [unlocked as h predicts] [new solution as h predicts]

where the last two factors are 0 or 1, as only the movement of levers and the opening of the door
depend on chance. Actions that cannot do anything in any room (pushing what is pushed, the door
while it is locked) carry no information and make no event.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from causal_openlock.belief.hypotheses import Strengths
from causal_openlock.belief.structures import Hypotheses, Masks, Rows
from causal_openlock.contract.learner import Step
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

DOOR = -1
"""The slot of an event that is a push of the door."""


class Event(NamedTuple):
    """One action of one subject and its result.

    Attributes:
        slot: Which lever was pushed or pulled; :data:`DOOR` for a push of the unlocked door.
        pushed: The levers that were pushed before the action, as a bit mask of slots.
        took_effect: Whether the lever moved, or the door opened.
        unlocked: Whether the door was unlocked afterwards.
        new: Whether a solution was found that had not been found before.
        found: The pushed levers with which each solution so far was found.
    """

    slot: int
    pushed: int
    took_effect: bool
    unlocked: bool
    new: bool
    found: tuple[int, ...] = ()

    def repeated(self, count: int) -> Events:
        """Repeat an event ``count`` times, to compare it with that number of hypotheses."""
        return Events(
            np.full(count, self.slot),
            np.full(count, self.pushed, dtype=np.uint16),
            np.full(count, self.took_effect, dtype=bool),
            np.full(count, self.unlocked, dtype=bool),
            np.full(count, self.new, dtype=bool),
            np.tile(np.array(self.found, dtype=np.uint16), (count, 1)),
        )


@dataclass(frozen=True, eq=False)
class Events(Rows):
    """E events: the fields of :class:`Event`, each an array ``[E]``; ``found`` is ``[E, F]``.

    Rows of ``found`` are padded with 0, which is not a solution: no empty set unlocks the door.
    """

    slot: IntArray
    pushed: Masks
    took_effect: BoolArray
    unlocked: BoolArray
    new: BoolArray
    found: Masks

    def single(self, row: int, found: tuple[int, ...]) -> Event:
        """One of the events, with the solutions found before it."""
        return Event(
            int(self.slot[row]),
            int(self.pushed[row]),
            bool(self.took_effect[row]),
            bool(self.unlocked[row]),
            bool(self.new[row]),
            found,
        )


def informative(step: Step) -> IntArray:
    """The subjects whose action could do something: only these observe an event."""
    seen = step.view.observation
    positions = seen.shape[1] // 2 - 1
    is_pushed = seen[np.arange(len(seen)), step.action % positions] == 1
    able = np.where(
        step.action == 2 * positions, seen[:, -2] == 0, (step.action >= positions) == is_pushed
    )
    return np.flatnonzero(step.view.playing & able)


def observed(
    step: Step, subjects: IntArray, slots: IntArray, found: Sequence[tuple[int, ...]]
) -> Events:
    """The events that some subjects observed.

    Args:
        step: What their actions led to.
        subjects: ``[E]`` some of the :func:`informative` ones.
        slots: ``[E, P]`` the slot of each position in the room of each.
        found: The solutions that each had found before.
    """
    seen, outcome = step.view.observation[subjects], step.outcome[subjects]
    action, rows = step.action[subjects], np.arange(len(subjects))
    positions = slots.shape[1]
    door, lever = action == 2 * positions, action % positions
    padded = np.zeros((len(subjects), max(map(len, found), default=0)), dtype=np.uint16)
    for row, sets in enumerate(found):
        padded[row, : len(sets)] = sets
    return Events(
        slot=np.where(door, DOOR, slots[rows, lever]),
        pushed=(seen[:, :positions].astype(np.int64) << slots).sum(axis=1).astype(np.uint16),
        took_effect=np.where(door, outcome[:, -1] == 1, seen[rows, lever] != outcome[rows, lever]),
        unlocked=outcome[:, -2] == 0,
        new=step.new_solution[subjects],
        found=padded,
    )


def likelihood(
    hypotheses: Hypotheses, which: IntArray, strengths: Strengths, events: Event | Events
) -> FloatArray:
    """``[E]`` likelihood of events, each under one hypothesis.

    Args:
        hypotheses: H hypotheses.
        which: ``[E]`` the hypothesis of each pair.
        strengths: What their strengths stand for.
        events: The event of each pair, or one event for all of them.

    Example:
        A lever that nothing enables can always be pushed; the door is unlocked by it alone.

        >>> from causal_openlock.belief.hypotheses import strengths
        >>> one = np.zeros(1, dtype=np.uint8)
        >>> alone = Hypotheses(np.array([[0, 1]]), np.array([[0, 1]]), one, one[None], one)
        >>> pushed = Event(slot=0, pushed=0, took_effect=True, unlocked=True, new=False)
        >>> stuck = Event(slot=0, pushed=0, took_effect=False, unlocked=False, new=False)
        >>> certain = strengths(0.0, 1.0, 1.0, 1)
        >>> [float(likelihood(alone, one, certain, event)[0]) for event in (pushed, stuck)]
        [1.0, 0.0]
    """
    if isinstance(events, Event):
        events = events.repeated(len(which))
    door = hypotheses.causes.shape[1] - 1
    node = np.where(events.slot == DOOR, door, events.slot)
    chance = takes_effect(hypotheses, which, strengths, node, events.pushed)
    result: FloatArray = np.where(events.took_effect, chance, 1.0 - chance)
    of_lever = events.slot != DOOR
    bit = np.left_shift(np.uint16(1), np.where(of_lever, events.slot, 0).astype(np.uint16))
    after = np.where(events.took_effect & of_lever, events.pushed ^ bit, events.pushed)
    live = np.bitwise_count(hypotheses.causes[which, door] & after)
    result *= (live >= hypotheses.threshold[which, door]) == events.unlocked
    opened = np.flatnonzero(events.took_effect & ~of_lever)
    if len(opened):
        new = completes(hypotheses, which[opened], events.pushed[opened], events.found[opened])
        result[opened] *= new == events.new[opened]
    return result


def takes_effect(
    hypotheses: Hypotheses,
    which: IntArray,
    strengths: Strengths,
    node: IntArray,
    pushed: Masks,
) -> FloatArray:
    """``[E]`` probability that a lever moves, or that the unlocked door opens."""
    live = np.bitwise_count(hypotheses.causes[which, node] & pushed)
    return strengths.chance[hypotheses.strength[which], live, hypotheses.threshold[which, node]]


def completes(hypotheses: Hypotheses, which: IntArray, pushed: Masks, found: Masks) -> BoolArray:
    """``[E]`` whether opening the door with these levers pushed completes a new solution."""
    relevant = ~hypotheses.inert[which]
    done = pushed & relevant
    credited = (hypotheses.solutions[which] == done[:, None]).any(axis=1)
    before = ((found & relevant[:, None]) == done[:, None]).any(axis=1)
    return credited & ~before
