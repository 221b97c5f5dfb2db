"""A DDQN that explores as a scientist would.

The paper's discussion asks for model-free learning guided by a causal model. Here the model is the
belief of the structure learner (:mod:`learners.bayes`): when the DDQN explores, it draws its action
in proportion to what the action is expected to tell about the causal structure of the room, in
place of uniformly. Once there is nothing left to be told, it draws uniformly again. Everything else
is the DDQN (:mod:`learners.ddqn`): it values and chooses actions as before, and knows nothing of
what the belief holds.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from causal_openlock.belief.beliefs import Beliefs
from causal_openlock.belief.believer import Believer
from causal_openlock.belief.planning import TIE
from causal_openlock.belief.prior import Prior
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.randomness import pick
from learners.ddqn import DDQN, DDQNParameters


@dataclass(frozen=True)
class BayesNetDDQNParameters(Prior, DDQNParameters):
    """Hyper-parameters: those of the DDQN, and what the structure learner believes at first."""


class BayesNetDDQN(DDQN, Believer):
    """A DDQN whose exploratory actions are drawn by expected information gain."""

    Parameters = BayesNetDDQNParameters
    parameters: BayesNetDDQNParameters

    def begin(self, brief: Brief) -> None:
        """Make the DDQN and the structure learner."""
        super().begin(brief)
        samples = tuple(generator.spawn(1)[0] for generator in brief.generators)
        self.beliefs = Beliefs(brief, self.parameters, samples)

    def _explore(self, view: View, explores: BoolArray, draw: FloatArray) -> IntArray:
        self.beliefs.enter(view)
        actions = super()._explore(view, explores, draw)
        for subject in np.flatnonzero(explores & view.playing).tolist():
            gains = self.gains(subject, view)
            if gains.sum() > TIE:
                actions[subject] = pick(gains, float(draw[subject]))
        return actions

    def learn(self, step: Step) -> None:
        """Learn as the DDQN does, and revise the belief."""
        super().learn(step)
        self.beliefs.update(step)

    def state_dict(self) -> dict[str, Any]:
        """What the DDQN learned, and what the structure learner believes."""
        return super().state_dict() | {"beliefs": self.beliefs.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        super().load_state_dict(state)
        self.beliefs.load_state_dict(state["beliefs"])
