"""What an experiment is: learners in conditions, declared once, and cut into cells.

Files, programs and results folders are read by the same classes, which take *short forms* of their
parts: ``CC3-CC4`` is a condition, ``rl`` a protocol, ``ddqn`` a learner, ``paper`` a reward.
``as_dict`` is what a results folder stores and identities are made of; ``as_file`` is what a user
would write.

A *cell* is the unit of work: one learner in one condition with at most ``cell_size`` subjects. Its
identity is a hash of everything that determines its record, so a finished cell is never played
again unless something in it has changed.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import chain, islice, product
from math import prod
from typing import Annotated, Any

from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    Field,
    InstanceOf,
    PlainSerializer,
    ValidationInfo,
    field_validator,
)
from pydantic.json_schema import SkipJsonSchema

from causal_openlock.contract.registry import learner_class, name_of, parse_parameters
from causal_openlock.errors import ExperimentError, LearnerError, OpenLockError, together
from causal_openlock.experiment.condition import AnyCondition, Condition
from causal_openlock.experiment.origin import NOTES, Origin, answer_of, origin_of
from causal_openlock.experiment.protocol import (
    AT_LEAST_ONE,
    HUMAN,
    PROTOCOLS,
    AnyProtocol,
    Count,
    Name,
    OwnProtocols,
    Seed,
    Subjects,
    context_of,
    declares,
    label_of,
)

# For play/person.py, whose text must not change: its hash is in the identity of people's folders.
from causal_openlock.experiment.protocol import Protocol as Protocol
from causal_openlock.files.validation import Part, adapter, part, plain, present, read
from causal_openlock.schemas.schema import JSON_SCHEMA_ID, Schema
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import joined
from causal_openlock.world import rewards

RANDOM_CLASS = "openlock_learners.random:RandomLearner"
PERSON = "causal_openlock.play.person:Person"  #: the learner of a record of people
AGENT = "causal_openlock.play.person:Agent"  #: that of a record of an agent from outside
MOST_SWEPT = 500  #: the most learners that one sweep can declare
PAPER = rewards.PRESETS[rewards.PAPER_REWARD]


# -- learners --------------------------------------------------------------------------------------


def _reward(value: Any, info: ValidationInfo) -> rewards.RewardFunction:
    """A reward in any form; a recorded one as it was, without its code."""
    if not (isinstance(value, Mapping) and context_of(info).get("recorded")):
        return rewards.find_reward(value)
    recorded: Any = adapter(
        rewards.Reward | rewards.OwnReward | rewards.AuthorsReward
    ).validate_python(value)
    if unknown := {*getattr(recorded, "terms", ())} - {*rewards.TERMS}:
        raise ExperimentError(f"there is no reward term {min(unknown)!r}")
    return recorded


AnyReward = Annotated[
    InstanceOf[rewards.RewardFunction],
    BeforeValidator(_reward, json_schema_input_type=str | list[str] | rewards.RewardWeights),
    PlainSerializer(lambda reward: reward.as_dict()),
]


def points(entry: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Entries for the learners of a sweep, with their labels.

    >>> swept = points({"learner": "bayes", "sweep": {"lapse": [0.0, 0.1]}})
    >>> [(point["name"], point["parameters"]) for point in swept]
    [('bayes-lapse-0', {'lapse': 0.0}), ('bayes-lapse-0.1', {'lapse': 0.1})]
    """
    sweep, fixed = entry.get("sweep"), entry.get("parameters") or {}
    if not (isinstance(sweep, Mapping) and isinstance(fixed, Mapping)):
        return []
    name = str(entry.get("name") or str(entry.get("learner")).rpartition(":")[2])
    lists = [values if isinstance(values, list) else [] for values in sweep.values()]
    entries = []
    for values in islice(product(*lists), MOST_SWEPT):
        point = dict(zip(sweep, values, strict=True))
        changed = {"name": label_of(name, point, "-"), "parameters": {**fixed, **point}}
        entries.append({**{key: entry[key] for key in entry if key != "sweep"}, **changed})
    return entries


