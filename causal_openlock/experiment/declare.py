"""What an experiment is: protocols, conditions and learners, declared once.

Files, programs and results folders are read by the same classes, which take *short forms* of their
parts: ``CC3-CC4`` is a condition, ``rl`` a protocol, ``ddqn`` a learner, ``paper`` a reward.
``as_dict`` is what a results folder stores and identities are made of; ``as_file`` is what a user
would write.

A *condition* is a sequence of trials: ``CC4`` is a baseline (rooms of the schema CC4), ``CC3-CC4``
a transfer (six rooms of CC3, then CC4). In ``shown-CC3-CC4`` the training is *shown*: in each of
its rooms the subject watches every solution once and does nothing itself; then it plays the test.

A *cell* is the unit of work: one learner in one condition with at most ``cell_size`` subjects. Its
identity is a hash of everything that determines its record, so a finished cell is never played
again unless something in it has changed.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from itertools import chain, islice, product
from math import prod
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    AliasChoices,
    BeforeValidator,
    Field,
    InstanceOf,
    PlainSerializer,
    ValidationInfo,
    WrapValidator,
    field_validator,
)
from pydantic.json_schema import SkipJsonSchema

from causal_openlock.contract.registry import learner_class, name_of, parse_parameters
from causal_openlock.errors import ExperimentError, LearnerError, OpenLockError, together
from causal_openlock.experiment.origin import NOTES, Origin, answer_of, origin_of
from causal_openlock.files.checksums import digest
from causal_openlock.files.validation import Part, adapter, part, plain, present, read
from causal_openlock.schemas.finding import SUFFIXES, bundled_schemas, find_schema
from causal_openlock.schemas.schema import JSON_SCHEMA_ID, NAME, Schema
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import joined, nearest
from causal_openlock.world import rewards
from causal_openlock.world.room import Layout

HUMAN_PROTOCOL = "human"  #: the protocol under which people played in the paper
PAPER_CONDITIONS = ("CC4", "CE4", "CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4")
PAPER_ACTION_LIMIT = 3
MAX_ACTION_LIMIT = 63
SHOWN = "shown"
"""The phase of training that is shown, and what the name of such a condition begins with."""
RANDOM_CLASS = "openlock_learners.random:RandomLearner"
PERSON = "causal_openlock.play.person:Person"  #: the learner of a record of people
AGENT = "causal_openlock.play.person:Agent"  #: that of a record of an agent from outside
MOST_SWEPT = 500  #: the most learners that one sweep can declare

NAME_FORM = r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$"
MISSING = ("NA", "NaN", "nan", "NULL", "null", "None")
NAME_IN_WORDS = "letters, digits, underscores, dots and dashes, at most 64 in all"


def _context(info: ValidationInfo) -> dict[str, Any]:
    """What is known while a declaration is read.

    ``folders`` to look for schemas in; ``protocols`` of the experiment's own; whether everything is
    ``recorded`` in a results folder, so that no code is loaded; and names that are taken.
    """
    return {} if info.context is None else info.context


def _declares(info: ValidationInfo) -> bool:
    """Whether something is declared: not recorded, nor made of parts that were checked before."""
    return info.context is not None and not info.context.get("recorded")


def _well_formed(name: str, info: ValidationInfo) -> str:
    if _declares(info) and not re.fullmatch(NAME_FORM, name):
        raise ExperimentError(f"{name[:80]!r} is not a name here; it must have {NAME_IN_WORDS}")
    if _declares(info) and name in MISSING:
        raise ExperimentError(
            f"{name!r} is no label, as tables read it as a missing value; choose another name"
        )
    return name


Name = Annotated[
    str,
    AfterValidator(_well_formed),
    Field(description=NAME_IN_WORDS, json_schema_extra={"pattern": NAME_FORM}),
]
Count = Annotated[int, Field(strict=True, ge=1, le=1_000_000), BeforeValidator(plain)]
Subjects = Annotated[int, Field(strict=True, ge=1, le=10_000_000), BeforeValidator(plain)]
ActionLimit = Annotated[int, Field(strict=True, ge=1, le=MAX_ACTION_LIMIT), BeforeValidator(plain)]
Seed = Annotated[int, Field(strict=True, ge=0, lt=2**63), BeforeValidator(plain)]


def _any(parts: Any, info: ValidationInfo) -> Any:
    if _declares(info) and not parts:
        raise ExperimentError(f"{info.field_name} needs at least 1; add one")
    return parts


AT_LEAST_ONE = (AfterValidator(_any), Field(json_schema_extra={"minItems": 1}))


# -- schemas and rewards in their short forms ------------------------------------------------------


def _schema(source: Any, info: ValidationInfo) -> Schema:
    return find_schema(source, _context(info).get("folders", ()))


AnySchema = Annotated[
    InstanceOf[Schema],
    BeforeValidator(_schema, json_schema_input_type=str),
    PlainSerializer(Schema.as_dict),
    Field(description="Name or path of a schema."),
]


def _reward(value: Any, info: ValidationInfo) -> rewards.RewardFunction:
    """A reward in any form; a recorded one as it was, without its code."""
    if not (isinstance(value, Mapping) and _context(info).get("recorded")):
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


# -- protocols -------------------------------------------------------------------------------------

LayoutSource = Literal["published", "random"]
LayoutForms = LayoutSource | list[str | dict[str, str]] | None
LayoutOfSchema = Annotated[
    InstanceOf[Layout], BeforeValidator(lambda layout, info: Layout.of(info.context, layout))
]


def default_action_limit(schema: Schema) -> int:
    """Actions in an attempt by default: the paper's 3, or as many as the schema needs."""
    return max(PAPER_ACTION_LIMIT, schema.least_action_limit)


