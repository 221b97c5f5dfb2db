"""An experiment: learners × conditions × protocol × subjects, cut into cells.

A *cell* is the unit of work: one learner in one condition with at most ``cell_size`` subjects. Its
identity is a hash of everything that determines its record, so a finished cell is never played
again unless something in it has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

from causal_openlock.contract.learner import InformedLearner
from causal_openlock.contract.registry import learner_class, origin, parse_parameters
from causal_openlock.errors import LearnerError, OpenLockError, in_short
from causal_openlock.experiment.protocol import Condition, Protocol
from causal_openlock.files.json_text import present
from causal_openlock.schemas.schema import Schema
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import counted, first_line
from causal_openlock.world.rewards import RewardFunction

RANDOM_CLASS = "openlock_learners.random:RandomLearner"
PERSON = "causal_openlock.play.person:Person"
"""The learner of a record of people."""

_NOTES = ("prior_attempts", "informed", "about")  # of a learner's origin: they follow from its code


@dataclass(frozen=True)
class Origin:
    """The code of a learner, so that results of different code can be distinguished.

    Attributes:
        class_name: Its class, ``module:Class``.
        package: Its package and version; or its file, and a hash of it and of what it imports of
            the user's.
        artifact_hash: Hash of files that its parameters name, such as trained weights; or empty.
        prior_attempts: Attempts that it was trained with before the experiment; None if unknown.
        informed: Whether it is given what subjects cannot perceive.
        about: What it is, in a line: the first of its docstring.
    """

    class_name: str
    package: str
    artifact_hash: str = ""
    prior_attempts: int | None = 0
    informed: bool = False
    about: str = ""


def origin_of(learner: str, parameters: Mapping[str, Any]) -> Origin:
    """The code of a learner with some parameters.

    Raises:
        LearnerError: If the learner cannot be found, or fails to say what files it uses.
    """
    kind = learner_class(learner)
    given = parse_parameters(learner, parameters)
    return Origin(
        class_name=f"{kind.__module__}:{kind.__qualname__}",
        package=origin(learner),
        artifact_hash=_answer(learner, "artifact_hash", str, given),
        prior_attempts=_answer(learner, "prior_attempts", int | None, given),
        informed=issubclass(kind, InformedLearner),
        about=first_line(kind.__doc__),
    )


def _answer(learner: str, method: str, wanted: Any, *given: Any) -> Any:
    """Answer of a class of learners, which may be a user's, to a question about itself.

    Raises:
        LearnerError: If the method fails, or returns something else than is wanted.
    """
    try:
        answer = getattr(learner_class(learner), method)(*given)
    except OpenLockError:
        raise
    except Exception as error:  # a user's code can fail in any way
        raise LearnerError(
            f"{method} of {learner} fails ({type(error).__name__}: {in_short(error)})"
        ) from error
    if not isinstance(answer, wanted) or (isinstance(answer, int) and answer < 0):
        what = "a text" if wanted is str else "a whole number of attempts, or None if unknown"
        raise LearnerError(f"{method} of {learner} has to return {what}, and returned {answer!r}")
    return answer


@dataclass(frozen=True)
class LearnerSpec:
    """A learner of an experiment.

    Attributes:
        name: Its label.
        learner: Its registered name, or ``module:Class``.
        parameters: All its hyper-parameters, defaults included.
        protocol: The protocol it plays under.
        reward: The reward of its actions.
        subjects: How many subjects it plays in each condition.
        cell_size: Most of them in a cell; by default as the experiment says.
        recorded: Its origin, if it is read from a results folder; its code is then not loaded and
            need not be installed.
    """

    name: str
    learner: str
    parameters: dict[str, Any]
    protocol: Protocol
    reward: RewardFunction
    subjects: int
    cell_size: int | None = None
    recorded: Origin | None = None

    @cached_property
    def origin(self) -> Origin:
        """The learner's recorded origin, or that of the installed code."""
        if self.recorded is not None:
            return self.recorded
        return origin_of(self.learner, self.parameters)

    @property
    def is_random(self) -> bool:
        """Whether the learner draws every action at random."""
        return self.learner == "random" or self.origin.class_name == RANDOM_CLASS

    def as_dict(self) -> dict[str, Any]:
        """The learner as plain data, with its origin."""
        known = {name: getattr(self.origin, name) or None for name in _NOTES}
        if self.origin.prior_attempts is None:
            known["prior_attempts"] = "unknown"
        return present(
            {
                "name": self.name,
                "learner": self.learner,
                "class": self.origin.class_name,
                "package": self.origin.package,
                "material": self.origin.artifact_hash or None,
                "parameters": self.parameters,
                "protocol": self.protocol.as_dict(),
                "reward": self.reward.as_dict(),
                "subjects": self.subjects,
                "cell_size": self.cell_size,
                **known,
            }
        )


