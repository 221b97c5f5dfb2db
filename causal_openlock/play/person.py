"""A person as a learner: what experiments and reports know people by."""

from __future__ import annotations

from typing import NoReturn

from causal_openlock.contract.learner import Brief, Learner, View
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import PERSON, LearnerSpec, Protocol
from causal_openlock.world.rewards import RewardFunction

LABEL = "person"


def as_learner(protocol: Protocol, reward: RewardFunction, label: str = LABEL) -> LearnerSpec:
    """People as an experiment has them; they play until nobody joins any more."""
    return LearnerSpec(learner=PERSON, name=label, protocol=protocol, reward=reward, subjects=1)


class Person(Learner):
    """A person, who takes part in no comparison: nobody can be asked to act here."""

    def begin(self, brief: Brief) -> NoReturn:
        """Say how people play, and how a report shows them next to learners."""
        raise LearnerError("a person plays in the browser; start causal-openlock play")

    def act(self, view: View) -> NoReturn:
        """Never called: it does not begin."""
        raise NotImplementedError
