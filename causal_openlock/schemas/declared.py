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
            * edges, as ``{cause: [effects]}`` or ``{cause: {effect: strength}}``, or in a list, as
              ``(cause, effect)`` or ``(cause, effect, strength)``.

            Levers have the order in which they first appear; the node ``door`` is the door.
        name: Another name; by default that of the source, or ``schema``.
        gates: For a graph or edges, ``{node: gate}``: ``any``, ``all``, ``at_least 2`` or a Gate.
        inert: For a graph or edges, levers that are on no path to the door on purpose.

    Raises:
        SchemaError: If it declares no schema; for a text, the message quotes the statement.
        OpenLockError: If there is no schema of this name, or arguments do not go together.

    Example:
        >>> edges = {"A": ["B", "C"], "B": ["door"], "C": ["door"]}
        >>> schema("A -> B, C; B | C -> door") == schema(edges)
        True
        >>> schema([("A", "door"), ("B", "door")], gates={"door": "all"}).solutions
        (('A', 'B'),)
    """
    inside = isinstance(source, str | os.PathLike | Schema)
    inside = inside or (isinstance(source, Mapping) and {"levers", "edges"} <= source.keys())
    if inside and (gates or inert):
        raise OpenLockError("gates and inert go with edges or a graph; write them into the source")
    if isinstance(source, str) and "->" in source:
        declared = parse_line(source)
    elif isinstance(source, str | os.PathLike | Schema):
        declared = find_schema(source)
    elif inside and isinstance(source, Mapping):
        declared = schema_from_dict(source)
    else:
        form = "networkx" if isinstance(source, nx.Graph) else "declared"
        graph = source.copy() if isinstance(source, nx.Graph) else _graph(source)
        if not isinstance(gates or {}, Mapping) or not several(inert):
            raise SchemaError(
                f"gates are {{node: gate}} and inert a list of levers, not {gates!r:.64} and "
                f"{inert!r:.64}"
            )
        for node, gate in (gates or {}).items():
            if node not in graph:
                known = nearest(str(node)[:64], map(str, graph))
                raise SchemaError(f"{node!r:.64} has a gate and is not there; {known}")
            graph.nodes[node]["gate"] = gate
        graph.graph["inert"] = [*inert] or graph.graph.get("inert", [])
        declared = schema_of_graph(graph, form, "schema")
    return declared if name is None else schema_from_dict({**declared.as_dict(), "name": name})


def _graph(source: Any) -> nx.MultiDiGraph:
    """Edges as a graph."""
    graph = nx.MultiDiGraph()
    if isinstance(source, Mapping):
        source = [
            (cause, effect, *([effects[effect]] if isinstance(effects, Mapping) else []))
            for cause, effects in source.items()
            for effect in (effects if several(effects) else [effects])
        ]
    for edge in source if several(source) else [source]:
        cause, effect, *strength = edge if several(edge) and len([*edge]) in (2, 3) else (0, 0)
        if not isinstance(cause, str) or not isinstance(effect, str):
            raise SchemaError(f"{edge!r:.64} is not an edge; write (cause, effect), or {_AS_TEXT}")
        graph.add_edge(cause, effect, **({"strength": strength[0]} if strength else {}))
    if not graph:
        raise SchemaError(f"a schema has at least one edge; {_AS_TEXT}")
    return graph


_AS_TEXT = 'declare the schema with a text such as "A -> B, C; B | C -> door"'
