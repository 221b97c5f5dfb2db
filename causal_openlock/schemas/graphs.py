"""Schemas in the file formats of other programs, and as a Bayesian network.

A :class:`~causal_openlock.schemas.schema.Schema` is turned into a networkx ``DiGraph`` with plain
attributes, and each graph format writes that graph:

* of the graph: ``name``, ``title``, ``levers`` (their order) and ``inert``;
* of a node: ``kind`` (lever or door), and ``gate`` (``any``, ``all``, ``at_least 2``) if it has
  causes; of an edge: ``strength``.

YAML, the line of text (:mod:`~causal_openlock.schemas.one_line`), node-link JSON, GML and DOT lose
nothing. A file from other software may lack any of these
attributes: levers then have the order of its nodes, gates are ``any``, strengths 1, and no lever is
inert. The node ``door`` is the door.

DAGitty has no attributes of the graph, so they are on the door; ``beta`` is the strength, the door
is the ``outcome``, free levers are ``exposure``. Nothing is lost here, but DAGitty drops title,
lever order, gates and inert levers when it saves a diagram again. In a text from DAGitty the
outcome is the door, whatever its name; positions and the roles latent, adjusted and selected are
ignored, and edges other than ``->`` and ``<-`` are refused.

BIF can only be written: it holds the tables of :func:`to_bayesian_network`, not their gates.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Sequence
from contextlib import suppress
from itertools import compress, product
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import networkx as nx
import numpy as np

from causal_openlock.errors import OpenLockError, SchemaError, together
from causal_openlock.files.atomic import write_text
from causal_openlock.files.json_text import DoubledKeyError, each_once
from causal_openlock.files.yaml_file import MAX_BYTES, read_text
from causal_openlock.schemas.dot import dagitty_text, dot_text, parse_graph
from causal_openlock.schemas.fsm import FloatArray, gate_chance
from causal_openlock.schemas.one_line import one_line, parse_line
from causal_openlock.schemas.schema import DOOR, NAME, Gate, Schema
from causal_openlock.schemas.schema_file import (
    parse_schema,
    read_schema_file,
    schema_from_dict,
)
from causal_openlock.wording import nearest

if TYPE_CHECKING:
    from pgmpy.factors.discrete import TabularCPD
    from pgmpy.models import DiscreteBayesianNetwork


class Format(NamedTuple):
    """A file format that a schema can be written in.

    Attributes:
        name: Its name here.
        suffixes: Suffixes of its files.
        description: What it is and what reads it.
        write: From a schema to text.
        read: From text and a default name to a schema; None if it cannot be read.
    """

    name: str
    suffixes: tuple[str, ...]
    description: str
    write: Callable[[Schema], str]
    read: Callable[[str, str], Schema] | None = None


def export_schema(schema: Schema, format: str) -> str:
    """A schema as text in one of :data:`FORMATS`.

    Raises:
        OpenLockError: If there is no such format.

    Example:
        >>> chain = Schema("chain", ["A", "B"], {"A": ["B"], "B": ["door"]})
        >>> import_schema(export_schema(chain, "gml"), "gml") == chain
        True
    """
    return _format(format).write(schema)


def import_schema(text: str, format: str, name: str = "imported") -> Schema:
    """A schema from text in one of :data:`FORMATS`.

    Args:
        text: The content of a file.
        format: Name of its format.
        name: Name of the schema if the text has none.

    Raises:
        SchemaError: If the text is not in that format, or its graph is not a schema.
        OpenLockError: If there is no such format or it can only be written.
    """
    chosen = _format(format)
    if chosen.read is None:
        readable = ", ".join(known for known, each in FORMATS.items() if each.read)
        raise OpenLockError(
            f"{chosen.name} can only be written, as it does not hold all of a schema; "
            f"formats that can be read: {readable}"
        )
    if len(text) > MAX_BYTES:
        raise SchemaError(
            f"this {chosen.name} text has {len(text):,} characters, more than the {MAX_BYTES:,} "
            "allowed; is this the right file?"
        )
    return chosen.read(text, name)


def write_schema(schema: Schema, path: Path | str, format: str | None = None) -> None:
    """Write a schema to a file; by default its suffix gives the format.

    A file that is there already is written over.

    Raises:
        OpenLockError: If the format is unknown, or the file cannot be written.
    """
    chosen = _format(format or _format_of(path)).name
    write_text(path, export_schema(schema, chosen))


def read_schema(path: Path | str, format: str | None = None) -> Schema:
    """Read a schema from a file; by default its suffix gives the format and its name the name.

    Raises:
        FileError: With line, column and remedy of every fault of a schema file.
        OpenLockError: If the file cannot be read or holds no schema; the text begins with its path.
    """
    path = Path(path)
    chosen = format or _format_of(path)
    if chosen == "yaml":
        return read_schema_file(path)
    text = read_text(path)
    stem = path.stem.replace("-", "_").replace(" ", "_")
    try:
        return import_schema(text, chosen, stem if NAME.fullmatch(stem) else "imported")
    except SchemaError as error:
        raise _prefixed(f"{path}", error) from None


def _format(name: str) -> Format:
    """A format by its name or suffix."""
    for format in FORMATS.values():
        if name == format.name or f".{name}" in format.suffixes:
            return format
    raise OpenLockError(f"there is no schema format {name!r}; {nearest(name, FORMATS)}")


def _format_of(path: Path | str) -> str:
    suffix = Path(path).suffix.lower()
    known = {known: format.name for format in FORMATS.values() for known in format.suffixes}
    if suffix not in known:
        raise OpenLockError(
            f"{path}: the suffix {suffix!r} stands for no schema format; {nearest(suffix, known)}"
        )
    return known[suffix]


# -- a schema as a plain graph, and back ----------------------------------------------------------


def _plain_graph(schema: Schema) -> nx.DiGraph:
    """The schema as a graph whose attributes are names, numbers and lists of names."""
    about = {"name": schema.name, "title": schema.title}
    graph = nx.DiGraph(**about, levers=list(schema.levers), inert=list(schema.inert))
    for node in [*schema.levers, DOOR]:
        graph.add_node(node, kind="door" if node == DOOR else "lever")
        if schema.causes(node):
            graph.nodes[node]["gate"] = str(schema.gate(node)).replace("at least", "at_least")
        for cause, strength in zip(schema.causes(node), schema.strengths(node), strict=True):
            graph.add_edge(cause, node, strength=strength)
    return graph


def schema_of_graph(graph: nx.DiGraph, format: str, name: str) -> Schema:
    """The schema that a graph holds, from a file or from networkx.

    Raises:
        SchemaError: If it holds none; the message names the format.
    """
    about = graph.graph
    if not graph.is_directed() or graph.is_multigraph():
        raise SchemaError(
            f"this {format} graph is not a directed graph with at most one edge from a node to "
            "another; declare it directed and list each edge once"
        )
    if DOOR not in graph:
        raise SchemaError(
            f"this {format} graph has no node named {DOOR}; rename the node that stands for the "
            f"door; {nearest(DOOR, map(str, graph))}"
        )
    data = {
        "name": about.get("name") or name,
        "title": about.get("title", ""),
        "levers": _names(about["levers"] if "levers" in about else [n for n in graph if n != DOOR]),
        "edges": {
            cause: {
                effect: {"strength": _number(edge.get("strength", 1.0), float)}
                for effect, edge in effects.items()
            }
            for cause, effects in graph.adjacency()
            if effects
        },
        "gates": {
            node: _gate(gate)
            for node, gate in graph.nodes(data="gate")
            if gate not in (None, Gate())
        },
        "inert": _names(about.get("inert", [])),
    }
    try:
        for node in graph if isinstance(data["levers"], list) else ():
            if node != DOOR and node not in data["levers"]:
                raise SchemaError(f"the list of levers lacks the node {node!r}; add it to the list")
        return schema_from_dict(data)
    except SchemaError as error:
        raise _prefixed(f"this {format} graph is not a schema", error) from None


def _prefixed(what: str, error: SchemaError) -> OpenLockError:
    """The same faults, each with what has them."""
    return together([SchemaError(f"{what}: {one}", one.at) for one in error.parts])


def _names(value: Any) -> Any:
    """A list of names, which most formats hold as one text."""
    return value.split() if isinstance(value, str) else value


def _gate(value: Any) -> Any:
    """A gate as a schema file has it, from ``at_least 2`` or a :class:`Gate`."""
    text = str(value).replace("at least", "at_least") if isinstance(value, Gate) else value
    if isinstance(text, str) and text.startswith("at_least "):
        return {"at_least": _number(text.removeprefix("at_least "), int)}
    return text


def _number(value: Any, kind: type[int] | type[float]) -> Any:
    """A number that a format may hold as text; anything else is left to validation."""
    with suppress(ValueError):
        return kind(value) if isinstance(value, str) else value
    return value


def _no_graph(format: str, why: object, remedy: str) -> SchemaError:
    """An error from an exception of networkx."""
    return SchemaError(f"this is no {format} graph ({' '.join(str(why).split())[:160]}); {remedy}")


# -- the formats ----------------------------------------------------------------------------------

_UNREADABLE = (LookupError, ValueError, TypeError, AttributeError, RecursionError, nx.NetworkXError)
"""Exceptions that networkx raises for a text that is not a graph."""


def _write_node_link(schema: Schema) -> str:
    data = nx.node_link_data(_plain_graph(schema), edges="edges")
    return json.dumps(data, indent=2, ensure_ascii=False) + "\n"


_NODE_LINK = 'write one with networkx.node_link_data(graph, edges="edges") and json.dumps'


def _read_node_link(text: str, name: str) -> Schema:
    remedy = _NODE_LINK
    try:
        data = json.loads(text, object_pairs_hook=each_once)
        edges = "edges" if "edges" in data else "links"
        _check_node_link(data, edges)
        graph = nx.node_link_graph(data, data.get("directed", True), False, edges=edges)
    except SchemaError:
        raise
    except DoubledKeyError as error:
        raise SchemaError(f"this is not a node-link graph: {error}; take one out") from None
    except KeyError as error:
        raise _no_graph("node-link", f"the key {error} is missing", remedy) from None
    except _UNREADABLE as error:
        raise _no_graph("node-link", error, remedy) from None
    return schema_of_graph(graph, "node-link", name)


def _check_node_link(data: Any, edges: str) -> None:
    """Refuse what networkx would misread, or would not say plainly."""

    def refuse(what: str) -> None:
        raise SchemaError(f"this is not a node-link graph: {what}; {_NODE_LINK}")

    if not isinstance(data, dict):
        refuse("it begins with a list or a value; a graph is an object with nodes and edges")
    if not isinstance(data.get("graph", {}), dict):
        refuse('"graph" holds the attributes of the graph, {"name": ...}; leave it out if empty')
    for key in ("nodes", edges):
        if key not in data:
            refuse(f"the key {key!r} is missing")
        if not (isinstance(data.get(key), list) and all(isinstance(x, dict) for x in data[key])):
            refuse(f"{key} is a list of objects; write {key} like [{{...}}]")
    names = [one.get("id") for one in data["nodes"]]
    if None in names:
        refuse('a node has no id; write {"id": "L0"}')
    ends = [one.get(end) for one in data[edges] for end in ("source", "target")]
    if any(type(end) is int for end in ends) and not any(type(name) is int for name in names):
        refuse(f"its {edges} name nodes by their place in the list; name them by id")
    for name in names:
        if names.count(name) > 1:
            refuse(f"the node {name!r} is there twice; take one out")
    for end in ends:
        if end not in names:
            refuse(f"the edge from or to {end!r} is of no node; add the node, or correct the edge")


def _text_graph(schema: Schema) -> nx.DiGraph:
    """The schema as a graph whose lists of names are texts, left out if empty."""
    graph = _plain_graph(schema)
    for key in ("levers", "inert"):
        graph.graph[key] = " ".join(graph.graph[key])
        if not graph.graph[key]:
            del graph.graph[key]
    return graph


_SHORT_NUMBER = re.compile(
    r'^(?:[^"\n#]|"[^"\n]*")*?(?<![\w.+-])([+-]?\d+[eE][+-]?\d+)', re.MULTILINE
)
"""A number with an exponent and no point, of which networkx reads the digits before the e."""


def _check_gml(text: str) -> None:
    if found := _SHORT_NUMBER.search(text):
        line, number = text.count("\n", 0, found.start(1)) + 1, found[1]
        raise SchemaError(
            f"line {line} of this gml text: {number} would be misread; write it with a point, such "
            f"as {float(number)!r}"
        )


def _read_gml(text: str, name: str) -> Schema:
    _check_gml(text)
    try:
        labelled = re.search(r"[\s\[]label\s", text) or not re.search(r"[\s\[]name\s", text)
        by = "label" if labelled else "name"
        graph = nx.parse_gml(text, label=by)  # igraph writes names and no labels
    except _UNREADABLE as error:
        raise _no_graph("gml", error, "write one with networkx.write_gml") from None
    if "title" in graph.graph:
        # networkx takes the texts "()" and "[]" for empty lists.
        graph.graph["title"] = str(graph.graph["title"])
    return schema_of_graph(graph, "gml", name)


def _write_bif(schema: Schema) -> str:
    from pgmpy.readwrite import BIFWriter

    return str(BIFWriter(to_bayesian_network(schema)))


def _read_dagitty(text: str, name: str) -> Schema:
    graph = parse_graph(text, "dagitty")
    outcomes = [node for node, data in graph.nodes(data=True) if {"outcome", "target"} & {*data}]
    if DOOR not in graph and len(outcomes) > 1:
        raise SchemaError(
            f"this dagitty graph has {len(outcomes)} outcomes ({', '.join(outcomes)}), and a room "
            "has one door; name one of them door"
        )
    if DOOR not in graph and len(outcomes) == 1:
        nx.relabel_nodes(graph, {outcomes[0]: DOOR}, copy=False)
    of_graph = graph.nodes.get(DOOR, {})
    graph.graph |= {key: of_graph[key] for key in ("title", "levers", "inert") if key in of_graph}
    for *_, edge in graph.edges(data=True):
        edge["strength"] = edge.get("beta", 1.0)
    return schema_of_graph(graph, "dagitty", name)


def to_bayesian_network(
    schema: Schema, push_probability: float = 1.0, lock: bool = False
) -> DiscreteBayesianNetwork:
    """The causal model of one push per lever, causes before effects, then of the door.

    A lever's state is 1 if it moved: it was pushed and as many of its causes transmitted as its
    gate needs. The door's state is 1 if it opens when it is pushed then. For an intervention, cut
    the model and condition on the state that was set, in pgmpy
    ``VariableElimination(model.do(["L0"])).query(["door"], evidence={"L0": 1})``;
    its ``CausalInference.query`` is wrong where levers that cause one another are set together.

    Args:
        schema: The levers and the door.
        push_probability: Probability that a lever is pushed, independent of the others.
        lock: Whether the door's state is instead that it is unlocked, whatever its strengths.

    Returns:
        A checked model whose nodes are the schema's and have the states 0 and 1.

    Raises:
        OpenLockError: If ``push_probability`` is not a probability.
    """
    from pgmpy.models import DiscreteBayesianNetwork

    if not 0.0 <= push_probability <= 1.0:
        raise OpenLockError(f"push_probability is {push_probability}; give a number from 0 to 1")
    network = DiscreteBayesianNetwork()
    network.name = schema.name
    network.add_nodes_from(schema.graph.nodes)
    network.add_edges_from(schema.graph.edges)
    for node in schema.graph.nodes:
        causes = schema.causes(node)
        bits = [schema.mask([cause]) for cause in causes]
        # pgmpy counts through the causes' states with the first cause slowest.
        states = product((0, 1), repeat=len(causes))
        moved = np.array([sum(compress(bits, each)) for each in states], dtype=np.int64)
        chance = gate_chance(schema, node, moved)
        if lock and node == DOOR:
            chance = (np.bitwise_count(moved) >= schema.threshold(DOOR)).astype(float)
        # Rounding may leave a sum of probabilities just above 1.
        chance = chance * (1.0 if node == DOOR else push_probability)
        network.add_cpds(binary_cpd(node, chance, causes))
    network.check_model()
    return network


def binary_cpd(node: str, chance: FloatArray, causes: Sequence[str] = ()) -> TabularCPD:
    """A conditional probability table of pgmpy for a node with the states 0 and 1.

    ``chance``, ``[2^K]``, is the probability of 1 by the states of the causes, the first slowest.
    """
    from pgmpy.factors.discrete import TabularCPD

    return TabularCPD(
        node,
        2,
        [1.0 - chance, chance],
        evidence=list(causes),
        evidence_card=[2] * len(causes),
        state_names={each: [0, 1] for each in (node, *causes)},
    )


FORMATS: dict[str, Format] = {
    format.name: format
    for format in (
        Format("yaml", (".yaml", ".yml"), "the toolkit's own schema file", Schema.to_yaml,
               lambda text, _: parse_schema(text)),
        Format("line", (".txt",), "one line of text: A -> B, C; B | C -> door",
               lambda schema: one_line(schema) + "\n", parse_line),
        Format("node-link", (".json",), "networkx node-link JSON, also for D3",
               _write_node_link, _read_node_link),
        Format("gml", (".gml",), "Graph Modelling Language: networkx, Gephi, igraph, yEd",
               lambda schema: "\n".join(nx.generate_gml(_text_graph(schema))) + "\n", _read_gml),
        Format("dot", (".dot", ".gv"), "Graphviz", lambda schema: dot_text(_text_graph(schema)),
               lambda text, name: schema_of_graph(parse_graph(text, "dot"), "dot", name)),
        Format("dagitty", (".dagitty",), "DAGitty in the browser and in R",
               lambda schema: dagitty_text(_text_graph(schema)), _read_dagitty),
        Format("bif", (".bif",), "Bayesian network: pgmpy, bnlearn", _write_bif),
    )
}  # fmt: skip
