"""The associative learner: the Rescorla-Wagner rule on lever, colour and position.

Rescorla & Wagner (1972), which the paper names as the associative account of causal learning. An
action is a conditioning trial. Its cues are the *lever* itself (a new one in every room, so that
what was associated with it is gone there), its *position* and its *colour* (which stay), each
together with the verb, push or pull; the door's colour is the lamp of its lock. All cues present
share one prediction error::

    V = V_lever + V_position + V_colour
    V_cue += salience_cue * (effect - V)

The effect is 1 if the door opened, ``partial`` if a lever came out, and 0 otherwise. Actions are
drawn by the softmax of V, among those that can be seen to be possible: no push of a pushed lever,
no pull of one that is in.

It learns to push grey levers until the lock's lamp changes, and then the door. Which lever enables
which, and which solutions were found, has no place in it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.contract.parameters import Positive, Share
from causal_openlock.schemas.fsm import FloatArray, IntArray


@dataclass(frozen=True)
class AssociativeParameters:
    """Saliences (the rule's alpha times beta), effects, and how strictly it takes the strongest."""

    lever: Annotated[Share, "salience of the lever itself, which is another one in each room"] = 0.3
    position: Annotated[Share, "salience of the position"] = 0.05
    colour: Annotated[Share, "salience of the colour"] = 0.15
    partial: Annotated[Share, "effect of a lever that comes out; the open door is 1"] = 0.5
    temperature: Annotated[Positive, "of the softmax by which actions are drawn"] = 0.1


class Associative(Learner):
    """Learns by the Rescorla-Wagner rule which levers, colours and positions have effects."""

    Parameters = AssociativeParameters
    parameters: AssociativeParameters

    def begin(self, brief: Brief) -> None:
        """Begin without any association."""
        super().begin(brief)
        self._positions = brief.positions
        self.lever = np.zeros((brief.subjects, brief.actions))
        self.position = np.zeros((brief.subjects, brief.actions))
        self.colour = np.zeros((brief.subjects, 6))  # push white, grey; pull white, grey; door

    def _colours(self, observation: Observations) -> IntArray:
        """``[B, 2P + 1]`` which colour cue each action has."""
        grey = observation[:, self._positions : 2 * self._positions].astype(np.int64)
        unlocked = 1 - observation[:, -2:-1].astype(np.int64)
        return np.hstack([grey, 2 + grey, 4 + unlocked])

    def strength(self, observation: Observations) -> FloatArray:
        """``[B, 2P + 1]`` the summed association of each action's cues."""
        colour = np.take_along_axis(self.colour, self._colours(observation), axis=1)
        total: FloatArray = self.lever + self.position + colour
        return total

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the softmax of the strengths."""
        out = view.observation[:, : self._positions] == 1
        impossible = np.hstack([out, ~out, np.zeros((len(out), 1), dtype=bool)])
        strength = self.strength(view.observation) / self.parameters.temperature
        strength[impossible] = -np.inf
        odds: FloatArray = np.exp(strength - strength.max(axis=1, keepdims=True))
        return odds / odds.sum(axis=1, keepdims=True)

    def learn(self, step: Step) -> None:
        """Share the prediction error among the cues that were present."""
        settings, seen = self.parameters, step.view.observation
        who = np.flatnonzero(step.view.playing)
        action = step.action[who]
        came_out = (step.outcome[who, : self._positions] > seen[who, : self._positions]).any(axis=1)
        effect = np.where(step.outcome[who, -1] == 1, 1.0, settings.partial * came_out)
        error = effect - self.strength(seen)[who, action]
        self.lever[who, action] += settings.lever * error
        self.position[who, action] += settings.position * error
        self.colour[who, self._colours(seen)[who, action]] += settings.colour * error
        self.lever[step.trial_over & step.view.playing] = 0.0