@part()
class Protocol(Part):
    """Protocol: the budgets and rules under which a condition is played.

    Example:
        >>> from dataclasses import replace
        >>> short = replace(PROTOCOLS["human"], name="short", attempt_limit=5)
        >>> short.attempt_limit, short.training_trials
        (5, 6)
    """

    name: Name
    attempt_limit: Count = 30  #: attempts in a trial
    stop_when_solved: Annotated[bool, Field(strict=True)] = True  #: else a trial goes on
    # Trials where a condition does not say how many; at most as many as there are published
    # layouts, if those are used (five with four levers).
    baseline_trials: Count = 5  #: trials of a condition without a test
    training_trials: Count = 6  #: trials to train on
    test_trials: Count = 1  #: trials to test on
    baseline_loops: Count = 1  #: how often the trials of a baseline are repeated
    train_loops: Count = 1  #: how often those to train on are
    test_loops: Count = 1  #: how often those to test on are
    layouts: LayoutSource = "published"  #: those of the paper's authors, or random ones
    test_layout: SkipJsonSchema[str | None] = None  #: in results of 0.2: the layout of all tests
    action_limit: ActionLimit | None = None  #: by default 3, or as many as the schema needs

    def actions_for(self, schema: Schema) -> int:
        """Actions in an attempt in a room of this schema, which may need more than allowed."""
        limit = self.action_limit or default_action_limit(schema)
        if limit < schema.least_action_limit:
            raise ExperimentError(
                f"{schema.name} needs attempts of {schema.least_action_limit} actions and the "
                f"protocol {self.name} allows {limit}; raise its action_limit"
            )
        return limit


@part()
class ProtocolChanges(Protocol):
    """A protocol of one's own: another one with some settings changed."""

    name: Name = ""
    based_on: str = HUMAN_PROTOCOL


# Those of the paper ("Materials and Procedure", "Model Results"; where its figures show other
# numbers, these follow its text), and that of "Theory-based Causal Transfer" (AAAI 2020).
PROTOCOLS = {
    "human": Protocol("human", 30, True),
    "rl": Protocol("rl", 300, False, 5, 6, 5, baseline_loops=10, train_loops=100, test_loops=10),
    "rl_2020": Protocol("rl_2020", 700, True, 5, 6, 5, 200, 200, 200),
}
HUMAN, PAPER = PROTOCOLS[HUMAN_PROTOCOL], rewards.PRESETS[rewards.PAPER_REWARD]


