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
from dataclasses import astuple, dataclass
from functools import lru_cache
from typing import Any

import numpy as np

from causal_openlock.belief.hypotheses import Strengths, at_least, strengths
from causal_openlock.belief.likelihoods import Event, informative, likelihood, observed
from causal_openlock.belief.marginals import expected_structure
from causal_openlock.belief.optimal import Optimum, Point, bits
from causal_openlock.belief.placements import (
    TABLE_LIMIT,
    TooLargeError,
    placements,
    ways_to_place,
)
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation, thinned
from causal_openlock.contract.learner import (
    Brief,
    InformedLearner,
    Step,
    Structure,
    Truth,
    View,
)
from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import Schema

PLANNED = 600
"""The most hypotheses that a plan takes into account."""


@dataclass(eq=False)
class RoomBelief:
    """A subject's belief about the room that it is in."""

    action_limit: int
    slots: IntArray  # [P] slot of each position; those of the n active, grey levers come first
    weight: FloatArray  # [H] probability of each placement of the schema's levers
    found: tuple[int, ...] = ()  # levers pushed when solutions were found, in ascending order


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
        self._rooms: list[RoomBelief | None] = [None] * brief.subjects
        self._left: list[tuple[RoomBelief, Schema] | None] = [None] * brief.subjects

    def inform(self, truth: Truth) -> None:
        """Take the schema of each subject's room; the layout is not used."""
        self._schemas = [truth.rooms[room].schema for room in truth.room]

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` the same for each of the best actions."""
        found = np.zeros((self.brief.subjects, self.brief.actions))
        for subject in np.flatnonzero(view.playing).tolist():
            best = self._best(view, subject)
            found[subject, best] = 1.0 / len(best)
        return found

    def _best(self, view: View, subject: int) -> list[int]:
        """The best actions of a subject."""
        room = self._rooms[subject] or self._enter(view, subject)
        schema = self._schemas[subject]
        situation = Situation.of(view, subject, room.slots, room.found)
        solver = _solver(schema, room.action_limit)
        best = solver.best(room.weight, situation, bool(view.console.solutions_left[subject]))
        return [self._action(room, *divmod(each, len(schema.levers))) for each in best]

    def _action(self, room: RoomBelief, verb: int, slot: int) -> int:
        positions = self.brief.positions
        lever = int(np.flatnonzero(room.slots == slot)[0])
        return 2 * positions if verb == 2 else verb * positions + lever

    def _enter(self, view: View, subject: int) -> RoomBelief:
        positions = self.brief.positions
        white = view.observation[subject, positions : 2 * positions] == 0
        schema, limit = self._schemas[subject], int(view.console.actions_left[subject])
        slots = np.argsort(np.argsort(white, kind="stable"))
        room = self._rooms[subject] = RoomBelief(limit, slots, _solver(schema, limit).prior)
        return room

    def learn(self, step: Step) -> None:
        """Rule out placements, and forget the room when its trial is over."""
        for subject in informative(step).tolist():
            room, schema = self._rooms[subject], self._schemas[subject]
            if room is None:
                continue
            events = observed(step, np.array([subject]), room.slots[None], [room.found])
            event = events.single(0, room.found)
            if event.slot < len(schema.levers):  # white levers are no part of the hypotheses
                room.weight = _solver(schema, room.action_limit).after(room.weight, event)
                if event.new:
                    room.found = tuple(sorted((*room.found, event.pushed)))
        for subject in np.flatnonzero(step.trial_over & step.view.playing).tolist():
            last = self._rooms[subject]
            self._left[subject] = (last, self._schemas[subject]) if last else None
            self._rooms[subject] = None

    def structure(self, subject: int) -> Structure | None:
        """Edges and gates of the placements that are still possible.

        Of placements that no attempt can tell apart one stands for all.
        """
        now = self._rooms[subject]
        known = (now, self._schemas[subject]) if now else self._left[subject]
        if known is None:
            return None
        room, schema = known
        at = np.argsort(room.slots)[: len(schema.levers)]
        placed = _solver(schema, room.action_limit).hypotheses
        return expected_structure([(at, placed, room.weight)], self.brief.positions)


class _Solver:
    """Posteriors and best actions for a schema, cached for all subjects.

    The cache changes no result, so a subject does not depend on the others.
    """

    def __init__(self, schema: Schema, action_limit: int) -> None:
        try:
            self.hypotheses = placements(schema, action_limit)
        except TooLargeError as error:
            raise LearnerError(
                f"the ideal observer lists every way to place the levers, and {error}; leave this "
                "learner or this schema out"
            ) from None
        self.prior = np.full(len(self.hypotheses), 1.0 / len(self.hypotheses))
        self._optimum: Optimum | None = None
        self._best: dict[Any, tuple[int, ...]] = {}
        self._posteriors: dict[tuple[bytes, Event], FloatArray] = {}
        if not schema.deterministic:  # certainty, and the mean strength of the schema's edges
            known = [schema.graph.edges[edge]["strength"] for edge in schema.graph.edges]
            value = np.array([1.0, float(np.mean(known))])
            steps = np.stack([at_least(strength) for strength in value])
            self._strengths = Strengths(value, np.array([0.0, 1.0]), steps)
            self.hypotheses.strength[:] = 1
            return
        self._strengths = strengths(0.0, 1.0, 1.0, 1)
        try:
            optimum = Optimum(self.hypotheses, self.prior, action_limit)
            optimum.attempts()
        except TooLargeError:
            return
        optimum.node_limit = math.inf  # it is in reach, whatever was computed before
        self._optimum = optimum

    def best(self, weight: FloatArray, situation: Situation, seeking: bool) -> tuple[int, ...]:
        """The actions that are best: pushes by slot, then pulls, then the door.

        If it is not ``seeking`` a solution that is left to find, any solution counts.
        """
        if self._optimum is not None and seeking:
            possible = weight > 0
            key = (possible.tobytes(), situation.pushed, situation.left, situation.found)
            if key not in self._best:
                point = Point(bits(possible), situation.found, situation.pushed, situation.left)
                self._best[key] = tuple(self._optimum.best(point))
            return self._best[key]
        which, counts = thinned(weight, PLANNED)
        key = (which.tobytes(), counts.tobytes(), *astuple(situation), seeking)
        if key not in self._best:  # plan for the rest of the attempt
            objective = Objective() if seeking else Objective(information=0.0)
            planner = Planner(self.hypotheses[which], self._strengths, objective)
            values = planner.values(counts, situation)
            slots = len(values) - 1
            best = np.flatnonzero(values >= values.max() - TIE).tolist()
            self._best[key] = tuple(2 * slots if slot == slots else slot for slot in best)
        return self._best[key]

    def after(self, weight: FloatArray, event: Event) -> FloatArray:
        """``[H]`` the posterior after an event; shared, so not to be changed."""
        key = (weight.tobytes(), event)
        if (known := self._posteriors.get(key)) is not None:
            return known
        every = np.arange(len(weight))
        joint = weight * likelihood(self.hypotheses, every, self._strengths, event)
        total = float(joint.sum())
        assert total > 0, "the room's schema allows what happens in it"
        posterior: FloatArray = joint / total
        if len(self._strengths) == 1:  # otherwise hardly any posterior occurs twice
            self._posteriors[key] = posterior
        return posterior


_solver = lru_cache(maxsize=32)(_Solver)
