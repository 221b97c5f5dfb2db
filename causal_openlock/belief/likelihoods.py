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

from typing import NamedTuple

import numpy as np

from causal_openlock.belief.hypotheses import Strengths
from causal_openlock.belief.structures import Hypotheses
from causal_openlock.contract.learner import Step
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray

DOOR = -1
"""The slot of an event that is a push of the door, the last node."""


class Event(NamedTuple):
    """One action of one subject and its result."""

    slot: int  #: which lever was pushed or pulled; :data:`DOOR` for a push of the unlocked door
    pushed: int  #: the levers that were pushed before the action, as a bit mask of slots
    took_effect: bool  #: whether the lever moved, or the door opened
    unlocked: bool  #: whether the door was unlocked afterwards
    new: bool  #: whether a solution was found that had not been found before
    found: tuple[int, ...] = ()  #: the pushed levers with which each solution so far was found


def observed(
    step: Step, subject: int, slots: IntArray, found: tuple[int, ...] = ()
) -> Event | None:
    """The event that a subject that still plays observed; None if its action could do nothing.

    ``slots``, ``[P]``, are those of the positions in its room, ``found`` what it had found before.
    """
    before, after = step.view.observation[subject], step.outcome[subject]
    verb, position = divmod(int(step.action[subject]), len(slots))
    pushed = int((before[: len(slots)].astype(np.int64) << slots).sum())
    unlocked, new = bool(after[-2] == 0), bool(step.new_solution[subject])
    if verb == 2:
        if before[-2]:  # the door is locked
            return None
        return Event(DOOR, pushed, bool(after[-1]), unlocked, new, found)
    if before[position] != verb:  # a lever that is pushed already, or pulled back already
        return None
    moved = bool(before[position] != after[position])
    return Event(int(slots[position]), pushed, moved, unlocked, new, found)


def likelihood(
    hypotheses: Hypotheses, which: IntArray, strengths: Strengths, event: Event
) -> FloatArray:
    """``[E]`` likelihood of an event under the hypotheses at ``which``, ``[E]``.

    Example:
        A lever that nothing enables can always be pushed; the door is unlocked by it alone.

        >>> from causal_openlock.belief.hypotheses import strengths
        >>> one = np.zeros(1, dtype=np.uint8)
        >>> alone = Hypotheses(np.array([[0, 1]]), np.array([[0, 1]]), one, one[None], one)
        >>> pushed = Event(slot=0, pushed=0, took_effect=True, unlocked=True, new=False)
        >>> stuck = Event(slot=0, pushed=0, took_effect=False, unlocked=False, new=False)
        >>> certain = strengths(0.0)
        >>> [float(likelihood(alone, one, certain, event)[0]) for event in (pushed, stuck)]
        [1.0, 0.0]
    """
    slot, pushed, took_effect, unlocked, new, found = event
    door = hypotheses.causes.shape[1] - 1
    live = np.bitwise_count(hypotheses.causes[which, slot] & np.uint16(pushed))
    threshold = hypotheses.threshold[which, slot]
    chance = strengths.chance[hypotheses.strength[which], live, threshold]
    result: FloatArray = chance if took_effect else 1.0 - chance
    after = pushed ^ 1 << slot if took_effect and slot != DOOR else pushed
    live = np.bitwise_count(hypotheses.causes[which, door] & np.uint16(after))
    result *= (live >= hypotheses.threshold[which, door]) == unlocked
    if slot == DOOR and took_effect:
        result *= completes(hypotheses, which, pushed, found) == new
    return result


def completes(
    hypotheses: Hypotheses, which: IntArray | slice, pushed: int, found: tuple[int, ...]
) -> BoolArray:
    """``[E]`` whether opening the door with these levers pushed completes a new solution."""
    relevant = ~hypotheses.inert[which]
    solution = np.uint16(pushed) & relevant
    new: BoolArray = (hypotheses.solutions[which] == solution[:, None]).any(axis=1)
    for earlier in found:
        new &= np.uint16(earlier) & relevant != solution
    return new
