"""Experiment files: YAML to an :class:`Experiment`, with line numbers for faults.

An experiment file looks like this; only ``name``, ``conditions`` and ``learners`` are required::

    name: first_look
    title: Random against the oracle
    seed: 2018
    protocol: human               # or rl, or one defined below
    subjects: 40
    reward: paper                 # a preset, a list of terms, weights, or module:function
    conditions: [CC4, CC3-CC4, chain3]
    learners:
      - random
      - oracle
      - {learner: ddqn, name: ddqn_slow, parameters: {learning_rate: 0.0001}, subjects: 10}
    protocols:
      short: {based_on: rl, attempt_limit: 60, train_loops: 2}

Any other condition than ``A`` or ``A-B`` is a sequence of schemas and layouts::

    - name: keys_then_chain
      train: [{schema: two_keys, layouts: random, trials: 4}]
      test: [{schema: chain3, layouts: [trial1, {L0: LEFT, L1: UPPER, L2: LOWER}]}]

The pydantic model :class:`ExperimentFile` defines the format; the JSON Schema for editors
(``experiments/schema.json``) is generated from it.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, is_dataclass, replace
from itertools import product
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_type_hints

import numpy as np
from pydantic import BaseModel, Discriminator, Field, Tag, create_model

from causal_openlock.contract.registry import file_that_runs, learner_class, parse_parameters
from causal_openlock.errors import ExperimentError, FileError, OpenLockError
from causal_openlock.experiment.experiment import Experiment, LearnerSpec
from causal_openlock.experiment.protocol import (
    PROTOCOLS,
    Condition,
    Protocol,
    Trials,
    find_protocol,
    plan,
)
from causal_openlock.files.module_source import look_beside
from causal_openlock.files.validation import StrictModel
from causal_openlock.files.yaml_file import Document, Where, read_document
from causal_openlock.formats.schema_file import JSON_SCHEMA_ID, bundled, find_schema
from causal_openlock.wording import joined, nearest
from causal_openlock.world.rewards import PAPER_REWARD, WEIGHTS, find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.schema import NAME, Schema

LONGEST_NAMES = 28
"""The longest list of learners or conditions in the name of a comparison, which has two."""

Positive = Annotated[int, Field(ge=1)]
Name = Annotated[
    str,
    Field(
        pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$",
        description="letters, digits, underscores, dots and dashes, at most 64 in all",
    ),
]


def _form(value: Any) -> str:
    """The tag of a union's member, by the type of the value."""
    if isinstance(value, Mapping | BaseModel):
        return "<mapping>"
    return "<list>" if isinstance(value, list) else "<name>"


def _written(*forms: str) -> Discriminator:
    known = " or ".join(f"a {form}" for form in forms)
    return Discriminator(
        _form, custom_error_type="custom.form", custom_error_message=f"write {known} here"
    )


A_NAME, A_LIST, A_MAPPING = Tag("<name>"), Tag("<list>"), Tag("<mapping>")


def _maybe(kind: Any, meaning: str) -> tuple[Any, None]:
    return Annotated[kind | None, Field(description=meaning)], None


_CHANGES: dict[str, Any] = {
    "preset": _maybe(str, "What is changed; the paper's reward if nothing is said."),
    "terms": _maybe(list[str], "Terms that add up, instead of a preset."),
    **{
        name: _maybe(Annotated[float, Field(allow_inf_nan=False)], meaning)
        for name, meaning in WEIGHTS.items()
    },
}
RewardWeights = create_model("RewardWeights", __base__=StrictModel, **_CHANGES)
RewardWeights.__doc__ = "A reward with other weights."
RewardName = Annotated[
    Annotated[str, A_NAME] | Annotated[list[str], A_LIST] | Annotated[RewardWeights, A_MAPPING],
    _written("name", "list of terms", "mapping of weights"),
]
LayoutEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[dict[str, str], A_MAPPING],
    _written("name such as trial1", "mapping such as {L0: LEFT}"),
]


