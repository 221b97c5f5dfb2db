"""Many rooms at once, each newly drawn: the environment of meta-training.

A :class:`~causal_openlock.experiment.session.Session` plans every trial beforehand and keeps a
record. Meta-training needs neither and goes through millions of rooms, so that they are drawn as it
runs. What a learner perceives has the same form as in a session.

A *life* is what a memory lasts for: some trials, the first in a room of a schema that is drawn, and
each of the others in another room of the same schema, or now and then of another one.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from causal_openlock.contract.learner import Brief, Step, View
from causal_openlock.experiment.protocol import default_action_limit
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.facts import room_facts
from causal_openlock.world.kernel import PAYER, SOLUTIONS_LEFT
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import PAPER_POSITIONS, action_names
from causal_openlock.world.rooms import Rooms, RoomTables
from openlock_learners.meta.training_file import RoomsFile

POSITIONS = len(PAPER_POSITIONS)


class MetaRooms:
    """B endless sequences of rooms of these schemas, by weight, drawn by a generator."""

    def __init__(
        self,
        file: RoomsFile,
        schemas: Mapping[Schema, float],
        rooms: int,
        generator: np.random.Generator,
    ) -> None:
        self.file, self.generator = file, generator
        self._levers = np.array([len(schema.levers) for schema in schemas])
        weights = np.array([*schemas.values()])
        self._reached = np.cumsum(weights / weights.sum())
        self._tables = RoomTables.of(
            [(schema, default_action_limit(schema)) for schema in schemas], POSITIONS
        )
        rewards = [find_reward(name) for name in file.rewards]
        self._rooms = Rooms(self._tables, rewards, rooms, file.attempt_limit)
        # Sets of positions, by a bit for each: whatever levers stand there, in whatever order.
        self._forbidden = np.zeros(1 << POSITIONS, dtype=bool)
        for layout in room_facts()["layouts"].values():
            places = map(PAPER_POSITIONS.index, layout.values())
            self._forbidden[sum(1 << place for place in places)] = True
        self.brief = Brief(
            subjects=rooms,
            positions=POSITIONS,
            action_names=action_names(POSITIONS),
            action_limit=int(self._tables.actions_left.max()),
            attempt_limit=file.attempt_limit,
            trials=file.trials[1],
            generators=(),
        )
        self._schema = np.zeros(rooms, dtype=np.int64)
        self._trial = np.ones(rooms, dtype=np.int64)
        self._trials = np.ones(rooms, dtype=np.int64)
        self._playing = np.ones(rooms, dtype=bool)
        self.life_over = np.zeros(rooms, dtype=bool)  #: ``[B]`` whether a memory's life ended last
        #: ``[B]`` whether everything was found in the room of the last step
        self.last_solved = np.zeros(rooms, dtype=bool)
        self._new_trials(np.arange(rooms), self._playing)
        self.view = self._perceive()  #: what is perceived now

    def _new_trials(self, who: IntArray, lives: BoolArray) -> None:
        """Begin a trial in the rooms ``who``, and in those of ``lives`` also a new life."""
        generator, (least, most) = self.generator, self.file.trials
        drawn = np.searchsorted(self._reached, generator.random(len(who)), side="right")
        changes = lives | (generator.random(len(who)) < self.file.change)
        schema = np.where(changes, np.minimum(drawn, len(self._levers) - 1), self._schema[who])
        length = generator.integers(least, most + 1, len(who))
        reward = generator.integers(len(self.file.rewards), size=len(who))
        self._schema[who] = schema
        self._trials[who] = np.where(lives, length, self._trials[who])
        payer = self._rooms.state.situation[:, PAYER]
        payer[who] = np.where(lives, reward, payer[who])
        self._trial[who] = np.where(lives, 1, self._trial[who] + 1)
        places = self._places(self._levers[schema])
        self._rooms.begin_trials(who, schema, places.argsort(axis=1))

    def _places(self, levers: IntArray) -> IntArray:
        """``[n, 7]`` random positions; the first ``levers`` of each row are not an excluded set."""
        places = np.empty((len(levers), POSITIONS), dtype=np.int64)
        due = np.arange(len(levers))
        while len(due):
            places[due] = self.generator.random((len(due), POSITIONS)).argsort(axis=1)
            inside = np.arange(POSITIONS) < levers[due, None]
            sets = ((1 << places[due]) * inside).sum(axis=1)
            due = due[self._forbidden[sets]]
        return places

    def _perceive(self) -> View:
        return View.of(self._rooms, self._trial.copy(), self._playing)

    def step(self, action: IntArray) -> Step:
        """Take one action, ``[B]``, in each room."""
        view = self.view
        luck = self.generator.random(len(action)) if self._tables.stochastic else None
        outcome = self._rooms.step(action, luck, seen=True)
        self.last_solved = self._rooms.console[:, SOLUTIONS_LEFT] == 0
        self.life_over = outcome.trial_over & (self._trial >= self._trials)
        over = np.flatnonzero(outcome.trial_over)
        if len(over):
            self._new_trials(over, self.life_over[over])
        self.view = self._perceive()
        return Step.of(view, action, outcome, self.view)
