"""The random learner: every action is uniformly random.

The chance level of every comparison. Under the human protocol it almost never finishes a trial: of
the 3,375 sequences of three actions only two or three open the door.
"""

from __future__ import annotations

import numpy as np

from causal_openlock.contract.learner import Learner, View
from causal_openlock.schemas.fsm import FloatArray


class RandomLearner(Learner):
    """Draws every action uniformly."""

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the same for every action."""
        return np.full((self.brief.subjects, self.brief.actions), 1.0 / self.brief.actions)