class TrialsFile(StrictModel):
    """Some trials in rooms of one schema."""

    schema_: Annotated[str, Field(alias="schema", description="Name or path of a schema.")]
    layouts: Annotated[
        Annotated[Literal["published", "random"], A_NAME] | Annotated[list[LayoutEntry], A_LIST],
        _written("name (published, random)", "list of layouts"),
        Field(description="Where the levers stand; the protocol decides if this is left out."),
    ] = None  # type: ignore[assignment]
    trials: Annotated[Positive | None, Field(description="How many trials.")] = None
    shuffle: Annotated[bool, Field(description="Whether layouts come in random order.")] = True


class ConditionFile(StrictModel):
    """A condition spelled out."""

    name: Name
    train: Annotated[list[TrialsFile], Field(min_length=1)]
    test: list[TrialsFile] = Field(default_factory=list)


def _setting(kind: Any) -> tuple[Any, None]:
    """A field of :class:`Protocol` as a key of the file that may be left out."""
    return (Positive if int in (kind, *get_args(kind)) else kind) | None, None


_SETTINGS: dict[str, Any] = {
    "based_on": (Annotated[str, Field(description="A protocol to start from.")], "human"),
    **{name: _setting(kind) for name, kind in get_type_hints(Protocol).items() if name != "name"},
}
ProtocolFile = create_model("ProtocolFile", __base__=StrictModel, **_SETTINGS)
ProtocolFile.__doc__ = "A protocol of one's own: another one with some settings changed."


class LearnerFile(StrictModel):
    """A learner that takes part, with what is different for it."""

    learner: Annotated[str, Field(description="Registered name, or module:Class.")]
    name: Annotated[Name | None, Field(description="Label in tables; the learner's name.")] = None
    parameters: dict[str, Any] = Field(default_factory=dict)
    protocol: str | None = None
    subjects: Positive | None = None
    reward: RewardName | None = None


ConditionEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[ConditionFile, A_MAPPING],
    _written("name such as CC4 or CC3-CC4", "mapping with name, train and test"),
]
LearnerEntry = Annotated[
    Annotated[str, A_NAME] | Annotated[LearnerFile, A_MAPPING],
    _written("name", "mapping with learner, name, parameters and so on"),
]


class ExperimentFile(StrictModel):
    """An experiment: learners, conditions, protocol, subjects."""

    name: Name
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    protocol: str = "human"
    subjects: Positive = 40
    cell_size: Annotated[Positive, Field(description="Most subjects in a unit of work.")] = 40
    reward: RewardName = PAPER_REWARD
    conditions: Annotated[list[ConditionEntry], Field(min_length=1)]
    learners: Annotated[list[LearnerEntry], Field(min_length=1)]
    protocols: dict[str, ProtocolFile] = Field(default_factory=dict)


@dataclass(frozen=True)
class Changes:
    """Changes to an experiment from the command line; ``None`` changes nothing.

    Example:
        >>> Changes(subjects=10, learners=["oracle"]).options
        ['--learner', 'oracle', '--subjects', '10']
    """

    conditions: Sequence[str] | None = None
    learners: Sequence[str] | None = None
    protocol: str | None = None
    subjects: int | None = None
    seed: int | None = None

    @property
    def options(self) -> list[str]:
        """The equivalent options of the command line."""
        words = [word for name in self.conditions or () for word in ("--condition", name)]
        words += [word for name in self.learners or () for word in ("--learner", name)]
        for option in ("protocol", "subjects", "seed"):
            if (value := getattr(self, option)) is not None:
                words += [f"--{option}", str(value)]
        return words


