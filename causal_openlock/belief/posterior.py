"""One subject's posterior over the hypotheses about its room, and how it forgets.

Bayes' rule: ``P(h | events)`` is proportional to ``P(h)`` times the product of ``P(event | h)``. A
subject with a perfect memory drops every hypothesis that is ruled out. One that forgets moves back
at the end of each attempt, by a share ``lost``, towards a baseline: its prior at the start of the
trial or, if it forgets failures alone, that prior conditioned on its successful attempts.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from causal_openlock.belief.evidence import DOOR, Event, likelihood
from causal_openlock.belief.hypotheses import Space
from causal_openlock.world.fsm import FloatArray, IntArray

CACHED_EVENTS = 1000
"""Likelihoods kept for a space, each with a byte for every hypothesis."""
_CACHE: WeakKeyDictionary[Space, dict[Event, NDArray[np.bool_]]] = WeakKeyDictionary()


@dataclass(eq=False, repr=False)
class Belief:
    """What one subject believes about the room that it is in.

    Attributes:
        space: The hypotheses.
        slots: ``[P]`` the slot of each position.
        which: ``[E]`` indices of the hypotheses that are still possible, in ascending order.
        weight: ``[E]`` their posterior probabilities.
        start: ``[E]`` the baseline that a subject that forgets moves back to.
        found: The levers that were pushed when each solution was found, as masks of slots.
        drawn: How many hypotheses were sampled, where there are too many to list.
        possible: Whether any hypothesis explains what was observed.
        events: How often each event was observed in this trial.
        attempt: The events of this attempt, for subjects that forget.
        kept: The events of the trial that are not forgotten.

    Example:
        >>> import numpy as np
        >>> Belief(None, np.arange(3), np.arange(4), np.full(4, 0.25)).entropy
        2.0
    """

    space: Space
    slots: IntArray
    which: IntArray
    weight: FloatArray
    start: FloatArray | None = None
    found: tuple[int, ...] = ()
    drawn: int = 0
    possible: bool = True
    events: Counter[Event] = field(default_factory=Counter)
    attempt: tuple[Event, ...] = ()
    kept: tuple[Event, ...] = ()

    @property
    def positions(self) -> IntArray:
        """``[P]`` the position of each slot."""
        return np.argsort(self.slots)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Belief({len(self.which):,} hypotheses, {self.entropy:.2f} bits)"

    @property
    def whole(self) -> bool:
        """Whether all hypotheses are listed, and none is ruled out."""
        return not self.drawn and len(self.which) == len(self.space)

    @property
    def entropy(self) -> float:
        """Shannon entropy of the posterior, in bits."""
        weight = self.weight[self.weight > 0]
        return float(-(weight * np.log2(weight)).sum())

    def forget(self, lost: float, keeps: bool) -> None:
        """Lose a part of the trial's evidence at the end of an attempt.

        Args:
            lost: How far the posterior moves back to the baseline, from 0 to 1.
            keeps: Whether the events of this attempt become part of the baseline.
        """
        if self.start is None:
            return
        if keeps:
            self.start = conditioned(self.space, self.which, self.start, self.attempt)
            self.kept += self.attempt
        self.attempt = ()
        self.weight = (1.0 - lost) * self.weight + lost * self.start


def conditioned(
    space: Space, which: IntArray, prior: FloatArray, events: Iterable[Event]
) -> FloatArray:
    """``[E]`` posterior of some hypotheses, by Bayes' rule.

    Args:
        space: The hypotheses.
        which: ``[E]`` indices of those that have a probability.
        prior: ``[E]`` these probabilities.
        events: What was observed. If no hypothesis explains it, the prior is returned.
    """
    weight = prior.copy()
    for event in events:
        weight *= likelihood(space.hypotheses, which, space.strengths, event)
    total = weight.sum()
    return weight / total if total > 0 else prior


def likelihood_of_all(space: Space, event: Event) -> NDArray[Any]:
    """``[H]`` likelihood of one event under every hypothesis of a space.

    Without noise it is 0 or 1 and is cached: subjects that forget rule nothing out, and meet the
    same events again and again.
    """
    everything = np.arange(len(space))
    if len(space.strengths) > 1:
        return likelihood(space.hypotheses, everything, space.strengths, event)
    # The solutions found before matter to the door alone.
    key = event if event.slot == DOOR else event._replace(found=())
    cached = _CACHE.setdefault(space, {})
    if key not in cached:
        if len(cached) >= CACHED_EVENTS:
            cached.clear()
        cached[key] = likelihood(space.hypotheses, everything, space.strengths, event) > 0
    return cached[key]
