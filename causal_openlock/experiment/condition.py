"""Conditions: sequences of trials, in rooms of one schema or of several.

``CC4`` is a baseline (rooms of the schema CC4), ``CC3-CC4`` a transfer (six rooms of CC3, then
CC4). In ``shown-CC3-CC4`` the training is *shown*: in each of its rooms the subject watches every
solution once and does nothing itself; then it plays the test.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import field
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AliasChoices,
    BeforeValidator,
    Field,
    InstanceOf,
    PlainSerializer,
    ValidationInfo,
    field_validator,
)
from pydantic.json_schema import SkipJsonSchema

from causal_openlock.errors import ExperimentError
from causal_openlock.experiment.protocol import AT_LEAST_ONE, Count, LayoutSource, Name, context_of
from causal_openlock.files.validation import Part, adapter, part, present, read
from causal_openlock.schemas.finding import SUFFIXES, bundled_schemas, find_schema
from causal_openlock.schemas.schema import NAME, Schema
from causal_openlock.world.room import Layout

PAPER_CONDITIONS = ("CC4", "CE4", "CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4")
SHOWN = "shown"
"""The phase of training that is shown, and what the name of such a condition begins with."""

LayoutForms = LayoutSource | list[str | dict[str, str]] | None
LayoutOfSchema = Annotated[
    InstanceOf[Layout], BeforeValidator(lambda layout, info: Layout.of(info.context, layout))
]


def _schema(source: Any, info: ValidationInfo) -> Schema:
    return find_schema(source, context_of(info).get("folders", ()))


AnySchema = Annotated[
    InstanceOf[Schema],
    BeforeValidator(_schema, json_schema_input_type=str),
    PlainSerializer(Schema.as_dict),
    Field(description="Name or path of a schema."),
]


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
        is_empty = not layouts and not context_of(info).get("recorded")
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
