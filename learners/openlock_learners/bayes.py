"""The Bayesian structure learner: active causal learning by expected information gain.

It holds a posterior over the causal structures of the room (:mod:`causal_openlock.belief`), chooses
the most valuable action, and updates the posterior with what it observes. What it learns about
*schemas* is carried into the next room; which lever does what is learned in each room. It perceives
what every subject perceives and knows nothing else about roles, schemas or solutions.

The policy is a parameter:

* ``solve_and_learn``: expected information gain over the rest of the attempt, plus ``beta`` times
  the probability of a new solution. Within a few hundredths of an attempt of the optimum.
* ``solve``: the probability of a new solution alone.
* ``learn_attempt``, ``learn_action``: expected information gain alone, over the attempt or of the
  next action; an unlocked door is opened at the end.
* ``thompson``: Thompson sampling. Draw a hypothesis from the posterior, carry out a solution of it.
* ``random_consistent``: carry out a random solution that some hypothesis still allows.

Bounded rationality is off by default: decision noise, lapses, forgetting (of everything, or of
failures alone), the expectation that levers act on the door themselves, and a strong prior.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b
from typing import Annotated, Any, Literal
from weakref import WeakKeyDictionary

import numpy as np

from causal_openlock.belief.belief_learner import BeliefLearner
from causal_openlock.belief.beliefs import Belief, Beliefs
from causal_openlock.belief.hypotheses import Space
from causal_openlock.belief.intentions import Intentions, Plan, drawn_solutions
from causal_openlock.belief.knowledge import BeliefParameters
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation, thinned
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.contract.parameters import Count, NotNegative, Share
from causal_openlock.schemas.fsm import FloatArray

Policy = Literal[
    "solve_and_learn", "solve", "learn_attempt", "learn_action", "thompson", "random_consistent"
]
_PLANS: WeakKeyDictionary[Space, dict[Any, FloatArray]] = WeakKeyDictionary()
"""Plans made in this process; subjects with the same posterior share them."""
MOST_PLANS = 50_000
ALMOST_NOTHING = 1e-6


@dataclass(frozen=True)
class BayesParameters(BeliefParameters):
    """Prior, policy, and bounds of rationality."""

    policy: Annotated[Policy, "how it picks actions"] = "solve_and_learn"
    beta: Annotated[NotNegative, "worth of a new solution, in bits of information"] = 3.0
    planned: Annotated[Count, "most hypotheses that a plan takes into account"] = 4000
    temperature: Annotated[NotNegative, "softmax noise of decisions, in bits; 0 takes the best"] = (
        0.0
    )
    lapse: Annotated[Share, "share of actions that are random"] = 0.0


class Bayes(BeliefLearner):
    """Acts on a posterior over the causal structure of the room."""

    Parameters = BayesParameters
    parameters: BayesParameters

    def begin(self, brief: Brief) -> None:
        """Set the priors before the first room."""
        super().begin(brief)
        samples = tuple(generator.spawn(1)[0] for generator in brief.generators)
        self.beliefs = Beliefs(brief, self.parameters, samples)
        self._intentions: dict[int, Intentions] = {}
        self._objectives = {
            "solve_and_learn": Objective(1.0, self.parameters.beta),
            "solve": Objective(0.0, 1.0),
            # When there is nothing left to learn, solving decides.
            "learn_attempt": Objective(1.0, ALMOST_NOTHING),
            "learn_action": Objective(1.0, 0.0, horizon=1),
        }

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the policy mixed with lapses, averaged over possible intentions."""
        self.beliefs.enter(view)
        positions, lapse = self.brief.positions, self.parameters.lapse
        chances = np.full((self.brief.subjects, self.brief.actions), lapse / self.brief.actions)
        for subject in np.flatnonzero(view.playing).tolist():
            belief = self.belief(subject)
            situation = Situation.of(view, subject, belief.slots, belief.found)
            if self.parameters.policy in ("thompson", "random_consistent"):
                odds = self._intended(subject, belief, situation)
            else:
                odds = self._odds(self._values(belief, situation))
            odds = (1.0 - lapse) * odds / odds.sum()
            chances[subject, belief.positions] += odds[:positions]
            chances[subject, -1] += odds[-1]
        return chances

    def _intended(self, subject: int, belief: Belief, situation: Situation) -> FloatArray:
        """``[P + 1]`` the probability of each slot, and the door, after what was done so far."""
        if subject not in self._intentions:
            self._intentions[subject] = Intentions(self.parameters.lapse, self.brief.actions)

        def draw() -> list[tuple[float, Plan]]:
            possible = belief.space.hypotheses
            if len(belief.which) < len(possible):
                possible = possible[belief.which]
            by_weight = self.parameters.policy == "thompson"
            return drawn_solutions(possible, belief.weight, situation, by_weight)

        return self._intentions[subject].next(situation, self.brief.positions, draw)

    def _odds(self, values: FloatArray) -> FloatArray:
        """``[P + 1]`` how likely each lever is pushed, and the door, by softmax."""
        best, temperature = values.max(), self.parameters.temperature
        if not temperature:
            return (values >= best - TIE).astype(float)
        with np.errstate(over="ignore"):  # at very low temperatures
            odds: FloatArray = np.exp((values - best) / temperature)
        return odds

    def _values(self, belief: Belief, situation: Situation) -> FloatArray:
        """``[P + 1]`` value of pushing each lever, and the door, under the policy."""
        policy = self.parameters.policy
        values = self._plan(belief, situation, self._objectives[policy])
        if policy == "learn_action" and (situation.unlocked or values.max() < TIE):
            to_solve = self._plan(belief, situation, self._objectives["solve"])
            if values.max() < TIE or to_solve[-1] > 0:
                return to_solve
        return values

    def _plan(self, belief: Belief, situation: Situation, objective: Objective) -> FloatArray:
        space = belief.space
        chosen, weight = thinned(belief.weight, self.parameters.planned)
        which = belief.which[chosen]
        digest = blake2b(which.tobytes() + weight.tobytes(), digest_size=16).digest()
        key, plans = (objective, situation, digest), _PLANS.setdefault(space, {})
        if key not in plans:
            if len(plans) >= MOST_PLANS:
                plans.clear()
            planner = Planner(space.hypotheses[which], space.strengths, objective)
            plans[key] = planner.values(weight, situation)
        return plans[key]

    def learn(self, step: Step) -> None:
        """Update the posteriors with what was observed."""
        positions = self.brief.positions
        for subject, intentions in self._intentions.items():
            if step.view.playing[subject]:
                action, slot = int(step.action[subject]), None
                if action < positions:
                    slot = int(self.belief(subject).slots[action])
                elif action == 2 * positions:
                    slot = positions  # the door
                intentions.acted(slot, bool(step.attempt_over[subject]))
        self.beliefs.update(step)
