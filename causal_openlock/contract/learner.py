"""The contract of a learner: what it gets, what it perceives, what it returns.

A :class:`Learner` plays B subjects at once: every array is ``[B, ...]`` and no subject sees
another's data. It gets a :class:`Brief`, perceives a :class:`View`, returns actions, and learns
from a :class:`Step` what they led to. None of these can hold a role, a schema or a solution, and
rooms cannot be drawn again from the generators in a brief. What is latent is in :class:`Truth`,
which only an :class:`InformedLearner` gets. Nothing is promised against malice: a class in the same
process can read the call stack.

A :class:`~causal_openlock.contract.one_subject.OneSubjectLearner` plays one subject, and needs a
single method, ``act(observation)``.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar, TypeVar

import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import LearnerError
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.kernel import ATTEMPTS_LEFT
from causal_openlock.world.room import Room
from causal_openlock.world.rooms import Outcome, Rooms

Observations = NDArray[np.int8]
Told = TypeVar("Told")


@dataclass(frozen=True)
class Brief:
    """A learner's knowledge before it starts."""

    subjects: int  #: how many it plays, B
    positions: int  #: levers of the room, P; seven in the paper
    action_names: tuple[str, ...]  #: 2P + 1, by index: ``push_...``, ``pull_...``, ``push_door``
    action_limit: int  #: the most actions that an attempt can have
    attempt_limit: int  #: attempts in a trial
    trials: int  #: how many trials there will be
    generators: tuple[np.random.Generator, ...]  #: randomness of each subject; seeds are hashes

    @property
    def actions(self) -> int:
        """Number of actions, 2P + 1."""
        return 2 * self.positions + 1

    @property
    def observation_size(self) -> int:
        """Bits of an observation, 2P + 2."""
        return 2 * self.positions + 2


@dataclass(frozen=True)
class Console:
    """The console next to the room; every field is ``[B]``."""

    solutions_left: IntArray  #: not yet found in this trial
    solutions_found: IntArray  #: found in this trial
    attempts_left: IntArray  #: in this trial, the present one included
    actions_left: NDArray[np.uint8]  #: in this attempt


@dataclass(frozen=True)
class View:
    """Perception of B subjects at one moment."""

    observation: Observations
    """``[B, 2P + 2]`` of 0 and 1: levers pushed, levers grey, door locked, door open."""
    console: Console
    trial: IntArray  #: ``[B]`` number of the trial in the whole condition, from 1
    attempt: IntArray  #: ``[B]`` number of the attempt in the trial, from 1
    playing: BoolArray  #: ``[B]`` who still plays; actions of the others are ignored

    @classmethod
    def of(cls, rooms: Rooms, trial: IntArray, playing: BoolArray) -> View:
        """What is perceived in rooms, in arrays that nobody can write to."""
        console = rooms.console.T.astype(np.int64)
        console.setflags(write=False)
        attempt = rooms.attempt_limit + 1 - console[ATTEMPTS_LEFT]
        return _read_only(cls(rooms.observation, Console(*console), trial, attempt, playing))


@dataclass(frozen=True)
class Step:
    """Result of one action of each subject; ignore the rows of subjects that had finished."""

    view: View  #: what was perceived before
    action: IntArray  #: ``[B]``
    outcome: Observations  #: ``[B, 2P + 2]`` the observation right after it, before any reset
    reward: FloatArray  #: ``[B]``
    attempt_over: BoolArray  #: ``[B]`` whether the attempt ended with it
    trial_over: BoolArray  #: ``[B]`` whether the trial ended with it
    new_solution: BoolArray  #: ``[B]`` whether it completed one not found before in the trial
    next: View  #: after an attempt the room is reset, after a trial it is another room

    @classmethod
    def of(cls, view: View, action: IntArray, outcome: Outcome, next: View) -> Step:
        """What an action in rooms led to, in arrays that nobody can write to."""
        reward, attempt_over, trial_over, new_solution, seen = outcome
        step = cls(view, action, seen, reward, attempt_over, trial_over, new_solution, next)
        return _read_only(step)


def _read_only(told: Told) -> Told:
    for value in vars(told).values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    return told


@dataclass(frozen=True)
class Truth:
    """Latent facts, which subjects cannot perceive: for informed learners and for analysis."""

    rooms: tuple[Room, ...]  #: of the session
    room: IntArray  #: ``[B]`` index of the room that each subject is in now


@dataclass(frozen=True, eq=False)
class Structure:
    """A subject's belief about the causal structure of a room; P positions."""

    edges: FloatArray
    """``[P, P + 1]`` probability that a lever enables another, or the door (last)."""
    gates: FloatArray
    """``[P + 1]`` probability that a lever, or the door, needs all of its causes, if it has
    several; NaN where it surely has not, or nothing is known."""

    def __post_init__(self) -> None:
        shapes = np.shape(self.edges), np.shape(self.gates)
        positions = len(self.edges)
        if shapes != ((positions, positions + 1), (positions + 1,)):
            raise ValueError(f"edges have to be [P, P + 1] and gates [P + 1]; these are {shapes}")
        values = np.concatenate([np.ravel(self.edges), self.gates[~np.isnan(self.gates)]])
        if not ((values >= -1e-6) & (values <= 1 + 1e-6)).all():
            raise ValueError("edges and gates have to be probabilities, from 0 to 1")


