"""The theory-based causal transfer model (Edmonds et al., AAAI 2020).

Two theories of the world decide together what to do. The *bottom-up* one is associative: objects
like those that had effects will have effects. The *top-down* one is structural: the solutions of a
room make up a causal schema, and some schemas are likelier than others.

* **Bottom-up.** Dirichlet beliefs about which colour, which position and which verb has effects:
  global ones, from room to room, and local ones, which begin each room in proportion to the global
  ones, between 1 and 10. Whatever changes the room adds ``local_gain`` to the local beliefs about
  its attributes; a finished trial adds ``global_gain``, shared out as its changes were.
* **Top-down.** From general to particular (:mod:`openlock_learners.chains`): atomic schemas,
  with a Dirichlet belief that a solved room updates in favour of the nearest; abstract schemas,
  likelier the nearer they are to a likely atomic schema; instantiated schemas, equally likely
  within an abstract one, of which only those count that hold all solutions found and nothing that
  failed. A chain is as likely as the schemas that it completes.
* **Pruning.** A sequence of actions whose last one changed nothing is a dead end: the chains that
  begin with it are removed, and all schemas with a path none of whose chains is left.
* **Action.** For the present place in the chain, the likelihood of each action under the chains
  that begin as the attempt has begun, times what the bottom-up theory expects of its lever; the
  greatest is taken, at random among equals. An unlocked door is pushed.

Equations 2 to 9 are the paper's; what it leaves open is a parameter or is said here. Dirichlet
priors are 1 for each value; the door has no attributes. In a new room the least local belief is 1,
and what is then above 10 is 10. A solved room supports the atomic schema nearest by edit distance
of the levers' graphs; ties share it. Chains are all ways to push or pull two different levers, then
the door. With over 30,000 schemas to list, chains are equally likely. One thing differs: beliefs in
attributes are drawn once for an attempt, so that a change counts from the next attempt on, where
the paper updates beliefs after each action.

How likely an action is under sampled beliefs is an integral without a closed form, so the model
gives probabilities only where beliefs are means.

Written from the papers alone. The gains and the weight were fitted, once, to the means that the
paper publishes of its own model (evidence/rivals/fit.json).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Brief, Learner, Step, Structure, View
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.randomness import pick
from causal_openlock.world.room import positions_for
from openlock_learners.chains import ATOMIC, CHAIN_LIMIT, RoomHypotheses, edit_distances

MOST = 10.0
"""The greatest local belief at the start of a room; the least is 1."""
TIE = 1e-9
"""Relative difference up to which actions are equally good."""
Strength = Annotated[float, Field(ge=0, le=1e6)]


@dataclass(frozen=True)
class TheoryBasedParameters:
    """Ablations of the model, and what the paper leaves open."""

    top_down: Annotated[bool, "whether schemas are believed in; if not, all chains are equal"] = (
        True
    )
    bottom_up: Annotated[bool, "whether colours, positions and verbs are believed in"] = True
    beliefs: Annotated[
        Literal["sampled", "mean"], "whether each attempt acts on a sample of its beliefs"
    ] = "sampled"
    local_gain: Annotated[Strength, "what a change adds to beliefs about its attributes"] = 0.075
    global_gain: Annotated[Strength, "what a trial adds to the global beliefs"] = 1.6
    schema_gain: Annotated[Strength, "what a solved room adds to the belief in its schema"] = 2.4
    edit_weight: Annotated[
        Strength, "how much less likely an abstract schema is with each edit, in nats"
    ] = 0.8


class TheoryBased(Learner):
    """Transfers a causal theory: of attributes, bottom-up, and of schemas, top-down."""

    Parameters = TheoryBasedParameters
    parameters: TheoryBasedParameters

    @classmethod
    def cannot_play(
        cls, parameters: TheoryBasedParameters, schema: Schema, action_limit: int
    ) -> str:
        """Refuse rooms with more chains of levers than can be listed."""
        length = action_limit - 1
        many = math.perm(positions_for(schema), length) << length  # each lever pushed or pulled
        if many <= CHAIN_LIMIT:
            return ""
        return f"it would have to list {many:,} chains of levers, too many"

    def begin(self, brief: Brief) -> None:
        """Begin with the same belief in everything."""
        super().begin(brief)
        # Columns: white and grey, pushed and pulled, and the positions.
        self._parts = slice(0, 2), slice(2, 4), slice(4, 4 + brief.positions)
        self._global = np.ones((brief.subjects, 4 + brief.positions))
        self._local, self._theta = self._global.copy(), self._global.copy()
        self._changes = np.zeros_like(self._global)
        self._atomic = np.ones((brief.subjects, len(ATOMIC)))
        self._rooms: list[RoomHypotheses | None] = [None] * brief.subjects

    def _room(self, view: View, subject: int) -> RoomHypotheses:
        """A subject's hypotheses about its room, which begin when it enters."""
        room = self._rooms[subject]
        if room is not None and not room.over:
            return room
        console, grey = view.console, view.observation[subject, self.brief.positions : -2]
        room = self._rooms[subject] = RoomHypotheses(
            length=max(int(console.actions_left[subject]) - 1, 1),
            solutions=int(console.solutions_left[subject] + console.solutions_found[subject]),
            grey=grey.astype(np.int64),
        )
        for part in self._parts:
            begun = self._global[subject, part]
            self._local[subject, part] = np.clip(begun / begun.min(), 1.0, MOST)
        self._changes[subject] = 0.0
        self._draw_theta(subject)
        return room

    # -- the two theories -----------------------------------------------------------------------

    def _drawn(self, subject: int, alpha: FloatArray) -> FloatArray:
        """Probabilities that are Dirichlet-distributed: a sample, or their mean."""
        if self.parameters.beliefs == "sampled":
            return self.brief.generators[subject].dirichlet(alpha)
        share: FloatArray = alpha / alpha.sum()
        return share

    def _draw_theta(self, subject: int) -> None:
        for part in self._parts:
            self._theta[subject, part] = self._drawn(subject, self._local[subject, part])

    def _bottom_up(self, subject: int, room: RoomHypotheses) -> FloatArray:
        """``[2P]`` how much is expected of each action on a lever, by its attributes."""
        if not self.parameters.bottom_up:
            return np.ones(2 * self.brief.positions)
        colour, verb, position = (self._theta[subject, part] for part in self._parts)
        by_lever = colour[room.grey] * position
        return np.concatenate([verb[0] * by_lever, verb[1] * by_lever])

    def _top_down(self, subject: int, room: RoomHypotheses) -> FloatArray:
        """``[C]`` how likely each chain is, by the schemas that it completes."""
        possible = room.possible
        if not (self.parameters.top_down and len(possible.share)):
            return possible.left.astype(float)
        belief = self._abstract(room, self._drawn(subject, self._atomic[subject]))
        likely: FloatArray = belief @ possible.likely
        return likely

    def _abstract(self, room: RoomHypotheses, atomic: FloatArray) -> FloatArray:
        """``[G]`` probability of each abstract schema, by that ``[3]`` of the atomic ones."""
        assert room.schemas is not None
        near = np.exp(-self.parameters.edit_weight * room.schemas.distance)
        belief: FloatArray = near / near.sum(axis=0) @ atomic
        return belief

    # -- acting ---------------------------------------------------------------------------------

    def act(self, view: View) -> IntArray:
        """``[B]`` the action that both theories together favour."""
        actions = np.full(self.brief.subjects, 2 * self.brief.positions)
        for subject, odds in self._decisions(view):
            actions[subject] = pick(odds, self.brief.generators[subject].random())
        return actions

    def probabilities(self, view: View) -> FloatArray | None:
        """``[B, A]`` equal for ties; None where beliefs are sampled."""
        if self.parameters.beliefs == "sampled":
            return None
        door = 2 * self.brief.positions
        chances = np.eye(self.brief.actions)[np.full(self.brief.subjects, door)]
        for subject, odds in self._decisions(view):
            chances[subject] = [*odds, 0.0]
        return chances

    def _decisions(self, view: View) -> Iterator[tuple[int, FloatArray]]:
        """Subjects that do not go for the door, and ``[2P]`` the odds of their other actions."""
        for subject in np.flatnonzero(view.playing & (view.observation[:, -2] == 1)).tolist():
            room = self._room(view, subject)
            if len(room.done) < room.length:
                worth = self._worth(subject, room)
                best = (worth >= worth.max() * (1 - TIE)).astype(float)
                yield subject, best / best.sum()

    def _worth(self, subject: int, room: RoomHypotheses) -> FloatArray:
        """``[2P]`` how much both theories expect of each action on a lever now."""
        expected = self._bottom_up(subject, room)
        if room.lost:  # what is left of the attempt is for the attributes
            expected[room.done] = 0.0
            return expected
        if room.likely is None:
            room.likely = self._top_down(subject, room)
        on = np.flatnonzero(room.chains.beginning_with(room.done) & (room.likely > 0))
        now, *later = room.chains.actions[on, len(room.done) :].T
        worth = room.likely[on]
        for actions in later:
            worth = worth * expected[actions]
        total: FloatArray = np.bincount(now, worth, len(expected)) * expected
        return total

    # -- learning -------------------------------------------------------------------------------

    def learn(self, step: Step) -> None:
        """Update attributes with every change, and schemas with every failure and every trial."""
        changed = (step.outcome != step.view.observation).any(axis=1)
        for subject in np.flatnonzero(step.view.playing).tolist():
            room = self._room(step.view, subject)
            self._observe(subject, room, int(step.action[subject]), bool(changed[subject]))
            if step.attempt_over[subject]:
                opened = bool(step.outcome[subject, -1] == 1)
                room.end_attempt(opened, bool(step.new_solution[subject]))
                self._draw_theta(subject)
            if step.trial_over[subject]:
                self._end_trial(subject, room)

    def _observe(self, subject: int, room: RoomHypotheses, action: int, changed: bool) -> None:
        tried = [*room.done, action]
        if not changed:
            room.remove(tried[: room.length])
        elif action < 2 * self.brief.positions:
            verb, lever = divmod(action, self.brief.positions)
            attributes = [room.grey[lever], 2 + verb, 4 + lever]
            self._local[subject, attributes] += self.parameters.local_gain
            self._changes[subject, attributes] += 1.0
            room.done = tried

    def _end_trial(self, subject: int, room: RoomHypotheses) -> None:
        for part in self._parts:
            share = self._changes[subject, part]
            if share.any():
                self._global[subject, part] += self.parameters.global_gain * share / share.sum()
        if room.solutions and len(room.found) == room.solutions:
            paths = np.sort(room.chains.path[room.found])
            distance = edit_distances(room.chains.paths[paths])
            nearest = distance == distance.min()
            self._atomic[subject, nearest] += self.parameters.schema_gain / nearest.sum()
        room.over = True

    def structure(self, subject: int) -> Structure | None:
        """Edges of the schemas that are still possible, by their mean probabilities.

        A lever of a path enables the next one, and its last the door; gates are unknown.
        """
        room = self._rooms[subject]
        if room is None or not len(room.possible.share):
            return None
        atomic = self._atomic[subject]
        edges = room.edges(self._abstract(room, atomic / atomic.sum()))
        return Structure(edges, np.full(len(edges) + 1, np.nan))
