"""Schemas wherever one is needed: by name, in a file of any format, as text, graph or edges."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from functools import cache
from os.path import isfile  # unlike that of a Path, it takes any name
from pathlib import Path
from typing import Any

import networkx as nx

from causal_openlock.errors import OpenLockError, SchemaError
from causal_openlock.files.validation import several
from causal_openlock.schemas.graphs import FORMATS, read_schema, schema_of_graph
from causal_openlock.schemas.one_line import parse_line
from causal_openlock.schemas.schema import Gate, Schema, schema_from_dict
from causal_openlock.wording import nearest

PACKAGE = Path(__file__).parents[1]
SUFFIXES = tuple(suffix for format in FORMATS.values() for suffix in format.suffixes)
"""Suffixes of files that a schema can be read from or written to."""

Edges = Mapping[str, Iterable[str] | Mapping[str, float]] | Iterable[tuple[str, str]]


def bundled(kind: str) -> Path:
    """Path of a bundled part: ``schemas``, ``experiments``, ``notebooks``, ``CITATION.cff``.

    In a checkout it is next to the package, in an installed wheel inside it.
    """
    inside = PACKAGE / "bundled" / kind
    return inside if inside.exists() else PACKAGE.parent / kind


def find_schema(
    source: str | os.PathLike[str] | Schema | Mapping[str, Any], beside: Iterable[Path] = ()
) -> Schema:
    """A schema by name or path, or from a line of text or what a schema file holds.

    A path is looked for in the folders ``beside`` and in the working directory; the file of a name,
    ``NAME.yaml``, in a folder ``schemas`` of these as well, and last among the bundled schemas.

    Raises:
        OpenLockError: If the declaration has faults, or there is no such schema; the message names
            the nearest.

    Example:
        >>> find_schema("CC4").title
        'Common cause, four levers'
    """
    if isinstance(source, Schema):
        return source
    if isinstance(source, Mapping):
        return schema_from_dict(source)
    if not isinstance(source, str | os.PathLike):
        raise OpenLockError(
            f"a schema is given by its name, the path of a file or a Schema, not by {source!r:.64}"
        )
    text = os.fspath(source)
    if "->" in text:
        return parse_line(text)
    folders = [*map(Path, beside), Path()]
    if text.lower().endswith(SUFFIXES):
        path = next(filter(isfile, [folder / text for folder in folders]), None)
        if path is None and "-" in text and Path(text).name == text:
            raise OpenLockError(
                f"there is no file {text:.200}; to train in one schema and test in another, name "
                f"them without the suffix: {Path(text).stem:.200}"
            )
        return read_schema(path or text)
    collections = [*(folder / "schemas" for folder in folders), bundled("schemas")]
    for path in filter(isfile, [place / f"{text}.yaml" for place in [*folders, *collections]]):
        return _bundled_schema(path) if path.parent == collections[-1] else read_schema(path)
    known = {path.stem for folder in collections for path in folder.glob("*.yaml")}
    raise OpenLockError(
        f"there is no schema {text!r:.64}; {nearest(text[:64], known)}, or give the path of a file"
    )


_bundled_schema = cache(read_schema)


def bundled_schemas() -> dict[str, Schema]:
    """The schemas that come with the package by name, the paper's four first."""
    paths = {path.stem: path for path in sorted(bundled("schemas").glob("*.yaml"))}
    names = dict.fromkeys(["CC3", "CE3", "CC4", "CE4", *paths])
    return {name: _bundled_schema(paths[name]) for name in names}


def schema(
    source: str | os.PathLike[str] | Schema | nx.DiGraph | Edges | Mapping[str, Any],
    *,
    name: str | None = None,
    gates: Mapping[str, str | Gate] | None = None,
    inert: Iterable[str] = (),
) -> Schema:
    """A schema from a line of text, a graph, edges, or its name.

    Args:
        source: A text with an arrow (:mod:`causal_openlock.schemas.one_line`), or else a name or
            the path of a file; what a schema file holds; a directed graph of networkx, where a node
            can have a ``gate`` and an edge a ``strength``; or edges, ``{cause: [effects]}``,
            ``{cause: {effect: strength}}`` or a list of ``(cause, effect)`` or
            ``(cause, effect, strength)``. Levers have the order in which they first appear.
        name: Another name; by default that of the source, or ``schema``.
        gates: For a graph or edges, ``{node: gate}``: ``any``, ``all``, ``at_least 2`` or a Gate.
        inert: For a graph or edges, levers that are on no path to the door on purpose.

    Raises:
        OpenLockError: If it declares no schema, there is none of this name, or arguments do not go
            together.

    Example:
        >>> edges = {"A": ["B", "C"], "B": ["door"], "C": ["door"]}
        >>> schema("A -> B, C; B | C -> door") == schema(edges)
        True
        >>> schema([("A", "door"), ("B", "door")], gates={"door": "all"}).solutions
        (('A', 'B'),)
    """
    given = {"name": name, "gates": gates, "inert": inert}
    changes = {key: value for key, value in given.items() if value}
    if not isinstance(source, str | os.PathLike | Schema) and not (
        isinstance(source, Mapping) and {"levers", "edges"} <= source.keys()
    ):
        graph = source if isinstance(source, nx.Graph) else _graph(source)
        return schema_of_graph(graph, "schema", changes)
    if gates or inert:
        raise OpenLockError("gates and inert go with edges or a graph; write them into the source")
    declared = find_schema(source)
    return schema_from_dict(declared.as_dict() | changes) if changes else declared


def _graph(source: Any) -> nx.MultiDiGraph:
    """Edges as a graph."""
    if isinstance(source, Mapping):
        source = [
            (cause, effect, *([effects[effect]] if isinstance(effects, Mapping) else []))
            for cause, effects in source.items()
            for effect in (effects if several(effects) else [effects])
        ]
    graph = nx.MultiDiGraph()
    for edge in source if several(source) else [source]:
        match edge:
            case (str(cause), str(effect)):
                graph.add_edge(cause, effect)
            case (str(cause), str(effect), strength):
                graph.add_edge(cause, effect, strength=strength)
            case _:
                raise SchemaError(
                    f"{edge!r:.64} is not an edge; write (cause, effect), or declare the schema "
                    'with a text such as "A -> B, C; B | C -> door"'
                )
    return graph
