"""Schemas in the file formats of other programs.

A schema is written as a graph of networkx with plain attributes: ``name``, ``title`` and ``inert``
of the graph; ``kind`` (lever or door) and ``gate`` (``any``, ``all``, ``at_least 2``) of a node;
``strength`` of an edge. Levers have the order of the nodes. What a graph from elsewhere lacks has
its default: gates are ``any``, strengths 1, no lever is inert. Where no node is named ``door``,
nodes are known by their ``label`` or ``name``, and in DAGitty the ``outcome`` is the door.

How a graph is drawn is ignored. Whatever else a node or an edge says is refused by name, such as
``style=invis``, ``arrowhead=tee``, or a weight that may be meant as a strength.

DAGitty has no attributes of a graph, so they are on the door, and ``beta`` is the strength. BIF can
only be written: it holds the tables of
:func:`~causal_openlock.schemas.bayes_net.to_bayesian_network`, not their gates.
"""

from __future__ import annotations

import html
import io
import json
import re
import warnings
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import redirect_stdout, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree

import networkx as nx

from causal_openlock.errors import FileError, OpenLockError, SchemaError, together
from causal_openlock.files.atomic import write_text
from causal_openlock.files.yaml_file import Document, read_text
from causal_openlock.schemas.bayes_net import bif_text
from causal_openlock.schemas.one_line import one_line, parse_line
from causal_openlock.schemas.schema import DOOR, NAME, Schema, SchemaData, schema_from_dict
from causal_openlock.wording import nearest


class Format(NamedTuple):
    """A file format: suffixes of its files, and how it is written and read with a default name."""

    suffixes: tuple[str, ...]
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
    return FORMATS[_known(format)].write(schema)


def import_schema(text: str, format: str, name: str = "imported") -> Schema:
    """A schema from text in one of :data:`FORMATS`, called ``name`` if the text has no name.

    Raises:
        OpenLockError: If there is no such format, it can only be written, or the text is not in it
            or not a schema.
    """
    return _parsed(text, _known(format), name, f"this {format} text")


def write_schema(schema: Schema, path: Path | str, format: str | None = None) -> None:
    """Write a schema to a file, over one that is there; by default its suffix gives the format.

    Raises:
        OpenLockError: If the format is unknown, or the file cannot be written.
    """
    write_text(path, export_schema(schema, format or Path(path).suffix))


def read_schema(path: Path | str, format: str | None = None) -> Schema:
    """Read a schema from a file; by default its suffix gives the format and its name the name.

    Raises:
        FileError: With line, column and remedy of every fault of a schema file.
        OpenLockError: If the file cannot be read or holds no schema; the text begins with its path.
    """
    path = Path(path)
    format, text = _known(format or path.suffix), read_text(path)
    if format == "yaml":
        return _yaml_schema(text, path)
    stem = path.stem.replace("-", "_").replace(" ", "_")
    return _parsed(text, format, stem if NAME.fullmatch(stem) else "imported", str(path))


def _known(name: str) -> str:
    """The name of a format, from its name or a suffix of its files."""
    names = {name: name for name in FORMATS}
    names |= {end: format for format in FORMATS for end in FORMATS[format].suffixes}
    for key in (name, name.lower(), f".{name}"):
        if key in names:
            return names[key]
    raise OpenLockError(f"there is no schema format {name!r:.64}; {nearest(name[:64], names)}")


def _parsed(text: str, format: str, name: str, what: str) -> Schema:
    """The schema of a text; each fault says what has it."""
    if (read := FORMATS[format].read) is None:
        readable = ", ".join(other for other in FORMATS if FORMATS[other].read)
        raise OpenLockError(f"{format} can only be written; formats that are read: {readable}")
    try:
        with warnings.catch_warnings(action="ignore"):
            return read(text, name)
    except FileError:
        raise
    except OpenLockError as error:
        faults = [SchemaError(f"{what}: {part}", part.at) for part in error.parts]
    except Exception as error:  # libraries raise what they like at a text that is no graph
        why = " ".join(f"{type(error).__name__} {error}".split())[:160]
        faults = [SchemaError(f"{what} cannot be read as {format} ({why}); correct it")]
    raise together(faults)


# -- a graph as a schema ---------------------------------------------------------------------------