@dataclass(frozen=True)
class Cell:
    """One unit of work: some subjects of one learner in one condition of an experiment."""

    experiment: str
    seed: int
    spec: LearnerSpec
    condition: Condition
    first_subject: int
    subjects: int

    @cached_property
    def identity(self) -> str:
        """A hash of everything that determines the cell's record."""
        learner = _deciding(self.spec.as_dict())
        del learner["subjects"]
        learner.pop("cell_size", None)
        return _digest(
            {
                "version": RESULTS_VERSION,
                "experiment": self.experiment,
                "seed": self.seed,
                "entry": learner,
                "condition": self.condition.as_dict(),
                "subjects": [self.first_subject, self.subjects],
            }
        )

    @property
    def in_words(self) -> str:
        """The cell in words, such as ``ddqn in CC4, subjects 0-19``."""
        first, last = self.first_subject, self.first_subject + self.subjects - 1
        numbers = f"subject {first}" if first == last else f"subjects {first}-{last}"
        return f"{self.spec.name} in {self.condition.name}, {numbers}"

    @property
    def name(self) -> str:
        """The cell as a part of a file name."""
        first, last = self.first_subject, self.first_subject + self.subjects - 1
        return f"{self.spec.name}_{self.condition.name}_{first}-{last}"

    @property
    def file_name(self) -> str:
        """Name of the cell's file."""
        return f"{self.name}_{self.identity[:12]}.parquet"


