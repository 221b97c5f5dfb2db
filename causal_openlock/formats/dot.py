"""Directed graphs in DOT (Graphviz) and in DAGitty's dialect of it.

Both are lists of statements in braces: nodes and edges with attributes in brackets, and
``key=value`` for the whole graph. Also read are chains ``a -> b -> c``, groups ``{a b} -> c``,
defaults (``edge [strength=0.5]``), subgraphs, ports, comments, and ``<-`` in DAGitty. Edges without
direction and labels in HTML are refused.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import networkx as nx

from causal_openlock.errors import SchemaError

HEADS = {"dot": ("digraph",), "dagitty": ("dag", "digraph")}
MAX_DEPTH = 16

TOKEN = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|/\*.*?\*/|^\#[^\n]*)
      | "(?P<quoted>(?:[^"\\]|\\.)*)"
      | (?P<edge><->|@-@|@->|<-@|@--|--@|->|<-|--)
      | (?P<word>-?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?![\w.])|[^\W]\w*(?:\.\w+)*)
      | (?P<mark>[{}\[\]=;,:])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


@dataclass(frozen=True)
class Token:
    """A token: its kind, its text, and its line."""

    kind: str
    text: str
    line: int

    def __str__(self) -> str:
        return repr(self.text) if self.kind != "end" else "the end of the text"


def parse_graph(text: str, format: str) -> nx.DiGraph:
    """The graph of a text, with all attributes as strings.

    Args:
        text: The whole text.
        format: ``dot`` or ``dagitty``; errors name it.

    Raises:
        SchemaError: If the text is no directed graph in that format.

    Example:
        >>> list(parse_graph("digraph { a -> b -> c }", "dot").edges)
        [('a', 'b'), ('b', 'c')]
    """
    return _Reader(text, format).graph_()


def dot_text(graph: nx.DiGraph) -> str:
    """A schema's graph in DOT; the door is drawn as a box, inert levers are dashed."""
    about = dict(graph.graph)
    lines = [f"digraph {_quoted(about.pop('name'))} {{"]
    lines += [f"  {key}={_quoted(value)};" for key, value in about.items()]
    lines += ["  node [shape=circle];"]
    inert = about.get("inert", "").split()
    for node, data in graph.nodes(data=True):
        look = {"shape": "box"} if data["kind"] == "door" else {}
        look |= {"style": "dashed"} if node in inert else {}
        lines.append(f"  {_quoted(node)}{_attributes({**data, **look})};")
    for cause, effect, data in graph.edges(data=True):
        look = {"label": f"{data['strength']:g}"} if data["strength"] < 1.0 else {}
        lines.append(f"  {_quoted(cause)} -> {_quoted(effect)}{_attributes({**data, **look})};")
    return "\n".join([*lines, "}"]) + "\n"


def dagitty_text(graph: nx.DiGraph) -> str:
    """A schema's graph in DAGitty's language; the attributes of the graph are on the door."""
    about = dict(graph.graph)
    lines = [f"dag {_quoted(about.pop('name'))} {{"]
    inert = about.get("inert", "").split()
    for node, data in graph.nodes(data=True):
        values: dict[str, object] = {}
        if data["kind"] == "door":
            values = {"outcome": True}
        elif "gate" not in data and node not in inert:
            values = {"exposure": True}
        if data.get("gate", "any") != "any":
            values["gate"] = data["gate"]
        if data["kind"] == "door":
            values |= about
        lines.append(_quoted(node) + _attributes(values))
    for cause, effect, strength in graph.edges(data="strength"):
        beta = {"beta": strength} if strength < 1.0 else {}
        lines.append(f"{_quoted(cause)} -> {_quoted(effect)}{_attributes(beta)}")
    return "\n".join([*lines, "}"]) + "\n"


def _quoted(text: object) -> str:
    """A quoted string of either format; characters that could end it become entities."""
    entities = {"&": "&amp;", '"': "&quot;", "\\": "&#92;", "\n": "&#10;", "\r": "&#13;"}
    return '"' + "".join(entities.get(letter, letter) for letter in str(text)) + '"'


def _attributes(values: Mapping[str, object]) -> str:
    """Attributes in brackets, True ones without a value; empty if there are none."""
    found = [key if value is True else f"{key}={_quoted(value)}" for key, value in values.items()]
    return f" [{', '.join(found)}]" if found else ""


