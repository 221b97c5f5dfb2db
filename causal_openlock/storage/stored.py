"""Reads ``experiment.json`` of a results folder into typed objects.

The file holds the data of :meth:`Experiment.as_dict`, the identity of the experiment and the names
of its cells. It is checked and parsed only here; the rest of the toolkit works with the resulting
:class:`StoredExperiment`. Reading imports no code that the file names: a learner or a reward
function need not be installed.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, ValidationError

from causal_openlock.contract.parameters import Count
from causal_openlock.errors import OpenLockError, RewardError, StoreError
from causal_openlock.experiment.experiment import Experiment, LearnerSpec, Origin
from causal_openlock.experiment.protocol import Condition, LayoutSource, Protocol, Trials
from causal_openlock.files.validation import StrictModel, faults_of
from causal_openlock.schemas.schema import Schema
from causal_openlock.schemas.schema_file import SchemaFile
from causal_openlock.world.facts import room_facts
from causal_openlock.world.reward_code import OwnReward
from causal_openlock.world.rewards import TERMS, AuthorsReward, Reward, Weights
from causal_openlock.world.room import Layout, position_names, positions_for, published_layouts

Versions = Mapping[str, str | list[str]]
"""Versions by the name of the package; a list if cells were made with several."""


@dataclass(frozen=True)
class StoredExperiment(Experiment):
    """An experiment read from a results folder, with the state of its cells.

    Attributes:
        identity: Its identity when it was run.
        files: Names of the files of its cells.
        versions: Versions of the packages that it was made with; in a record, that the cells were.
        missing: Names of the missing cells.
        failures: Why cells failed, a sentence each, by the name of the cell.
        not_applicable: By learner and condition, why the learner could not play it.
        excluded: By the label of people, how many of them an analysis leaves out.
    """

    identity: str = ""
    files: tuple[str, ...] = ()
    versions: Versions = field(default_factory=dict)
    missing: tuple[str, ...] = ()
    failures: Mapping[str, str] = field(default_factory=dict)
    not_applicable: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    excluded: Mapping[str, int] = field(default_factory=dict)


def parse_experiment(data: Any) -> StoredExperiment:
    """The experiment in the content of ``experiment.json``.

    Raises:
        StoreError: If it is malformed; the message has the place and the fault.
    """
    try:
        return _File.model_validate_json(json.dumps(data)).built()
    except ValidationError as error:
        fault = error.errors(include_url=False)[0]
        where, message = faults_of(error, _File)[0]
        if fault["type"] == "json_invalid":
            message = "it is nested too deeply, or holds text that is not Unicode"
        elif fault["type"] in ("missing", "extra_forbidden") and where[1:]:
            message = f"{'.'.join(map(str, where[:-1]))}: {message}"
    except OpenLockError as error:  # its parts do not fit together
        message = str(error)
    raise StoreError(message)


def recorded_layout(schema: Schema, name: str, positions: int) -> Layout:
    """A layout by its name in the record: a published one, or its positions in order.

    Raises:
        StoreError: If it is neither.
    """
    if name in room_facts()["layouts"]:
        return Layout.of(schema, name, positions)
    known = position_names(positions)
    places = name.split()
    if name.lower() in room_facts()["layouts"]:
        raise StoreError(f"there is no layout {name!r} in the record; did you mean {name.lower()}?")
    if len(places) != len(schema.levers) or not set(places) <= set(known):
        raise StoreError(
            f"the layout {name!r} in the record does not give the positions of the "
            f"{len(schema.levers)} levers of {schema.name}; compare again to make another record"
        )
    return Layout(tuple(map(known.index, places)), positions)


def _built(form: Any, place: str) -> Any:
    try:
        return form.built()
    except OpenLockError as error:
        raise StoreError(f"{place}: {error}") from None


class _Trials(StrictModel):
    schema_: Annotated[SchemaFile, Field(alias="schema")]
    layouts: LayoutSource | list[list[int]] | None
    number: Count | None
    shuffle: bool

    def built(self) -> Trials:
        schema, layouts = self.schema_.schema_(), self.layouts
        if isinstance(layouts, list):
            given = tuple(_placed(schema, places) for places in layouts)
            return Trials(schema, given, self.number, self.shuffle)
        return Trials(schema, layouts, self.number, self.shuffle)


def _placed(schema: Schema, places: Sequence[int]) -> Layout:
    """A layout by its places; under its name, if it is published."""
    layout = Layout(tuple(places), positions_for(schema))
    known = [Layout.of(schema, name) for name in published_layouts(schema)]
    return next((one for one in known if one.places == layout.places), layout)


class _Condition(StrictModel):
    name: str
    train: Annotated[list[_Trials], Field(min_length=1)]
    test: list[_Trials]
    rooms: Annotated[dict[str, list[list[int]]], Field(default_factory=dict)]
    shown: bool = False

    def built(self) -> Condition:
        train, test = (
            tuple(_built(one, f"{name}.{i}") for i, one in enumerate(part))
            for name, part in (("train", self.train), ("test", self.test))
        )
        fitting = {len(one.schema.levers): one.schema for one in (*train, *test)}
        rooms = {}
        for subject, layouts in self.rooms.items():
            if not subject.isdecimal() or not {*map(len, layouts)} <= fitting.keys():
                raise StoreError(f"rooms.{subject[:20]} are not layouts of a subject's trials")
            rooms[int(subject)] = tuple(_placed(fitting[len(one)], one) for one in layouts)
        return Condition(self.name, train, test, rooms, self.shown)


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
    return next((f"<{key}>" for key in ("terms", "function") if key in keys), "<cases>")


_Reward = Annotated[
    Annotated[_Terms, Tag("<terms>")]
    | Annotated[_Function, Tag("<function>")]
    | Annotated[AuthorsReward, Tag("<cases>")],
    Discriminator(_reward_form),
]


class _Learner(StrictModel):
    name: str
    learner: str
    class_: Annotated[str, Field(alias="class")]
    package: str
    material: str = ""
    parameters: dict[str, Any]
    protocol: Protocol
    reward: _Reward
    subjects: Count
    cell_size: Count | None = None
    prior_attempts: Annotated[int, Field(ge=0)] | Literal["unknown"] = 0
    informed: bool = False
    about: str = ""

    def built(self) -> LearnerSpec:
        reward, name = self.reward, self.class_
        if self.package.startswith("causal-openlock 0.2.") and name.startswith("learners."):
            name = f"openlock_{name}"  # what the package of the bundled learners is called now
        return LearnerSpec(
            name=self.name,
            learner=self.learner,
            parameters=self.parameters,
            protocol=self.protocol,
            reward=reward if isinstance(reward, AuthorsReward) else reward.built(),
            subjects=self.subjects,
            cell_size=self.cell_size,
            recorded=Origin(
                name,
                self.package,
                self.material,
                None if self.prior_attempts == "unknown" else self.prior_attempts,
                self.informed,
                self.about,
            ),
        )


class _File(StrictModel):
    identity: str
    version: str
    name: str
    title: str
    command: str
    seed: int
    cell_size: Count
    conditions: Annotated[list[_Condition], Field(min_length=1)]
    learners: Annotated[list[_Learner], Field(min_length=1)]
    cells: list[Any]  # the store checks that these are names of files
    versions: dict[str, str | list[str]] = Field(default_factory=dict)
    not_applicable: dict[str, dict[str, str]] = Field(default_factory=dict)

    def built(self) -> StoredExperiment:
        parts: dict[str, Any] = dict(self)
        for name in ("conditions", "learners"):
            parts[name] = tuple(_built(one, f"{name}.{i}") for i, one in enumerate(parts[name]))
        return StoredExperiment(files=tuple(parts.pop("cells")), **parts)