_LOOKS = re.compile(
    r"""(arrow(head|tail)|targetArrow)=(normal|vee|open|empty|onormal|standard|delta|plain)
      | arrow=(last|first) | dir=(forward|back) | sourceArrow=none | (value|weight)=1(\.0)?
      | (style|color|penwidth)=(?!.*(invis|transparent|none)|0+\.?0*$|.*\#\w{6}00$).*
      | (fillcolor | fill | arrowsize | outline | smooth\w* | bend | edgeAnchor
        | label(font\w+|angle|distance|loc) | LabelGraphics | font(name|size|color) | image | size
        | shape(_type)? | sides | peripheries | regular | orientation | fixedsize | len | minlen
        | width | height | margin | pos | lp | [fv]?[xyz] | [whdrgb] | point | Line
        | (head|tail)port | same(head|tail) | group | ordering | rank | id | index | key | comment
        | description | tooltip | url | href | constraint)=.*""",
    re.VERBOSE | re.IGNORECASE | re.DOTALL,
)
"""How a node or an edge is drawn, if it is seen and leads from its cause to its effect.

``arrow=first`` and ``dir=back`` turn an edge.
"""
_OF_NODES = ("gate", "label", "name", "graphics", "exposure")


def schema_of_graph(graph: nx.Graph, name: str, changes: Mapping[str, Any]) -> Schema:
    """The schema that a graph holds, from a file or from networkx, with changes.

    Raises:
        OpenLockError: If it holds none.
    """
    if not graph.is_directed():
        raise SchemaError("the graph is not directed; write edges as cause -> effect")
    for key in ("label", "name"):
        labels = dict(graph.nodes(data=key))
        if DOOR not in graph and all(isinstance(label, str) for label in labels.values()):
            if len({*labels.values()}) < len(labels):
                raise SchemaError(f"two nodes have the same {key}; give each its own")
            graph = nx.relabel_nodes(graph, labels)
    if DOOR not in graph:
        raise SchemaError(
            f"no node is named {DOOR}; rename the one that stands for the door; "
            f"{nearest(DOOR, map(str, graph))[:500]}"
        )
    inert = graph.graph.get("inert", [])
    data: dict[str, Any] = {
        "name": graph.graph.get("name") or name,
        "title": graph.graph.get("title", ""),
        "levers": [node for node in graph if node != DOOR],
        "edges": {},
        "gates": {},
        "inert": inert.split() if isinstance(inert, str) else inert,
    }
    for node, says in graph.nodes(data=True):
        kind = "kind=door" if node == DOOR else "kind=lever"
        _check(f"the node {node!s:.64}", says, (*_OF_NODES, kind))
        data["gates"][node] = says.get("gate", "any")
    for cause, effect, says in graph.edges(data=True):
        edge = f"the edge {cause!s:.64} -> {effect!s:.64}"
        strength = says.get("strength", 1.0)
        with suppress(ValueError):
            strength = float(strength) if isinstance(strength, str) else strength
        label = f"label={strength:g}" if isinstance(strength, float) else "label="
        _check(edge, says, ("strength", "label=", "label=none", label))
        if str(says.get("dir", says.get("arrow"))).lower() in ("back", "first"):
            cause, effect = effect, cause
        if effect in data["edges"].setdefault(cause, {}):
            raise SchemaError(f"{edge} is there twice; remove one of them")
        data["edges"][cause][effect] = {"strength": strength}
    return schema_from_dict(data | dict(changes))


def _check(what: str, says: Mapping[str, Any], read: Collection[str]) -> None:
    """Refuse what a node or an edge says, if it is neither read nor a look."""
    for key, value in says.items():
        said = f"{key}={value}"
        if key not in read and said not in read and not _LOOKS.fullmatch(said):
            raise SchemaError(f"{what} says {said:.99}, which is not understood; take it out")


# -- the formats ----------------------------------------------------------------------------------


def _graph_of(schema: Schema) -> nx.DiGraph:
    """The schema as a graph whose attributes are texts and numbers."""
    graph = nx.DiGraph(schema.graph, title=schema.title)
    if schema.inert:
        graph.graph["inert"] = " ".join(schema.inert)
    for node, says in graph.nodes(data=True):
        gate = str(says.pop("gate")).replace("at least", "at_least")
        says |= {"gate": gate} if schema.causes(node) else {}
    return graph


def _written(lines: Callable[[nx.DiGraph], Iterable[str]]) -> Callable[[Schema], str]:
    """The writer of a format from what makes lines of a graph."""
    return lambda schema: "\n".join([*lines(_graph_of(schema)), ""])


def _read(graph_of: Callable[[str], nx.Graph]) -> Callable[[str, str], Schema]:
    """The reader of a format from what makes a graph of its text."""
    return lambda text, name: schema_of_graph(graph_of(text), name, {})


def _yaml_schema(text: str, path: Path | str = "<text>") -> Schema:
    schema: Schema = Document(text, path).validate(SchemaData)
    return schema


def _node_link_lines(graph: nx.DiGraph) -> Iterator[str]:
    yield json.dumps(nx.node_link_data(graph, edges="edges"), indent=2, ensure_ascii=False)


def _node_link_graph(text: str) -> nx.Graph:
    data = json.loads(text)
    data["graph"] = dict(data.get("graph", {}))
    edges = "edges" if "edges" in data else "links"
    # Every edge is kept, whatever its key, so that a doubled one is seen.
    graph = nx.node_link_graph({**data, "multigraph": True}, directed=True, edges=edges, key="")
    if len(graph) != len(data["nodes"]):
        raise SchemaError("a node is there twice, or only in an edge")
    return graph


