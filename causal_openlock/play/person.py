"""A person, or an agent, as a learner: what experiments and reports know those by who play here."""

from __future__ import annotations

from typing import NoReturn

from causal_openlock.contract.learner import Brief, Learner, NoParameters, View
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import PERSON, LearnerSpec, Protocol
from causal_openlock.world.rewards import RewardFunction

LABEL = "person"


def as_learner(
    protocol: Protocol, reward: RewardFunction, label: str = LABEL, learner: str = PERSON
) -> LearnerSpec:
    """People, or an agent, as an experiment has them; they play until nobody joins any more."""
    return LearnerSpec(learner=learner, name=label, protocol=protocol, reward=reward, subjects=1)


class Person(Learner):
    """A person, who takes part in no comparison: nobody can be asked to act here."""

    how = "a person plays in the browser; start causal-openlock play"

    def begin(self, brief: Brief) -> NoReturn:
        """Say how people play, and how a report shows them next to learners."""
        raise LearnerError(self.how)

    def act(self, view: View) -> NoReturn:
        """Never called: it does not begin."""
        raise NotImplementedError


class Agent(Person):
    """An agent that acts through tools, from outside."""

    how = "an agent plays through tools; start causal-openlock serve"

    @classmethod
    def prior_attempts(cls, parameters: NoParameters) -> None:
        """Nobody knows what an agent has seen before."""
