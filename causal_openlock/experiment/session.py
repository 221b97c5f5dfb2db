"""A session: B subjects play the trials of a condition, and every attempt is recorded.

The session steps all subjects at once, whatever trial each of them is in, gives a learner only what
subjects perceive, and keeps the record. :mod:`causal_openlock.world.batch` decides when attempts
and trials end and which solutions are new.

:meth:`Session.play` runs a learner to the end, :meth:`Session.steps` step by step. With
:meth:`Session.view` and :meth:`Session.step`, the caller takes the steps, as for a person.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.contract.learner import (
    Brief,
    Console,
    InformedLearner,
    Learner,
    Step,
    Truth,
    View,
    put_back,
)
from causal_openlock.errors import LearnerError, ProtocolError
from causal_openlock.experiment.protocol import Condition, Protocol, Visit, check_trial, plan
from causal_openlock.experiment.record import AttemptLog, assemble
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.batch import BatchStep, RoomBatch
from causal_openlock.world.randomness import Streams, generators, unrelated_generators
from causal_openlock.world.rewards import PAPER_REWARD, RewardForm, find_reward
from causal_openlock.world.room import Layout, action_names, positions_for
from causal_openlock.world.tables import ACTIONS_LEFT, RoomTables

if TYPE_CHECKING:
    import pyarrow as pa

CHANGING = ("_visit", "_playing", "_actions", "_moved", "_was_unlocked", "_earned", "_luck")
"""The attributes of a session that change, apart from the rooms, the log and the clock."""

AT_ONCE = 40
"""Number of recorded subjects replayed in one batch."""


class Session:
    """B subjects in one condition under one protocol.

    Args:
        condition: The trials.
        protocol: Their budgets.
        subjects: Numbers of the subjects; their rooms and random numbers depend on them.
        seed: Seed of the experiment.
        reward: The reward of each action.
        learner: Label of the learner, for the record; the learner's randomness depends on it, while
            rooms and their random numbers are the same for all learners.
        experiment: Name of the experiment, for the record.

    Attributes:
        shown_trials: How many trials each subject is shown before it plays.

    Raises:
        ProtocolError: If a schema of the condition does not fit the protocol, or there is no
            subject or one twice.

    Example:
        >>> from causal_openlock import PROTOCOLS, create, find_schema
        >>> condition = Condition.named("CC3", find_schema)
        >>> session = Session(condition, PROTOCOLS["human"], subjects=4)
        >>> session.play(create("oracle")).num_rows  # two attempts in each of five trials
        40
    """

    def __init__(
        self,
        condition: Condition,
        protocol: Protocol,
        subjects: Sequence[int] | int,
        *,
        seed: int = 0,
        reward: RewardForm = PAPER_REWARD,
        learner: str = "learner",
        experiment: str = "session",
    ) -> None:
        numbers = range(subjects) if isinstance(subjects, int) else subjects
        self.condition, self.protocol = condition, protocol
        self.subjects = len(numbers)
        if not numbers or len(set(numbers)) < len(numbers):
            raise ProtocolError("a session needs at least one subject, and each subject only once")
        self._constants = {
            "experiment": experiment,
            "learner": learner,
            "condition": condition.name,
            "protocol": protocol.name,
            "seed": seed,
            "subjects": np.array(numbers, dtype=np.int32),
        }
        place = f"{condition.name}/{protocol.name}"
        environment = generators(seed, f"environment/{condition.name}", numbers)
        visits = [
            plan(condition, protocol, generator, subject)
            for subject, generator in zip(numbers, environment, strict=True)
        ]
        self._tables = RoomTables(max(positions_for(schema) for schema in condition.schemas))
        self._rooms, layouts = self._stack(visits)
        schemas = [room.schema.name for room in self._tables.rooms]
        self._visits = {
            "phase": np.array([[visit.phase for visit in row] for row in visits], dtype=object),
            "loop": np.array([[visit.loop for visit in row] for row in visits], dtype=np.int32),
            "trial": np.array([[visit.trial for visit in row] for row in visits], dtype=np.int32),
            "schema": np.array(schemas, dtype=object)[self._rooms],
            "layout": layouts,
            "solutions": self._tables.solutions.astype(np.int16)[self._rooms],
        }
        self._orders = [[visit.order for visit in row if visit.order] for row in visits]
        self.shown_trials = len(self._orders[0])
        self._luck = Streams(environment) if self._tables.stochastic else None
        self._batch = RoomBatch(
            self._tables,
            [find_reward(reward)],
            self.subjects,
            protocol.attempt_limit,
            stop_when_solved=protocol.stop_when_solved,
        )
        self.brief = Brief(
            subjects=self.subjects,
            positions=self._tables.positions,
            action_names=action_names(self._tables.positions),
            action_limit=int(self._tables.action_limit.max()),
            attempt_limit=protocol.attempt_limit,
            trials=self._rooms.shape[1],
            generators=unrelated_generators(seed, f"learner/{learner}/{place}", numbers),
        )
        self._log = AttemptLog(self.brief.action_limit)
        self._clock = time.perf_counter()
        self._batch.begin_trials(slice(None), self._rooms[:, 0])
        self._visit = np.zeros(self.subjects, dtype=np.int64)
        self._playing = np.ones(self.subjects, dtype=bool)
        self._everyone = np.arange(self.subjects)
        # What has happened in the attempt in progress.
        self._actions = np.zeros((self.subjects, self.brief.action_limit), dtype=np.uint8)
        self._moved = self._actions.astype(bool)
        self._was_unlocked = np.zeros(self.subjects, dtype=bool)
        self._earned = np.zeros(self.subjects)
        self._view = self._perceive()

    def _stack(self, visits: list[list[Visit]]) -> tuple[IntArray, NDArray[np.object_]]:
        """``[B, T]`` index of the room of each trial, and ``[B, T]`` the name of its layout.

        Layouts with different names can be the same positions, and are then one room; so the name
        of the layout is kept with the trial.
        """
        positions, protocol = self._tables.positions, self.protocol
        limits = {schema: protocol.actions_for(schema) for schema in self.condition.schemas}
        distinct: dict[tuple[int, Layout], int] = {}
        rooms: list[tuple[Schema, Layout, int]] = []
        which = np.zeros((len(visits), len(visits[0])), dtype=np.int64)
        for subject, row in enumerate(visits):
            for trial, visit in enumerate(row):
                room = distinct.setdefault((id(visit.schema), visit.layout), len(rooms))
                which[subject, trial] = room
                if room == len(rooms):
                    layout = visit.layout.in_room(positions)
                    rooms.append((visit.schema, layout, limits[visit.schema]))
        names = np.array([layout.name for _, layout, _ in rooms], dtype=object)
        return self._tables.add(rooms)[which], names[which]

    # -- what is seen, and what is latent -------------------------------------------------------

    @property
    def view(self) -> View:
        """Perception of the subjects now."""
        return self._view

    @property
    def over(self) -> bool:
        """Whether every subject has finished."""
        return not self._playing.any()

    @property
    def shown(self) -> IntArray | None:
        """``[B]`` the action that each subject is shown now; None where they act themselves.

        Shown trials come first, and each has as many actions for all subjects.
        """
        if not self.shown_trials or self._visit.min() >= self.shown_trials:
            return None
        tables, batch = self._tables, self._batch
        actions = []
        for subject, orders in enumerate(self._orders):
            room = tables.rooms[batch.room[subject]]
            which = orders[self._visit[subject]][batch.attempt[subject] - 1]
            solution = room.action_of(room.schema.solutions[which])
            actions.append(solution[tables.used[batch.row[subject]]])
        return np.array(actions)

    @property
    def truth(self) -> Truth:
        """Latent facts, for informed learners and for analysis."""
        return Truth(rooms=tuple(self._tables.rooms), room=self._batch.room.copy())

    def _perceive(self) -> View:
        tables, batch = self._tables, self._batch
        row = batch.row
        return View(
            observation=_read_only(tables.observation.take(row, axis=0)),
            console=Console(
                solutions_left=_read_only(batch.solutions - batch.found_count),
                solutions_found=_read_only(batch.found_count.copy()),
                attempts_left=_read_only(self.protocol.attempt_limit + 1 - batch.attempt),
                actions_left=_read_only(tables.status.take(row) & ACTIONS_LEFT),
            ),
            trial=_read_only(self._visit + 1),
            attempt=_read_only(batch.attempt.copy()),
            playing=_read_only(self._playing.copy()),
        )

    # -- the loop -------------------------------------------------------------------------------

    def play(self, learner: Learner) -> pa.Table:
        """Let a learner play to the end; returns :meth:`record`.

        Raises:
            LearnerError: If the learner does not answer with B action indices.
        """
        self.begin(learner)
        for _ in self.steps(learner):
            pass
        return self.record()

    def begin(self, learner: Learner, state: Any = None) -> None:
        """Let a learner begin, or continue from a state of another; :meth:`steps` comes next.

        Raises:
            LearnerError: If the condition shows what the learner cannot learn from.
        """
        if self.shown_trials and not learner.learns_from_others:
            raise LearnerError(
                f"{type(learner).__name__} learns from its own actions alone, so nothing can be "
                f"shown to it; leave it out of {self.condition.name}"
            )
        if state is None:
            learner.begin(self.brief)
        else:
            put_back(learner, state, self.brief)
        if isinstance(learner, InformedLearner):
            learner.inform(self.truth)

    def begin_trial(self, learner: Learner, trial: int) -> None:
        """Let a learner begin, and play the only subject to the beginning of a trial, from 1.

        Raises:
            ProtocolError: If there is no such trial.
        """
        where = f"{self.condition.name} under protocol {self.protocol.name}"
        check_trial(trial, self.brief.trials, where)
        self.begin(learner)
        steps = self.steps(learner)
        while self._view.trial[0] < trial:
            next(steps)

    def steps(self, learner: Learner) -> Iterator[Step]:
        """Let a learner that has begun play; yields each step after the learner has learned."""
        informed = learner if isinstance(learner, InformedLearner) else None
        while not self.over:
            step = self.step(self.chosen(learner))
            learner.learn(step)
            if informed and step.trial_over.any():
                informed.inform(self.truth)
            yield step

    def chosen(self, learner: Learner) -> IntArray:
        """``[B]`` what is done next: what the learner answers, unless it is shown something."""
        shown = self.shown
        if shown is None:
            return learner.act(self._view)
        learner.probabilities(self._view)  # as the contract has it where actions are given
        return shown

    def following(self, done: Sequence[IntArray]) -> Iterator[tuple[BoolArray, Step]]:
        """Take the actions that are known to have been taken.

        Args:
            done: For each of the B subjects its actions, in the order of time. One that has fewer
                than others continues with actions that mean nothing.

        Yields:
            ``[B]`` whose actions these are, and the step.
        """
        actions, exists = padded(done)
        for now, acts in zip(actions.T, exists.T, strict=True):
            yield acts, self.step(now)

    def step(self, action: Any) -> Step:
        """Take one action for each subject.

        Args:
            action: ``[B]`` action indices; those of subjects that have finished are ignored.

        Raises:
            LearnerError: If there are not B integers, or one is outside the action space.
        """
        tables, view = self._tables, self._view
        action = self._checked(action)
        done = action if self._playing.all() else np.where(self._playing, action, tables.wait)
        row = self._batch.row
        taken = self._batch.step(done, self._luck.uniform() if self._luck else None)
        moment = tables.used.take(row)
        self._actions[self._everyone, moment] = action
        self._moved[self._everyone, moment] = tables.state.take(taken.after) != tables.state[row]
        self._was_unlocked |= tables.unlocked.take(taken.after)
        if self.shown_trials and taken.any_new_solution:
            # Whatever the protocol says, a shown trial ends with its last solution.
            seen = self._batch.found_count == self._batch.solutions
            over = taken.trial_over | (seen & (self._visit < self.shown_trials))
            taken = taken._replace(trial_over=over, any_trial_over=bool(over.any()))
        self._earned += taken.reward
        if taken.any_attempt_over:
            self._end_attempts(taken)
        self._view = self._perceive()
        return Step(
            view=view,
            action=_read_only(action),
            outcome=_read_only(tables.observation.take(taken.after, axis=0)),
            reward=_read_only(taken.reward.view()),  # the rooms use their own arrays again
            attempt_over=_read_only(taken.attempt_over.view()),
            trial_over=_read_only(taken.trial_over.view()),
            new_solution=_read_only(taken.new_solution.view()),
            next=self._view,
        )

    def _checked(self, action: Any) -> IntArray:
        try:
            actions = np.asarray(action)
        except ValueError:  # lists of different lengths
            actions = np.asarray(None)
        if actions.shape != (self.subjects,) or actions.dtype.kind not in "iu":
            raise LearnerError(
                f"a learner answers with {self.subjects} integers, one for each subject, and not "
                f"with {actions.dtype} of shape {actions.shape}"
            )
        chosen: IntArray = np.where(self._playing, actions, 0).astype(np.int64)
        if chosen.min() < 0 or chosen.max() >= self.brief.actions:
            wrong = chosen[(chosen < 0) | (chosen >= self.brief.actions)][0]
            raise LearnerError(
                f"action {wrong} is outside the action space; a room of {self.brief.positions} "
                f"positions has actions 0 to {self.brief.actions - 1}"
            )
        return chosen

    def _end_attempts(self, taken: BatchStep) -> None:
        """Log the attempts that ended, and begin the trials that follow."""
        tables, batch = self._tables, self._batch
        ended = np.flatnonzero(taken.attempt_over)
        row = taken.after[ended]
        opened = tables.opened[row]
        self._log.append(
            subject=ended,
            visit=self._visit[ended],
            attempt=batch.attempt[ended] - 1,  # the next one has begun
            used=tables.used[row],
            actions=self._actions[ended],
            moved=self._moved[ended],
            unlocked=self._was_unlocked[ended],
            opened=opened,
            solution=np.where(opened, tables.solution[row], -1),
            new_solution=taken.new_solution[ended],
            solutions_found=batch.found_count[ended],
            reward=self._earned[ended],
            wall_time=self.seconds,
        )
        self._was_unlocked[ended] = False
        self._earned[ended] = 0.0
        if not taken.any_trial_over:
            return
        finished = np.flatnonzero(taken.trial_over)
        self._visit[finished] += 1
        self._playing[finished] = self._visit[finished] < self.brief.trials
        # After its last trial, a subject's room stays at the start of another one.
        last = np.minimum(self._visit[finished], self.brief.trials - 1)
        batch.begin_trials(finished, self._rooms[finished, last])

    @property
    def log(self) -> AttemptLog:
        """The attempts so far, in the order in which they ended."""
        return self._log

    @property
    def solutions(self) -> IntArray:
        """``[B, T]`` how many solutions the room of each trial has."""
        return self._visits["solutions"]

    @property
    def progress(self) -> float:
        """The share of all trials that are over."""
        return float(self._visit.mean()) / self.brief.trials

    @property
    def seconds(self) -> float:
        """Seconds played, also before an interruption."""
        return time.perf_counter() - self._clock

    @property
    def state(self) -> dict[str, Any]:
        """All that changes while a session is played, for a checkpoint."""
        changing = {name: getattr(self, name) for name in CHANGING}
        rooms, log = self._batch.arrays(), self._log.since(0)
        return {**changing, "rooms": rooms, "log": log, "seconds": self.seconds}

    def resume(self, state: dict[str, Any]) -> None:
        """Continue from the state of another session with the same arguments."""
        vars(self).update({name: state[name] for name in CHANGING})
        for name, array in self._batch.arrays().items():
            array[:] = state["rooms"][name]
        self._batch.row = state["rooms"]["row"]
        self._log.extend(state["log"])
        self._clock = time.perf_counter() - state["seconds"]
        self._view = self._perceive()

    def record(self) -> pa.Table:
        """The attempts so far as a record, sorted by subject and time."""
        return assemble(self._log, self._visits, self._constants)


def _read_only(array: NDArray[Any]) -> NDArray[Any]:
    """The same array, which a learner cannot write to: the session uses it later."""
    array.setflags(write=False)
    return array


def padded(done: Sequence[IntArray]) -> tuple[IntArray, BoolArray]:
    """``[B, T]`` the actions of subjects, and which of them there are; 0 after the last."""
    lengths = np.array([len(own) for own in done])
    exists = np.arange(lengths.max(initial=0)) < lengths[:, None]
    actions = np.zeros(exists.shape, dtype=np.int64)
    actions[exists] = np.concatenate(done)
    return actions, exists