def _gml_graph(text: str) -> nx.Graph:
    graph = nx.parse_gml(text, label="id")
    if "title" in graph.graph:  # networkx takes the texts "()" and "[]" for empty lists
        graph.graph["title"] = str(graph.graph["title"])
    for says in graph.edges.values():
        drawing = dict(says.pop("graphics", {}))
        drawing.pop("type", None)  # of line
        says |= drawing
    return graph


def _graphml_graph(text: str) -> nx.Graph:
    """The graph; networkx would pass over doubled and nested parts, and arrows of yEd."""
    tags = []
    for element in ElementTree.fromstring(text).iter():
        tags.append(element.tag.rpartition("}")[2])
        ends = element.get("source"), element.get("target")
        seen = ends[0] == "none" and _LOOKS.fullmatch(f"targetArrow={ends[1]}")
        if tags[-1] == "Arrows" and not seen:
            raise SchemaError(f"an edge has the arrows {ends}, not an effect")
    graph = nx.parse_graphml(text, force_multigraph=True)
    if (len(graph), graph.number_of_edges()) != (tags.count("node"), tags.count("edge")):
        raise SchemaError("a node or an edge is there twice, or outside of the graph")
    for kind, parts in (("node", graph.nodes), ("edge", graph.edges)):
        for says in parts.values():
            says |= {**graph.graph[f"{kind}_default"], **says}
    return graph


_TEXT = r'"(?:[^"\\]|\\.)*"'
_COMMENT = r"//[^\n]*|/\*.*?\*/|^\#[^\n]*"
_TEXT_OR_COMMENT = re.compile(f"{_TEXT}|{_COMMENT}", re.DOTALL | re.MULTILINE)


def _dot_graph(text: str) -> nx.Graph:
    """The graph; pydot would read ``--`` as ``->``, and pass over what follows the graph."""
    try:
        import pydot
    except ImportError:
        raise OpenLockError("DOT is read by pydot; pip install 'causal-openlock[dot]'") from None
    body = _TEXT_OR_COMMENT.sub('""', text).partition("{")[2]
    for sign, what in (("--", "an edge without direction"), ("{", "a group or subgraph")):
        if sign in body:
            raise SchemaError(f"it has {what} ({sign}); write each edge as A -> B")
    with redirect_stdout(io.StringIO()) as complaint:
        drawings = pydot.graph_from_dot_data(text)
    if not drawings or body.rpartition("}")[2].strip():
        raise ValueError(complaint.getvalue()[-100:] or "text follows the graph")
    (drawing,) = drawings
    graph = (nx.MultiDiGraph if drawing.get_type() == "digraph" else nx.MultiGraph)()
    default: dict[str, dict[str, str]] = {"graph": {}, "node": {}, "edge": {}}
    parts: list[Any] = [*drawing.get_nodes(), *drawing.get_edges()]
    for part in sorted(parts, key=lambda part: part.get_sequence()):
        says = {_unquoted(key): _unquoted(value) for key, value in part.get_attributes().items()}
        if isinstance(part, pydot.Edge):
            ends = [_unquoted(end) for end in (part.get_source(), part.get_destination())]
            graph.add_nodes_from((end, default["node"]) for end in ends if end not in graph)
            graph.add_edges_from([(*ends, default["edge"] | says)])
        elif part.get_name() in default:
            default[part.get_name()] |= says
        else:
            node = _unquoted(part.get_name())
            graph.add_nodes_from([(node, says if node in graph else default["node"] | says)])
    about = {key: _unquoted(value) for key, value in drawing.get_attributes().items()}
    graph.graph = {"name": _unquoted(drawing.get_name()), **default["graph"], **about}
    return graph


_NODE = rf"{_TEXT}|[\w.]+"
_LINK = re.compile(rf"\s*([-<>@]{{2,3}})\s*({_NODE})")
_ATTRIBUTE = re.compile(rf"({_TEXT}|\w+)\s*(?:=\s*({_TEXT}|[^\s,\]]+))?")
_DAGITTY = re.compile(rf"\s*(?:dag|digraph)\s*({_TEXT}|\w*)\s*\{{(.*)\}}\s*", re.DOTALL)
_STATEMENT = re.compile(
    rf"\w+\s*=\s*{_TEXT}|({_NODE})((?:{_LINK.pattern})*)\s*(?:\[((?:{_TEXT}|[^\]\"])*)\])?"
)


