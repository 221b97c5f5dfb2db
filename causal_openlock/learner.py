"""The contract of a learner, and the registry that finds learners by name.

A :class:`Learner` plays B subjects at once: every array is ``[B, ...]`` and no subject sees
another's data. It is told a :class:`Brief`, sees a :class:`View`, answers with actions, and is
told in a :class:`Step` what they led to. None of these types can hold a role, a schema or a
solution: what is latent lives in :class:`Truth`, and only an :class:`InformedLearner`, which the
record then shows beside the others as a bound, is ever given one.

Learners are found through the entry-point group ``causal_openlock.learners``, so that a package
of one's own adds learners by declaring them::

    [project.entry-points."causal_openlock.learners"]
    mine = "my_package:MyLearner"

For a first learner, :class:`OneSubjectLearner` asks for a single method, ``act(observation)``.
"""

from __future__ import annotations

import importlib
import os
import pickle
import sys
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, fields
from functools import cache
from importlib.metadata import EntryPoint, entry_points
from typing import Any, ClassVar, get_type_hints

import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import LearnerError, nearest
from causal_openlock.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.room import Room

ENTRY_POINTS = "causal_openlock.learners"
Observations = NDArray[np.int8]


@dataclass(frozen=True)
class Brief:
    """What a learner is told before it starts.

    Attributes:
        subjects: How many subjects it plays, B.
        positions: Levers of the room, P; seven in the paper.
        action_names: The 2P + 1 actions by index: ``push_...``, ``pull_...``, ``push_door``.
        action_limit: The most actions that an attempt can have.
        attempt_limit: Attempts in a trial.
        trials: How many trials there will be.
        generators: One source of randomness for each subject.
    """

    subjects: int
    positions: int
    action_names: tuple[str, ...]
    action_limit: int
    attempt_limit: int
    trials: int
    generators: tuple[np.random.Generator, ...]

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
    """What is shown beside the room; every field is ``[B]``.

    Attributes:
        solutions_left: Solutions not yet found in this trial.
        solutions_found: Solutions found in this trial.
        attempts_left: Attempts left in this trial, the present one included.
        actions_left: Actions left in this attempt.
    """

    solutions_left: IntArray
    solutions_found: IntArray
    attempts_left: IntArray
    actions_left: NDArray[np.uint8]


@dataclass(frozen=True)
class View:
    """What B subjects perceive at one moment.

    Attributes:
        observation: ``[B, 2P + 2]`` of 0 and 1: levers pushed, levers grey, door locked, door open.
        console: What is shown beside the room.
        trial: ``[B]`` number of the trial in the whole condition, from 1.
        attempt: ``[B]`` number of the attempt in the trial, from 1.
        playing: ``[B]`` whether the subject still plays; actions of the others are ignored.
    """

    observation: Observations
    console: Console
    trial: IntArray
    attempt: IntArray
    playing: BoolArray


@dataclass(frozen=True)
class Step:
    """What one action of each subject led to; rows of subjects that had finished mean nothing.

    Attributes:
        view: What was perceived before.
        action: ``[B]`` what was done.
        outcome: ``[B, 2P + 2]`` the observation right after the action, before any reset.
        reward: ``[B]`` the experiment's reward for it.
        attempt_over: ``[B]`` whether the attempt ended with it.
        trial_over: ``[B]`` whether the trial ended with it.
        new_solution: ``[B]`` whether it completed a solution not found before in the trial.
        next: What is perceived next: after an attempt the room is reset, after a trial it is
            another room.
    """

    view: View
    action: IntArray
    outcome: Observations
    reward: FloatArray
    attempt_over: BoolArray
    trial_over: BoolArray
    new_solution: BoolArray
    next: View


@dataclass(frozen=True)
class Truth:
    """What is latent, for informed learners and for analysis.

    Attributes:
        rooms: The rooms of the session.
        room: ``[B]`` index into ``rooms`` of the room that each subject is in now.
    """

    rooms: tuple[Room, ...]
    room: IntArray


@dataclass(frozen=True)
class NoParameters:
    """The parameters of a learner that has none."""