@part(kw_only=True)
class LearnerSpec(Part):
    """A learner of an experiment."""

    #: Its origin, if a results folder has it; its code is then not loaded.
    recorded: Annotated[
        InstanceOf[Origin] | None, SkipJsonSchema(), Field(exclude=True, repr=False)
    ] = None
    learner: Annotated[str, Field(description="Registered name, or module:Class.")]
    name: Name = ""  #: its label; by default its name
    sweep: Annotated[
        dict[str, Annotated[list[Any], Field(min_length=1)]],
        Field(description="Values of parameters; each combination is a learner.", exclude=True),
    ] = field(default_factory=dict)
    #: All its hyper-parameters, defaults included.
    parameters: Annotated[dict[str, Any], Field(validate_default=True)] = field(
        default_factory=dict
    )
    protocol: AnyProtocol = field(default_factory=lambda: HUMAN)
    reward: AnyReward = field(default_factory=lambda: PAPER)
    subjects: Subjects = 40  #: in each condition
    cell_size: Annotated[Count | None, Field(exclude_if=lambda size: size is None)] = None

    @field_validator("learner")
    @classmethod
    def _is_there(cls, learner: str, info: ValidationInfo) -> str:
        if not info.data.get("recorded"):
            learner_class(learner)
        return learner

    @field_validator("parameters")
    @classmethod
    def _fit(cls, parameters: dict[str, Any], info: ValidationInfo) -> dict[str, Any]:
        """All parameters, defaults included; those of a sweep are checked with its values."""
        learner = info.data.get("learner")
        if learner is None or info.data.get("recorded") or info.data.get("sweep"):
            return parameters
        return asdict(parse_parameters(learner, parameters))

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.learner.rpartition(":")[2])

    def as_dict(self) -> dict[str, Any]:
        """The learner as plain data, with its origin, which no file says."""
        return {**super().as_dict(), **self.origin.as_dict()}

    def as_file(self) -> dict[str, Any]:
        """The learner as an experiment file has it."""
        data = {**super().as_dict(), "reward": self.reward.written()}
        if PROTOCOLS.get(self.protocol.name) == self.protocol:
            return {**data, "protocol": self.protocol.name}
        return {**data, "protocol": present(data["protocol"])}

    @cached_property
    def origin(self) -> Origin:
        """The learner's recorded origin, or that of the installed code."""
        return self.recorded or origin_of(self.learner, self.parameters)

    def cannot_play(self, condition: Condition) -> str:
        """Why the learner cannot play a condition, in a sentence; empty if it can."""
        if self.recorded is not None:  # its code need not be installed
            return ""
        if condition.shown and not learner_class(self.learner).learns_from_others:
            return f"{self.name} learns from its own actions alone, so nothing can be shown to it"
        parameters = parse_parameters(self.learner, self.parameters)
        for schema in condition.schemas:
            limit = self.protocol.actions_for(schema)
            if why := answer_of(self.learner, "cannot_play", str, parameters, schema, limit):
                return f"{self.name} cannot play in rooms of {schema.name}: {why}"
        return ""


def _learner(value: Any, info: ValidationInfo) -> Any:
    """A learner by its name or class, with what the experiment says for all."""
    if isinstance(value, LearnerSpec):
        return value
    entry = {**value} if isinstance(value, Mapping) else {"learner": value}
    learner = entry.get("learner")
    if isinstance(learner, type):
        entry["learner"] = name_of(learner)
    elif not isinstance(learner, str | None):
        raise LearnerError(
            f"{learner!r:.200} is not a learner; give a name, a class of learners, or "
            "learner(NAME, parameter=value)"
        )
    for_all = ("protocol", "reward", "subjects")
    entry = {**{key: info.data[key] for key in for_all if key in (info.data or {})}, **entry}
    if context_of(info).get("recorded"):
        entry["recorded"] = Origin.taken_from(entry)
    return entry


