"""Tabular Q-learning (Watkins 1989): a value for every action in every state of the room.

The state is the whole observation, so nothing is generalised: a room with other grey levers is a
new world, and only in rooms of the same colours is anything met again. After each action::

    Q(s, a) += learning_rate * (reward + gamma * max Q(s', .) - Q(s, a))

An attempt is an episode: no value reaches over its end. Actions are epsilon-greedy, with ties
broken at random and the epsilons of the paper's DDQN, which is this learner with a network in the
place of the table.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.contract.parameters import Share
from causal_openlock.schemas.fsm import FloatArray, IntArray
from openlock_learners.exploration import Exploration, ExplorationParameters
from openlock_learners.networks.replay_buffer import ObservationTable


@dataclass(frozen=True)
class TabularQParameters(ExplorationParameters):
    """Hyper-parameters; discount and exploration are those of the paper's DDQN."""

    learning_rate: Annotated[Share, "share of the error that is corrected at once"] = 0.2
    gamma: Annotated[Share, "discount factor"] = 0.8
    initial_value: Annotated[float, "of every action in every state"] = 0.0


class TabularQ(Learner):
    """Q-learning with a table over all that can be observed."""

    Parameters = TabularQParameters
    parameters: TabularQParameters

    def begin(self, brief: Brief) -> None:
        """Begin with an empty table; it grows with the observations that are met."""
        super().begin(brief)
        self._everyone = np.arange(brief.subjects)
        self._table = ObservationTable(brief.observation_size)
        self._values = np.full((brief.subjects, 64, brief.actions), self.parameters.initial_value)
        self.exploration = Exploration(self.parameters, brief.subjects)

    def _rows(self, observations: Observations) -> IntArray:
        """``[B]`` the row of each observation; all subjects use the same rows of their tables."""
        rows = self._table.number(observations)
        while len(self._table.rows) > self._values.shape[1]:
            fresh = np.full_like(self._values, self.parameters.initial_value)
            self._values = np.concatenate([self._values, fresh], axis=1)
        return rows

    def values(self, observations: Observations) -> FloatArray:
        """``[B, 2P + 1]`` the values of all actions in the states that the subjects are in."""
        rows = self._rows(observations)  # which may make the table larger
        found: FloatArray = self._values[self._everyone, rows]
        return found

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` a random action and the best ones, mixed by epsilon."""
        values = self.values(view.observation)
        best = values == values.max(axis=1, keepdims=True)
        greedy = best / best.sum(axis=1, keepdims=True)
        return self.exploration.mixed(greedy, 1.0 / self.brief.actions)

    def learn(self, step: Step) -> None:
        """Correct the value of each action that was taken, and lower epsilon."""
        settings, who = self.parameters, np.flatnonzero(step.view.playing)
        before, after = (self._rows(seen) for seen in (step.view.observation, step.outcome))
        place = who, before[who], step.action[who]
        to_come = self._values[who, after[who]].max(axis=1) * ~step.attempt_over[who]
        error = step.reward[who] + settings.gamma * to_come - self._values[place]
        self._values[place] += settings.learning_rate * error
        self.exploration.decay(step)