@dataclass(frozen=True)
class Account:
    """Files and remarks that a learner adds to the record when its cell is over."""

    transcripts: tuple[list[dict[str, Any]], ...] = ()  #: by subject: a line of JSON each
    remarks: tuple[str, ...] = ()  #: sentences for the user who runs the comparison


@dataclass(frozen=True)
class NoParameters:
    """The parameters of a learner that has none."""


class LearnerBase:
    """What a class of learners says of itself before it plays, for many subjects or for one."""

    Parameters: ClassVar[type] = NoParameters
    """A frozen dataclass of hyper-parameters."""
    learns_from_others: ClassVar[bool] = True
    """Whether ``learn`` can be given what another subject did, without a call of ``act``."""
    resumable: ClassVar[bool] = True
    """Whether a killed cell continues from a checkpoint; otherwise it begins again.

    A checkpoint is a pickle of ``__getstate__()``, by default of all attributes. What cannot be
    pickled, such as an open file, is left out there and made anew in ``__setstate__``, which takes
    the place of :meth:`begin` when the cell continues.
    """

    def __init__(self, parameters: Any = None) -> None:
        self.parameters = self.Parameters() if parameters is None else parameters

    def __setstate__(self, state: Any) -> None:
        vars(self).update(state)

    @classmethod
    def artifact_hash(cls, parameters: Any) -> str:
        """Hash of the content of files that it reads, such as weights or a table; empty if none."""
        return ""

    @classmethod
    def prior_attempts(cls, parameters: Any) -> int | None:
        """Attempts of training before the experiment, which costs count; None if unknown."""
        return 0

    @classmethod
    def first_update(cls, parameters: Any) -> int:
        """Actions of a subject before the first that it can learn from; fewer are warned about."""
        return 0

    @classmethod
    def prompt_tokens(cls, parameters: Any, actions: int) -> int:
        """About how many tokens a subject's prompts have by so many actions in a condition."""
        return 0

    def updates_made(self) -> int | None:
        """How often it has learned; None if it does not count, or is not to learn.

        Results warn of a cell that ends without any.
        """
        return None

    @classmethod
    def cannot_play(cls, parameters: Any, schema: Schema, action_limit: int) -> str:
        """Reason to leave out a schema, such as the size of its rooms; empty if there is none."""
        return ""


class Learner(LearnerBase, ABC):
    """A learner that plays B subjects at once; it defines :meth:`probabilities` or :meth:`act`.

    Example:
        >>> class PushesTheDoor(Learner):
        ...     def act(self, view):
        ...         return np.full(self.brief.subjects, self.brief.actions - 1)
    """

    brief: Brief

    def begin(self, brief: Brief) -> None:
        """Get ready to play; called once, before anything else."""
        self.brief = brief

    def act(self, view: View) -> IntArray:
        """``[B]`` actions; by default each drawn from :meth:`probabilities` with one number."""
        odds = self.probabilities(view)
        if odds is None:
            raise LearnerError(f"{type(self).__name__} defines neither act nor probabilities")
        reached = odds.cumsum(axis=1)
        uniform = np.array([generator.random() for generator in self.brief.generators])
        chosen: IntArray = (reached > uniform[:, None] * reached[:, -1:]).argmax(axis=1)
        return chosen

    def probabilities(self, view: View) -> FloatArray | None:
        """``[B, A]`` the probability of each action now; None if the learner cannot say.

        ``act`` draws from exactly these, given all that was perceived and done so far. Hidden
        states, such as an intention that the learner carries out, are averaged over. May be called
        before ``act`` (without affecting it), or instead of it when recorded actions are replayed;
        then ``learn`` follows. Rows of subjects that have finished are ignored.
        """
        return None

    def predictions(self, view: View) -> FloatArray | None:
        """``[B, A]`` how likely it finds each action of recorded subjects; None if it cannot say.

        For a learner whose ``probabilities`` are None, as ``act`` does not draw from these. Only
        scoring asks, once for each action of the rows that play.
        """
        return None

    def structure(self, subject: int) -> Structure | None:
        """A subject's belief about the structure of its room; None if the learner cannot say.

        After the last action of a trial it is about the room just left. Asking changes nothing.
        """
        return None

    def learn(self, step: Step) -> None:
        """Learn from what the actions led to; called after every action."""

    def account(self) -> Account:
        """Files and remarks to add to the record; called once, when the learner's cell is over."""
        return Account()

    def metrics(self) -> dict[str, float]:
        """Means over the subjects, by name, for ``compare --tensorboard``; changes nothing."""
        return {}


class InformedLearner(Learner):
    """A learner that gets the :class:`Truth`: a bound to compare other learners with."""

    @abstractmethod
    def inform(self, truth: Truth) -> None:
        """Called after :meth:`begin`, and again whenever a subject enters another room."""
