"""The Bayesian structure learner: it intervenes to find out, and solves with what it knows.

It holds a belief about how the levers of the room hang together
(:mod:`causal_openlock.belief`), picks the action that promises most, looks at what happens, and
believes the less in whatever had predicted something else. What it learns about *schemas* it
carries into the next room; which lever does what it finds out in each. It is told nothing of roles,
schemas or solutions: it knows what every subject perceives.

How it picks actions is a parameter, so that rules can be compared:

* ``solve_and_learn``: expected information over the rest of the attempt, plus ``beta`` times the
  probability of a new solution. Within a few hundredths of an attempt of the best possible.
* ``solve``: the probability of a new solution alone.
* ``learn_attempt``, ``learn_action``: expected information alone, over the attempt or of the next
  action; an unlocked door is opened at the end.
* ``thompson``: believe one hypothesis, drawn as probable as it is, and carry out a solution of it.
* ``random_consistent``: carry out any solution that some hypothesis still allows.

Bounded rationality is a parameter too, and off by default: noise in decisions, lapses of attention,
forgetting (of everything, or of failures alone), the expectation that levers act on the door
themselves, and how readily a prior gives way.
"""

from __future__ import annotations

from dataclasses import dataclass
from hashlib import blake2b
from typing import Annotated, Any, Literal
from weakref import WeakKeyDictionary

import numpy as np
from pydantic import Field

from causal_openlock.belief.beliefs import Belief, Beliefs
from causal_openlock.belief.believer import Believer, situation_of
from causal_openlock.belief.catalogue import FREE_FORM_LEVERS, TABLE_BYTES
from causal_openlock.belief.intention import draw_intention
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation, thinned
from causal_openlock.belief.prior import Count, Prior, Share
from causal_openlock.belief.sampling import DRAWS, LISTED_CAUSES, ROUNDS
from causal_openlock.belief.space import Space
from causal_openlock.belief.structures import behaviour_bytes
from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.experiment.expected_cost import Cost
from causal_openlock.world.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import Streams, pick
from causal_openlock.world.schema import Schema

Policy = Literal[
    "solve_and_learn", "solve", "learn_attempt", "learn_action", "thompson", "random_consistent"
]
_PLANS: WeakKeyDictionary[Space, dict[Any, FloatArray]] = WeakKeyDictionary()
"""Plans made in this process: a plan follows from a belief, whoever holds it."""
MOST_PLANS = 50_000
SAMPLINGS, SAMPLINGS_A_SOLUTION = 8, 1.5
"""How often hypotheses are sampled in a trial of many levers, as measured; for an estimate."""
SECONDS_A_NODE = 2e-6
"""Seconds to look at a structure, for each lever; the same."""
COPIES = 4
ALMOST_NOTHING = 1e-6


@dataclass(frozen=True)
class BayesParameters(Prior):
    """What the learner believes at first, how it decides, and where its rationality is bounded."""

    policy: Annotated[Policy, "how it picks actions"] = "solve_and_learn"
    beta: Annotated[float, Field(ge=0), "worth of a new solution, in bits of information"] = 3.0
    planned: Annotated[Count, "most hypotheses that a plan takes into account"] = 4000
    temperature: Annotated[
        float, Field(ge=0), "softmax noise of decisions, in bits; 0 takes the best"
    ] = 0.0
    lapse: Annotated[Share, "share of actions that are random"] = 0.0


