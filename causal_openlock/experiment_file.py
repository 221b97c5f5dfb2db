"""Experiment files: an experiment as YAML, everything in it resolved, with line numbers.

An experiment file looks like this; only ``name``, ``conditions`` and ``learners`` are required::

    name: first_look
    title: Random against the oracle
    seed: 2018
    protocol: human               # or rl, or one declared below
    subjects: 40
    reward: paper                 # a preset, or a list of terms
    conditions: [CC4, CC3-CC4, chain3]
    learners:
      - random
      - oracle
      - {learner: ddqn, name: ddqn_slow, parameters: {learning_rate: 0.0001}, subjects: 10}
    protocols:
      short: {based_on: rl, attempt_limit: 60, train_loops: 2}

A condition that is not of the form ``A`` or ``A-B`` is spelled out, any sequence of schemas and
layouts::

    - name: keys_then_chain
      train: [{schema: two_keys, layouts: random, trials: 4}]
      test: [{schema: chain3, layouts: [trial1, {L0: LEFT, L1: UPPER, L2: LOWER}]}]

The form of the file is the pydantic model :class:`ExperimentFile`, from which the JSON Schema for
editors is made (``experiments/schema.json``).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, is_dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from causal_openlock.errors import ExperimentError, FileError, OpenLockError, nearest
from causal_openlock.experiment import Entry, Experiment
from causal_openlock.learner_registry import learner_class, parse_parameters
from causal_openlock.protocol import Condition, Protocol, Trials, find_protocol, plan
from causal_openlock.rewards import PAPER_REWARD, find_reward
from causal_openlock.room import Layout
from causal_openlock.schema import NAME, Schema
from causal_openlock.schema_file import JSON_SCHEMA_ID, bundled, find_schema
from causal_openlock.yaml_file import Document, Where, read_document

Positive = Annotated[int, Field(ge=1)]
Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]{0,63}$")]
RewardName = str | list[str]
DEFAULT_EXPERIMENT = "default"


class _Strict(BaseModel):
    model_config = ConfigDict(extra="forbid", strict=True)


class TrialsFile(_Strict):
    """Some trials in rooms of one schema."""

    schema_: Annotated[str, Field(alias="schema", description="Name or path of a schema.")]
    layouts: Annotated[
        Literal["published", "random"] | list[str | dict[str, str]] | None,
        Field(description="Where the levers stand; the protocol decides if this is left out."),
    ] = None
    trials: Annotated[Positive | None, Field(description="How many trials.")] = None
    shuffle: Annotated[bool, Field(description="Whether layouts come in random order.")] = True


class ConditionFile(_Strict):
    """A condition spelled out."""

    name: Name
    train: Annotated[list[TrialsFile], Field(min_length=1)]
    test: list[TrialsFile] = []


class ProtocolFile(_Strict):
    """A protocol of one's own: another one with some settings changed."""

    based_on: Annotated[str, Field(description="A protocol to start from.")] = "human"
    attempt_limit: Positive | None = None
    stop_when_solved: bool | None = None
    baseline_trials: Positive | None = None
    training_trials: Positive | None = None
    test_trials: Positive | None = None
    baseline_loops: Positive | None = None
    train_loops: Positive | None = None
    test_loops: Positive | None = None
    layouts: Literal["published", "random"] | None = None
    test_layout: str | None = None
    action_limit: Positive | None = None


class LearnerFile(_Strict):
    """A learner that takes part, with what is different for it."""

    learner: Annotated[str, Field(description="Registered name, or module:Class.")]
    name: Annotated[Name | None, Field(description="Label in tables; the learner's name.")] = None
    parameters: dict[str, Any] = {}
    protocol: str | None = None
    subjects: Positive | None = None
    reward: RewardName | None = None


class ExperimentFile(_Strict):
    """An experiment: learners, conditions, protocol, subjects."""

    name: Name
    title: str = ""
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    protocol: str = "human"
    subjects: Positive = 40
    cell_size: Annotated[Positive, Field(description="Most subjects in a unit of work.")] = 40
    reward: RewardName = PAPER_REWARD
    conditions: Annotated[list[str | ConditionFile], Field(min_length=1)]
    learners: Annotated[list[str | LearnerFile], Field(min_length=1)]
    protocols: dict[str, ProtocolFile] = {}


@dataclass(frozen=True)
class Changes:
    """What the command line may change of an experiment; ``None`` leaves it as it is."""

    conditions: Sequence[str] | None = None
    learners: Sequence[str] | None = None
    protocol: str | None = None
    subjects: int | None = None
    seed: int | None = None


def read_experiment(path: Path | str, changes: Changes | None = None) -> Experiment:
    """Read an experiment file.

    Args:
        path: The file.
        changes: What to change of it.

    Raises:
        FileError: With line, column and remedy of every fault of the file, or of a schema file
            that it names.
        OpenLockError: If one of the changes does not fit.
    """
    document = read_document(path)
    return _Builder(document, document.validate(ExperimentFile), changes or Changes()).build()