@dataclass(frozen=True)
class Experiment:
    """An experiment, with all names resolved and checked.

    :func:`~causal_openlock.experiment.file.read_experiment` reads one from a file.

    Attributes:
        name: A short name.
        title: A line for the report.
        seed: All randomness comes from it.
        cell_size: Most subjects in a cell of a learner that has none of its own.
        conditions: The conditions.
        learners: The learners.
        command: The command that runs it again.
        version: Version of this package's results.
    """

    name: str
    title: str
    seed: int
    cell_size: int
    conditions: tuple[Condition, ...]
    learners: tuple[LearnerSpec, ...]
    command: str = ""
    version: str = RESULTS_VERSION

    def cells(self) -> tuple[Cell, ...]:
        """The units of work, always in the same order; none where a learner is not applicable."""
        return self._cells

    @cached_property
    def _cells(self) -> tuple[Cell, ...]:
        cells = []
        for spec in self.learners:
            size = spec.cell_size or self.cell_size
            impossible = self.not_applicable.get(spec.name, {})
            for condition in self.conditions:
                if condition.name in impossible:
                    continue
                for first in range(0, spec.subjects, size):
                    subjects = min(size, spec.subjects - first)
                    cells.append(Cell(self.name, self.seed, spec, condition, first, subjects))
        return tuple(cells)

    @cached_property
    def not_applicable(self) -> Mapping[str, Mapping[str, str]]:
        """Reasons why learners cannot play conditions, by learner and condition, in a sentence.

        Learners say so themselves, in ``cannot_play``.
        """
        found: dict[str, dict[str, str]] = {}
        for spec in self.learners:
            for condition in self.conditions:
                for schema in condition.schemas:
                    if why := _cannot_play(spec, condition, schema):
                        found.setdefault(spec.name, {})[condition.name] = why
        return found

    def without_any(self, protocol: str) -> list[str]:
        """Labels of the learners under a protocol that can play none of the conditions."""
        every = len(self.conditions)
        return [
            spec.name
            for spec in self.learners
            if spec.protocol.name == protocol
            and len(self.not_applicable.get(spec.name, {})) == every
        ]

    @property
    def reasons(self) -> tuple[str, ...]:
        """Each reason in :attr:`not_applicable`, once."""
        each = (why for own in self.not_applicable.values() for why in own.values())
        return tuple(dict.fromkeys(each))

    @property
    def schemas(self) -> tuple[Schema, ...]:
        """The schemas of the conditions, each once."""
        return tuple(dict.fromkeys(s for one in self.conditions for s in one.schemas))

    @property
    def protocols(self) -> tuple[Protocol, ...]:
        """The protocols of the learners, each once."""
        return tuple(dict.fromkeys(spec.protocol for spec in self.learners))

    @property
    def random_learners(self) -> set[str]:
        """Labels of the learners that draw every action at random."""
        return {spec.name for spec in self.learners if spec.is_random}

    def as_dict(self) -> dict[str, Any]:
        """The experiment as plain data, schemas and defaults included."""
        return {
            "version": self.version,
            "name": self.name,
            "title": self.title,
            "command": self.command,
            "seed": self.seed,
            "cell_size": self.cell_size,
            "conditions": [condition.as_dict() for condition in self.conditions],
            "learners": [spec.as_dict() for spec in self.learners],
        }

    def warnings(self) -> list[str]:
        """A sentence for each schema that cannot be solved under a protocol."""
        return [
            f"{schema.name} has {len(schema.solutions)} solutions and protocol {protocol.name} "
            f"gives {counted(protocol.attempt_limit, 'attempt')}, so its trials cannot be solved"
            for protocol in self.protocols
            for schema in self.schemas
            if len(schema.solutions) > protocol.attempt_limit
        ]

    @cached_property
    def identity(self) -> str:
        """A hash of everything in :meth:`as_dict` that determines the results."""
        decides = self.as_dict()
        del decides["title"], decides["command"]
        decides["learners"] = list(map(_deciding, decides["learners"]))
        return _digest(decides)

    @cached_property
    def declaration(self) -> str:
        """A hash of what is asked for: :attr:`identity` apart from the versions of packages."""
        asked = self.as_dict()
        del asked["title"], asked["command"], asked["version"]
        learners = list(map(_deciding, asked["learners"]))
        # The file of a learner of one's own is no version of a package.
        asked["learners"] = [
            {k: v for k, v in one.items() if k != "package" or ":" in one["learner"]}
            for one in learners
        ]
        return _digest(asked)


def _cannot_play(spec: LearnerSpec, condition: Condition, schema: Schema) -> str:
    """Reason why a learner cannot play a condition's rooms of a schema; empty if it can."""
    if spec.recorded is not None:  # its code need not be installed
        return ""
    if condition.shown and not learner_class(spec.learner).learns_from_others:
        return f"{spec.name} learns from its own actions alone, so nothing can be shown to it"
    limit = spec.protocol.actions_for(schema)
    parameters = parse_parameters(spec.learner, spec.parameters)
    why = _answer(spec.learner, "cannot_play", str, parameters, schema, limit)
    return why and f"{spec.name} cannot play in rooms of {schema.name}: {why}"


def _deciding(learner: dict[str, Any]) -> dict[str, Any]:
    """Part of a learner's description that determines its results and identity."""
    decides = {key: value for key, value in learner.items() if key not in _NOTES}
    # The hashes of published studies were made when the package of the bundled learners was called
    # "learners", and "double" was no parameter.
    name = learner["class"].removeprefix("openlock_")
    parameters = {k: v for k, v in learner["parameters"].items() if (k, v) != ("double", True)}
    return {**decides, "class": name, "parameters": parameters}


def _digest(data: Any) -> str:
    text = json.dumps(data, sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()
