"""One way to declare a schema wherever one is needed: :func:`schema`."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

import networkx as nx

from causal_openlock.errors import OpenLockError, SchemaError
from causal_openlock.files.validation import several
from causal_openlock.schemas.finding import find_schema
from causal_openlock.schemas.graphs import schema_of_graph
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import Gate, Schema
from causal_openlock.schemas.schema_file import schema_from_dict
from causal_openlock.wording import nearest

Edges = Mapping[str, Iterable[str] | Mapping[str, float]] | Iterable[tuple[str, str]]


def schema(
    source: str | os.PathLike[str] | Schema | nx.DiGraph | Edges | Mapping[str, Any],
    *,
    name: str | None = None,
    gates: Mapping[str, str | Gate] | None = None,
    strengths: Mapping[tuple[str, str], float] | None = None,
    inert: Iterable[str] = (),
) -> Schema:
    """A schema from a line of text, a graph, edges, or its name.

    Args:
        source: One of these:

            * a text with an arrow, such as ``A -> B, C; B | C -> door``
              (:mod:`causal_openlock.schemas.one_line`);
            * any other text: the name of a schema, or the path of a file;
            * a directed graph of networkx; a node can have the attribute ``gate`` and an edge
              ``strength``;
            * what a schema file holds, ``{"name": ..., "levers": [...], "edges": {...}}``;
            * edges, as pairs ``(cause, effect)``, as ``{cause: [effects]}``, or as
              ``{cause: {effect: strength}}``.

            Levers have the order in which they first appear; the node ``door`` is the door.
        name: Another name; by default that of the source, or ``schema``.
        gates: For a graph or edges, ``{node: gate}``: ``any``, ``all``, ``at_least 2`` or a Gate.
        strengths: For a graph or edges, ``{(cause, effect): strength}``; others are 1.
        inert: For a graph or edges, levers that are on no path to the door on purpose.

    Raises:
        SchemaError: If it declares no schema; for a text, the message names the column.
        OpenLockError: If there is no schema of this name, or arguments do not go together.

    Example:
        >>> edges = {"A": ["B", "C"], "B": ["door"], "C": ["door"]}
        >>> schema("A -> B, C; B | C -> door") == schema(edges)
        True
        >>> schema([("A", "door"), ("B", "door")], gates={"door": "all"}).solutions
        (('A', 'B'),)
    """
    if isinstance(source, str | os.PathLike | Schema):
        if gates or strengths or inert:
            raise OpenLockError(
                "gates, strengths and inert go with a graph or edges; a text has them in it, as in "
                "A & B (0.8) -> door; inert C"
            )
        if isinstance(source, str) and "->" in source:
            found = parse_line(source)
        else:
            found = find_schema(source)
    elif isinstance(source, Mapping) and {"levers", "edges"} <= source.keys():
        if gates or strengths or inert:
            raise OpenLockError("gates, strengths and inert go into the declaration itself")
        found = schema_from_dict(source)
    else:
        graph = source.copy() if isinstance(source, nx.Graph) else _graph(source)
        _add(graph.nodes, "gate", gates or {})
        _add(graph.edges, "strength", strengths or {})
        if not several(inert):
            raise SchemaError(f"inert levers are a list of names, not {inert!r}")
        if inert := [*inert]:
            graph.graph["inert"] = inert
        form = "networkx" if isinstance(source, nx.Graph) else "declared"
        found = schema_of_graph(graph, form, "schema")
    return found if name is None else schema_from_dict({**found.as_dict(), "name": name})


_AS_TEXT = 'declare the schema with a text such as "A -> B, C; B | C -> door"'


def _graph(source: Any) -> nx.DiGraph:
    """Edges as a graph."""
    graph = nx.DiGraph()
    if isinstance(source, Mapping):
        source = [
            (cause, effect, *([effects[effect]] if isinstance(effects, Mapping) else []))
            for cause, effects in source.items()
            for effect in (effects if several(effects) else [effects])
        ]
    for edge in source if several(source) else [source]:
        ends = [*edge][:2] if several(edge) else []
        if len(ends) < 2 or len([*edge]) > 3 or not all(isinstance(one, str) for one in ends):
            raise SchemaError(f"{edge!r} is not an edge; write (cause, effect), or {_AS_TEXT}")
        if graph.has_edge(*edge[:2]):
            raise SchemaError(
                f"the edge {edge[0]} -> {edge[1]} is listed twice; remove one of them"
            )
        cause, effect = map(str, ends)
        graph.add_edge(cause, effect)
        if len(edge) == 3:
            graph[cause][effect]["strength"] = edge[2]
    if not graph:
        raise SchemaError(f"a schema has at least one edge; {_AS_TEXT}")
    return graph


def _add(parts: Any, attribute: str, values: Mapping[Any, Any]) -> None:
    """Set an attribute of nodes or edges of a graph."""
    if not isinstance(values, Mapping):
        form = "{node: gate}" if attribute == "gate" else "{(cause, effect): strength}"
        raise SchemaError(f"{attribute}s are {form}, not {values!r}")

    def written(part: Any) -> str:
        return " -> ".join(map(str, part)) if isinstance(part, tuple) else str(part)

    for part, value in values.items():
        if attribute == "strength" and not (isinstance(part, tuple) and len(part) == 2):
            raise SchemaError(
                f"{part!r} is not an edge; strengths are {{(cause, effect): strength}}"
            )
        if part not in parts:
            known = nearest(written(part), map(written, parts))
            raise SchemaError(f"{written(part)!r} has a {attribute} and is not there; {known}")
        parts[part][attribute] = value
