"""The theory-based causal transfer model (Edmonds et al., AAAI 2020), and its form of CogSci 2019.

Two theories of the world decide together what to do. The *bottom-up* one is associative: objects
like those that had effects will have effects. The *top-down* one is structural: the solutions of a
room make up a causal schema, and some schemas are likelier than others.

* **Bottom-up.** Dirichlet beliefs about which colour, which position and which verb has effects:
  global ones, from room to room, and local ones, which begin each room in proportion to the global
  ones, between 1 and 10. Whatever changes the room adds ``local_gain`` to the local beliefs about
  its attributes; a finished trial adds ``global_gain``, shared out as its changes were.
* **Top-down.** From general to particular (:mod:`openlock_learners.theory.schemas`): three atomic
  schemas, with a Dirichlet belief that a solved room updates in favour of the nearest; abstract
  schemas, likelier the nearer they are to a likely atomic schema; instantiated schemas, equally
  likely within an abstract one, of which only those count that hold all solutions found and nothing
  that failed. A chain is as likely as the schemas that it completes.
* **Pruning.** A sequence of actions whose last one changed nothing is a dead end: the chains that
  begin with it are removed, and all schemas with a path none of whose chains is left.
* **Action.** For the present place in the chain, the likelihood of each action under the chains
  that begin as the attempt has begun, times what the bottom-up theory expects of its lever; the
  greatest is taken, at random among equals. An unlocked door is pushed.

Its probabilities are exact where beliefs are means: sums over ties. Where beliefs are sampled, they
are integrals without a closed form, and are estimated (:mod:`openlock_learners.theory.draws`).

Equations 2 to 9 are the paper's; what it leaves open is a parameter or is said here. Dirichlet
priors are 1 for each value; the door has no attributes. In a new room the least local belief is 1,
and what is then above 10 is 10. A solved room supports the atomic schema nearest by edit distance
of the levers' graphs; ties share it. Chains are all ways to push or pull two different levers, then
the door. With over 30,000 schemas to list, chains are equally likely. One thing differs: beliefs in
attributes are drawn once for an attempt, so that a change counts from the next attempt on, where
the paper updates beliefs after each action.

``form: cogsci_2019`` is the model before: it settles on a whole chain for each attempt, knows no
verbs (levers are pushed), prunes nothing, samples its beliefs for each attempt, and believes in
abstract schemas directly, without atomic ones, so that what was learned of rooms with two solutions
says nothing about rooms with three.

Written from the papers alone. The gains and the weight were fitted, once, to the means that the
paper of 2020 publishes of its own model (evidence/rivals/fit.json).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field

from causal_openlock.contract.learner import Brief, Learner, Step, Structure, View
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.randomness import pick
from causal_openlock.world.room import positions_for
from openlock_learners.theory.chains import CHAIN_LIMIT, chains_of, number_of_chains
from openlock_learners.theory.draws import DRAWS, LOCAL, AttemptDraws, Moment, Odds, RoomDraws, best
from openlock_learners.theory.possible_chains import RoomHypotheses
from openlock_learners.theory.schemas import ATOMIC, Schemas, edit_distances

DRAWN_CHAINS = 2**20
"""Chains that are looked at together, for the probabilities."""
MOST = 10.0
"""The greatest local belief at the start of a room; the least is 1 (both papers)."""
NotNegative = Annotated[float, Field(ge=0, le=1e6)]


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
        bool, "whether an action is judged also by what is expected of the levers after it"
    ] = True
    local_gain: Annotated[NotNegative, "what a change adds to beliefs about its attributes"] = 0.075
    global_gain: Annotated[NotNegative, "what a trial adds to the global beliefs"] = 1.6
    schema_gain: Annotated[NotNegative, "what a solved room adds to the belief in its schema"] = 2.4
    edit_weight: Annotated[
        NotNegative, "how much less likely an abstract schema is with each edit, in nats"
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
        many = number_of_chains(positions_for(schema), action_limit - 1)
        if many <= CHAIN_LIMIT:
            return ""
        return f"it would have to list {many:,} chains of levers, too many"

    def begin(self, brief: Brief) -> None:
        """Begin with the same belief in everything."""
        self.brief, self._earlier = brief, self.parameters.form == "cogsci_2019"
        self._samples = self._earlier or self.parameters.beliefs == "sampled"
        # Columns: white and grey, pushed and pulled, and the positions.
        self._parts = slice(0, 2), slice(2, 4), slice(4, 4 + brief.positions)
        self._global = np.ones((brief.subjects, 4 + brief.positions))
        self._local, self._changes = self._global.copy(), 0 * self._global
        self._theta = self._global.copy()
        self._atomic = np.ones((brief.subjects, len(ATOMIC)))
        self._abstract: list[dict[tuple[int, int], FloatArray]] = [{} for _ in brief.generators]
        self._rooms: list[RoomHypotheses | None] = [None] * brief.subjects
        self._left: list[RoomHypotheses | None] = [None] * brief.subjects
        # For its probabilities, which leave what it draws itself as it is.
        self._others = [generator.spawn(1)[0] for generator in brief.generators]
        self._attempts: dict[int, AttemptDraws] = {}
        self._settling: dict[int, RoomDraws] = {}

    # -- the two theories -----------------------------------------------------------------------

    def _drawn(self, generator: np.random.Generator, alpha: FloatArray, many: int) -> FloatArray:
        """``[many, K]`` probabilities that are Dirichlet-distributed: samples, or their mean."""
        if self._samples:
            return generator.dirichlet(alpha, many)
        share: FloatArray = np.tile(alpha / alpha.sum(), (many, 1))
        return share

    def _enter(self, view: View, subject: int) -> RoomHypotheses:
        positions, console = self.brief.positions, view.console
        length = max(int(console.actions_left[subject]) - 1, 1)
        solutions = int(console.solutions_left[subject] + console.solutions_found[subject])
        grey = view.observation[subject, positions:-2].astype(np.int64)
        every = np.ones(len(chains_of(positions, length).actions), dtype=bool)
        if self._earlier:
            every &= (chains_of(positions, length).actions < positions).all(axis=1)
        room = self._rooms[subject] = RoomHypotheses(length, solutions, grey, every, every)
        (self._local[subject],) = self._begun(subject, self.brief.generators[subject], 1)
        self._changes[subject] = 0.0
        self._draw_theta(subject)
        return room

    def _begun(self, subject: int, generator: np.random.Generator, many: int) -> FloatArray:
        """``[many, K]`` local beliefs at the start of a room."""
        begun = np.tile(self._global[subject], (many, 1))
        for part in self._parts:
            alpha = self._global[subject, part]
            begun[:, part] = generator.dirichlet(alpha, many) if self._earlier else alpha
            begun[:, part] /= begun[:, part].min(axis=1, keepdims=True)
        return np.clip(begun, 1.0, MOST)

    def _draw_theta(self, subject: int) -> None:
        generator, local = self.brief.generators[subject], self._local[subject]
        for part in self._parts:
            (self._theta[subject, part],) = self._drawn(generator, local[part], 1)

    def _bottom_up(self, theta: FloatArray, room: RoomHypotheses) -> FloatArray:
        """``[N, 2P]`` how much is expected of each action on a lever, by its attributes."""
        if not self.parameters.bottom_up:
            return np.ones((len(theta), 2 * self.brief.positions))
        colour, verb, position = (theta[:, part] for part in self._parts)
        by_lever = colour[:, room.grey] * position
        verb = np.ones_like(verb) if self._earlier else verb
        return np.hstack([verb[:, :1] * by_lever, verb[:, 1:] * by_lever])

    def _schema_belief(
        self, subject: int, room: RoomHypotheses, generator: np.random.Generator, many: int
    ) -> FloatArray:
        """``[many, G]`` probability of the abstract schemas."""
        schemas = room.every_schema
        if schemas is None or not room.structured:
            return np.ones((many, 1))
        if self._earlier:
            key = room.length, room.solutions
            alpha = self._abstract[subject].setdefault(key, np.ones(len(schemas.distance)))
            return self._drawn(generator, alpha, many)
        atomic = self._drawn(generator, self._atomic[subject], many)
        return atomic @ self._abstracted(schemas).T

    def _abstracted(self, schemas: Schemas) -> FloatArray:
        """``[G, 3]`` probability of each abstract schema, by what is atomic."""
        near = np.exp(-self.parameters.edit_weight * schemas.distance)
        share: FloatArray = near / near.sum(axis=0)
        return share

    # -- acting ---------------------------------------------------------------------------------

    def act(self, view: View) -> IntArray:
        """``[B]`` the action that both theories together favour."""
        actions = np.full(self.brief.subjects, 2 * self.brief.positions)
        for subject, room in self._deciding(view):
            actions[subject] = self._next(subject, room)
        return actions

    def _deciding(self, view: View) -> Iterator[tuple[int, RoomHypotheses]]:
        """The subjects that do not go for the door, and what they think of their rooms."""
        for subject in np.flatnonzero(view.playing & (view.observation[:, -2] == 1)).tolist():
            room = self._rooms[subject] or self._enter(view, subject)
            if len(room.done) < room.length:
                yield subject, room

    def _next(self, subject: int, room: RoomHypotheses) -> int:
        place, generator = len(room.done), self.brief.generators[subject]
        if room.chain:
            return room.chain[place]
        theta = self._theta[[subject]]
        if room.lost:
            return pick(best(self._beside_chains(theta, room))[0], generator.random())
        if room.likely is None:
            likely = room.likelihood(self.parameters.top_down)
            (room.likely,) = self._schema_belief(subject, room, generator, 1) @ likely.T
        worth = self._worth(theta, np.ones((1, 1)), room.likely[:, None], room)
        chosen = pick(best(worth)[0], generator.random())
        if self._earlier:
            room.chain = room.chains.actions[chosen].tolist()
            return room.chain[place]
        return chosen

    def _beside_chains(self, theta: FloatArray, room: RoomHypotheses) -> FloatArray:
        """``[N, 2P]`` what is left of a lost attempt is for the attributes."""
        expected = self._bottom_up(theta, room)
        expected[:, [action for action in room.done if action < expected.shape[1]]] = 0.0
        return expected

    def _worth(
        self, theta: FloatArray, belief: FloatArray, likely: FloatArray, room: RoomHypotheses
    ) -> FloatArray:
        """``[N, 2P]`` how much both theories expect of each action now, or ``[N, C]`` of chains.

        Args:
            theta: ``[N, K]`` beliefs in attributes.
            belief: ``[N, G]`` beliefs in schemas.
            likely: ``[C, G]`` probability of each chain, by schemas.
            room: What else is thought of the room.
        """
        chains, place = room.chains, len(room.done)
        on = np.flatnonzero(chains.beginning_with(room.done) & likely.any(axis=1))
        expected = np.ascontiguousarray(self._bottom_up(theta, room).T)
        worth = likely[on] @ belief.T
        judged = chains.actions[on, place + (not self._earlier) :].T
        for later in judged if self._earlier or self.parameters.foresight else ():
            worth *= expected[later]
        if self._earlier:
            whole = np.zeros((len(chains.actions), len(theta)))
            whole[on] = worth
            return whole.T
        firsts = chains.actions[on, place] == np.arange(len(expected))[:, None]
        return (firsts.astype(float) @ worth * expected).T

    # -- its probabilities ----------------------------------------------------------------------

    def probabilities(self, view: View) -> FloatArray:
        """``[B, A]`` equal for ties; estimated where beliefs are sampled (see ``sample_size``)."""
        door = 2 * self.brief.positions
        found = np.eye(self.brief.actions)[np.full(self.brief.subjects, door)]
        self._sizes = np.full(self.brief.subjects, np.inf)
        for subject, room in self._deciding(view):
            found[subject, :door], self._sizes[subject] = self._odds(subject, room)
            found[subject, door] = 0.0
        return found

    def sample_size(self) -> FloatArray | None:
        """``[B]`` how many draws of its beliefs the probabilities are shares of."""
        return self._sizes if self._samples else None

    def _odds(self, subject: int, room: RoomHypotheses) -> Odds:
        """The probabilities of the actions on levers."""
        if self._earlier:
            return self._settled(subject, room).ask(room.chains.actions[:, len(room.done)])
        moment = self._moment(subject, room)
        if not self._samples:
            worth = moment.worth(self._theta[[subject]], moment.schemas(1))
            return Odds(best(worth)[0], np.inf)
        if subject not in self._attempts:
            local, generator = self._local[subject].copy(), self._others[subject]
            self._attempts[subject] = AttemptDraws(
                lambda many: np.hstack(
                    [self._drawn(generator, local[part], many) for part in self._parts]
                ),
                self._many(room),
            )
        return self._attempts[subject].ask(moment)

    def _many(self, room: RoomHypotheses) -> int:
        """Number of draws, limited by memory."""
        return int(np.clip(DRAWN_CHAINS // len(room.allowed), LOCAL, DRAWS))

    def _moment(self, subject: int, room: RoomHypotheses) -> Moment:
        room, levers = replace(room), 2 * self.brief.positions  # as it is now
        if room.lost:
            return Moment(
                lambda theta, _: self._beside_chains(theta, room),
                lambda many: np.zeros((many, 0)),
                -1,
                ~np.isin(np.arange(levers), room.done),
            )
        likely, chains = room.likelihood(self.parameters.top_down), room.chains
        on = chains.beginning_with(room.done) & likely.any(axis=1)
        possible = np.bincount(chains.actions[on, len(room.done)], minlength=levers) > 0
        return Moment(
            lambda theta, belief: self._worth(theta, belief, likely, room),
            lambda many: self._schema_belief(subject, room, self._others[subject], many),
            int(room.allowed.sum()),
            possible | ~possible.any(),
        )

    def _settled(self, subject: int, room: RoomHypotheses) -> RoomDraws:
        """Draws of the chain that the subject may have settled on for the attempt."""
        generator = self._others[subject]
        if subject not in self._settling:
            self._settling[subject] = RoomDraws(self._begun(subject, generator, LOCAL))
        drawn = self._settling[subject]
        if drawn.settled is None:
            likely, each = room.likelihood(self.parameters.top_down), self._many(room) // LOCAL
            local = drawn.local + self.parameters.local_gain * self._changes[subject]
            # All chains have as many factors, so that these need not add up to 1.
            theta = generator.standard_gamma(np.repeat(local, each, axis=0))
            belief = self._schema_belief(subject, room, generator, len(theta))
            on = np.flatnonzero(likely.any(axis=1))
            worth = self._worth(theta, belief, likely, room)[:, on]
            chosen = np.zeros((LOCAL, len(likely)))
            chosen[:, on] = best(worth).reshape(LOCAL, each, -1).mean(axis=1)
            drawn.settle(chosen, each, likely.sum(axis=1) > 0)
        return drawn

    def _note(self, subject: int, room: RoomHypotheses, action: int, step: Step) -> None:
        """Update the draws by the action that was taken."""
        place, over = len(room.done), bool(step.attempt_over[subject])
        if subject in self._attempts:
            self._attempts[subject].acted(action)
            if over:
                del self._attempts[subject]
        if subject in self._settling:
            actions = room.chains.actions
            asked = actions[:, place] == action if place < room.length else True
            self._settling[subject].acted(asked, over)
            if step.trial_over[subject]:
                del self._settling[subject]

    # -- learning -------------------------------------------------------------------------------

    def learn(self, step: Step) -> None:
        """Update attributes with every change, and schemas with every failure and every trial."""
        changed = (step.outcome != step.view.observation).any(axis=1)
        for subject in np.flatnonzero(step.view.playing).tolist():
            room = self._rooms[subject] or self._enter(step.view, subject)
            action = int(step.action[subject])
            self._note(subject, room, action, step)
            self._observe(subject, room, action, bool(changed[subject]))
            if step.attempt_over[subject]:
                opened = bool(step.outcome[subject, -1] == 1)
                room.end_attempt(opened, bool(step.new_solution[subject]))
                self._draw_theta(subject)
            if step.trial_over[subject]:
                self._end_trial(subject, room)

    def _observe(self, subject: int, room: RoomHypotheses, action: int, changed: bool) -> None:
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
            room.remove(tried[: room.length])

    def _end_trial(self, subject: int, room: RoomHypotheses) -> None:
        settings = self.parameters
        for part in self._parts:
            share = self._changes[subject, part]
            if share.any():
                self._global[subject, part] += settings.global_gain * share / share.sum()
        chains = room.chains
        if room.solutions and len(room.found) == room.solutions:
            paths = np.sort(chains.path[room.found])
            schemas = room.every_schema
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
        schemas = room and room.every_schema
        if not room or not schemas or self._earlier:
            return None
        atomic = self._atomic[subject] / self._atomic[subject].sum()
        edges = room.edges(schemas, self._abstracted(schemas) @ atomic)
        return edges if edges is None else Structure(edges, np.full(len(edges) + 1, np.nan))

    def __getstate__(self) -> dict[str, Any]:
        """All but the draws behind its probabilities, which change nothing that it does."""
        return vars(self) | {"_attempts": {}, "_settling": {}}
