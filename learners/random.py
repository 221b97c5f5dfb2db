"""The random learner: every action equally likely, whatever happens.

The lower bound of every comparison. Under the human protocol it almost never finishes a trial: of
the 3,375 sequences of three actions only two or three open the door.
"""

from __future__ import annotations

from typing import Any

from causal_openlock.contract.learner import Brief, Learner, View
from causal_openlock.world.fsm import IntArray
from causal_openlock.world.randomness import Streams


class RandomLearner(Learner):
    """Draws every action uniformly."""

    def begin(self, brief: Brief) -> None:
        """Open one stream of numbers for each subject."""
        self._actions = brief.actions
        self._streams = Streams(brief.generators)

    def act(self, view: View) -> IntArray:
        """``[B]`` uniformly random actions."""
        return self._streams.integers(self._actions)

    def state_dict(self) -> dict[str, Any]:
        """Where its streams stand, so that it goes on drawing as if never interrupted."""
        return {"streams": self._streams.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self._streams.load_state_dict(state["streams"])
