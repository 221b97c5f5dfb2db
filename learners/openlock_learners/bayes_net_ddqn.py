"""A DDQN that explores by expected information gain.

The paper's discussion asks for model-free learning guided by a causal model. Here the model is the
posterior of the structure learner (:mod:`openlock_learners.bayes`): exploratory actions are drawn
in proportion to their expected information gain about the causal structure of the room, and
uniformly once nothing is left to learn. Values and greedy actions are those of the DDQN
(:mod:`openlock_learners.ddqn`), which does not use the posterior.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from causal_openlock.belief.belief_learner import BeliefLearner
from causal_openlock.belief.beliefs import Beliefs
from causal_openlock.belief.knowledge import BeliefParameters
from causal_openlock.belief.planning import TIE
from causal_openlock.contract.learner import Brief, Learner, Step, View
from causal_openlock.schemas.fsm import FloatArray, IntArray
from openlock_learners.ddqn import DDQN, DDQNParameters


@dataclass(frozen=True)
class BayesNetDDQNParameters(BeliefParameters, DDQNParameters):
    """Hyper-parameters of the DDQN, and the prior of the structure learner."""


class BayesNetDDQN(DDQN, BeliefLearner):
    """A DDQN whose exploratory actions are drawn by expected information gain."""

    Parameters = BayesNetDDQNParameters
    parameters: BayesNetDDQNParameters

    def begin(self, brief: Brief) -> None:
        """Begin as a DDQN, with a belief for each subject."""
        super().begin(brief)
        samples = tuple(generator.spawn(1)[0] for generator in brief.generators)
        self.beliefs = Beliefs(brief, self.parameters, samples)

    def act(self, view: View) -> IntArray:
        """``[B]`` actions drawn from :meth:`probabilities`."""
        return Learner.act(self, view)

    def _exploring(self, view: View) -> FloatArray:
        self.beliefs.enter(view)
        odds = super()._exploring(view)
        for subject in np.flatnonzero(view.playing).tolist():
            gains = self.gains(subject, view)
            if gains.sum() > TIE:
                odds[subject] = gains / gains.sum()
        return odds

    def learn(self, step: Step) -> None:
        """Train the DDQN and update the posteriors."""
        super().learn(step)
        self.beliefs.update(step)
