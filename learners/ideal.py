"""The ideal observer: it knows the schema, and finds out at once which lever is which.

The bound that the others are drawn beside. It is told the schema that governs the room, and that
the grey levers are the active ones, but never where which of them stands; what is left to find out
is the room, and it does that in the least expected number of attempts, by exact dynamic programming
over its beliefs (:mod:`causal_openlock.belief.optimal`): 8/3 attempts with the paper's three levers
and 3.75 with four, under common cause and common effect alike. Actions that are equally good are
drawn by chance.

Where the optimum is out of reach, because levers may fail to move or can be placed in too many
ways, it plans ahead to the end of each attempt as the Bayesian learner does, schema and strength
known: close to the best, and no exact bound any more. A schema whose edges differ in strength is
held to have their mean.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import asdict, astuple, dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from causal_openlock.belief.evidence import DOOR, Event, likelihood
from causal_openlock.belief.optimal import HYPOTHESIS_LIMIT, NODE_LIMIT, Optimum, Point
from causal_openlock.belief.placements import (
    TABLE_LIMIT,
    TooLargeError,
    placements,
    ways_to_place,
)
from causal_openlock.belief.planning import TIE, Objective, Planner, Situation, thinned
from causal_openlock.belief.space import Hypotheses
from causal_openlock.belief.strength import Strengths, at_least, strengths
from causal_openlock.belief.symmetry import bits
from causal_openlock.contract.learner import Brief, InformedLearner, Observations, Step, Truth, View
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.expected_cost import Cost
from causal_openlock.world.fsm import FloatArray, IntArray
from causal_openlock.world.randomness import Streams
from causal_openlock.world.schema import Schema

PLANNED = 600
"""The most hypotheses that a plan takes into account."""
SECONDS_A_STATE, SECONDS_A_PLAN = 3e-4, 2e-4
"""Seconds for a state of the search, and for a placement where it plans; for an estimate."""


@dataclass(eq=False)
class Acquaintance:
    """What a subject knows of the room that it is in.

    Attributes:
        action_limit: Actions in an attempt.
        grey: ``[n]`` positions of the active levers; a lever's place here is its slot.
        weight: ``[H]`` how probable each placement of the schema's levers is.
        found: What stood pushed when solutions were found, in ascending order.
    """

    action_limit: int
    grey: IntArray
    weight: FloatArray
    found: tuple[int, ...] = ()


class Happened(NamedTuple):
    """An :class:`~causal_openlock.belief.evidence.Event` of one subject, in plain numbers."""

    slot: int
    pushed: int
    took_effect: bool
    unlocked: bool
    new: bool
    found: tuple[int, ...]


class Ideal(InformedLearner):
    """Knows the schema and not the layout, and needs the fewest attempts that are possible."""

    @classmethod
    def expected_cost(cls, parameters: Any, schema: Schema, action_limit: int) -> Cost:
        """What a room costs: every placement is listed, and the exact search may be long."""
        many = ways_to_place(schema)
        if many << len(schema.levers) > TABLE_LIMIT:
            return Cost(math.inf, f"its levers can be placed in {many:,} ways, too many to list")
        if not schema.deterministic or many > HYPOTHESIS_LIMIT:
            return Cost(many * SECONDS_A_PLAN, f"plans over {many:,} placements")
        # The search over few placements is soon done; the more solutions, the more orders of them.
        states = min(NODE_LIMIT, many * len(schema.solutions) * len(schema.levers))
        return Cost(
            states * SECONDS_A_STATE,
            f"an exact search over {many:,} placements, of some {states:,} states before the first "
            "action, and without a bound after it",
        )

    def begin(self, brief: Brief) -> None:
        """Open one stream of numbers for each subject."""
        self._brief = brief
        self._draws = Streams(brief.generators)
        self._rooms: list[Acquaintance | None] = [None] * brief.subjects

    def inform(self, truth: Truth) -> None:
        """Hear which schema governs each subject's room, and nothing of layouts."""
        self._schemas = [truth.rooms[room].schema for room in truth.room]

    def act(self, view: View) -> IntArray:
        """``[B]`` one of the best actions of each subject."""
        positions = self._brief.positions
        draws = self._draws.uniform()
        actions = np.zeros(self._brief.subjects, dtype=np.int64)
        for subject in np.flatnonzero(view.playing).tolist():
            room = self._rooms[subject] or self._enter(view, subject)
            seen = view.observation[subject]
            situation = Situation(
                pushed=_mask(seen, room.grey),
                unlocked=bool(seen[-2] == 0),
                left=int(view.console.actions_left[subject]),
                found=room.found,
            )
            mind = _mind(self._schemas[subject], room.action_limit)
            best = mind.best(room.weight, situation, bool(view.console.solutions_left[subject]))
            verb, slot = divmod(best[int(draws[subject] * len(best))], len(room.grey))
            actions[subject] = 2 * positions if verb == 2 else verb * positions + room.grey[slot]
        return actions

    def _enter(self, view: View, subject: int) -> Acquaintance:
        positions = self._brief.positions
        grey = np.flatnonzero(view.observation[subject, positions : 2 * positions])
        schema, limit = self._schemas[subject], int(view.console.actions_left[subject])
        room = Acquaintance(limit, grey, _mind(schema, limit).prior)
        self._rooms[subject] = room
        return room

    def learn(self, step: Step) -> None:
        """Rule out where levers cannot stand, and forget the room when its trial is over."""
        for subject in np.flatnonzero(step.view.playing).tolist():
            room = self._rooms[subject]
            if step.trial_over[subject]:
                self._rooms[subject] = None
            elif room is not None and (event := self._event(step, subject, room)):
                mind = _mind(self._schemas[subject], room.action_limit)
                room.weight = mind.after(room.weight, event)
                if event.new:
                    room.found = tuple(sorted((*room.found, event.pushed)))

    def _event(self, step: Step, subject: int, room: Acquaintance) -> Happened | None:
        """What an action told, if it could do something."""
        seen, outcome = step.view.observation[subject], step.outcome[subject]
        verb, position = divmod(int(step.action[subject]), self._brief.positions)
        if verb == 2:
            slot, could, took_effect = DOOR, seen[-2] == 0, outcome[-1] == 1
        elif position not in room.grey:
            return None
        else:
            slot = int(np.searchsorted(room.grey, position))
            could, took_effect = seen[position] == verb, seen[position] != outcome[position]
        if not could:
            return None
        return Happened(
            slot=slot,
            pushed=_mask(seen, room.grey),
            took_effect=bool(took_effect),
            unlocked=bool(outcome[-2] == 0),
            new=bool(step.new_solution[subject]),
            found=room.found,
        )

    def state_dict(self) -> dict[str, Any]:
        """What each subject knows of its room, and where the streams stand."""
        rooms = [None if room is None else asdict(room) for room in self._rooms]
        return {"rooms": rooms, "draws": self._draws.state_dict()}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        self._rooms = [room and Acquaintance(**deepcopy(room)) for room in state["rooms"]]
        self._draws.load_state_dict(state["draws"])


