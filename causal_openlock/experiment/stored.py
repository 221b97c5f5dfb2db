"""An experiment as a results folder keeps it: ``experiment.json``, read into typed objects.

The file holds what :meth:`Experiment.as_dict` gives, with the identity of the experiment and the
names of its cells. It is checked and parsed once, here; all that reads results works with the
:class:`StoredExperiment` that comes of it. Reading imports no code that the file names: a learner
or a reward function need not be installed.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, GetCoreSchemaHandler, Tag, ValidationError
from pydantic_core import CoreSchema, core_schema

from causal_openlock.errors import OpenLockError, RewardError, StoreError
from causal_openlock.experiment.experiment import Experiment, LearnerSpec, Origin
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.files.validation import StrictModel, sentence
from causal_openlock.formats.schema_file import SchemaFile
from causal_openlock.world.reference import room_facts
from causal_openlock.world.reward_code import OwnReward
from causal_openlock.world.rewards import TERMS, AuthorsReward, Reward, RewardFunction, Weights
from causal_openlock.world.room import Layout, position_names, positions_for, published_layouts
from causal_openlock.world.schema import Schema

Versions = Mapping[str, str | list[str]]
"""Versions by the name of the package; a list where cells were made with several."""


@dataclass(frozen=True)
class StoredExperiment(Experiment):
    """An experiment read from a results folder, with what the folder tells of its cells.

    Attributes:
        identity: As it was when the experiment was declared.
        files: Names of the files of its cells.
        versions: Of the packages that the cells were made with.
        missing: Names of the cells that are not there.
        failures: Why cells failed, a sentence each, by the name of the cell.
    """

    identity: str = ""
    files: tuple[str, ...] = ()
    versions: Versions = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    failures: Mapping[str, str] = field(default_factory=dict)


def parse_experiment(data: Any) -> StoredExperiment:
    """The experiment that the content of ``experiment.json`` describes.

    Raises:
        StoreError: If it is malformed; the message says where and how.
    """
    try:
        return _File.model_validate_json(json.dumps(data)).built()
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where = tuple(part for part in fault["loc"] if not str(part).startswith("<"))
        if fault["type"] == "json_invalid":
            message = "it is nested too deeply, or holds text that is no Unicode"
        elif fault["type"] == "value_error":
            message = f"{'.'.join(map(str, where))}: {fault['ctx']['error']}"
        else:
            message = sentence({**fault, "loc": where}, _File)
            if fault["type"] in ("missing", "extra_forbidden") and where[1:]:
                message = f"{'.'.join(map(str, where[:-1]))}: {message}"
        raise StoreError(message) from None


def recorded_layout(schema: Schema, name: str, positions: int) -> Layout:
    """A layout by its name in the record: a published one, or its positions in order.

    Raises:
        StoreError: If it is neither.
    """
    if name in room_facts()["layouts"]:
        return Layout.of(schema, name, positions)
    known = position_names(positions)
    places = name.split()
    if len(places) != len(schema.levers) or not set(places) <= set(known):
        raise StoreError(
            f"the layout {name!r} in the record does not say where the {len(schema.levers)} "
            f"levers of {schema.name} stand; compare again to make a record that does"
        )
    return Layout(tuple(map(known.index, places)), positions)


@dataclass(frozen=True)
class _WrittenAs:
    """Annotation of a field: the form in which it is written, and how to make the object of it."""

    form: Any
    build: Callable[[Any], Any] = lambda form: form.built()

    def __get_pydantic_core_schema__(
        self, source: Any, handler: GetCoreSchemaHandler
    ) -> CoreSchema:
        return core_schema.no_info_wrap_validator_function(
            self._built, handler.generate_schema(self.form)
        )

    def _built(self, value: Any, validate: Callable[[Any], Any]) -> Any:
        try:
            return self.build(validate(value))
        except OpenLockError as error:  # as a fault, it is reported with its place in the file
            raise ValueError(str(error)) from None


class _Trials(StrictModel):
    schema_: Annotated[Schema, _WrittenAs(SchemaFile, SchemaFile.schema_), Field(alias="schema")]
    layouts: Literal["published", "random"] | list[list[int]] | None
    number: Annotated[int, Field(ge=1)] | None
    shuffle: bool

    def built(self) -> Trials:
        layouts: Any = self.layouts
        if isinstance(layouts, list):
            layouts = tuple(_layout(self.schema_, tuple(places)) for places in layouts)
        return Trials(self.schema_, layouts, self.number, self.shuffle)


def _layout(schema: Schema, places: tuple[int, ...]) -> Layout:
    """A layout by its places; a published one goes by its name."""
    for name in published_layouts(schema):
        published = Layout.of(schema, name)
        if published.places == places:
            return published
    return Layout(places, positions_for(schema))


class _Condition(StrictModel):
    name: str
    train: Annotated[list[Annotated[Trials, _WrittenAs(_Trials)]], Field(min_length=1)]
    test: list[Annotated[Trials, _WrittenAs(_Trials)]]

    def built(self) -> Condition:
        return Condition(self.name, tuple(self.train), tuple(self.test))


class _Terms(StrictModel):
    name: str
    terms: list[str]
    weights: Weights = Weights()

    def built(self) -> Reward:
        if unknown := {*self.terms} - {*TERMS}:
            raise RewardError(f"there is no reward term {min(unknown)!r}")
        return Reward(self.name, tuple(self.terms), self.weights)


class _Function(StrictModel):
    name: str
    function: str
    source: str

    def built(self) -> OwnReward:
        return OwnReward(self.function, self.source)


def _reward_form(data: Any) -> str:
    keys = data.keys() if isinstance(data, Mapping) else ()
    return next((f"<{key}>" for key in ("terms", "function") if key in keys), "<rungs>")


_Reward = Annotated[
    Annotated[RewardFunction, _WrittenAs(_Terms), Tag("<terms>")]
    | Annotated[RewardFunction, _WrittenAs(_Function), Tag("<function>")]
    | Annotated[AuthorsReward, Tag("<rungs>")],
    Discriminator(_reward_form),
]


class _Learner(StrictModel):
    name: str
    learner: str
    class_: Annotated[str, Field(alias="class")]
    package: str
    material: str = ""
    parameters: dict[str, Any]
    protocol: Annotated[Protocol, _WrittenAs(Protocol, lambda protocol: protocol)]
    reward: _Reward
    subjects: Annotated[int, Field(ge=1)]

    def built(self) -> LearnerSpec:
        return LearnerSpec(
            name=self.name,
            learner=self.learner,
            parameters=self.parameters,
            protocol=self.protocol,
            reward=self.reward,
            subjects=self.subjects,
            recorded=Origin(self.class_, self.package, self.material),
        )


class _File(StrictModel):
    identity: str
    version: str
    name: str
    title: str
    command: str
    seed: int
    cell_size: Annotated[int, Field(ge=1)]
    conditions: Annotated[list[Annotated[Condition, _WrittenAs(_Condition)]], Field(min_length=1)]
    learners: Annotated[list[Annotated[LearnerSpec, _WrittenAs(_Learner)]], Field(min_length=1)]
    cells: list[Any]  # causal_openlock.experiment.inside checks these

    def built(self) -> StoredExperiment:
        return StoredExperiment(
            name=self.name,
            title=self.title,
            seed=self.seed,
            cell_size=self.cell_size,
            conditions=tuple(self.conditions),
            learners=tuple(self.learners),
            command=self.command,
            version=self.version,
            identity=self.identity,
            files=tuple(self.cells),
        )
