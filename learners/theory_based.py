"""The theory-based causal transfer model (Edmonds et al., AAAI 2020), and its form of CogSci 2019.

Two theories of the world decide together what to do. The *bottom-up* one is associative: objects
like those that had effects will have effects. The *top-down* one is structural: the solutions of a
room make up a causal schema, and some schemas are likelier than others.

* **Bottom-up.** Dirichlet beliefs about which colour, which position and which verb has effects:
  global ones, from room to room, and local ones, which begin each room in proportion to the global
  ones, between 1 and 10. Whatever changes the room adds ``local_gain`` to the local beliefs about
  its attributes; a finished trial adds ``global_gain``, shared out as its changes were.
* **Top-down.** From general to particular (:mod:`learners.theory.schemas`): three atomic schemas,
  with a Dirichlet belief that a solved room updates in favour of the nearest; abstract schemas,
  likelier the nearer they are to a likely atomic schema; instantiated schemas, equally likely
  within an abstract one, of which only those count that hold all solutions found and nothing that
  failed. A chain is as likely as the schemas that it completes.
* **Pruning.** A sequence of actions whose last one changed nothing is a dead end: the chains that
  begin with it are removed, and all schemas with a path none of whose chains is left.
* **Action.** For the present place in the chain, the likelihood of each action under the chains
  that begin as the attempt has begun, times what the bottom-up theory expects of its lever; the
  greatest is taken, at random among equals. An unlocked door is pushed.

Equations 2 to 9 are the paper's; what it leaves open is a parameter or is said here, and
docs/rivals.md lists it. ``form: cogsci_2019`` is the model before: it settles on a whole chain for
each attempt, knows no verbs (levers are pushed), prunes nothing, samples its beliefs anew for each
attempt, and believes in abstract schemas directly, without atomic ones, so that what was learned of
rooms with two solutions says nothing about rooms with three.

Written from the papers alone. The gains and the weight were fitted, once, to the means that the
paper of 2020 publishes of its own model (docs/rivals.md).
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import asdict, dataclass, field
from itertools import pairwise
from typing import Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Brief, Learner, Step, Structure, View
from causal_openlock.experiment.expected_cost import Cost
from causal_openlock.world.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.randomness import pick
from causal_openlock.world.room import positions_for
from causal_openlock.world.schema import Schema
from learners.networks.checkpointed import Checkpointed
from learners.theory.chains import CHAIN_LIMIT, Chains, chains_of, number_of_chains
from learners.theory.schemas import ATOMIC, Schemas, edit_distances, schemas_of

MOST = 10.0
"""The greatest local belief at the start of a room; the least is 1 (both papers)."""
NotNegative = Annotated[float, Field(ge=0)]


@dataclass(frozen=True)
class TheoryBasedParameters:
    """Ablations, the form of the model, and what the papers leave open."""

    form: Annotated[
        Literal["aaai_2020", "cogsci_2019"], "which paper's model: by the action, or by the chain"
    ] = "aaai_2020"
    top_down: Annotated[bool, "whether schemas are believed in; if not, all chains are equal"] = (
        True
    )
    bottom_up: Annotated[bool, "whether colours, positions and verbs are believed in"] = True
    beliefs: Annotated[
        Literal["sampled", "mean"], "whether each attempt acts on a sample of its beliefs"
    ] = "sampled"
    retries: Annotated[
        bool, "whether an action that did nothing is followed by another in its place"
    ] = True
    foresight: Annotated[
        bool, "whether an action is judged by what is expected of the levers after it, too"
    ] = True
    local_gain: Annotated[NotNegative, "what a change adds to beliefs about its attributes"] = 0.075
    global_gain: Annotated[NotNegative, "what a trial adds to the global beliefs"] = 1.6
    schema_gain: Annotated[NotNegative, "what a solved room adds to the belief in its schema"] = 2.4
    edit_weight: Annotated[
        NotNegative, "how much less likely an abstract schema is with each edit, in nats"
    ] = 0.8


@dataclass(eq=False)
class RoomTheory:
    """What a subject thinks of the room that it is in."""

    length: int  # levers in a chain
    solutions: int
    grey: IntArray  # [P] 1 where the lever is grey
    allowed: BoolArray  # [C] chains that were not removed
    found: list[int] = field(default_factory=list)  # solutions, as chains
    done: list[int] = field(default_factory=list)  # actions of the attempt that stand in the chain
    chain: list[int] = field(default_factory=list)  # settled on for the attempt (CogSci 2019)
    likely: FloatArray | None = None  # [C] probability of the chains, until something changes
    schemas: IntArray | None = None  # those that are still possible


class TheoryBased(Checkpointed, Learner):
    """Transfers a causal theory: of attributes, bottom-up, and of schemas, top-down."""

    Parameters = TheoryBasedParameters
    parameters: TheoryBasedParameters
    checkpointed: ClassVar = {
        "global": "_global",
        "local": "_local",
        "theta": "_theta",
        "changes": "_changes",
        "atomic": "_atomic",
        "abstract": "_abstract",
    }

    @classmethod
    def expected_cost(
        cls, parameters: TheoryBasedParameters, schema: Schema, action_limit: int
    ) -> Cost | None:
        """It lists all chains, and cannot play where these are too many."""
        many = number_of_chains(positions_for(schema), action_limit - 1)
        return Cost(float("inf"), f"it lists {many:,} chains") if many > CHAIN_LIMIT else None

    def begin(self, brief: Brief) -> None:
        """Begin with the same belief in everything."""
        self.brief, self._earlier = brief, self.parameters.form == "cogsci_2019"
        # Columns: white and grey, pushed and pulled, and the positions.
        self._parts = slice(0, 2), slice(2, 4), slice(4, 4 + brief.positions)
        self._global = np.ones((brief.subjects, 4 + brief.positions))
        self._local, self._changes = self._global.copy(), 0 * self._global
        self._theta = self._global.copy()
        self._atomic = np.ones((brief.subjects, len(ATOMIC)))
        self._abstract: list[dict[tuple[int, int], FloatArray]] = [{} for _ in brief.generators]
        self._rooms: list[RoomTheory | None] = [None] * brief.subjects
        self._left: list[RoomTheory | None] = [None] * brief.subjects

    # -- the two theories -----------------------------------------------------------------------

    def _drawn(self, subject: int, alpha: FloatArray) -> FloatArray:
        """Probabilities that are Dirichlet-distributed: a sample, or their mean."""
        if self._earlier or self.parameters.beliefs == "sampled":
            return self.brief.generators[subject].dirichlet(alpha)
        share: FloatArray = alpha / alpha.sum()
        return share

    def _enter(self, view: View, subject: int) -> RoomTheory:
        positions, console = self.brief.positions, view.console
        length = max(int(console.actions_left[subject]) - 1, 1)
        solutions = int(console.solutions_left[subject] + console.solutions_found[subject])
        grey = view.observation[subject, positions:-2].astype(np.int64)
        every = np.ones(len(chains_of(positions, length).actions), dtype=bool)
        if self._earlier:
            every &= (chains_of(positions, length).actions < positions).all(axis=1)
        room = self._rooms[subject] = RoomTheory(length, solutions, grey, every)
        for part in self._parts:
            alpha = self._global[subject, part]
            alpha = self.brief.generators[subject].dirichlet(alpha) if self._earlier else alpha
            self._local[subject, part] = np.clip(alpha / alpha.min(), 1.0, MOST)
        self._changes[subject] = 0.0
        self._draw_theta(subject)
        return room

    def _draw_theta(self, subject: int) -> None:
        for part in self._parts:
            self._theta[subject, part] = self._drawn(subject, self._local[subject, part])

    def _bottom_up(self, subject: int, room: RoomTheory) -> FloatArray:
        """``[2P]`` how much is expected of each action on a lever, by its attributes."""
        if not self.parameters.bottom_up:
            return np.ones(2 * self.brief.positions)
        colour, verb, position = (self._theta[subject, part] for part in self._parts)
        by_lever = colour[room.grey] * position
        verb = np.ones(2) if self._earlier else verb
        expected: FloatArray = np.concatenate([verb[0] * by_lever, verb[1] * by_lever])
        return expected

    def _schema_belief(self, subject: int, schemas: Schemas, room: RoomTheory) -> FloatArray:
        """``[G]`` probability of the abstract schemas."""
        if self._earlier:
            key = room.length, room.solutions
            alpha = self._abstract[subject].setdefault(key, np.ones(len(schemas.distance)))
            return self._drawn(subject, alpha)
        near = np.exp(-self.parameters.edit_weight * schemas.distance)
        belief: FloatArray = near / near.sum(axis=0) @ self._drawn(subject, self._atomic[subject])
        return belief

    def _top_down(self, subject: int, room: RoomTheory) -> FloatArray:
        """``[C]`` probability of each chain, given what failed and what was found."""
        chains = self._chains(room)
        found = chains.path[room.found]
        left = room.allowed & ~np.isin(chains.path, found)
        if not left.any():  # the room does not always obey, or is of another kind than believed
            room.schemas = None
            room.allowed[:] = (chains.actions < self.brief.positions).all(axis=1) | ~self._earlier
            left = room.allowed & ~np.isin(chains.path, found)
        # A path has as many chains as are left of it, and a schema as many forms as their product.
        versions = np.bincount(chains.path[left], minlength=len(chains.paths)).astype(float)
        versions[found] = 1.0
        worth = versions.copy()
        schemas = schemas_of(self.brief.positions, room.length, room.solutions)
        if self.parameters.top_down and schemas:
            which, of_each, abstract = room.schemas, schemas.paths, schemas.abstract
            if which is None:
                which = np.arange(len(abstract))
            else:
                of_each, abstract = of_each[:, which], abstract[which]
            forms = math.prod(versions[paths] for paths in of_each)
            for one in found:
                forms *= np.logical_or.reduce([paths == one for paths in of_each])
            if not (left_over := forms > 0).all():
                which, of_each = which[left_over], of_each[:, left_over]
                forms, abstract = forms[left_over], abstract[left_over]
            room.schemas = which
            if len(forms):
                many = np.bincount(abstract, forms, len(schemas.distance))
                belief = self._schema_belief(subject, schemas, room)
                forms *= (belief / np.where(many > 0, many, 1.0))[abstract]
                worth = np.zeros(len(versions))
                for paths in of_each:
                    worth += np.bincount(paths, forms, len(worth))
        likely: FloatArray = left * (worth / np.maximum(versions, 1))[chains.path]
        return likely

    def _chains(self, room: RoomTheory) -> Chains:
        return chains_of(self.brief.positions, room.length)

    # -- acting ---------------------------------------------------------------------------------

    def act(self, view: View) -> IntArray:
        """``[B]`` the action that both theories together favour."""
        actions = np.full(self.brief.subjects, 2 * self.brief.positions)
        for subject in np.flatnonzero(view.playing & (view.observation[:, -2] == 1)).tolist():
            room = self._rooms[subject] or self._enter(view, subject)
            if len(room.done) < room.length:
                actions[subject] = self._next(subject, room)
        return actions

    def _next(self, subject: int, room: RoomTheory) -> int:
        chains, place, levers = self._chains(room), len(room.done), 2 * self.brief.positions
        if room.chain:
            return room.chain[place]
        expected = self._bottom_up(subject, room)
        begun = chains.beginning_with(room.done)
        if place and not (begun & room.allowed).any():
            # The attempt is lost; what is left of it is for the attributes.
            expected[room.done] = 0.0
            return self._best(subject, expected)
        if room.likely is None:
            room.likely = self._top_down(subject, room)
        if self._earlier:
            chain = self._best(subject, room.likely * expected[chains.actions].prod(axis=1))
            room.chain = chains.actions[chain].tolist()
            return room.chain[place]
        likely = room.likely * begun
        if self.parameters.foresight:
            likely *= expected[chains.actions[:, place + 1 :]].prod(axis=1)
        worth = np.bincount(chains.actions[:, place], likely, levers)
        return self._best(subject, worth * expected)

    def _best(self, subject: int, worth: FloatArray) -> int:
        best = worth >= worth.max() * (1 - 1e-9)
        return pick(best.astype(float), self.brief.generators[subject].random())

    # -- learning -------------------------------------------------------------------------------

    def learn(self, step: Step) -> None:
        """Update attributes with every change, and schemas with every failure and every trial."""
        changed = (step.outcome != step.view.observation).any(axis=1)
        for subject in np.flatnonzero(step.view.playing).tolist():
            room = self._rooms[subject] or self._enter(step.view, subject)
            action = int(step.action[subject])
            self._observe(subject, room, action, bool(changed[subject]))
            if step.attempt_over[subject]:
                opened = step.outcome[subject, -1] == 1
                self._end_attempt(subject, room, opened, bool(step.new_solution[subject]))
            if step.trial_over[subject]:
                self._end_trial(subject, room)

    def _observe(self, subject: int, room: RoomTheory, action: int, changed: bool) -> None:
        tried = [*room.done, action]
        if action < 2 * self.brief.positions:
            verb, lever = divmod(action, self.brief.positions)
            if changed:
                attributes = [room.grey[lever], 2 + verb, 4 + lever]
                self._local[subject, attributes] += self.parameters.local_gain
                self._changes[subject, attributes] += 1.0
            if changed or self._earlier or not self.parameters.retries:
                room.done = tried
        if not changed and not self._earlier:
            self._remove(room, tried[: room.length])

    def _remove(self, room: RoomTheory, actions: list[int]) -> None:
        """Remove the chains that begin with these actions."""
        gone = self._chains(room).beginning_with(actions) & room.allowed
        if gone.any():
            room.allowed &= ~gone
            room.likely = None

    def _end_attempt(self, subject: int, room: RoomTheory, opened: bool, new: bool) -> None:
        whole = np.flatnonzero(self._chains(room).beginning_with(room.done))
        if new and len(room.done) == room.length and len(whole):
            room.found.append(int(whole[0]))
        elif opened:  # it opens the door, and counts no more
            self._remove(room, room.done)
        room.done, room.chain, room.likely = [], [], None
        self._draw_theta(subject)

    def _end_trial(self, subject: int, room: RoomTheory) -> None:
        settings = self.parameters
        for part in self._parts:
            share = self._changes[subject, part]
            if share.any():
                self._global[subject, part] += settings.global_gain * share / share.sum()
        chains = self._chains(room)
        if room.solutions and len(room.found) == room.solutions:
            paths = np.sort(chains.path[room.found])
            schemas = schemas_of(self.brief.positions, room.length, room.solutions)
            if self._earlier and schemas:
                (which,) = np.flatnonzero((paths == schemas.paths.T).all(axis=1))
                key = room.length, room.solutions
                alpha = self._abstract[subject].setdefault(key, np.ones(len(schemas.distance)))
                alpha[schemas.abstract[which]] += settings.schema_gain
            distance = edit_distances(chains.paths[paths])
            nearest = distance == distance.min()
            self._atomic[subject, nearest] += settings.schema_gain / nearest.sum()
        self._left[subject], self._rooms[subject] = self._rooms[subject], None

    def structure(self, subject: int) -> Structure | None:
        """Edges of the schemas that are still possible, by their mean probabilities.

        A lever of a path enables the next one, and its last the door. Nothing is believed about
        gates.
        """
        room = self._rooms[subject] or self._left[subject]
        schemas = room and schemas_of(self.brief.positions, room.length, room.solutions)
        if not room or not schemas or self._earlier:
            return None
        chains, positions = self._chains(room), self.brief.positions
        found = chains.path[room.found]
        left = room.allowed & ~np.isin(chains.path, found)
        versions = np.bincount(chains.path[left], minlength=len(chains.paths)).astype(float)
        versions[found] = 1.0
        likely: FloatArray = math.prod(versions[paths] for paths in schemas.paths)
        for one in found:
            likely *= (schemas.paths == one).any(axis=0)
        near = np.exp(-self.parameters.edit_weight * schemas.distance)
        atomic = self._atomic[subject] / self._atomic[subject].sum()
        many = np.bincount(schemas.abstract, likely, len(schemas.distance))
        likely *= (near / near.sum(axis=0) @ atomic / np.where(many > 0, many, 1.0))[
            schemas.abstract
        ]
        if not likely.any():  # the room is of another kind than it can believe in
            return None
        possible = np.flatnonzero(likely)
        steps = np.hstack([chains.paths, np.full((len(chains.paths), 1), positions)])
        has = np.zeros((len(possible), positions, positions + 1), dtype=bool)
        for paths in schemas.paths[:, possible]:
            for cause, effect in pairwise(steps[paths].T):
                has[np.arange(len(possible)), cause, effect] = True
        edges = np.tensordot(likely[possible] / likely.sum(), has, axes=1)
        return Structure(edges, np.full(positions + 1, np.nan))

    def state_dict(self) -> dict[str, Any]:
        """Beliefs, rooms, and the states of the generators."""
        rooms = [None if room is None else asdict(room) for room in self._rooms]
        states = [generator.bit_generator.state for generator in self.brief.generators]
        return {**super().state_dict(), "rooms": rooms, "generators": states}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        super().load_state_dict(state)
        self._rooms = [room and RoomTheory(**deepcopy(room)) for room in state["rooms"]]
        for generator, kept in zip(self.brief.generators, state["generators"], strict=True):
            generator.bit_generator.state = kept