def read_experiment(
    path: Path | str, changes: Changes | None = None, tell: Callable[[str], None] | None = None
) -> Experiment:
    """Read an experiment file.

    Args:
        path: The file.
        changes: Changes to it.
        tell: Called with a sentence before code runs that the file names and that is not part of an
            installed package.

    Raises:
        FileError: With line, column and remedy of every fault of the file, or of a schema file
            that it names.
        OpenLockError: If one of the changes does not fit.

    Example:
        >>> changes = Changes(learners=["oracle"], conditions=["CC3", "CC3-CC4"], subjects=10)
        >>> experiment = read_experiment(find_experiment("default"), changes)
        >>> [cell.in_words for cell in experiment.cells()]
        ['oracle in CC3, subjects 0-9', 'oracle in CC3-CC4, subjects 0-9']
    """
    document = read_document(path)
    if isinstance(document.data, dict) and {"levers", "edges"} <= document.data.keys():
        raise OpenLockError(f"{path} is a schema; play it with: compare --condition {path}")
    file = document.validate(ExperimentFile)
    builder = _Builder(document, file, changes or Changes())
    if tell:
        builder.tell_what_runs(tell)
    return builder.build()


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment, by path or by the name of a bundled one.

    Raises:
        OpenLockError: If there is none; the message suggests the nearest name.
    """
    if Path(name).suffix in (".yaml", ".yml"):
        return Path(name)
    here = Path("experiments") / f"{name}.yaml"
    folder = bundled("experiments")
    for path in (here, folder / f"{name}.yaml"):
        if path.is_file():
            return path
    known = [path.stem for path in folder.glob("*.yaml")]
    raise OpenLockError(
        f"there is no experiment {str(name)!r}; {nearest(str(name), known)}, or give the path of "
        "a .yaml file"
    )


def json_schema() -> dict[str, Any]:
    """The JSON Schema of experiment files, for editors."""
    made = ExperimentFile.model_json_schema(by_alias=True)
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock experiment"}


def _in_short(names: Sequence[str], what: str) -> str:
    """Names as a part of a name, or their number if they are too long."""
    short = re.sub(r"[^A-Za-z0-9_.-]+", "_", "_".join(names)).strip("_.-")
    return short if 0 < len(short) <= LONGEST_NAMES else f"{len(names)}_{what}"


class _Builder:
    """Resolves every name in an experiment file, and reports the place of those that it cannot."""

    def __init__(self, document: Document, file: ExperimentFile, changes: Changes) -> None:
        self.document, self.file, self.changes = document, file, changes
        self.folder = document.path.resolve().parent
        self.own_protocols: dict[str, Protocol] = {}

    @contextmanager
    def at(self, *where: str | int) -> Iterator[None]:
        """Add the place in the file to errors; values from the command line have no such place."""
        try:
            yield
        except FileError:
            raise
        except OpenLockError as error:
            if getattr(self.changes, str(where[0]), None) is not None:
                raise
            raise self.document.error(where, str(error)) from None

    def tell_what_runs(self, tell: Callable[[str], None]) -> None:
        """Report the code files that the experiment file names and that will run."""
        chosen = self.changes.learners
        learners = [
            one
            for one in map(self.as_learner, self.file.learners)
            if chosen is None or {one.name, one.learner} & {*chosen}
        ]
        runs = {file_that_runs(one.learner, self.folder) for one in learners}
        rewards = [self.file.reward, *(one.reward for one in learners)]
        runs |= {
            file_that_runs(one, self.folder, "reward") for one in rewards if isinstance(one, str)
        }
        for sentence in sorted(filter(None, runs)):
            tell(sentence)

    def build(self) -> Experiment:
        file, changes = self.file, self.changes
        for name, declared in file.protocols.items():
            with self.at("protocols", name):
                self.own_protocols[name] = self.protocol(name, declared)
        conditions = self.resolved("conditions", self.condition)
        learners = self.resolved("learners", self.learner)
        check_together(conditions.values(), learners.values())
        name, title = file.name, file.title or file.name
        if changes.conditions is not None or changes.learners is not None:
            players, places = [*learners], [*conditions]
            name = f"{_in_short(players, 'learners')}_in_{_in_short(places, 'conditions')}"
            title = f"{joined(players)} in {joined(places)}"
        words = ["causal-openlock", "compare", self.document.path.as_posix(), *changes.options]
        return Experiment(
            name=name,
            title=title,
            command=shlex.join(words),
            seed=file.seed if changes.seed is None else changes.seed,
            cell_size=file.cell_size,
            conditions=tuple(conditions.values()),
            learners=tuple(learners.values()),
        )

    def resolved(self, key: str, resolve: Callable[[Any, int], Any]) -> dict[str, Any]:
        """By name, the conditions or learners of the file, or those of the command line."""
        declared = getattr(self.file, key)
        if (chosen := getattr(self.changes, key)) is not None:
            known = {one.name or one.learner: one for one in declared if not isinstance(one, str)}
            declared = [known.get(name, name) for name in chosen]
        found: dict[str, Any] = {}
        for index, entry in enumerate(declared):
            one = resolve(entry, index)
            with self.at(key, index):
                if one.name in found:
                    raise ExperimentError(
                        f"the {key[:-1]} {one.name} is listed twice; give one of them another name"
                    )
            found[one.name] = one
        return found

    @staticmethod
    def as_learner(learner: str | LearnerFile) -> LearnerFile:
        return LearnerFile(learner=learner) if isinstance(learner, str) else learner

    def schema(self, name: str) -> Schema:
        return find_schema(name, beside=[self.folder])

    def protocol(self, name: str, declared: BaseModel) -> Protocol:
        if name in PROTOCOLS:
            raise ExperimentError(
                f"the protocol {name} comes with the package; choose another name"
            )
        if not NAME.fullmatch(name):
            raise ExperimentError(
                f"{name!r} is not a valid name of a protocol; use letters and digits"
            )
        settings = declared.model_dump(exclude_unset=True)
        base = find_protocol(settings.pop("based_on", "human"), self.own_protocols)
        return replace(base, name=name, **settings)

    def condition(self, declared: str | ConditionFile, index: int) -> Condition:
        with self.at("conditions", index):
            if isinstance(declared, str):
                return Condition.named(declared, self.schema)
            train, test = (
                tuple(
                    self.trials(trials, ("conditions", index, phase, number))
                    for number, trials in enumerate(getattr(declared, phase))
                )
                for phase in ("train", "test")
            )
            return Condition(declared.name, train, test)

    def trials(self, declared: TrialsFile, where: Where) -> Trials:
        with self.at(*where, "schema"):
            schema = self.schema(declared.schema_)
        layouts: Any = declared.layouts
        if isinstance(layouts, list):
            places = []
            for index, layout in enumerate(layouts):
                with self.at(*where, "layouts", index):
                    places.append(Layout.of(schema, layout))
            layouts = tuple(places)
        with self.at(*where, "trials"):
            return Trials(schema, layouts, declared.trials, declared.shuffle)

    def learner(self, entry: str | LearnerFile, index: int) -> LearnerSpec:
        declared, file, where = self.as_learner(entry), self.file, ("learners", index)
        own_reward = declared.reward is not None
        reward: Any = declared.reward if own_reward else file.reward
        if isinstance(reward, BaseModel):
            reward = reward.model_dump(exclude_none=True)
        if ":" in declared.learner or ":" in reward:
            look_beside(self.folder)
        with self.at(*where, "learner"):
            learner_class(declared.learner)
        with self.at(*where, "parameters"):
            parameters = parse_parameters(declared.learner, declared.parameters)
        own_protocol = declared.protocol and not self.changes.protocol
        with self.at(*(where if own_protocol else ()), "protocol"):
            protocol = find_protocol(
                self.changes.protocol or declared.protocol or file.protocol, self.own_protocols
            )
        with self.at(*(where if own_reward else ()), "reward"):
            pays = find_reward(reward)
        return LearnerSpec(
            name=declared.name or declared.learner.rpartition(":")[2],
            learner=declared.learner,
            parameters=asdict(parameters) if is_dataclass(parameters) else {},  # type: ignore[arg-type]
            protocol=protocol,
            reward=pays,
            subjects=self.changes.subjects or declared.subjects or file.subjects,
        )


def check_together(conditions: Iterable[Condition], learners: Iterable[LearnerSpec]) -> None:
    """Refuse different schemas with the same name, and schemas that do not fit a protocol.

    Otherwise a comparison could fail after an hour.
    """
    known: dict[str, Schema] = {}
    for condition in conditions:
        for schema in condition.schemas:
            if known.setdefault(schema.name, schema) != schema:
                raise ExperimentError(
                    f"two different schemas are called {schema.name}; rename one of them"
                )
    for spec, condition in product(learners, conditions):
        once = replace(spec.protocol, baseline_loops=1, train_loops=1, test_loops=1)
        plan(condition, once, np.random.default_rng(0))
