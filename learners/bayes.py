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
forgetting, and how readily a prior gives way.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from causal_openlock.belief.beliefs import Belief, Beliefs, Prior
from causal_openlock.belief.believer import Believer, situation_of
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation
from causal_openlock.fsm import FloatArray, IntArray
from causal_openlock.learner import Brief, Step, View
from causal_openlock.randomness import Streams

Share = Annotated[float, Field(ge=0, le=1)]
Positive = Annotated[float, Field(gt=0)]
Count = Annotated[int, Field(ge=1)]
Policy = Literal[
    "solve_and_learn", "solve", "learn_attempt", "learn_action", "thompson", "random_consistent"
]
GRAIN = 1024
"""Planning tells apart probabilities that differ by more than 1/1024 of the greatest."""


@dataclass(frozen=True)
class BayesParameters:
    """What the learner believes at first, how it decides, and where its rationality is bounded."""

    policy: Annotated[Policy, "how it picks actions"] = "solve_and_learn"
    beta: Annotated[float, Field(ge=0), "worth of a new solution, in bits of information"] = 3.0
    concentration: Annotated[
        Positive, "how many rooms the prior over schema classes is worth (Dirichlet)"
    ] = 1.0
    simplicity: Annotated[
        float, Field(ge=0), "cost of each part of a schema's description, in nats"
    ] = math.log(2.0)
    free_form: Annotated[
        float, Field(gt=0, lt=1), "prior probability that a schema is of no class of the grammar"
    ] = 0.1
    by_colour: Annotated[
        float, Field(gt=0, lt=1), "prior probability that colour marks the active levers"
    ] = 0.5
    by_white: Annotated[Share, "if colour does, probability that it is the white ones"] = 0.1
    noise: Annotated[
        float,
        Field(ge=0, lt=1),
        "prior probability that levers may fail to move; at 0, only if nothing else is possible",
    ] = 0.0
    strength_alpha: Annotated[Positive, "first parameter of the strength's Beta prior"] = 4.0
    strength_beta: Annotated[Positive, "second parameter of it"] = 1.0
    hypothesis_limit: Annotated[Count, "about how many hypotheses are enumerated for a room"] = (
        20_000
    )
    particles: Annotated[
        Count, "hypotheses sampled where a room has too many levers to enumerate every structure"
    ] = 500
    planned: Annotated[Count, "most hypotheses that a plan takes into account"] = 600
    temperature: Annotated[
        float, Field(ge=0), "softmax noise of decisions, in bits; 0 takes the best"
    ] = 0.0
    lapse: Annotated[Share, "share of actions that are random"] = 0.0
    forgetting: Annotated[Share, "share of a trial's evidence lost with every attempt"] = 0.0


class Bayes(Believer):
    """Plays by a belief about the causal structure of the room."""

    Parameters = BayesParameters
    parameters: BayesParameters

    def begin(self, brief: Brief) -> None:
        """Believe what there is to believe before the first room."""
        own = self.parameters
        self.brief = brief
        choices, samples = zip(*(g.spawn(2) for g in brief.generators), strict=True)
        self._draws = Streams(choices, width=3)
        prior = Prior(**{name: getattr(own, name) for name in Prior.__dataclass_fields__})
        self.beliefs = Beliefs(brief, prior, samples)
        self._plans: dict[Any, FloatArray] = {}

    def act(self, view: View) -> IntArray:
        """``[B]`` what each subject does."""
        self.beliefs.enter(view)
        draws = self._draws.uniform()
        actions = np.zeros(self.brief.subjects, dtype=np.int64)
        for subject in np.flatnonzero(view.playing):
            if draws[subject, 0] < self.parameters.lapse:
                actions[subject] = int(draws[subject, 1] * self.brief.actions)
                continue
            belief = self.beliefs.of[subject]
            assert belief is not None
            slot = self._choose(belief, view, subject, draws[subject])
            actions[subject] = (
                2 * self.brief.positions if slot == self.brief.positions else belief.positions[slot]
            )
        return actions

    def _choose(self, belief: Belief, view: View, subject: int, draws: FloatArray) -> int:
        """The slot of the lever to push; P is the door."""
        situation = situation_of(belief, view, subject)
        values = self._values(belief, situation)
        best = values.max()
        if self.parameters.temperature > 0:
            odds = np.exp((values - best) / self.parameters.temperature)
        else:
            odds = (values >= best - TIE).astype(float)
        ladder = odds.cumsum()
        return int(np.searchsorted(ladder, draws[2] * ladder[-1], side="right"))

    def _values(self, belief: Belief, situation: Situation) -> FloatArray:
        coarse = np.rint(belief.weight * ((GRAIN - 1) / belief.weight.max())).astype(np.int64)
        kept = np.flatnonzero(coarse)
        coarse = coarse[kept]
        which = belief.which[kept]
        if len(which) > self.parameters.planned:
            # As many points evenly spaced over the belief: a sample without luck.
            points = (np.arange(self.parameters.planned) + 0.5) * coarse.sum()
            hit = np.searchsorted(coarse.cumsum(), points / self.parameters.planned, side="right")
            chosen, coarse = np.unique(hit, return_counts=True)
            which = which[chosen]
        key = (
            id(belief.space), which.tobytes(), coarse.tobytes(), situation.pushed,
            situation.unlocked, situation.left, situation.found,
        )  # fmt: skip
        if key not in self._plans:
            space = belief.space
            planner = Planner(
                space.hypotheses[which],
                space.strengths,
                self._objective(),
                situation.found,
            )
            self._plans[key] = planner.values(coarse.astype(float), situation)
        return self._plans[key]

    def _objective(self) -> Objective:
        return Objective(1.0, self.parameters.beta, None)

    def learn(self, step: Step) -> None:
        """Believe the less in what had predicted something else."""
        self.beliefs.update(step)
