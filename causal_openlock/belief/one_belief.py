"""What one subject holds possible in the room that it is in, and how that fades.

A subject with a perfect memory drops whatever is ruled out. One that forgets goes back, a share of
the way with every attempt, to what is in mind for good: what it believed when the trial began and,
if only failures fade, what those attempts told that found something new.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from causal_openlock.belief.recall import Seen, in_mind
from causal_openlock.belief.space import Space
from causal_openlock.world.fsm import FloatArray, IntArray


@dataclass(eq=False, repr=False)
class Belief:
    """What one subject holds possible in the room that it is in.

    Attributes:
        space: The hypotheses.
        slots: ``[P]`` the slot of each position.
        which: ``[E]`` indices of hypotheses that are still possible, in ascending order.
        weight: ``[E]`` their probabilities; they add up to 1.
        start: ``[E]`` what subjects that forget go back to: the same when the trial began.
        found: What stood pushed when solutions were found, as masks of slots.
        drawn: How many hypotheses were sampled, because there are too many to list.
        possible: Whether any hypothesis explains what happened.
        events: How often what happened in this trial.
        attempt: What happened in this attempt, for subjects that forget.
        kept: What happened in the trial and is not forgotten.
    """

    space: Space
    slots: IntArray
    which: IntArray
    weight: FloatArray
    start: FloatArray | None = None
    found: tuple[int, ...] = ()
    drawn: int = 0
    possible: bool = True
    events: Counter[Seen] = field(default_factory=Counter)
    attempt: tuple[Seen, ...] = ()
    kept: tuple[Seen, ...] = ()

    @property
    def positions(self) -> IntArray:
        """``[P]`` the position of each slot."""
        return np.argsort(self.slots)

    def __repr__(self) -> str:
        """Short, as there can be a million hypotheses."""
        return f"Belief({len(self.which):,} hypotheses, {self.entropy:.2f} bits)"

    @property
    def whole(self) -> bool:
        """Whether all hypotheses can be listed, and none is ruled out."""
        return not self.drawn and len(self.which) == len(self.space)

    @property
    def entropy(self) -> float:
        """Bits that are missing to certainty."""
        weight = self.weight[self.weight > 0]
        return float(-(weight * np.log2(weight)).sum())

    def forget(self, lost: float, keeps: bool) -> None:
        """Lose a part of the trial's evidence, when an attempt is over.

        Args:
            lost: How far the belief goes back to what is in mind for good.
            keeps: Whether what the attempt told is kept in mind.
        """
        if self.start is None:
            return
        if keeps:
            self.start = in_mind(self.space, self.which, self.start, self.attempt)
            self.kept += self.attempt
        self.attempt = ()
        self.weight = (1.0 - lost) * self.weight + lost * self.start