def find_experiment(name: str | Path) -> Path:
    """The file of an experiment, by path or by the name of a bundled one.

    Raises:
        OpenLockError: If there is none; the message names the nearest.
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


class _Builder:
    """Resolves every name in an experiment file, and says where one cannot be resolved."""

    def __init__(self, document: Document, file: ExperimentFile, changes: Changes) -> None:
        self.document, self.file, self.changes = document, file, changes
        self.folder = document.path.resolve().parent
        self.own_protocols: dict[str, Protocol] = {}

    def at(self, where: Where | None, resolve: Callable[[], Any]) -> Any:
        """Resolve something; a fault in it is a fault at ``where`` in the file, if it is there."""
        try:
            return resolve()
        except FileError:
            raise
        except OpenLockError as error:
            if where is None:
                raise
            raise self.document.error(where, str(error)) from None

    def build(self) -> Experiment:
        file, changes = self.file, self.changes
        for name, declared in file.protocols.items():
            self.own_protocols[name] = self.at(
                ("protocols", name), partial(self.protocol, name, declared)
            )
        if changes.conditions is None:
            conditions = [
                self.at(("conditions", index), partial(self.condition, condition))
                for index, condition in enumerate(file.conditions)
            ]
        else:
            conditions = [self.condition(condition) for condition in changes.conditions]
        if changes.learners is None:
            entries = [
                self.entry(self.as_learner(learner), ("learners", index))
                for index, learner in enumerate(file.learners)
            ]
        else:
            declared_learners = {
                (known := self.as_learner(learner)).name or known.learner: known
                for learner in file.learners
            }
            entries = [
                self.entry(declared_learners.get(name) or LearnerFile(learner=name), None)
                for name in changes.learners
            ]
        self.check_unique("condition", "conditions", [c.name for c in conditions])
        self.check_unique("learner", "learners", [e.name for e in entries])
        self.check_schemas(conditions)
        self.check_fit(conditions, entries)
        return Experiment(
            name=file.name,
            title=file.title or file.name,
            seed=file.seed if changes.seed is None else changes.seed,
            cell_size=file.cell_size,
            conditions=tuple(conditions),
            entries=tuple(entries),
        )

    @staticmethod
    def as_learner(learner: str | LearnerFile) -> LearnerFile:
        return LearnerFile(learner=learner) if isinstance(learner, str) else learner

    def schema(self, name: str) -> Schema:
        return find_schema(name, beside=[self.folder])

    def protocol(self, name: str, declared: ProtocolFile) -> Protocol:
        if not NAME.fullmatch(name):
            raise ExperimentError(f"{name!r} is no name for a protocol; use letters and digits")
        base = find_protocol(declared.based_on, self.own_protocols)
        given = declared.model_dump(exclude_unset=True, exclude={"based_on"})
        return replace(base, name=name, **given)

    def condition(self, declared: str | ConditionFile) -> Condition:
        if isinstance(declared, str):
            return Condition.named(declared, self.schema)
        return Condition(
            declared.name,
            tuple(self.trials(trials) for trials in declared.train),
            tuple(self.trials(trials) for trials in declared.test),
        )

    def trials(self, declared: TrialsFile) -> Trials:
        schema = self.schema(declared.schema_)
        layouts: Any = declared.layouts
        if isinstance(layouts, list):
            layouts = tuple(Layout.of(schema, layout) for layout in layouts)
            if declared.trials and declared.trials > len(layouts):
                raise ExperimentError(
                    f"{declared.trials} trials need as many layouts, and {len(layouts)} are given"
                )
        return Trials(schema, layouts, declared.trials, declared.shuffle)

    def entry(self, declared: LearnerFile, where: Where | None) -> Entry:
        changes, file = self.changes, self.file

        def part(*key: str) -> Where | None:
            return None if where is None else (*where, *key)

        protocol = declared.protocol or changes.protocol or file.protocol
        reward = file.reward if declared.reward is None else declared.reward
        self.at(part("learner"), lambda: learner_class(declared.learner))
        parameters = self.at(
            part("parameters"), lambda: parse_parameters(declared.learner, declared.parameters)
        )
        return Entry(
            name=declared.name or declared.learner.rpartition(":")[2],
            learner=declared.learner,
            parameters=asdict(parameters) if is_dataclass(parameters) else {},  # type: ignore[arg-type]
            protocol=self.at(
                part("protocol") if declared.protocol else self.whole("protocol"),
                lambda: find_protocol(protocol, self.own_protocols),
            ),
            reward=self.at(
                part("reward") if declared.reward is not None else ("reward",),
                lambda: find_reward(reward),
            ),
            subjects=changes.subjects or declared.subjects or file.subjects,
        )

    def whole(self, key: str) -> Where | None:
        """A place in the file, unless the command line overrides it."""
        return None if getattr(self.changes, key) is not None else (key,)

    def check_unique(self, what: str, key: str, names: list[str]) -> None:
        for index, name in enumerate(names):
            if name in names[:index]:
                message = f"the {what} {name} is listed twice; give one of them another name"
                if getattr(self.changes, key) is not None:
                    raise ExperimentError(message)
                raise self.document.error((key, index), message)

    def check_schemas(self, conditions: list[Condition]) -> None:
        known: dict[str, Schema] = {}
        for condition in conditions:
            for schema in condition.schemas:
                if known.setdefault(schema.name, schema) != schema:
                    raise ExperimentError(
                        f"two different schemas are called {schema.name}; rename one of them"
                    )

    def check_fit(self, conditions: list[Condition], entries: list[Entry]) -> None:
        """Every schema fits every protocol, so that nothing fails an hour into a comparison."""
        for entry in entries:
            for condition in conditions:
                once = replace(entry.protocol, baseline_loops=1, train_loops=1, test_loops=1)
                plan(condition, once, np.random.default_rng(0))
