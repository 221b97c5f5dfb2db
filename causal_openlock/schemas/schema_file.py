"""Schema files: schemas as YAML, validated with line numbers and written back without loss.

A schema file looks like this; ``title``, ``gates`` and ``inert`` may be left out::

    name: CC3
    title: Common cause, three levers
    levers: [L0, L1, L2]
    edges:                      # cause: [effects]
      L0: [L1, L2]
      L1: [door]
      L2: {door: 0.8}           # its strength
    gates: {door: any}          # any, all, or {at_least: 2}

Its form is the pydantic model :class:`SchemaFile`, also the source of the JSON Schema for editors
(``schemas/schema.json``); its meaning is checked by
:class:`~causal_openlock.schemas.schema.Schema`.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, ValidationError, WrapValidator
from pydantic_core import PydanticCustomError

from causal_openlock.errors import Faults, FileError, SchemaError, together
from causal_openlock.files.atomic import write_text
from causal_openlock.files.validation import StrictModel, described, faults_of, plain
from causal_openlock.files.yaml_file import (
    Document,
    parse_document,
    read_document,
    rewritten,
)
from causal_openlock.schemas.schema import MAX_LEVERS, NAME, Gate, Schema

PACKAGE = Path(__file__).parents[1]
JSON_SCHEMA_ID = "https://json-schema.org/draft/2020-12/schema"


Strength = Annotated[
    float, Field(gt=0, le=1, description="Probability that an enabled push takes effect.")
]


class Edge(StrictModel):
    """Attributes of one edge."""

    strength: Strength = 1.0


class AtLeast(StrictModel):
    """A gate that holds while at least this number of causes are pushed."""

    at_least: Annotated[int, Field(ge=1, le=MAX_LEVERS)]


def _one_of(what: str) -> WrapValidator:
    """One message for a union, instead of one for each of its arms."""

    def check(value: Any, handler: Any) -> Any:
        try:
            return handler(value)
        except ValidationError as error:
            # If the value has the form of one arm, a list or a mapping, report that arm's faults.
            deep = [fault for fault in error.errors(include_url=False) if len(fault["loc"]) > 1]
            if not deep:
                message = f"{what}, and this is {described(value)}"
                raise PydanticCustomError(
                    "custom.union", "{message}", {"message": message}
                ) from None
            raise ValidationError.from_exception_data(
                error.title,
                [
                    {
                        "type": fault["type"],
                        "loc": fault["loc"][1:],
                        "input": fault["input"],
                        "ctx": fault.get("ctx", {}),
                    }
                    for fault in deep
                ],
            ) from None

    return WrapValidator(check)


def _as_edge(value: Any) -> Any:
    """A number in place of an edge is its strength."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return {"strength": value} if is_number else value


Effects = Annotated[
    list[str]
    | dict[str, Annotated[Edge, BeforeValidator(_as_edge, json_schema_input_type=Strength | Edge)]],
    _one_of("effects are a list like [L1, door] or a mapping like {L1: 0.8}"),
]
GateName = Annotated[
    Annotated[
        Literal["any", "all"],
        BeforeValidator(lambda name: name.lower() if isinstance(name, str) else name),
    ]
    | AtLeast,
    _one_of("a gate is any, all or {at_least: k}"),
]


class SchemaFile(StrictModel):
    """A causal schema of levers and a door."""

    name: Annotated[
        str,
        Field(
            pattern=f"^{NAME.pattern}$",
            description="a letter, then letters, digits and underscores, at most 64 in all",
        ),
    ]
    title: Annotated[str, Field(description="A line for tables and figures.")] = ""
    levers: Annotated[
        list[str],
        Field(min_length=1, description="The active levers, in the order layouts place them."),
    ]
    edges: Annotated[
        dict[str, Effects],
        Field(description="cause: [effects]; the effect `door` is the door."),
    ]
    gates: Annotated[
        dict[str, GateName],
        Field(description="How a node combines its causes; `any` where not given."),
    ] = Field(default_factory=dict)
    inert: Annotated[
        list[str], Field(description="Levers that are meant to lie on no path to the door.")
    ] = Field(default_factory=list)

    def schema_(self) -> Schema:
        """The schema that this file declares."""
        edges: dict[str, dict[str, float]] = {}
        faults = Faults()
        for cause, effects in self.edges.items():
            if isinstance(effects, dict):
                edges[cause] = {effect: edge.strength for effect, edge in effects.items()}
                continue
            edges[cause] = {}
            for index, effect in enumerate(effects):
                if effect in edges[cause]:
                    message = f"the edge {cause} -> {effect} is listed twice; remove one of them"
                    faults.append(SchemaError(message, ("edges", cause, index)))
                edges[cause][effect] = 1.0
        gates = {
            node: Gate("at_least", gate.at_least) if isinstance(gate, AtLeast) else Gate(gate)
            for node, gate in self.gates.items()
        }
        with faults.noted():
            made = Schema(
                self.name, self.levers, edges, gates=gates, inert=self.inert, title=self.title
            )
        faults.check()
        return made


def read_schema_file(path: Path | str) -> Schema:
    """Read a schema file.

    Raises:
        FileError: With line, column and remedy of every fault.
    """
    return _schema_of(read_document(path))


def parse_schema(text: str, path: Path | str = "<text>") -> Schema:
    """Read a schema from the text of a schema file.

    >>> parse_schema("{name: one, levers: [A], edges: {A: [door]}}").solutions
    (('A',),)
    """
    return _schema_of(parse_document(text, path))


def schema_from_dict(data: Mapping[str, Any]) -> Schema:
    """A schema from plain data in the form of a schema file.

    Raises:
        SchemaError: If the data are not a schema.
    """
    try:
        return SchemaFile.model_validate(plain(data)).schema_()
    except ValidationError as error:
        faults = faults_of(error, SchemaFile)
        raise together([SchemaError(said, where) for where, said in faults]) from None


def _schema_of(document: Document) -> Schema:
    declared = document.validate(SchemaFile)
    try:
        return declared.schema_()
    except SchemaError as error:
        raise document.error(error) from None


def write_schema_file(schema: Schema, path: Path | str) -> None:
    """Write a schema file.

    If the file already holds a schema, only what changed is rewritten; comments, order and spelling
    of the rest stay.

    Raises:
        FileError: If there is already a file, with faults; it stays unchanged.
        OpenLockError: If the file cannot be written.
    """
    path = Path(path)
    if not path.exists():
        write_text(path, schema.to_yaml())
        return
    document = read_document(path)
    before = _schema_of(document)
    if before == schema:
        return
    text = rewritten(document.text, before.as_dict(), schema.as_dict())
    try:
        faithful = parse_schema(text) == schema
    except FileError:
        faithful = False
    write_text(path, text if faithful else schema.to_yaml())


def json_schema() -> dict[str, Any]:
    """The JSON Schema of schema files, for editors."""
    made = SchemaFile.model_json_schema()
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock schema"}
