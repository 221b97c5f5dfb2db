"""A session: B subjects play the trials of a condition, and every attempt is recorded.

The session steps all subjects at once, whatever trial each of them is in, gives a learner only what
subjects perceive, and keeps the record. :mod:`causal_openlock.world.rooms` decides when attempts
and trials end and which solutions are new.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any

import numpy as np
import pyarrow as pa

from causal_openlock.contract.learner import Brief, InformedLearner, Learner, Step, Truth, View
from causal_openlock.errors import ExperimentError, LearnerError
from causal_openlock.experiment.condition import Condition
from causal_openlock.experiment.declare import Cell
from causal_openlock.experiment.plan import plan
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.record import AttemptLog, assemble
from causal_openlock.schemas.fsm import BoolArray, IntArray
from causal_openlock.world import kernel
from causal_openlock.world.randomness import Streams, generators, unrelated_generators
from causal_openlock.world.rewards import PAPER_REWARD, RewardForm, find_reward
from causal_openlock.world.room import Room, action_names, positions_for
from causal_openlock.world.rooms import Rooms, RoomTables

AT_ONCE = 40  #: number of recorded subjects replayed in one batch


class Session:
    """B subjects in one condition under one protocol.

    :meth:`play` runs a learner to the end, :meth:`steps` step by step. With ``view`` and
    :meth:`step` the caller takes the steps, as for a person.

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
        brief: What a learner is told before it begins.
        view: Perception of the subjects now.
        shown_trials: How many trials each subject is shown before it plays.
        solutions: ``[B, T]`` how many solutions the room of each trial has.
        log: The attempts so far, in the order in which they ended.

    Raises:
        ExperimentError: If a schema of the condition does not fit the protocol, or there is no
            subject or one twice.

    Example:
        >>> from causal_openlock import PROTOCOLS, create, find_condition
        >>> condition = find_condition("CC3")
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
        if not numbers or len(set(numbers)) < len(numbers):
            raise ExperimentError("a session has one subject or more, and each only once")
        self.condition, self.protocol, self.subjects = condition, protocol, len(numbers)
        environment = generators(seed, f"environment/{condition.name}", numbers)
        visits = [
            plan(condition, protocol, generator, subject)
            for subject, generator in zip(numbers, environment, strict=True)
        ]
        self._visits = visits
        self.shown_trials = sum(bool(visit.order) for visit in visits[0])
        schemas = condition.schemas
        self._tables = tables = RoomTables.of(
            [(schema, protocol.actions_for(schema)) for schema in schemas],
            max(map(positions_for, schemas)),
        )
        met = {(id(visit.schema), visit.layout): visit for visit in chain(*visits)}
        self._met = tuple(
            Room.of(visit.schema, visit.layout, tables.positions) for visit in met.values()
        )
        number = {place: i for i, place in enumerate(met)}
        self._room = np.array([[number[id(v.schema), v.layout] for v in row] for row in visits])
        self._schema = np.array([schemas.index(room.schema) for room in self._met])
        self._lever = np.array([room.layout.lever_at() for room in self._met])
        self.solutions = tables.solutions[self._schema].astype(np.int16)[self._room]
        self._luck = Streams(environment) if tables.stochastic else None
        self._rooms = Rooms(
            tables,
            [find_reward(reward)],
            self.subjects,
            protocol.attempt_limit,
            stop_when_solved=protocol.stop_when_solved,
        )
        self.brief = Brief(
            subjects=self.subjects,
            positions=tables.positions,
            action_names=action_names(tables.positions),
            action_limit=int(tables.actions_left.max()),
            attempt_limit=protocol.attempt_limit,
            trials=self._room.shape[1],
            generators=unrelated_generators(
                seed, f"learner/{learner}/{condition.name}/{protocol.name}", numbers
            ),
        )
        self._constants = {
            "experiment": experiment,
            "learner": learner,
            "condition": condition.name,
            "protocol": protocol.name,
            "seed": seed,
            "subjects": np.array(numbers, dtype=np.int32),
        }
        self.log = AttemptLog(self.brief.action_limit)
        self._clock = time.perf_counter()
        self._visit = np.zeros(self.subjects, dtype=np.int64)
        self._everyone = np.arange(self.subjects)
        self._begin_trials(self._everyone)
        self._attempts = np.zeros(self.subjects, self.log.dtype)  # those in progress
        self._attempts["subject"] = self._everyone
        self.view = self._perceive()

    def _room_now(self) -> IntArray:
        """``[B]`` index of the room that each subject is in, or was in last."""
        visit = np.minimum(self._visit, self.brief.trials - 1)
        return self._room[self._everyone, visit]

    def _begin_trials(self, which: IntArray) -> None:
        """Begin the trial of these subjects that is next."""
        room = self._room_now()[which]
        self._rooms.begin_trials(which, self._schema[room], self._lever[room])

    # -- what is seen, and what is latent -------------------------------------------------------

    @property
    def over(self) -> bool:
        """Whether every subject has finished."""
        return not self.view.playing.any()

    @property
    def shown(self) -> IntArray | None:
        """``[B]`` the action that each subject is shown now; None where they act themselves.

        Shown trials come first, and each has as many actions for all subjects.
        """
        if not self.shown_trials or self._visit.min() >= self.shown_trials:
            return None
        actions, used = [], self._tables.used[self._rooms.now(kernel.ROW)]
        for subject, number in enumerate(self._room_now()):
            room, visit = self._met[number], self._visits[subject][self._visit[subject]]
            which = visit.order[self.view.attempt[subject] - 1]
            actions.append(room.action_of(room.schema.solutions[which])[used[subject]])
        return np.array(actions)

    @property
    def truth(self) -> Truth:
        """Latent facts, for informed learners and for analysis."""
        return Truth(rooms=self._met, room=self._room_now())

    def _perceive(self) -> View:
        return View.of(self._rooms, self._visit + 1, self._visit < self.brief.trials)

    # -- the loop -------------------------------------------------------------------------------

    def play(self, learner: Learner) -> pa.Table:
        """Let a learner play to the end; returns :meth:`record`."""
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
            learner.__setstate__(state)
        if isinstance(learner, InformedLearner):
            learner.inform(self.truth)

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
            return learner.act(self.view)
        learner.probabilities(self.view)  # as the contract has it where actions are given
        return shown

    @classmethod
    def of(cls, cell: Cell) -> Session:
        """The session of a cell, before it begins."""
        return cls(
            cell.condition,
            cell.spec.protocol,
            range(cell.first_subject, cell.first_subject + cell.subjects),
            seed=cell.seed,
            reward=cell.spec.reward,
            learner=cell.spec.name,
            experiment=cell.experiment,
        )

    def following(self, done: Sequence[IntArray]) -> Iterator[tuple[BoolArray, Step]]:
        """Take the actions that each subject is known to have taken, in order.

        One that has fewer than others continues with actions that mean nothing; ``[B]`` whose
        actions count is yielded with each step.
        """
        actions, exists = padded(done)
        for action, acts in zip(actions.T, exists.T, strict=True):
            yield acts, self.step(action)

    def step(self, action: Any) -> Step:
        """Take one action for each subject.

        Args:
            action: ``[B]`` action indices; those of subjects that have finished are ignored.

        Raises:
            LearnerError: If there are not B integers, or one is outside the action space.
        """
        tables, rooms, view = self._tables, self._rooms, self.view
        action = self._checked(action)
        moment = tables.used[rooms.now(kernel.ROW)]
        luck = self._luck.uniform() if self._luck else None
        outcome = rooms.step(np.where(view.playing, action, tables.waits), luck, seen=True)
        event, attempts = rooms.now(kernel.EVENT), self._attempts
        attempts["actions"][self._everyone, moment] = action
        attempts["moved"][self._everyone, moment] = event & kernel.CHANGED != 0
        attempts["unlocked"] |= event & kernel.UNLOCKED != 0
        attempts["reward"] += outcome.reward
        if self.shown_trials and outcome.new_solution.any():
            # Whatever the protocol says, a shown trial ends with its last solution.
            seen_all = rooms.console[:, kernel.SOLUTIONS_LEFT] == 0
            over = outcome.trial_over | (seen_all & (self._visit < self.shown_trials))
            outcome = outcome._replace(trial_over=over)
        if outcome.attempt_over.any():
            self._log_attempts(np.flatnonzero(outcome.attempt_over), outcome.new_solution)
        if outcome.trial_over.any():
            self._visit += outcome.trial_over
            self._begin_trials(np.flatnonzero(outcome.trial_over))
        self.view = self._perceive()
        return Step.of(view, action, outcome, self.view)

    def _checked(self, action: Any) -> IntArray:
        try:
            answer = np.asarray(action)
        except ValueError:  # lists of different lengths
            answer = np.asarray(None)
        fits = answer.shape == (self.subjects,) and answer.dtype.kind in "iu"
        chosen: IntArray = np.where(self.view.playing, answer if fits else -1, 0).astype(np.int64)
        if not fits or chosen.min() < 0 or chosen.max() >= self.brief.actions:
            wrong = chosen if fits else f"{answer.dtype} of shape {answer.shape}"
            raise LearnerError(
                f"a learner answers with {self.subjects} integers from 0 to "
                f"{self.brief.actions - 1}, one for each subject, and not with {wrong}"
            )
        return chosen

    def _log_attempts(self, ended: IntArray, new_solution: BoolArray) -> None:
        """Log the attempts of subjects, which have ended, and get ready for others."""
        tables, rooms, attempts = self._tables, self._rooms, self._attempts[ended]
        row, event = rooms.now(kernel.AFTER)[ended], rooms.now(kernel.EVENT)[ended]
        opened = event & kernel.OPENS != 0
        attempts["visit"], attempts["attempt"] = self._visit[ended], self.view.attempt[ended]
        attempts["used"], attempts["opened"] = tables.used[row], opened
        attempts["solution"] = np.where(opened, tables.solution[row], -1)
        attempts["new_solution"] = new_solution[ended]
        attempts["solutions_found"] = rooms.console[ended, kernel.SOLUTIONS_FOUND]
        attempts["wall_time"] = self.seconds
        self.log.extend(attempts)
        self._attempts["unlocked"][ended], self._attempts["reward"][ended] = False, 0.0

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
        changing = self._visit, self._attempts, self._luck, self._rooms.state
        return {"changing": changing, "log": self.log.since(0), "seconds": self.seconds}

    def resume(self, state: dict[str, Any]) -> None:
        """Continue from the state of another session with the same arguments."""
        self._visit, self._attempts, self._luck, self._rooms.state = state["changing"]
        self.log.extend(state["log"])
        self._clock = time.perf_counter() - state["seconds"]
        self.view = self._perceive()

    def record(self) -> pa.Table:
        """The attempts so far as a record, sorted by subject and time."""
        trials = {
            name: np.array([[getattr(visit, name) for visit in row] for row in self._visits], kind)
            for name, kind in (("phase", object), ("loop", np.int32), ("trial", np.int32))
        }
        names = [(room.schema.name, room.layout.name) for room in self._met]
        trials["schema"], trials["layout"] = np.array(names, dtype=object).T[:, self._room]
        return assemble(self.log, {**trials, "solutions": self.solutions}, self._constants)


def padded(done: Sequence[IntArray]) -> tuple[IntArray, BoolArray]:
    """``[B, T]`` the actions of subjects, and which of them there are; 0 after the last."""
    lengths = np.array([len(actions) for actions in done])
    exists = np.arange(lengths.max(initial=0)) < lengths[:, None]
    actions = np.zeros(exists.shape, dtype=np.int64)
    actions[exists] = np.concatenate(done)
    return actions, exists
