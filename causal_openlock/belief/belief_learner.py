"""The base class of learners that hold beliefs about causal structure."""

from __future__ import annotations

import numpy as np

from causal_openlock.belief.beliefs import Belief, Beliefs
from causal_openlock.belief.marginals import Model, Posterior, model_of
from causal_openlock.belief.planning import Objective, Planner, Situation
from causal_openlock.contract.learner import Learner, Structure, View
from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.schemas.schema import Schema


class BeliefLearner(Learner):
    """A learner whose beliefs can be inspected.

    Example:
        >>> from causal_openlock import PROTOCOLS, Session, create, find_condition
        >>> session = Session(find_condition("CC3"), PROTOCOLS["human"], 1)
        >>> learner = create("bayes")
        >>> session.begin(learner)
        >>> _ = session.step(learner.act(session.view))
        >>> learner.belief(0), learner.structure(0).edges.shape
        (Belief(4,278 hypotheses, 7.86 bits), (7, 8))
    """

    beliefs: Beliefs  #: what its subjects believe; set by :meth:`begin`

    def belief(self, subject: int) -> Belief:
        """A subject's belief about its current room.

        Raises:
            LearnerError: If it has not seen the room yet (see :meth:`act`) or has finished.
        """
        subjects = len(self.beliefs.of) if hasattr(self, "beliefs") else 0
        if not 0 <= subject < subjects:
            raise LearnerError(f"there is no subject {subject}; this learner plays {subjects}")
        belief = self.beliefs.of[subject]
        if belief is None:
            raise LearnerError(
                f"subject {subject} has no belief about a room that it has not seen; ask after "
                "its first action there and before its last"
            )
        return belief

    def classes(self, subject: int) -> FloatArray:
        """``[C + 1]`` a subject's probability of each schema class; the last is the free form."""
        return self.beliefs.knowledge.classes(subject)

    def posterior(self, subject: int) -> Posterior:
        """A subject's belief, spread over structures on the positions of its current room."""
        return Posterior.of(self.belief(subject), self.classes(subject))

    def structure(self, subject: int) -> Structure | None:
        """Probabilities of edges and gates, of the room that a subject is in or has just left."""
        belief = self.beliefs.of[subject] or self.beliefs.left[subject]
        if belief is None:
            return None
        return Posterior.of(belief, self.classes(subject)).expected()

    def most_probable(self, subject: int) -> tuple[Schema, float]:
        """The most probable structure and its probability.

        Levers are named by position. The probability is that of all structures that behave alike.
        """
        return self.posterior(subject).most_probable()

    def model(self, subject: int) -> Model:
        """A subject's belief as objects of pgmpy."""
        return model_of(self.posterior(subject))

    def gains(self, subject: int, view: View) -> FloatArray:
        """``[2P + 1]`` expected information gain of each action alone, in bits; 0 for any pull.

        The subject must have seen the room of the view (see :meth:`act`).
        """
        belief, positions = self.belief(subject), self.beliefs.positions
        situation = Situation.of(view, subject, belief.slots, belief.found)
        planner = Planner(
            belief.space.hypotheses[belief.which],
            belief.space.strengths,
            Objective(information=1.0, beta=0.0, horizon=1),
        )
        values = planner.values(belief.weight, situation)
        gains = np.zeros(2 * positions + 1)
        gains[:positions] = values[belief.slots]
        gains[-1] = values[-1]
        return np.maximum(gains, 0.0)