def _dagitty_graph(text: str) -> nx.Graph:
    parts = _DAGITTY.fullmatch(text)
    if not parts:
        raise SchemaError("it is written `dag { A -> B }`; is this the right file?")
    body = _TEXT_OR_COMMENT.sub(lambda part: part[0] if part[0][0] == '"' else " ", parts[2])
    if rest := _STATEMENT.sub("", body).strip("; \t\r\n"):
        raise SchemaError(f"it is not understood at {rest!r:.64}")
    graph = nx.MultiDiGraph(name=_unquoted(parts[1]))
    for first, chain, *_, attributes in _STATEMENT.findall(body):
        if not first:  # a setting of the drawing
            continue
        links = _LINK.findall(chain)
        nodes = [_unquoted(node) for node in (first, *(node for _, node in links))]
        said = _ATTRIBUTE.findall(attributes)
        says = {_unquoted(key): _unquoted(value) if value else True for key, value in said}
        graph.add_nodes_from(nodes if links else [(nodes[0], says)])
        for (arrow, _), ends in zip(links, pairwise(nodes), strict=True):
            if arrow not in ("->", "<-"):
                raise SchemaError(f"{arrow} is not -> from cause to effect")
            graph.add_edges_from([(*(ends if arrow == "->" else ends[::-1]), says)])
    outcomes = [node for node, says in graph.nodes(data=True) if "outcome" in says]
    if DOOR not in graph and len(outcomes) == 1:
        graph = nx.relabel_nodes(graph, {outcomes[0]: DOOR})
    door = graph.nodes.get(DOOR, {})
    door.pop("outcome", None)
    graph.graph |= {key: door.pop(key) for key in ("title", "inert") if key in door}
    for says in graph.edges.values():
        says |= {"strength": says.pop("beta", 1.0)}
    return graph


def _unquoted(text: Any) -> str:
    """A name or value of DOT or DAGitty, without a port."""
    if (text := str(text)).startswith('"'):
        inside = text[1 : text.rindex('"')]
        return html.unescape(inside.replace("\\\n", "").replace('\\"', '"'))
    return text.partition(":")[0]


def _quoted(text: object) -> str:
    """A quoted text of DOT or DAGitty; characters that could end it become entities."""
    return '"' + re.sub(r'[&"\\\n\r]', lambda sign: f"&#{ord(sign[0])};", str(text)) + '"'


def _line(says: Mapping[str, object], *ends: str) -> str:
    """A node or an edge, with what it says in brackets."""
    written = [key if value is True else f"{key}={_quoted(value)}" for key, value in says.items()]
    return f"  {' -> '.join(map(_quoted, ends))}" + (f" [{', '.join(written)}]" if says else "")


def _dot_lines(graph: nx.DiGraph) -> Iterator[str]:
    """The schema in DOT; the door is drawn as a box, inert levers are dashed."""
    yield f"digraph {_quoted(graph.name)} {{"
    yield from (f"  {key}={_quoted(text)}" for key, text in graph.graph.items() if key != "name")
    for node, says in graph.nodes(data=True):
        look = {"style": "dashed"} if node in graph.graph.get("inert", "").split() else {}
        yield _line({**says, **look, "shape": "box" if node == DOOR else "circle"}, node)
    for cause, effect, says in graph.edges(data=True):
        label = {"label": f"{says['strength']:g}"} if says["strength"] < 1.0 else {}
        yield _line(says | label, cause, effect)
    yield "}"


def _dagitty_lines(graph: nx.DiGraph) -> Iterator[str]:
    """The schema in DAGitty's language; the attributes of the graph are on the door."""
    about = {key: text for key, text in graph.graph.items() if key != "name"}
    yield f"dag {_quoted(graph.name)} {{"
    for node, says in graph.nodes(data=True):
        free = "gate" not in says and node not in about.get("inert", "").split()
        role = {"outcome": True, **about} if node == DOOR else {"exposure": True} if free else {}
        gate = {"gate": says["gate"]} if says.get("gate", "any") != "any" else {}
        yield _line(role | gate, node)
    for *ends, strength in graph.edges(data="strength"):
        yield _line({"beta": strength} if strength < 1.0 else {}, *ends)
    yield "}"


FORMATS: dict[str, Format] = {
    "yaml": Format((".yaml", ".yml"), Schema.to_yaml, lambda text, _: _yaml_schema(text)),
    "line": Format((".txt",), lambda schema: one_line(schema) + "\n", parse_line),
    "node-link": Format((".json",), _written(_node_link_lines), _read(_node_link_graph)),
    "gml": Format((".gml",), _written(nx.generate_gml), _read(_gml_graph)),
    "graphml": Format((".graphml",), _written(nx.generate_graphml), _read(_graphml_graph)),
    "dot": Format((".dot", ".gv"), _written(_dot_lines), _read(_dot_graph)),
    "dagitty": Format((".dagitty",), _written(_dagitty_lines), _read(_dagitty_graph)),
    "bif": Format((".bif",), bif_text),
}
"""All formats by name."""