class Learner(ABC):
    """What plays. Subclasses state their hyper-parameters as a frozen dataclass ``Parameters``.

    Args:
        parameters: An instance of the class's ``Parameters``; by default their defaults.
    """

    Parameters: ClassVar[type] = NoParameters

    def __init__(self, parameters: Any = None) -> None:
        self.parameters = self.Parameters() if parameters is None else parameters

    @abstractmethod
    def begin(self, brief: Brief) -> None:
        """Get ready to play; called once, before anything else."""

    @abstractmethod
    def act(self, view: View) -> IntArray:
        """``[B]`` the action of each subject."""

    def learn(self, step: Step) -> None:
        """Take in what the actions led to; called after every action."""

    def state_dict(self) -> dict[str, Any]:
        """All that was learned, for a checkpoint; a learner without memory has nothing."""
        return {}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint; called after :meth:`begin`."""
        if state:
            raise LearnerError(f"{type(self).__name__} keeps no state and cannot load any")


class InformedLearner(Learner):
    """A learner that is told what is latent: a bound to compare others with, never a rival."""

    @abstractmethod
    def inform(self, truth: Truth) -> None:
        """Told after :meth:`begin`, and again whenever a subject enters another room."""


@dataclass(frozen=True)
class Moment:
    """A :class:`Step` of one subject, in plain numbers.

    Attributes:
        observation: ``[2P + 2]`` what was seen before the action.
        action: What was done.
        outcome: ``[2P + 2]`` what was seen right after it.
        reward: The reward for it.
        attempt_over: Whether the attempt ended with it.
        trial_over: Whether the trial ended with it.
        new_solution: Whether it completed a solution not found before in the trial.
        solutions_left: Solutions still to be found in the trial.
    """

    observation: Observations
    action: int
    outcome: Observations
    reward: float
    attempt_over: bool
    trial_over: bool
    new_solution: bool
    solutions_left: int


class OneSubjectLearner(ABC):
    """A learner written for a single subject; each subject gets an instance of its own.

    ``self.brief`` and ``self.generator`` are set before :meth:`begin` is called.

    Args:
        parameters: An instance of the class's ``Parameters``; by default their defaults.
    """

    Parameters: ClassVar[type] = NoParameters
    brief: Brief
    generator: np.random.Generator

    def __init__(self, parameters: Any = None) -> None:
        self.parameters = self.Parameters() if parameters is None else parameters

    def begin(self) -> None:
        """Get ready to play."""

    @abstractmethod
    def act(self, observation: Observations) -> int:
        """The action for what is seen: ``[2P + 2]`` of 0 and 1."""

    def learn(self, moment: Moment) -> None:
        """Take in what the action led to."""


class Chorus(Learner):
    """Plays B instances of a :class:`OneSubjectLearner` as one learner."""

    def __init__(self, single: type[OneSubjectLearner], parameters: Any = None) -> None:
        super().__init__(NoParameters())
        self._single = single
        self._parameters = parameters
        self._players: list[OneSubjectLearner] = []

    def begin(self, brief: Brief) -> None:
        """Make one player for each subject."""
        self._brief = brief
        self._players = []
        for generator in brief.generators:
            player = self._single(self._parameters)
            player.brief, player.generator = brief, generator
            player.begin()
            self._players.append(player)

    def act(self, view: View) -> IntArray:
        """Ask each player that still plays."""
        actions = np.zeros(len(self._players), dtype=np.int64)
        for subject in np.flatnonzero(view.playing):
            actions[subject] = self._players[subject].act(view.observation[subject])
        return actions

    def learn(self, step: Step) -> None:
        """Tell each player what its own action led to."""
        left = step.view.console.solutions_left - step.new_solution
        for subject in np.flatnonzero(step.view.playing):
            self._players[subject].learn(
                Moment(
                    observation=step.view.observation[subject],
                    action=int(step.action[subject]),
                    outcome=step.outcome[subject],
                    reward=float(step.reward[subject]),
                    attempt_over=bool(step.attempt_over[subject]),
                    trial_over=bool(step.trial_over[subject]),
                    new_solution=bool(step.new_solution[subject]),
                    solutions_left=int(left[subject]),
                )
            )

    def state_dict(self) -> dict[str, Any]:
        """Everything that the players hold, generators included."""
        kept = [{k: v for k, v in vars(p).items() if k != "brief"} for p in self._players]
        return {"players": pickle.dumps(kept)}

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Give each player back what it held."""
        for player, kept in zip(self._players, pickle.loads(state["players"]), strict=True):
            vars(player).update(kept)


