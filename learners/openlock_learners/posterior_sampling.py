"""Posterior sampling: a planner that learns how the room works, without a causal grammar.

Posterior sampling for reinforcement learning (Strens 2000; Osband, Russo & Van Roy 2013): before
each attempt it draws one model of the room from its posterior, plans the whole attempt by exact
dynamic programming as if that model were true, and carries the plan out. What is uncertain is
tried because some draws promise something there.

A state is which levers stand pushed and whether the lock is locked. What an action may do is known:
it moves its own lever or does not, and the lock is then locked or not; or it opens the door or does
not. Which of these happens is unknown in *every state by itself*: four counts for each state and
action, with a Dirichlet prior. No structure ties the states together, and that is the comparison
with ``bayes``: what does it buy to know that levers enable levers? The one thing carried over, from
state to state and from room to room, is the mean of the prior: how often actions of
the same verb, on levers of the same colour that stand the same way, or on a door whose lamp shows
the same, had which outcome.

Solutions of the trial that were found count nothing in the plan.

It gives no probabilities. That of an action is an integral, over thousands of Dirichlet draws that
make a model (3,480 gamma variates in a room of the paper), of whether the action is the best in it;
the best is a maximum over maxima, which has no closed form, and there is nothing to enumerate. It
is scored by inverse binomial sampling (:mod:`causal_openlock.scoring.inverse_binomial`): what it
draws lasts for one attempt, as that takes for granted.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations
from typing import Annotated

import numpy as np

from causal_openlock.contract.learner import Brief, Learner, Observations, Step, View
from causal_openlock.contract.parameters import Positive
from causal_openlock.schemas.fsm import FloatArray, IntArray

MOVED, UNLOCKED = 2, 1
"""An outcome is a number from 0 to 3 made of these bits; for the door, moved means opened."""
TIE = 1e-9


@dataclass(frozen=True)
class PosteriorSamplingParameters:
    """The prior over what an action does in a state."""

    concentration: Annotated[Positive, "what the prior is worth, in observations"] = 0.2


class PosteriorSampling(Learner):
    """Plans each attempt in a model of the room that is drawn from its posterior."""

    Parameters = PosteriorSamplingParameters
    parameters: PosteriorSamplingParameters

    def begin(self, brief: Brief) -> None:
        """List the states of a room, and what each action leads to if it moves its lever."""
        self.brief, positions, limit = brief, brief.positions, brief.action_limit
        pushed = [sum(1 << lever for lever in some) for size in range(min(limit, positions + 1))
                  for some in combinations(range(positions), size)]  # fmt: skip
        # States out of reach are numbered as one, S, which is worth nothing.
        self._number = np.full(1 << positions, len(pushed))
        self._number[pushed] = np.arange(len(pushed))
        masks, bits = np.array(pushed)[:, None], 1 << np.arange(positions)
        after = np.hstack([masks | bits, masks & ~bits, masks])
        self._moved = self._number[after]  # [S, A]
        self._stays = (after == masks)[:, :-1].astype(np.int64)  # the lever stands there already
        shape = brief.subjects, len(pushed), 2, brief.actions
        self._counts = np.zeros((*shape, 4))
        self._looks = np.zeros((brief.subjects, 10, 4))
        self._found = np.zeros(shape[:2], dtype=bool)
        self._policy = np.zeros((brief.subjects, limit + 1, *shape[1:3]), dtype=np.int64)
        self._planned = np.zeros(brief.subjects, dtype=bool)

    def act(self, view: View) -> IntArray:
        """``[B]`` the next action of each plan; a new attempt begins with a new one."""
        for subject in np.flatnonzero(view.playing & ~self._planned).tolist():
            grey = view.observation[subject, self.brief.positions : -2].astype(np.int64)
            self._plan(subject, grey)
        self._planned |= view.playing
        state, unlocked = self._states(view.observation)
        left = np.minimum(view.console.actions_left, self.brief.action_limit)
        chosen: IntArray = self._policy[np.arange(len(state)), left, state, unlocked]
        return chosen

    def _states(self, observation: Observations) -> tuple[IntArray, IntArray]:
        """``[B]`` number of the pushed levers, and ``[B]`` whether the lock is unlocked."""
        levers = observation[:, : self.brief.positions].astype(np.int64)
        number = self._number[levers @ (1 << np.arange(self.brief.positions))]
        return np.minimum(number, len(self._moved) - 1), 1 - observation[:, -2].astype(np.int64)

    def _looks_of(self, grey: IntArray, state: IntArray, unlocked: IntArray) -> IntArray:
        """``[..., A]`` what each action looks like in states, with colours ``[..., P]``."""
        colour, verb = np.concatenate([grey, grey], axis=-1), np.repeat([0, 4], grey.shape[-1])
        levers = verb + 2 * colour + self._stays[state]
        return np.concatenate([levers, 8 + unlocked[..., None]], axis=-1)

    def model(self, subject: int, grey: IntArray) -> FloatArray:
        """``[S, 2, A, 4]`` parameters of a subject's Dirichlet posteriors."""
        seen = self._looks[subject] + 1.0
        mean = seen / seen.sum(axis=1, keepdims=True)
        looks = self._looks_of(grey, *np.indices((len(self._moved), 2)))
        prior = self.parameters.concentration * mean[looks]
        posterior: FloatArray = prior + self._counts[subject]
        return posterior

    def _plan(self, subject: int, grey: IntArray) -> None:
        generator = self.brief.generators[subject]
        drawn = generator.standard_gamma(self.model(subject, grey))
        drawn /= np.maximum(drawn.sum(axis=3, keepdims=True), np.finfo(float).tiny)
        stays, unlocks = drawn[..., :MOVED], drawn[..., MOVED:]
        value = np.zeros((len(self._moved) + 1, 2))
        opens = unlocks[:, :, -1].sum(axis=2) * ~self._found[subject][:, None]
        for left in range(1, self.brief.action_limit + 1):
            here = np.einsum("slao,so->sla", stays, value[:-1])
            worth = here + np.einsum("slao,sao->sla", unlocks, value[self._moved])
            worth[:, :, -1] = opens + here[:, :, -1]
            worth += TIE * generator.random(worth.shape)
            self._policy[subject, left] = worth.argmax(axis=2)
            value[:-1] = worth.max(axis=2)

    def learn(self, step: Step) -> None:
        """Count the outcome of each action."""
        who = np.flatnonzero(step.view.playing)
        positions, action, outcome = self.brief.positions, step.action[who], step.outcome[who]
        seen = step.view.observation[who]
        state, unlocked = self._states(seen)
        levers = (outcome[:, :positions] != seen[:, :positions]).any(axis=1)
        moved = np.where(action == 2 * positions, outcome[:, -1] == 1, levers)
        came = MOVED * moved + UNLOCKED * (outcome[:, -2] == 0)
        self._counts[who, state, unlocked, action, came] += 1.0
        grey = seen[:, positions:-2].astype(np.int64)
        looks = self._looks_of(grey, state, unlocked)[np.arange(len(who)), action]
        self._looks[who, looks, came] += 1.0
        new = step.new_solution[who]
        self._found[who[new], state[new]] = True
        self._planned &= ~(step.attempt_over & step.view.playing)
        over = who[step.trial_over[who]]
        self._counts[over], self._found[over] = 0.0, False