def _family(spec: LearnerSpec, info: ValidationInfo) -> list[LearnerSpec]:
    """The learners of a sweep, one for each combination of values; without one, the learner."""
    sweep = spec.sweep
    learners: list[LearnerSpec] = []
    if not sweep:
        return [spec]
    if (size := prod(map(len, sweep.values()))) > MOST_SWEPT:
        raise LearnerError(
            f"this sweep has {size:,} learners; sweep at most {MOST_SWEPT}", ("sweep",)
        )
    if twice := sweep.keys() & spec.parameters.keys():
        key = min(twice)
        raise LearnerError(f"{key} is in parameters and in sweep; leave one out", ("sweep", key))
    faults: dict[Any, OpenLockError] = {}
    for point in points({key: getattr(spec, key) for key in spec.__dataclass_fields__}):
        if any(point["name"] == learner.name for learner in learners):
            raise LearnerError(
                f"two learners of this sweep are called {point['name']}; leave one out, or list "
                "them one by one, each with a name",
                ("sweep",),
            )
        try:
            learners.append(read(LearnerSpec, point, info.context))
        except OpenLockError as error:
            for fault in error.parts:
                match fault.at:
                    case ("parameters", str(key), *_) if key in sweep:
                        fault.at = ("sweep", key, sweep[key].index(point["parameters"][key]))
                faults.setdefault(fault.at, fault)
    if faults:
        raise together([*faults.values()])
    return learners


def _once(part: Any, info: ValidationInfo) -> Any:
    """Refuse a second condition or learner of a name, and a second schema of one."""
    if not declares(info):
        return part
    context = context_of(info)
    kind = "condition" if isinstance(part, Condition) else "learner"
    for named in part if isinstance(part, list) else [part]:
        if named.name in context.setdefault(kind, {}):
            raise ExperimentError(
                f"the {kind} {named.name} is listed twice; remove one of them, or give it another "
                "name (name: in a file; in Python learner(..., label=...), schema(..., name=...))"
            )
        if named.name == "people" and kind == "learner" and named.learner != PERSON:
            raise LearnerError("people are those of the paper in tables; choose another label")
        context[kind][named.name] = named
    for schema in part.schemas if isinstance(part, Condition) else ():
        if context.setdefault("schema", {}).setdefault(schema.name, schema) != schema:
            raise ExperimentError(f"two different schemas are called {schema.name}; rename one")
    return part


AnyLearner = Annotated[
    LearnerSpec,
    BeforeValidator(_learner, json_schema_input_type=str | LearnerSpec),
    AfterValidator(_family),
    AfterValidator(_once),
]