# -- the registry -------------------------------------------------------------------------------


def registry() -> dict[str, EntryPoint]:
    """Every installed learner by name; none of them is loaded by this.

    Raises:
        LearnerError: If two packages register the same name.
    """
    found: dict[str, EntryPoint] = {}
    for entry in entry_points(group=ENTRY_POINTS):
        other = found.setdefault(entry.name, entry)
        if other.value != entry.value:
            raise LearnerError(
                f"the learner {entry.name!r} is registered twice, as {other.value} and as "
                f"{entry.value}; uninstall one of these packages or rename its learner"
            )
    return dict(sorted(found.items()))


@cache
def learner_class(name: str) -> type[Learner] | type[OneSubjectLearner]:
    """A learner's class by its registered name, or by ``module:Class``.

    Raises:
        LearnerError: If there is none, it cannot be imported, or it is no learner.
    """
    if ":" in name:
        # A module beside the experiment, as in a notebook, needs no package of its own.
        if os.getcwd() not in sys.path:
            sys.path.insert(0, os.getcwd())
        entry = EntryPoint(name, name, ENTRY_POINTS)
    else:
        known = registry()
        if name not in known:
            raise LearnerError(f"there is no learner {name!r}; {nearest(name, known)}")
        entry = known[name]
    try:
        importlib.import_module(entry.module)
        loaded = entry.load()
    except (ImportError, AttributeError) as error:
        raise LearnerError(
            f"the learner {name!r} ({entry.value}) cannot be imported: {error}"
        ) from error
    if not (isinstance(loaded, type) and issubclass(loaded, Learner | OneSubjectLearner)):
        raise LearnerError(
            f"the learner {name!r} ({entry.value}) is no subclass of Learner or OneSubjectLearner"
        )
    return loaded


def create(name: str, parameters: Mapping[str, Any] | None = None) -> Learner:
    """A learner, ready for :meth:`Learner.begin`.

    Args:
        name: As for :func:`learner_class`.
        parameters: Hyper-parameters that differ from their defaults.

    Raises:
        LearnerError: If there is no such learner, or a parameter is unknown or has a wrong value.
    """
    kind = learner_class(name)
    checked = parse_parameters(name, parameters or {})
    return kind(checked) if issubclass(kind, Learner) else Chorus(kind, checked)


def parse_parameters(name: str, parameters: Mapping[str, Any]) -> Any:
    """Hyper-parameters from plain data, as an instance of the learner's ``Parameters``.

    Raises:
        LearnerError: If a parameter is unknown or its value does not fit; ``error.at`` names it.
    """
    from pydantic import TypeAdapter, ValidationError

    declared: Any = learner_class(name).Parameters
    hints = get_type_hints(declared, include_extras=True)
    values = {}
    for key, value in parameters.items():
        if key not in {field.name for field in fields(declared)}:
            raise LearnerError(
                f"the learner {name} has no parameter {key!r}; "
                f"{nearest(str(key), (field.name for field in fields(declared)))}"
            )
        try:
            values[key] = TypeAdapter(hints[key]).validate_python(value, strict=True)
        except ValidationError as error:
            said = error.errors(include_url=False)[0]["msg"].removeprefix("Input ")
            raise LearnerError(
                f"the parameter {key} of {name} {said}, and this is {value!r}"
            ) from None
    return declared(**values)


@dataclass(frozen=True)
class ParameterInfo:
    """A hyper-parameter as it is told to users."""

    name: str
    default: Any
    meaning: str


def parameter_table(name: str) -> list[ParameterInfo]:
    """The hyper-parameters of a learner, with defaults and meanings."""
    declared: Any = learner_class(name).Parameters
    hints = get_type_hints(declared, include_extras=True)
    table = []
    for field in fields(declared):
        notes = getattr(hints[field.name], "__metadata__", ())
        meaning = " ".join(
            note if isinstance(note, str) else note.description
            for note in notes
            if isinstance(note, str) or getattr(note, "description", None)
        )
        default = None if field.default is MISSING else field.default
        table.append(ParameterInfo(field.name, default, meaning))
    return table