class Bayes(Believer):
    """Plays by a belief about the causal structure of the room."""

    Parameters = BayesParameters
    parameters: BayesParameters

    @classmethod
    def expected_cost(cls, parameters: BayesParameters, schema: Schema, action_limit: int) -> Cost:
        """What a room costs: hypotheses sampled time after time, and tables to compare them."""
        levers = len(schema.levers)
        if levers <= FREE_FORM_LEVERS:
            return Cost(0.1, "every structure is listed")
        large = levers > LISTED_CAUSES + 1
        looked_at = parameters.effort if large else ROUNDS * DRAWS // 3
        times = SAMPLINGS + SAMPLINGS_A_SOLUTION * len(schema.solutions)
        work = f"about {times:.0f} times {looked_at:,} structures of {levers} levers are looked at"
        seconds = times * looked_at * SECONDS_A_NODE * levers
        many = min(parameters.hypothesis_limit * behaviour_bytes(levers, action_limit), TABLE_BYTES)
        return Cost(seconds, work, COPIES * many / 1e6)

    def begin(self, brief: Brief) -> None:
        """Believe what there is to believe before the first room."""
        self.brief = brief
        choices, samples = zip(*(g.spawn(2) for g in brief.generators), strict=True)
        self._draws = Streams(choices, width=3)
        self.beliefs = Beliefs(brief, self.parameters, samples)
        self._intended: list[tuple[int, ...] | None] = [None] * brief.subjects
        self._tried = [0] * brief.subjects

    def act(self, view: View) -> IntArray:
        """``[B]`` what each subject does."""
        self.beliefs.enter(view)
        draws = self._draws.uniform()
        actions = np.zeros(self.brief.subjects, dtype=np.int64)
        for subject in np.flatnonzero(view.playing).tolist():
            lapses, one, other = draws[subject].tolist()
            if lapses < self.parameters.lapse:
                actions[subject] = int(one * self.brief.actions)
                continue
            belief = self.belief(subject)
            situation = situation_of(belief, view, subject)
            if self.parameters.policy in ("thompson", "random_consistent"):
                slot = self._carry_out(subject, belief, situation, (one, other))
            else:
                slot = self._choose(self._values(belief, situation), other)
            door = slot == self.brief.positions
            actions[subject] = 2 * slot if door else belief.positions[slot]
        return actions

    def _choose(self, values: FloatArray, draw: float) -> int:
        """The slot of the lever that is best to push, or nearly; P is the door."""
        best = values.max()
        if self.parameters.temperature > 0:
            with np.errstate(over="ignore"):  # hardly any noise at all
                odds = np.exp((values - best) / self.parameters.temperature)
        else:
            odds = (values >= best - TIE).astype(float)
        return pick(odds, draw)

    def _values(self, belief: Belief, situation: Situation) -> FloatArray:
        """``[P + 1]`` what pushing each lever is worth to the policy, and the door."""
        beta = self.parameters.beta
        if self.parameters.policy == "solve_and_learn":
            return self._plan(belief, situation, Objective(1.0, beta))
        solve = Objective(0.0, 1.0)
        if self.parameters.policy == "solve":
            return self._plan(belief, situation, solve)
        if self.parameters.policy == "learn_attempt":
            # When there is nothing to learn, what solves comes first.
            return self._plan(belief, situation, Objective(1.0, ALMOST_NOTHING))
        values = self._plan(belief, situation, Objective(1.0, 0.0, horizon=1))
        if situation.unlocked or values.max() < TIE:
            to_solve = self._plan(belief, situation, solve)
            if values.max() < TIE or to_solve[-1] > 0:
                return to_solve
        return values

    def _carry_out(
        self, subject: int, belief: Belief, situation: Situation, draws: tuple[float, float]
    ) -> int:
        """The next lever of what the subject intends in this attempt; P is the door."""
        intended = self._intended[subject]
        missing = [slot for slot in intended or () if not situation.pushed >> slot & 1]
        # What was tried last and does not stand pushed has failed.
        if intended is None or len(intended) - len(missing) < self._tried[subject]:
            policy = self.parameters.policy
            hypotheses = belief.space.hypotheses
            intended = draw_intention(
                hypotheses if belief.whole else hypotheses[belief.which],
                belief.weight,
                situation,
                draws,
                by_weight=policy == "thompson",
            )
            self._intended[subject] = intended
            self._tried[subject] = 0
            missing = list(intended or ())
        if intended is None or not (missing or situation.unlocked):
            self._intended[subject] = None
            return int(draws[0] * self.brief.positions)
        if not missing:
            return self.brief.positions
        self._tried[subject] = len(intended) - len(missing) + 1
        return missing[0]

    def _plan(self, belief: Belief, situation: Situation, objective: Objective) -> FloatArray:
        chosen, weight = thinned(belief.weight, self.parameters.planned)
        which = belief.which[chosen]
        space = belief.space
        belief_key = blake2b(which.tobytes() + weight.tobytes(), digest_size=16).digest()
        key = (objective, situation, belief_key)
        plans = _PLANS.setdefault(space, {})
        if key not in plans:
            if len(plans) >= MOST_PLANS:
                plans.clear()
            planner = Planner(space.hypotheses[which], space.strengths, objective, situation.found)
            plans[key] = planner.values(weight, situation)
        return plans[key]

    def learn(self, step: Step) -> None:
        """Believe the less in what had predicted something else."""
        self.beliefs.update(step)
        for subject in np.flatnonzero(step.attempt_over & step.view.playing).tolist():
            self._intended[subject] = None

    def state_dict(self) -> dict[str, Any]:
        """Beliefs, intentions and randomness."""
        return {
            "beliefs": self.beliefs.state_dict(),
            "draws": self._draws.state_dict(),
            "intended": list(self._intended),
            "tried": list(self._tried),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self.beliefs.load_state_dict(state["beliefs"])
        self._draws.load_state_dict(state["draws"])
        self._intended = list(state["intended"])
        self._tried = list(state["tried"])
