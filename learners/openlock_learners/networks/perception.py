"""Input of a recurrent network: what its learner perceives, as numbers.

A room looks the same at the start of every attempt. Attempts differ in what the console shows and
in what the subject did: its last action, the reward of it, and whether it changed anything, which
would be lost as the room is put back. The network itself must remember what lies further back.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.schemas.fsm import BoolArray

Inputs = NDArray[np.float32]

SOLUTIONS = 3
"""Solutions of the paper's largest rooms, to scale their numbers to about 1."""


class Perception:
    """The inputs of B subjects, ``size`` numbers each, and what they last did.

    These are the bits of the room, the last action (one-hot; none at first), its reward, whether it
    changed anything, and solutions found, solutions left, attempts left and actions left.
    """

    def __init__(self, brief: Brief) -> None:
        self._brief = brief
        self._last: Inputs = np.zeros((brief.subjects, brief.actions + 2), dtype=np.float32)
        self.size = brief.observation_size + brief.actions + 2 + 4

    def inputs(self, view: View) -> Inputs:
        """``[B, size]`` what is perceived now."""
        console, brief = view.console, self._brief
        shown = [
            console.solutions_found / SOLUTIONS,
            console.solutions_left / SOLUTIONS,
            console.attempts_left / brief.attempt_limit,
            console.actions_left / brief.action_limit,
        ]
        return np.column_stack([view.observation, self._last, *shown]).astype(np.float32)

    def note(self, step: Step) -> None:
        """Note what the subjects that play did and what it led to."""
        who = np.flatnonzero(step.view.playing)
        reward = step.reward[who]
        moved = (step.outcome[who] != step.view.observation[who]).any(axis=1)
        self._last[who] = 0
        self._last[who, step.action[who]] = 1
        # Penalties are fractions and an opened door earns tens: the logarithm keeps both visible.
        self._last[who, -2] = np.sign(reward) * np.log1p(np.abs(reward))
        self._last[who, -1] = moved

    def forget(self, who: BoolArray) -> None:
        """Forget what the subjects marked in ``who``, ``[B]``, last did."""
        self._last[who] = 0
