"""The random learner: every action is uniformly random.

The chance level of every comparison. Under the human protocol it almost never finishes a trial: of
the 3,375 sequences of three actions only two or three open the door.
"""

from __future__ import annotations

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, View
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import Streams


class RandomLearner(Learner):
    """Draws every action uniformly."""

    def begin(self, brief: Brief) -> None:
        """Open a stream of numbers for each subject: drawn ahead, it is faster."""
        super().begin(brief)
        self._streams = Streams(brief.generators)

    def act(self, view: View) -> IntArray:
        """``[B]`` uniformly random actions."""
        return self._streams.integers(self.brief.actions)

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the same for every action."""
        return np.full((self.brief.subjects, self.brief.actions), 1.0 / self.brief.actions)
