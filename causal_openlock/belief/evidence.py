"""What happened, and how probable each hypothesis makes it.

An :class:`Event` is one action with everything that came of it: whether the lever moved, whether
the door was unlocked after it, whether it opened, and whether the console counted a new solution.
Actions that could do nothing in any room (pushing what is pushed, the door while locked) tell
nothing and make no event.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from causal_openlock.belief.space import Hypotheses
from causal_openlock.belief.strength import Strengths
from causal_openlock.belief.structures import Masks
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray

DOOR = -1
"""The slot of an event that is a push of the door."""


class Event(NamedTuple):
    """One action and what came of it; or many, with an array in each field.

    Attributes:
        slot: Which lever was pushed or pulled; :data:`DOOR` for a push of the unlocked door.
        pushed: The levers that stood pushed before, as a bit mask of slots.
        took_effect: Whether the lever moved, or the door opened.
        unlocked: Whether the door was unlocked afterwards.
        new: Whether a solution was found that had not been found before.
        found: ``[F]`` what stood pushed when the solutions found so far were found; padded with 0.
    """

    slot: IntArray
    pushed: Masks
    took_effect: BoolArray
    unlocked: BoolArray
    new: BoolArray
    found: Masks

    def take(self, rows: IntArray | slice) -> Event:
        """Some of many events, in any order, as often as they are asked for."""
        return Event(
            self.slot[rows],
            self.pushed[rows],
            self.took_effect[rows],
            self.unlocked[rows],
            self.new[rows],
            self.found[rows],
        )


def likelihood(
    hypotheses: Hypotheses, which: IntArray, strengths: Strengths, event: Event
) -> FloatArray:
    """``[E]`` probability of events under hypotheses, one each.

    Args:
        hypotheses: H hypotheses.
        which: ``[E]`` the hypothesis of each pair.
        strengths: What their strengths stand for.
        event: ``[E]`` the event of each pair; ``found`` is ``[E, F]``.
    """
    door = hypotheses.causes.shape[1] - 1
    node = np.where(event.slot == DOOR, door, event.slot)
    chance = takes_effect(hypotheses, which, strengths, node, event.pushed)
    result: FloatArray = np.where(event.took_effect, chance, 1.0 - chance)
    of_lever = event.slot != DOOR
    bit = np.left_shift(np.uint16(1), np.where(of_lever, event.slot, 0).astype(np.uint16))
    after = np.where(event.took_effect & of_lever, event.pushed ^ bit, event.pushed)
    result *= holds(hypotheses, which, np.full_like(node, door), after) == event.unlocked
    opened = np.flatnonzero(event.took_effect & ~of_lever)
    if len(opened):
        new = completes(hypotheses, which[opened], event.pushed[opened], event.found[opened])
        result[opened] *= new == event.new[opened]
    return result


def holds(hypotheses: Hypotheses, which: IntArray, node: IntArray, pushed: Masks) -> BoolArray:
    """``[E]`` whether enough causes of a node are pushed."""
    live = np.bitwise_count(hypotheses.causes[which, node] & pushed)
    enough: BoolArray = live >= hypotheses.threshold[which, node]
    return enough


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
    """``[E]`` whether opening the door completes a solution that was not found before.

    Args:
        hypotheses: H hypotheses.
        which: ``[E]`` one of them each.
        pushed: ``[E]`` what stands pushed.
        found: ``[E, F]`` what stood pushed when solutions were found.
    """
    relevant = ~hypotheses.inert[which]
    done = pushed & relevant
    credited = (hypotheses.solutions[which] == done[:, None]).any(axis=1)
    # An empty set of levers unlocks no door, so that padding never counts as found.
    before = ((found & relevant[:, None]) == done[:, None]).any(axis=1)
    new: BoolArray = credited & ~before
    return new
