"""Many rooms at once, each newly drawn: the environment of meta-training.

A :class:`~causal_openlock.experiment.session.Session` plans every trial beforehand and keeps a
record. Meta-training needs neither and goes through millions of rooms, so that they are drawn as it
runs. The tables of :mod:`causal_openlock.world.tables` hold each schema once, its levers at
the first positions; where they are in a trial is a permutation of the positions, applied to what
is seen and done. What a learner perceives has the same form as in a session.

A *life* is what a memory lasts for: some trials, the first in a room of a schema that is drawn, and
each of the others in another room of the same schema, or now and then of another one.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import Brief, Console, Step, View
from causal_openlock.experiment.protocol import default_action_limit
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.batch import RoomBatch
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import PAPER_POSITIONS, Layout, action_names
from causal_openlock.world.tables import ACTIONS_LEFT, RoomTables

POSITIONS = len(PAPER_POSITIONS)
_KEPT = ("_schema", "_listed_at", "_bits", "_trial", "_trials", "life_over")


@dataclass(frozen=True)
class Distribution:
    """The distribution of rooms that a :class:`~.training_file.RoomsFile` declares."""

    schemas: tuple[Schema, ...]
    weights: tuple[float, ...]  # how often each schema is drawn, relative to the others
    rewards: tuple[str, ...] = ("unique_solutions",)  # a life perceives one of these
    attempt_limit: int = 30
    trials: tuple[int, int] = (1, 7)  # the fewest and the most in a life
    change: float = 0.15
    excluded: frozenset[frozenset[int]] = frozenset()  # sets of positions of grey levers
    placements: int | None = None  # ways to place any number of levers; None: all


class MetaRooms:
    """B endless sequences of rooms, drawn from a distribution by a generator.

    Attributes:
        brief: What a learner knows before it starts.
        view: What is perceived now.
        life_over: ``[B]`` whether the memory's life ended with the last step.
        last_schema: ``[B]`` index of the schema of the room in which the last step was taken.
        last_solved: ``[B]`` whether everything was found in that room.
    """

    def __init__(
        self, distribution: Distribution, rooms: int, generator: np.random.Generator
    ) -> None:
        self.distribution, self.generator = distribution, generator
        self._levers = np.array([len(schema.levers) for schema in distribution.schemas])
        self._tables = RoomTables(POSITIONS)
        listed = [
            (
                schema,
                Layout(tuple(range(len(schema.levers))), POSITIONS),
                default_action_limit(schema),
            )
            for schema in distribution.schemas
        ]
        self._listed = self._tables.add(listed)
        weights = np.array(distribution.weights, dtype=float)
        self._reached = np.cumsum(weights / weights.sum())
        self._batch = RoomBatch(
            self._tables,
            [find_reward(name) for name in distribution.rewards],
            rooms,
            distribution.attempt_limit,
        )
        self._forbidden = np.zeros(1 << POSITIONS, dtype=bool)
        for places in distribution.excluded:
            self._forbidden[sum(1 << place for place in places)] = True
        # By the number of levers, if there are only so many placements: [8, placements, 7].
        counts = np.repeat(np.arange(POSITIONS + 1), distribution.placements or 0)
        self._known_places = self._new_places(counts).reshape(POSITIONS + 1, -1, POSITIONS)
        self.brief = Brief(
            subjects=rooms,
            positions=POSITIONS,
            action_names=action_names(POSITIONS),
            action_limit=int(self._tables.action_limit.max()),
            attempt_limit=distribution.attempt_limit,
            trials=distribution.trials[1],
            generators=(),
        )
        self._everyone = np.arange(rooms)
        self._schema = np.zeros(rooms, dtype=np.int64)
        # Which listed position is at each of the room's, and by action.
        self._listed_at = np.zeros((rooms, POSITIONS), dtype=np.int64)
        self._bits = np.zeros((rooms, 2 * POSITIONS + 2), dtype=np.int64)
        self._bits[:, -2:] = 2 * POSITIONS, 2 * POSITIONS + 1
        self._trial = np.ones(rooms, dtype=np.int64)
        self._trials = np.ones(rooms, dtype=np.int64)
        self._playing = np.ones(rooms, dtype=bool)
        self.life_over = np.zeros(rooms, dtype=bool)
        self.last_solved = np.zeros(rooms, dtype=bool)
        self.last_schema = self._schema.copy()
        self._new_trials(self._everyone, self._everyone >= 0)
        self.view = self._perceive()

    @property
    def schema(self) -> IntArray:
        """``[B]`` index of the schema of each room."""
        return self._schema.copy()

    @property
    def layout(self) -> IntArray:
        """``[B, 7]`` which lever of its schema is where; -1 where none is."""
        levers = self._levers[self._schema][:, None]
        return np.where(self._listed_at < levers, self._listed_at, -1)

    def _new_trials(self, who: IntArray, lives: BoolArray) -> None:
        """Begin a trial in the rooms ``who``, and in those of ``lives`` also a new life."""
        known, generator = self.distribution, self.generator
        least, most = known.trials
        drawn = np.searchsorted(self._reached, generator.random(len(who)), side="right")
        changes = lives | (generator.random(len(who)) < known.change)
        schema = np.where(changes, np.minimum(drawn, len(self._levers) - 1), self._schema[who])
        length = generator.integers(least, most + 1, len(who))
        reward = generator.integers(len(known.rewards), size=len(who))
        self._schema[who] = schema
        self._trials[who] = np.where(lives, length, self._trials[who])
        self._batch.reward[who] = np.where(lives, reward, self._batch.reward[who])
        self._trial[who] = np.where(lives, 1, self._trial[who] + 1)
        places = self._places(self._levers[schema])
        listed_at = np.empty_like(places)
        np.put_along_axis(listed_at, places, np.arange(POSITIONS)[None], axis=1)
        self._listed_at[who] = listed_at
        self._bits[who, :POSITIONS] = listed_at
        self._bits[who, POSITIONS : 2 * POSITIONS] = listed_at + POSITIONS
        self._batch.begin_trials(who, self._listed[schema])

    def _places(self, levers: IntArray) -> IntArray:
        """``[n, 7]`` positions for rooms, by their numbers of levers ``[n]``."""
        if (known := self._known_places.shape[1]) == 0:
            return self._new_places(levers)
        return self._known_places[levers, self.generator.integers(known, size=len(levers))]

    def _new_places(self, levers: IntArray) -> IntArray:
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
        tables, batch = self._tables, self._batch
        row = batch.row
        return View(
            observation=self._seen(row),
            console=Console(
                solutions_left=batch.solutions - batch.found_count,
                solutions_found=batch.found_count.copy(),
                attempts_left=self.distribution.attempt_limit + 1 - batch.attempt,
                actions_left=tables.status.take(row) & ACTIONS_LEFT,
            ),
            trial=self._trial.copy(),
            attempt=batch.attempt.copy(),
            playing=self._playing,
        )

    def _seen(self, row: IntArray) -> NDArray[np.int8]:
        """Observations at rows of the tables, with the levers where they are in each room."""
        return np.take_along_axis(self._tables.observation.take(row, axis=0), self._bits, axis=1)

    def step(self, action: IntArray) -> Step:
        """Take one action, ``[B]``, in each room."""
        view = self.view
        # The door's bit is behind those of all levers, where the actions have the door itself.
        listed = self._bits[self._everyone, np.where(action == 2 * POSITIONS, -2, action)]
        luck = self.generator.random(len(action)) if self._tables.stochastic else None
        taken = self._batch.step(listed, luck)
        outcome = self._seen(taken.after)
        self.last_schema = self._schema.copy()
        self.last_solved = self._batch.found_count == self._batch.solutions
        self.life_over = taken.trial_over & (self._trial >= self._trials)
        over = np.flatnonzero(taken.trial_over)
        if len(over):
            self._new_trials(over, self.life_over[over])
        self.view = self._perceive()
        return Step(
            view=view,
            action=action,
            outcome=outcome,
            reward=taken.reward,
            attempt_over=taken.attempt_over,
            trial_over=taken.trial_over,
            new_solution=taken.new_solution,
            next=self.view,
        )