def find_protocol(name: str, own: Mapping[str, Protocol] | None = None) -> Protocol:
    """A protocol by name; a refusal suggests the nearest."""
    known = {**PROTOCOLS, **(own or {})}
    if name not in known:
        raise ExperimentError(f"there is no protocol {name!r:.80}; {nearest(name, known)}")
    return known[name]


def _protocol(value: Any, info: ValidationInfo) -> Any:
    """A protocol by its name, or another one with some settings changed."""
    if isinstance(value, str):
        return find_protocol(value, _context(info).get("protocols"))
    if isinstance(value, Protocol) or _context(info).get("recorded"):
        return value
    if not isinstance(value, Mapping):
        raise ExperimentError(
            f"{value!r:.200} is not a protocol; give its name, or settings: {{attempt_limit: 10}}"
        )
    if value.get("test_layout"):
        raise ExperimentError(
            "test_layout belongs to conditions now, as in test: [{schema: CC4, layouts: [trial7]}]"
        )
    fields = [key for key in ProtocolChanges.__dataclass_fields__ if key in value]
    settings = {key: value[key] for key in [*fields, *value]}  # in an order that names it
    base = settings.pop("based_on", HUMAN_PROTOCOL)
    if base == value.get("name"):
        raise ExperimentError(f"the protocol {base} is based on itself; name another one")
    protocol = adapter(AnyProtocol).validate_python(base, context=info.context)
    name = settings.pop("name", None) or label_of(protocol.name, settings, "_")
    if name in PROTOCOLS and (settings or "name" in value):
        raise ExperimentError(f"the protocol {name} comes with the package; choose another name")
    if "name" not in value and not NAME.fullmatch(name):  # too many settings for a name
        name = f"{protocol.name[:40]}_{digest(repr(settings))[:8]}"
    return {**asdict(protocol), **settings, "name": name}


AnyProtocol = Annotated[
    Protocol, BeforeValidator(_protocol, json_schema_input_type=str | ProtocolChanges)
]


def _own_protocol(value: Any, read: Callable[[Any], Protocol], info: ValidationInfo) -> Protocol:
    """A protocol of an experiment's own; those below may be based on it."""
    known = _context(info).get("protocols", {})
    known[value["name"]] = HUMAN  # a faulty one is said to be so once
    known[value["name"]] = protocol = read(value)
    return protocol


def _with_names(protocols: Any) -> Any:
    if not isinstance(protocols, Mapping):
        return protocols
    forms = {k: v if isinstance(v, Mapping) else {"based_on": v} for k, v in protocols.items()}
    return {name: {**form, "name": name} for name, form in forms.items()}


# -- conditions ------------------------------------------------------------------------------------


def _places(layouts: Any) -> Any:
    return [[*layout.places] for layout in layouts] if isinstance(layouts, tuple) else layouts


@part()
class Trials(Part):
    """Trials in rooms of one schema."""

    schema: AnySchema
    #: Layouts to draw from without repeats, or their source; by default the protocol's.
    layouts: Annotated[
        tuple[Layout, ...] | LayoutSource | None,
        PlainSerializer(_places),
        Field(description="Where the levers stand; the protocol decides if this is left out."),
    ] = None
    #: Exactly how many, ``trials`` in a file; by default the protocol's number, or all layouts.
    number: Annotated[Count | None, Field(validation_alias=AliasChoices("trials", "number"))] = None
    shuffle: Annotated[bool, Field(strict=True)] = True  #: whether layouts come in random order

    @field_validator("layouts", mode="plain", json_schema_input_type=LayoutForms)
    @classmethod
    def _placed(cls, layouts: Any, info: ValidationInfo) -> Any:
        schema = info.data.get("schema")
        if schema is None or layouts is None or layouts in ("published", "random"):
            return layouts
        is_empty = not layouts and not _context(info).get("recorded")
        if is_empty or not isinstance(layouts, list | tuple):
            raise ExperimentError(
                f"layouts are 'published', 'random' or a list of one or more, not {layouts!r:.200}"
            )
        return adapter(tuple[LayoutOfSchema, ...]).validate_python(layouts, context=schema)

    def __post_init__(self) -> None:
        if isinstance(self.layouts, tuple) and (self.number or 0) > len(self.layouts):
            raise ExperimentError(
                f"{self.number} trials of {self.schema.name} need that number of layouts, and "
                f"{len(self.layouts)} are given"
            )

    def as_file(self) -> dict[str, Any]:
        """The trials as an experiment file has them."""
        data = {**self.as_dict(), "schema": f"schemas/{self.schema.name}.yaml"}
        if isinstance(self.layouts, tuple):
            data["layouts"] = [layout.name for layout in self.layouts]
        return present(data)