class _Reader:
    def __init__(self, text: str, format: str) -> None:
        self.format = format
        self.graph = nx.DiGraph()
        self.tokens = list(self._split(text))
        self.at = 0

    def fault(self, line: int, problem: str) -> SchemaError:
        return SchemaError(f"line {line} of this {self.format} text: {problem}")

    def _split(self, text: str) -> Iterator[Token]:
        start = 0
        while start < len(text):
            match = TOKEN.match(text, start)
            line = text.count("\n", 0, start) + 1
            if match is None:
                raise self.fault(
                    line, f"cannot make sense of {text[start : start + 12]!r}; correct or quote it"
                )
            if match.lastgroup != "skip":
                kind = str(match.lastgroup)
                yield Token(kind, match[kind], line)
            start = match.end()
        yield Token("end", "", text.count("\n") + 1)

    # -- tokens -----------------------------------------------------------------------------------

    def next_is(self, *texts: str) -> bool:
        token = self.tokens[self.at]
        return token.kind in ("mark", "word", "edge") and token.text.lower() in texts

    def take(self) -> Token:
        token = self.tokens[self.at]
        self.at = min(self.at + 1, len(self.tokens) - 1)
        return token

    def take_if(self, *texts: str) -> bool:
        if self.next_is(*texts):
            self.take()
            return True
        return False

    def expect(self, text: str, where: str) -> None:
        token = self.take()
        if token.kind in ("quoted", "end") or token.text != text:
            raise self.fault(token.line, f"{text!r} is needed {where}, and here is {token}; add it")

    def identifier(self, where: str) -> str:
        token = self.take()
        if token.kind not in ("word", "quoted"):
            raise self.fault(token.line, f"a name is needed {where}, and here is {token}; add one")
        if token.kind == "quoted":
            return html.unescape(token.text.replace("\\\n", "").replace('\\"', '"'))
        return token.text

    # -- the grammar ------------------------------------------------------------------------------

    def graph_(self) -> nx.DiGraph:
        self.take_if("strict")
        first = self.tokens[self.at]
        if not self.take_if(*HEADS[self.format]):
            begin = HEADS[self.format][0]
            raise self.fault(
                first.line,
                f"a directed graph begins with `{begin} {{`, and this begins with "
                f"{first.text[:20]!r}; is this the right file?",
            )
        if not self.next_is("{"):
            self.graph.graph["name"] = self.identifier(f"after {first.text}")
        self.group({}, {}, 1)
        if (extra := self.take()).kind != "end":
            raise self.fault(extra.line, f"{extra.text!r} comes after the graph; remove it")
        return self.graph

    def group(self, of_nodes: dict[str, str], of_edges: dict[str, str], depth: int) -> list[str]:
        """Statements in braces; defaults set inside end with them. Returns the nodes named."""
        self.expect("{", "before the statements")
        if depth > MAX_DEPTH:
            raise self.fault(
                self.tokens[self.at].line, f"braces are nested deeper than {MAX_DEPTH}; unnest them"
            )
        of_nodes, of_edges = dict(of_nodes), dict(of_edges)
        named: list[str] = []
        while not self.take_if("}"):
            if self.take_if(";", ","):
                continue
            following = self.tokens[self.at + 1] if self.at + 1 < len(self.tokens) else None
            has_list = following is not None and following.kind == "mark" and following.text == "["
            if has_list and self.next_is("graph", "node", "edge"):
                defaults = {"graph": self.graph.graph, "node": of_nodes, "edge": of_edges}
                defaults[self.take().text.lower()].update(self.attributes())
            elif following is not None and following.kind == "mark" and following.text == "=":
                key = self.identifier("before =")
                self.take()
                value = self.identifier(f"after {key}=")
                if depth == 1:
                    self.graph.graph[key] = value
            else:
                named += self.path(of_nodes, of_edges, depth)
        return named

    def path(self, of_nodes: dict[str, str], of_edges: dict[str, str], depth: int) -> list[str]:
        """One node, or nodes and groups of nodes with edges between them."""
        ends = [self.nodes(of_nodes, of_edges, depth)]
        pairs: list[tuple[str, str, int]] = []
        while self.tokens[self.at].kind == "edge":
            arrow = self.take()
            ends.append(self.nodes(of_nodes, of_edges, depth))
            left, right = ends[-2:] if arrow.text == "->" else (ends[-1], ends[-2])
            if arrow.text not in ("->", "<-" if self.format == "dagitty" else "->"):
                raise self.fault(
                    arrow.line,
                    f"the edge {ends[-2][:1]} {arrow.text} {ends[-1][:1]} does not say which is "
                    "cause and which effect; write cause -> effect",
                )
            pairs += [(cause, effect, arrow.line) for cause in left for effect in right]
        given = self.attributes() if self.next_is("[") else {}
        if not pairs:
            for node in ends[0]:
                self.graph.nodes[node].update(given)
        for cause, effect, line in pairs:
            if self.graph.has_edge(cause, effect):
                raise self.fault(
                    line, f"the edge {cause} -> {effect} is listed twice; remove one of them"
                )
            self.graph.add_edge(cause, effect, **{**of_edges, **given})
        return [node for group in ends for node in group]

    def nodes(self, of_nodes: dict[str, str], of_edges: dict[str, str], depth: int) -> list[str]:
        """A node or a group of nodes, at one end of an edge or alone."""
        if self.take_if("subgraph") and not self.next_is("{"):
            self.identifier("after subgraph")
        if self.next_is("{"):
            return self.group(of_nodes, of_edges, depth + 1)
        node = self.identifier("for a node")
        while self.take_if(":"):
            self.identifier("after :")
        if node not in self.graph:
            self.graph.add_node(node, **of_nodes)
        return [node]

    def attributes(self) -> dict[str, str]:
        """Lists of attributes in brackets; one without a value gets an empty one."""
        found: dict[str, str] = {}
        while self.take_if("["):
            while not self.take_if("]"):
                if self.take_if(",", ";"):
                    continue
                key = self.identifier("in brackets")
                found[key] = self.identifier(f"after {key}=") if self.take_if("=") else ""
        return found
