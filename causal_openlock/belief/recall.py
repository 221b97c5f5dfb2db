"""What was seen earlier in a trial, taken up again.

Who thinks again goes through all that happened with other hypotheses. Who forgets rules nothing
out, so that the same events are asked of the same hypotheses time after time: these answers are
kept. And what a subject that forgets keeps in mind for good is evidence that its belief goes back
to instead of fading away.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.evidence import DOOR, Event, likelihood
from causal_openlock.belief.space import Space
from causal_openlock.world.fsm import FloatArray, IntArray

Seen = tuple[Any, ...]
"""An event: slot, pushed before, took effect, unlocked after, new solution, and what was found."""

MOST_KEPT = 1000
"""Answers kept for a space, each a byte for every hypothesis."""
_ANSWERS: WeakKeyDictionary[Space, dict[Seen, NDArray[np.bool_]]] = WeakKeyDictionary()


def evidence(space: Space, which: IntArray, seen: Seen) -> FloatArray:
    """``[E]`` probability of one event under some hypotheses.

    Args:
        space: The hypotheses.
        which: ``[E]`` indices of those that are asked.
        seen: The event.
    """
    many = len(which)
    *one, found = seen
    slot, pushed, took_effect, unlocked, new = one
    event = Event(
        slot=np.full(many, slot),
        pushed=np.full(many, pushed, dtype=np.uint16),
        took_effect=np.full(many, bool(took_effect)),
        unlocked=np.full(many, bool(unlocked)),
        new=np.full(many, bool(new)),
        found=np.tile(np.array(found, dtype=np.uint16), (many, 1)),
    )
    return likelihood(space.hypotheses, which, space.strengths, event)


def evidence_of_all(space: Space, seen: Seen) -> NDArray[Any]:
    """``[H]`` probability of one event under every hypothesis of a space.

    Without noise it is yes or no, and kept.
    """
    everything = np.arange(len(space))
    if len(space.strengths) > 1:
        return evidence(space, everything, seen)
    # What was found before matters to the door alone.
    key = seen if seen[0] == DOOR else (*seen[:-1], ())
    answers = _ANSWERS.setdefault(space, {})
    if key not in answers:
        if len(answers) >= MOST_KEPT:
            answers.clear()
        answers[key] = evidence(space, everything, seen) > 0
    return answers[key]


def in_mind(
    space: Space, which: IntArray, start: FloatArray, happened: Iterable[Seen]
) -> FloatArray:
    """``[E]`` what a subject goes back to, once it keeps some events in mind for good.

    Args:
        space: The hypotheses.
        which: ``[E]`` indices of those held possible.
        start: ``[E]`` their probabilities when the trial began, or what was in mind until now.
        happened: The events. Where no hypothesis explains them nothing changes.
    """
    weight = start.copy()
    for seen in happened:
        weight *= evidence(space, which, seen)
    total = weight.sum()
    return weight / total if total > 0 else start