def _trials(value: Any, info: ValidationInfo) -> Any:
    """Trials in a list; a schema alone stands for trials in its rooms."""
    if isinstance(value, Mapping) and info.field_name == "train":
        return adapter(Shown).validate_python(value, context=info.context).shown
    groups = value if isinstance(value, list | tuple) else [value]
    if isinstance(value, Mapping) or any(isinstance(g, Mapping) and SHOWN in g for g in groups):
        raise ExperimentError(
            "write a schema by name or path, or a list of trials; what is shown is the whole of "
            "train, as in train: {shown: CC3}"
        )
    return [group if isinstance(group, Mapping | Trials) else {"schema": group} for group in groups]


SomeTrials = Annotated[tuple[Trials, ...], *AT_LEAST_ONE]


@part()
class Shown(Part):
    """Training that is shown: each solution of each room once."""

    shown: Annotated[
        SomeTrials, BeforeValidator(_trials, json_schema_input_type=str | list[Trials])
    ]


def _recorded_room(layout: Any, info: ValidationInfo) -> Layout:
    """A layout of the trials that come before in a condition, by the number of its levers."""
    trials = (*info.data.get("train", ()), *info.data.get("test", ()))
    fitting = {len(group.schema.levers): group.schema for group in trials}
    return layout if isinstance(layout, Layout) else Layout.of(fitting[len(layout)], layout)


RecordedRoom = Annotated[InstanceOf[Layout], BeforeValidator(_recorded_room)]


@part()
class Condition(Part):
    """A sequence of trials: first those to train on, or a baseline's, then those to test on.

    Example:
        >>> [schema.name for schema in find_condition("CC3-CC4").schemas]
        ['CC3', 'CC4']
    """

    name: Name = ""  #: by default that of the schemas, where they alone are declared
    train: Annotated[
        SomeTrials, BeforeValidator(_trials, json_schema_input_type=str | list[Trials] | Shown)
    ] = ()
    test: Annotated[
        tuple[Trials, ...], BeforeValidator(_trials, json_schema_input_type=str | list[Trials])
    ] = ()
    #: By number of the subject, the layouts of its trials, where they are on record.
    rooms: Annotated[
        dict[
            Annotated[int, PlainSerializer(str)],
            Annotated[tuple[RecordedRoom, ...], PlainSerializer(_places)],
        ],
        SkipJsonSchema(),
        Field(exclude_if=lambda rooms: not rooms),
    ] = field(default_factory=dict, compare=False)
    #: Whether each solution of the rooms to train on is shown, in an order drawn for the subject.
    shown: Annotated[bool, SkipJsonSchema(), Field(exclude_if=lambda shown: not shown)] = False

    def __post_init__(self) -> None:
        if not self.train:
            raise ExperimentError("train: is missing; add it")
        if not self.name:
            trials = (*self.train, *self.test)
            if any(group != Trials(group.schema) for group in trials):
                raise ExperimentError("name: is missing; add it")
            names = [*([SHOWN] if self.shown else []), *(group.schema.name for group in trials)]
            object.__setattr__(self, "name", read(Name, "-".join(names)))
        if self.shown and not self.test:
            raise ExperimentError(f"{self.name} is only shown; add a test, which is played")
        if self.shown and self.name in PAPER_CONDITIONS:
            raise ExperimentError(
                f"{self.name} is a condition of the paper, where nothing is shown; choose another "
                f"name, such as {SHOWN}-{self.name}"
            )
        noisy = [trials.schema.name for trials in self.train if not trials.schema.deterministic]
        if self.shown and noisy:
            raise ExperimentError(
                f"a push can fail in rooms of {noisy[0]}, so its solutions cannot be shown; choose "
                "a schema without strengths below 1"
            )

    @property
    def schemas(self) -> tuple[Schema, ...]:
        """The condition's schemas, each once, in order."""
        return tuple(dict.fromkeys(trials.schema for trials in (*self.train, *self.test)))

    @property
    def is_of_paper(self) -> bool:
        """Whether the rooms, too, are the paper's: any schema may be called ``CC4``."""
        if self.name not in PAPER_CONDITIONS:
            return False
        papers = [bundled_schemas()[name] for name in self.name.split("-")]
        schemas = [trials.schema for trials in (*self.train, *self.test)]
        untitled = [{**schema.as_dict(), "title": ""} for schema in (*schemas, *papers)]
        same = untitled[: len(schemas)] == untitled[len(schemas) :]
        return same and len(self.train) == 1