# -- experiments -----------------------------------------------------------------------------------


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
        return _digest(
            {
                "version": RESULTS_VERSION,
                "experiment": self.experiment,
                "seed": self.seed,
                "entry": _deciding(self.spec, "subjects", "cell_size"),
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
        last = self.first_subject + self.subjects - 1
        return f"{self.spec.name}_{self.condition.name}_{self.first_subject}-{last}"

    @property
    def file_name(self) -> str:
        """Name of the cell's file."""
        return f"{self.name}_{self.identity[:12]}.parquet"


@part(kw_only=True)
class Experiment(Part):
    """An experiment: learners × conditions × protocol × subjects, cut into cells."""

    version: SkipJsonSchema[str] = RESULTS_VERSION  #: of this package's results
    name: Name
    title: str = ""  #: a line for the report
    command: SkipJsonSchema[str] = ""  #: that runs it again
    seed: Seed = 0
    cell_size: Annotated[Count, Field(description="Most subjects in a unit of work.")] = 40
    #: Protocols of its own by name, ``protocols`` in a file.
    own_protocols: Annotated[
        OwnProtocols,
        Field(validation_alias=AliasChoices("protocols", "own_protocols"), exclude=True),
    ] = field(default_factory=dict)
    # These, and the size of cells, are those of learners that have none of their own.
    protocol: Annotated[AnyProtocol, Field(exclude=True)] = field(default_factory=lambda: HUMAN)
    reward: Annotated[AnyReward, Field(exclude=True)] = field(default_factory=lambda: PAPER)
    subjects: Annotated[Subjects, Field(exclude=True)] = 40
    conditions: Annotated[tuple[Annotated[AnyCondition, AfterValidator(_once)], ...], *AT_LEAST_ONE]
    learners: Annotated[
        tuple[AnyLearner, ...],
        *AT_LEAST_ONE,
        AfterValidator(lambda families: tuple(chain(*families))),
    ]

    def __post_init__(self) -> None:
        if not self.title:
            players = joined([spec.name for spec in self.learners])
            places = joined([condition.name for condition in self.conditions])
            object.__setattr__(self, "title", f"{players} in {places}")

    def cells(self) -> tuple[Cell, ...]:
        """The units of work, always in the same order; none where a learner is not applicable."""
        return self._cells

    @cached_property
    def _cells(self) -> tuple[Cell, ...]:
        return tuple(
            Cell(self.name, self.seed, spec, condition, first, min(size, spec.subjects - first))
            for spec in self.learners
            for size in [spec.cell_size or self.cell_size]
            for condition in self.conditions
            if condition.name not in self.not_applicable.get(spec.name, {})
            for first in range(0, spec.subjects, size)
        )

    @cached_property
    def not_applicable(self) -> Mapping[str, Mapping[str, str]]:
        """Reasons, in a sentence, why learners cannot play conditions, by learner and condition."""
        reasons: dict[str, dict[str, str]] = {}
        for spec, condition in product(self.learners, self.conditions):
            if why := spec.cannot_play(condition):
                reasons.setdefault(spec.name, {})[condition.name] = why
        return reasons

    @property
    def reasons(self) -> tuple[str, ...]:
        """Each reason in :attr:`not_applicable`, once."""
        reasons = (why for by_name in self.not_applicable.values() for why in by_name.values())
        return tuple(dict.fromkeys(reasons))

    @property
    def schemas(self) -> tuple[Schema, ...]:
        """The schemas of the conditions, each once."""
        return tuple(dict.fromkeys(chain(*(condition.schemas for condition in self.conditions))))

    @property
    def protocols(self) -> tuple[Protocol, ...]:
        """The protocols of the learners, each once."""
        return tuple(dict.fromkeys(spec.protocol for spec in self.learners))

    @property
    def random_learners(self) -> set[str]:
        """Labels of the learners that draw every action at random."""
        return {spec.name for spec in self.learners if spec.origin.class_name == RANDOM_CLASS}

    def as_dict(self) -> dict[str, Any]:
        """The experiment as plain data, schemas and defaults included."""
        learners = [spec.as_dict() for spec in self.learners]
        return {**plain(adapter(Experiment).dump_python(self)), "learners": learners}

    def as_file(self) -> dict[str, Any]:
        """The experiment as a file beside ``schemas/NAME.yaml`` has it, with the same identity."""
        data = self.as_dict()
        del data["version"], data["command"]
        for condition, entry in zip(self.conditions, data["conditions"], strict=True):
            entry["train"] = [trials.as_file() for trials in condition.train]
            entry["test"] = [trials.as_file() for trials in condition.test]
        return {**data, "learners": [spec.as_file() for spec in self.learners]}

    @cached_property
    def identity(self) -> str:
        """A hash of everything in :meth:`as_dict` that determines the results."""
        learners = [_deciding(spec) for spec in self.learners]
        return _digest({**self.as_dict(), "learners": learners}, "title", "command")

    @cached_property
    def declaration(self) -> str:
        """A hash of what is asked for: :attr:`identity` apart from the versions of packages."""
        learners = [  # a file of one's own is no version of a package
            _deciding(spec, *([] if ":" in spec.learner else ["package"])) for spec in self.learners
        ]
        return _digest({**self.as_dict(), "learners": learners}, "title", "command", "version")


def _deciding(spec: LearnerSpec, *without: str) -> dict[str, Any]:
    """Part of a learner's description that determines its results and identity."""
    data = {key: value for key, value in spec.as_dict().items() if key not in (*NOTES, *without)}
    # The hashes of published studies were made when the package of the bundled learners was called
    # "learners", and "double" was no parameter.
    parameters = {k: v for k, v in data["parameters"].items() if (k, v) != ("double", True)}
    return {**data, "class": data["class"].removeprefix("openlock_"), "parameters": parameters}


def _digest(data: Mapping[str, Any], *without: str) -> str:
    decides = {key: value for key, value in data.items() if key not in without}
    return hashlib.sha256(json.dumps(decides, sort_keys=True, default=str).encode()).hexdigest()


def json_schema() -> dict[str, Any]:
    """The JSON Schema of experiment files, for editors."""
    made = adapter(Experiment).json_schema()
    made["$defs"]["Condition"]["required"] = ["train"]  # in Python the name comes first
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock experiment"}
