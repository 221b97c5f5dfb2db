"""Learners that hold beliefs about causal structure, and let others look at them.

What :class:`Believer` offers is what a trace of a trial, a notebook or a test asks of a learner:
the belief itself, how probable arrows are, the most probable network for pgmpy, and what each
action would tell.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.belief.beliefs import Belief, Beliefs
from causal_openlock.belief.insight import edge_probabilities, most_probable
from causal_openlock.belief.planning import Objective, Planner, Situation
from causal_openlock.contract.learner import Learner, View
from causal_openlock.errors import LearnerError
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.schema import Schema

if TYPE_CHECKING:
    from causal_openlock.belief.networks import Model


class Believer(Learner):
    """A learner whose beliefs can be looked at.

    Attributes:
        beliefs: What its subjects believe; there from :meth:`begin` on.
    """

    beliefs: Beliefs

    def belief(self, subject: int) -> Belief:
        """What a subject believes of the room that it is in.

        Raises:
            LearnerError: If it has not looked at the room yet (see :meth:`act`) or has finished.
        """
        known = getattr(self, "beliefs", None)
        subjects = len(known.of) if known else 0
        if not 0 <= subject < subjects:
            raise LearnerError(f"there is no subject {subject}; this learner plays {subjects}")
        belief = self.beliefs.of[subject]
        if belief is None:
            raise LearnerError(
                f"subject {subject} believes nothing of a room that it has not seen; ask after "
                "its first action there and before its last"
            )
        return belief

    def classes(self, subject: int) -> FloatArray:
        """``[C + 1]`` how probable a subject holds each schema class; the last is none of them."""
        classes: FloatArray = self.beliefs.knowledge.classes(np.array([subject]))[0]
        return classes

    def edges(self, subject: int) -> FloatArray:
        """``[P, P + 1]`` probability that a lever enables another, or the door, by position."""
        return edge_probabilities(self.belief(subject), self.classes(subject))

    def most_probable(self, subject: int) -> tuple[Schema, float]:
        """What is most probable, its levers called by their positions, and how probable.

        The probability is that of all structures that act alike in every attempt.
        """
        return most_probable(self.belief(subject), self.classes(subject))

    def model(self, subject: int) -> Model:
        """A subject's belief as objects of pgmpy."""
        from causal_openlock.belief.networks import model_of

        return model_of(self.belief(subject), self.classes(subject))

    def gains(self, subject: int, view: View) -> FloatArray:
        """``[2P + 1]`` bits that each action is expected to tell, by itself; 0 for any pull.

        Args:
            subject: Whose belief counts.
            view: What the subjects see; they must have looked at it (see :meth:`act`).
        """
        belief = self.belief(subject)
        positions = self.beliefs.positions
        situation = situation_of(belief, view, subject)
        planner = Planner(
            belief.space.hypotheses[belief.which],
            belief.space.strengths,
            Objective(information=1.0, beta=0.0, horizon=1),
            situation.found,
        )
        values = planner.values(belief.weight, situation)
        gains = np.zeros(2 * positions + 1)
        gains[:positions] = values[belief.slots]
        gains[-1] = values[-1]
        return np.maximum(gains, 0.0)


def situation_of(belief: Belief, view: View, subject: int) -> Situation:
    """Where a subject's attempt stands.

    When there is nothing new to find, old solutions are as good as new ones.
    """
    seen = view.observation[subject]
    levers = seen[: len(belief.slots)].astype(np.int64)
    return Situation(
        pushed=int((levers << belief.slots).sum()),
        unlocked=bool(seen[-2] == 0),
        left=int(view.console.actions_left[subject]),
        found=belief.found if view.console.solutions_left[subject] else (),
    )