def _condition(value: Any) -> Any:
    """``CC4``, ``CC3-CC4``, ``shown-CC3-CC4``, a path, a schema, a list of these, or a mapping."""
    if isinstance(value, Condition):
        return value
    if isinstance(value, str | Path):
        value = _named(str(value))
    schemas = value if isinstance(value, list | tuple) else [value]
    if schemas and all(isinstance(schema, str | Path | Schema) for schema in schemas):
        first, *others = schemas
        value = {"train": [first, *others[:-1]], "test": others[-1:]}
    if not isinstance(value, Mapping):
        raise ExperimentError(
            f"{value!r:.200} is not a condition; give a name such as CC4 or CC3-CC4, a list of "
            "schemas whose last one is the test, or a mapping with name, train and test"
        )
    return {**value, "shown": True} if isinstance(value.get("train"), Mapping) else value


def _named(text: str) -> dict[str, Any]:
    """What a condition's name says: one schema for a baseline, two for a transfer."""
    if "->" in text or text.lower().endswith(SUFFIXES):
        return {"train": text}
    first, *others = text.removeprefix(f"{SHOWN}-").split("-")
    if len(others) > 1 or not all(map(NAME.fullmatch, (first, *others))):
        raise ExperimentError(
            f"{text!r:.200} is not a condition; write one schema for a baseline (CC4), two for a "
            "transfer (CC3-CC4), or a list where one is a file: [CC3, my/vault.yaml]"
        )
    return {"train": {SHOWN: first} if text.startswith(f"{SHOWN}-") else first, "test": others}


def _once(part: Any, info: ValidationInfo) -> Any:
    """Refuse a second condition or learner of a name, and a second schema of one."""
    if not _declares(info):
        return part
    context = _context(info)
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


AnyCondition = Annotated[
    Condition, BeforeValidator(_condition, json_schema_input_type=str | list[str] | Condition)
]


def find_condition(form: Any) -> Condition:
    """A condition in any form: ``CC4``, ``CC3-CC4``, a path, a schema, or a list of these.

    Raises:
        OpenLockError: If it has another form, or names a schema that is not there or is faulty.

    Example:
        >>> find_condition(["CC3", "CE3", "CC4"]).name
        'CC3-CE3-CC4'
    """
    condition: Condition = read(AnyCondition, form)
    return condition


# -- learners --------------------------------------------------------------------------------------


def label_of(name: str, values: Mapping[str, Any], mark: str) -> str:
    """A name with the values that are changed: ``bayes-policy-solve_and_learn-lapse-0.3``."""
    words = [name]
    for key, value in values.items():
        text = f"{value:.10g}" if isinstance(value, float) else str(value)
        words += [str(key), re.sub(r"[^A-Za-z0-9.-]+", "_", text).strip("_")]
    return mark.join(words)


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
    if _context(info).get("recorded"):
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
        dict[str, Annotated[AnyProtocol, WrapValidator(_own_protocol)]],
        BeforeValidator(_with_names, json_schema_input_type=dict[str, ProtocolChanges]),
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
