"""The ideal observer: it knows the schema and has to learn only which lever is which.

It is the bound that other learners are compared with. It knows the schema of the room, and that the
grey levers are the active ones, but not their layout. It solves the room in the least expected
number of attempts, by exact dynamic programming over beliefs
(:mod:`causal_openlock.belief.optimal`): 8/3 attempts with the paper's three levers and 3.75 with
four, for common cause and common effect alike. Ties between actions are broken at random.

Where the optimum is out of reach, because levers may fail to move or there are too many placements,
it plans to the end of each attempt as the Bayesian learner does, with schema and strength known:
near-optimal, but no exact bound. Edges of different strengths all get their mean.
"""

from __future__ import annotations

import math
from dataclasses import astuple
from functools import lru_cache
from typing import Any

import numpy as np

from causal_openlock.belief.beliefs import Belief
from causal_openlock.belief.catalogue import Catalogue
from causal_openlock.belief.hypotheses import RoomSight, Space, Strengths, at_least, strengths
from causal_openlock.belief.likelihoods import observed
from causal_openlock.belief.marginals import expected_structure
from causal_openlock.belief.optimal import Optimum, Point, bits
from causal_openlock.belief.placements import TABLE_LIMIT, TooLargeError, placements, ways_to_place
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation, thinned
from causal_openlock.contract.learner import Brief, InformedLearner, Step, Structure, Truth, View
from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.schemas.schema import Schema

PLANNED = 600
"""The most hypotheses that a plan takes into account."""


class Ideal(InformedLearner):
    """Knows the schema and not the layout; solves rooms in the fewest expected attempts."""

    @classmethod
    def cannot_play(cls, parameters: Any, schema: Schema, action_limit: int) -> str:
        """Refuse rooms with more placements than a table can list."""
        many = ways_to_place(schema)
        if many << len(schema.levers) > TABLE_LIMIT:
            return f"its levers can be placed in {many:,} ways, too many to list"
        return ""

    def begin(self, brief: Brief) -> None:
        """Begin in no room."""
        super().begin(brief)
        self._of: list[Belief | None] = [None] * brief.subjects
        self._left: list[Belief | None] = [None] * brief.subjects

    def inform(self, truth: Truth) -> None:
        """Take the schema of each subject's room; the layout is not used."""
        self._schemas = [truth.rooms[room].schema for room in truth.room]

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the same for each of the best actions."""
        chances = np.zeros((self.brief.subjects, self.brief.actions))
        for subject in np.flatnonzero(view.playing).tolist():
            belief = self._of[subject] = self._of[subject] or self._enter(view, subject)
            found = tuple(sorted(belief.found))
            situation = Situation.of(view, subject, belief.slots, found)
            solver = _solver(self._schemas[subject], belief.space.sight.action_limit)
            seeking = bool(view.console.solutions_left[subject])
            pushes = belief.positions[: belief.space.sight.grey]
            actions = [*pushes, *(pushes + self.brief.positions), 2 * self.brief.positions]
            best = [actions[action] for action in solver.best(belief, situation, seeking)]
            chances[subject, best] = 1.0 / len(best)
        return chances

    def _enter(self, view: View, subject: int) -> Belief:
        """Every placement of the levers, equally probable; grey levers come first."""
        positions = self.brief.positions
        white = view.observation[subject, positions : 2 * positions] == 0
        slots = np.argsort(np.argsort(white, kind="stable"))
        limit = int(view.console.actions_left[subject])
        space = _solver(self._schemas[subject], limit).space
        every = np.flatnonzero(space.hypotheses.strength == len(space.strengths) - 1)
        return Belief(space, slots, every, np.full(len(every), 1.0 / len(every)))

    def learn(self, step: Step) -> None:
        """Rule out placements, and forget the room when its trial is over."""
        for subject in np.flatnonzero(step.view.playing).tolist():
            belief = self._of[subject]
            if belief is None:
                continue
            event = observed(step, subject, belief.slots, belief.found)
            # White levers are no part of the hypotheses.
            if event and event.slot < belief.space.sight.grey:
                possible = belief.observe(event)
                assert possible, "the room's schema allows what happens in it"
                belief.attempts[-1].append(event)
            if step.trial_over[subject]:
                self._left[subject], self._of[subject] = belief, None

    def structure(self, subject: int) -> Structure | None:
        """Edges and gates of the placements that are still possible.

        Of placements that no attempt can tell apart one stands for all.
        """
        belief = self._of[subject] or self._left[subject]
        if belief is None:
            return None
        at = belief.positions[: belief.space.sight.grey]
        possible = belief.space.hypotheses.structures[belief.which]
        return expected_structure(possible.on_slots(at, self.brief.positions), belief.weight)


class _Solver:
    """The placements of a schema's levers and the best actions, cached for all subjects.

    The cache changes no result, so a subject does not depend on the others.
    """

    def __init__(self, schema: Schema, action_limit: int) -> None:
        try:
            hypotheses = placements(schema, action_limit)
        except TooLargeError as error:
            raise LearnerError(
                f"the ideal observer lists every way to place the levers, and {error}; leave this "
                "learner or this schema out"
            ) from None
        self._optimum: Optimum | None = None
        self._best: dict[Any, tuple[int, ...]] = {}
        how = strengths(0.0)
        if schema.deterministic:
            try:
                optimum = Optimum(hypotheses, np.ones(len(hypotheses)), action_limit)
                optimum.attempts()
                optimum.node_limit = math.inf  # it is in reach, whatever was computed before
                self._optimum = optimum
            except TooLargeError:
                pass
        else:  # certainty, and the mean strength of the schema's edges
            mean = float(np.mean([each for *_, each in schema.graph.edges(data="strength")]))
            chance = np.stack([at_least(1.0), at_least(mean)])
            how = Strengths(np.array([1.0, mean]), np.array([0.0, 1.0]), chance)
        levers, every = len(schema.levers), np.arange(len(hypotheses))
        sight = RoomSight(levers, levers, len(schema.solutions), action_limit)
        listed = Catalogue(hypotheses.structures, every, every, 0 * every, np.ones(len(every)))
        self.space = Space(sight, how, ((tuple(range(levers)), listed),))

    def best(self, belief: Belief, situation: Situation, seeking: bool) -> tuple[int, ...]:
        """The actions that are best: pushes by slot, then pulls, then the door.

        If it is not ``seeking`` a solution that is left to find, any solution counts.
        """
        if self._optimum is not None and seeking:
            key = (belief.which.tobytes(), situation)
            if key not in self._best:
                possible = np.isin(np.arange(len(self.space)), belief.which)
                at = Point(bits(possible), situation.found, situation.pushed, situation.left)
                self._best[key] = tuple(self._optimum.best(at))
            return self._best[key]
        chosen, counts = thinned(belief.weight, PLANNED)
        which = belief.which[chosen]
        key = (which.tobytes(), counts.tobytes(), *astuple(situation), seeking)
        if key not in self._best:  # plan for the rest of the attempt
            objective = Objective() if seeking else Objective(information=0.0)
            planner = Planner(self.space.hypotheses[which], self.space.strengths, objective)
            values = planner.values(counts, situation)
            levers = len(values) - 1
            best = np.flatnonzero(values >= values.max() - TIE).tolist()
            self._best[key] = tuple(2 * levers if slot == levers else slot for slot in best)
        return self._best[key]


_solver = lru_cache(maxsize=32)(_Solver)