def _mask(seen: Observations, grey: IntArray) -> int:
    """What stands pushed, as a bit mask of slots."""
    return int((seen[grey].astype(np.int64) << np.arange(len(grey))).sum())


class _Mind:
    """What anybody can think who knows a schema: kept, since many subjects think the same.

    Nothing that is kept changes what is thought, so a subject does not depend on the others.
    """

    def __init__(self, schema: Schema, action_limit: int) -> None:
        try:
            self._hypotheses = placements(schema, action_limit)
        except TooLargeError as error:
            raise LearnerError(
                f"the ideal observer lists every way to place the levers, and {error}; leave this "
                "learner or this schema out"
            ) from None
        self.prior = np.full(len(self._hypotheses), 1.0 / len(self._hypotheses))
        self._optimum: Optimum | None = None
        self._thoughts: dict[Any, tuple[int, ...]] = {}
        self._beliefs: dict[tuple[bytes, Happened], FloatArray] = {}
        if schema.deterministic:
            self._strengths = strengths(0.0, 1.0, 1.0, 1)
            self._optimum = _solved(self._hypotheses, self.prior, action_limit)
        else:
            self._strengths = _one_strength(schema)
            self._hypotheses.strength[:] = 1

    def best(self, weight: FloatArray, situation: Situation, seeking: bool) -> tuple[int, ...]:
        """The actions that are best: pushes by slot, then pulls, then the door.

        Args:
            weight: ``[H]`` what is believed.
            situation: Where the attempt stands.
            seeking: Whether there is a solution left to find; if not, any solution will do.
        """
        if self._optimum is not None and seeking:
            possible = weight > 0
            key = (possible.tobytes(), situation.pushed, situation.left, situation.found)
            if key not in self._thoughts:
                point = Point(bits(possible), situation.found, situation.pushed, situation.left)
                self._thoughts[key] = tuple(self._optimum.best(point))
            return self._thoughts[key]
        which, counts = thinned(weight, PLANNED)
        key = (which.tobytes(), counts.tobytes(), *astuple(situation), seeking)
        if key not in self._thoughts:
            self._thoughts[key] = self._planned(which, counts, situation, seeking)
        return self._thoughts[key]

    def _planned(
        self, which: IntArray, weight: FloatArray, situation: Situation, seeking: bool
    ) -> tuple[int, ...]:
        """The best actions by a plan for the rest of the attempt."""
        objective = Objective() if seeking else Objective(information=0.0)
        found = situation.found if seeking else ()
        planner = Planner(self._hypotheses[which], self._strengths, objective, found)
        values = planner.values(weight, situation)
        slots = len(values) - 1
        best = np.flatnonzero(values >= values.max() - TIE)
        return tuple(2 * slots if slot == slots else slot for slot in best.tolist())

    def after(self, weight: FloatArray, event: Happened) -> FloatArray:
        """``[H]`` what is believed after an event; not to be changed."""
        if len(self._strengths) > 1:  # hardly anything is believed twice
            return self._after(weight, event)
        key = (weight.tobytes(), event)
        if key not in self._beliefs:
            self._beliefs[key] = self._after(weight, event)
        return self._beliefs[key]

    def _after(self, weight: FloatArray, event: Happened) -> FloatArray:
        many = len(weight)
        whole = Event(
            slot=np.full(many, event.slot),
            pushed=np.full(many, event.pushed, dtype=np.uint16),
            took_effect=np.full(many, event.took_effect),
            unlocked=np.full(many, event.unlocked),
            new=np.full(many, event.new),
            found=np.tile(np.array(event.found, dtype=np.uint16), (many, 1)),
        )
        held = weight * likelihood(self._hypotheses, np.arange(many), self._strengths, whole)
        total = float(held.sum())
        assert total > 0, "the schema that governs the room allows what happens in it"
        result: FloatArray = held / total
        return result


def _solved(hypotheses: Hypotheses, weight: FloatArray, action_limit: int) -> Optimum | None:
    """The optimum if it is in reach, which must not depend on what was asked of it before."""
    try:
        optimum = Optimum(hypotheses, weight, action_limit)
        optimum.attempts()
    except TooLargeError:
        return None
    optimum.node_limit = math.inf
    return optimum


_mind = lru_cache(maxsize=32)(_Mind)


def _one_strength(schema: Schema) -> Strengths:
    """Certainty, and the strength that the schema's edges have in the mean."""
    known = [schema.graph.edges[edge]["strength"] for edge in schema.graph.edges]
    value = np.array([1.0, float(np.mean(known))])
    return Strengths(value, np.array([0.0, 1.0]), np.stack([at_least(s) for s in value]))
