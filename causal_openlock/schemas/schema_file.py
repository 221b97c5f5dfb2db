"""Schema files: schemas as YAML, validated with line numbers.

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
from typing import Annotated, Any, Literal, cast

from pydantic import BeforeValidator, Field, ValidationError, WrapValidator

from causal_openlock.errors import SchemaError, together
from causal_openlock.files.validation import StrictModel, described, errors_of, plain
from causal_openlock.files.yaml_file import parse_document
from causal_openlock.schemas.schema import MAX_LEVERS, NAME, Gate, Schema

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


def _edge(edge: Any) -> Any:
    """A number in place of an edge is its strength."""
    is_number = isinstance(edge, int | float) and not isinstance(edge, bool)
    return {"strength": edge} if is_number else edge


def _effects(effects: Any) -> Any:
    """A list of effects is a mapping of certain ones."""
    if isinstance(effects, list):
        faults = []
        for index, effect in enumerate(effects):
            if not isinstance(effect, str):
                problem = (
                    f"an effect is a name, and this is {described(effect)}; write it in quotes"
                )
                faults.append(SchemaError(problem, (index,)))
            elif effect in effects[:index]:
                problem = f"the effect {effect:.64} is listed twice; remove one of them"
                faults.append(SchemaError(problem, (index,)))
        if faults:
            raise together(faults)
        return {effect: {} for effect in effects}
    if not isinstance(effects, Mapping):
        raise SchemaError(
            "effects are a list like [L1, door] or a mapping like {L1: 0.8}, and this is "
            f"{described(effects)}"
        )
    return effects


def _gate(gate: Any, at_least: Any) -> Gate:
    """A gate from its name, or from the least number of causes."""
    if isinstance(gate, Mapping):
        return Gate("at_least", at_least(gate).at_least)
    if isinstance(gate, str) and gate.lower() in ("any", "all"):
        return Gate(gate.lower())
    raise SchemaError(f"a gate is any, all or {{at_least: k}}, and this is {described(gate)}")


EdgeForm = Annotated[Edge, BeforeValidator(_edge, json_schema_input_type=Strength | Edge)]
Effects = Annotated[
    dict[str, EdgeForm],
    BeforeValidator(_effects, json_schema_input_type=list[str] | dict[str, EdgeForm]),
]
GateForm = Annotated[
    AtLeast, WrapValidator(_gate, json_schema_input_type=Literal["any", "all"] | AtLeast)
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
        dict[str, GateForm],
        Field(description="How a node combines its causes; `any` where not given."),
    ] = Field(default_factory=dict)
    inert: Annotated[
        list[str], Field(description="Levers that are meant to lie on no path to the door.")
    ] = Field(default_factory=list)

    def schema_(self) -> Schema:
        """The schema that this file declares."""
        edges = {
            cause: {effect: edge.strength for effect, edge in effects.items()}
            for cause, effects in self.edges.items()
        }
        gates = cast("dict[str, Gate]", self.gates)
        title, inert = self.title, self.inert
        return Schema(self.name, self.levers, edges, gates=gates, inert=inert, title=title)


def parse_schema(text: str, path: Path | str = "<text>") -> Schema:
    """Read a schema from the text of a schema file.

    >>> parse_schema("{name: one, levers: [A], edges: {A: [door]}}").solutions
    (('A',),)

    Raises:
        FileError: With line, column and remedy of every fault.
    """
    document = parse_document(text, path)
    try:
        return document.validate(SchemaFile).schema_()
    except SchemaError as error:
        raise document.error(error) from None


def schema_from_dict(data: Mapping[str, Any]) -> Schema:
    """A schema from plain data in the form of a schema file.

    Raises:
        SchemaError: If the data are not a schema; its ``parts`` are all faults, each with its
            path of keys in ``at``.
    """
    try:
        return SchemaFile.model_validate(plain(data)).schema_()
    except ValidationError as error:
        faults = errors_of(error, SchemaFile)
        raise together([SchemaError(str(fault), fault.at) for fault in faults]) from None


def json_schema() -> dict[str, Any]:
    """The JSON Schema of schema files, for editors."""
    made = SchemaFile.model_json_schema()
    return {"$schema": JSON_SCHEMA_ID, **made, "title": "causal_openlock schema"}
