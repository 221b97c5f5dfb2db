"""Directed graphs in DOT (Graphviz) and in DAGitty's dialect of DOT.

Both are lists of statements in braces: nodes and edges with attributes in brackets, and
``key=value`` for the whole graph. Also read are chains ``a -> b -> c``, groups ``{a b} -> c``,
defaults (``edge [strength=0.5]``), subgraphs, ports, comments, and ``<-`` in DAGitty. Edges without
direction and labels in HTML are refused.
"""

from __future__ import annotations

import html
import re
from collections.abc import Iterator, Mapping
from typing import NamedTuple

import networkx as nx

from causal_openlock.errors import SchemaError

HEADS = {"dot": ("digraph",), "dagitty": ("dag", "digraph")}
MAX_DEPTH = 16
ENTITIES = str.maketrans({"&": "&amp;", '"': "&quot;", "\\": "&#92;", "\n": "&#10;", "\r": "&#13;"})

TOKEN = re.compile(
    r"""(?P<skip>\s+|//[^\n]*|/\*.*?\*/|^\#[^\n]*)
      | "(?P<quoted>(?:[^"\\]|\\.)*)"
      | (?P<edge><->|@-@|@->|<-@|@--|--@|->|<-|--)
      | (?P<word>-?(?:\.[0-9]+|[0-9]+(?:\.[0-9]*)?)(?![\w.])|[^\W]\w*(?:\.\w+)*)
      | (?P<mark>[{}\[\]=;,:])""",
    re.VERBOSE | re.DOTALL | re.MULTILINE,
)


Defaults = dict[str, dict[str, str]]
"""The attributes set for ``graph``, and by default for each ``node`` and ``edge``."""


class Token(NamedTuple):
    """A token: its kind, its text, and its line."""

    kind: str
    text: str
    line: int

    def __str__(self) -> str:
        return repr(self.text) if self.kind != "end" else "the end of the text"


def parse_graph(text: str, format: str) -> nx.DiGraph:
    """The graph of a text, with all attributes as strings.

    Raises:
        SchemaError: If the text is not a directed graph in that format, ``dot`` or ``dagitty``.

    Example:
        >>> list(parse_graph("digraph { a -> b -> c }", "dot").edges)
        [('a', 'b'), ('b', 'c')]
    """
    return _Reader(text, format).read()


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
    return f'"{str(text).translate(ENTITIES)}"'


def _attributes(values: Mapping[str, object]) -> str:
    """Attributes in brackets, True ones without a value; empty if there are none."""
    found = [key if value is True else f"{key}={_quoted(value)}" for key, value in values.items()]
    return f" [{', '.join(found)}]" if found else ""


class _Reader:
    def __init__(self, text: str, format: str) -> None:
        self.format, self.graph, self.depth, self.at = format, nx.DiGraph(), 0, 0
        self.tokens = list(self.split(text))

    def fault(self, line: int, problem: str) -> SchemaError:
        return SchemaError(f"line {line} of this {self.format} text: {problem}")

    def split(self, text: str) -> Iterator[Token]:
        start, line = 0, 1
        while start < len(text):
            match = TOKEN.match(text, start)
            if match is None:
                raise self.fault(
                    line, f"cannot make sense of {text[start : start + 12]!r}; correct or quote it"
                )
            if match.lastgroup != "skip":
                kind = str(match.lastgroup)
                yield Token(kind, match[kind], line)
            line += text.count("\n", start, match.end())
            start = match.end()
        end = Token("end", "", line)
        yield from (end, end)  # two, as the grammar looks one token ahead

    # -- tokens -----------------------------------------------------------------------------------

    def next_is(self, *texts: str, ahead: int = 0) -> bool:
        token = self.tokens[self.at + ahead]
        return token.kind in ("mark", "word", "edge") and token.text.lower() in texts

    def take(self) -> Token:
        token = self.tokens[self.at]
        self.at += token.kind != "end"
        return token

    def take_if(self, *texts: str) -> bool:
        return self.next_is(*texts) and bool(self.take())

    def name(self, where: str) -> str:
        token = self.take()
        if token.kind not in ("word", "quoted"):
            raise self.fault(token.line, f"a name is needed {where}, and here is {token}; add one")
        if token.kind == "quoted":
            return html.unescape(token.text.replace("\\\n", "").replace('\\"', '"'))
        return token.text

    # -- the grammar ------------------------------------------------------------------------------

    def read(self) -> nx.DiGraph:
        self.take_if("strict")
        first = self.tokens[self.at]
        if not self.take_if(*HEADS[self.format]):
            raise self.fault(
                first.line,
                f"a directed graph begins with `{HEADS[self.format][0]} {{`, and this begins with "
                f"{first.text[:20]!r}; is this the right file?",
            )
        if not self.next_is("{"):
            self.graph.graph["name"] = self.name(f"after {first.text}")
        self.group({"graph": self.graph.graph, "node": {}, "edge": {}})
        if (extra := self.take()).kind != "end":
            raise self.fault(extra.line, f"{extra.text!r} comes after the graph; remove it")
        return self.graph

    def group(self, defaults: Defaults) -> list[str]:
        """Statements in braces; defaults set inside end with them. Returns the nodes named."""
        here = self.tokens[self.at]
        if not self.take_if("{"):
            raise self.fault(
                here.line, f"'{{' is needed before the statements, and here is {here}; add it"
            )
        outer = self.depth > 0  # what a subgraph says of itself says nothing of the graph
        self.depth += 1
        if self.depth > MAX_DEPTH:
            raise self.fault(here.line, f"braces are nested deeper than {MAX_DEPTH}; unnest them")
        defaults = {kind: {**values} for kind, values in defaults.items()} if outer else defaults
        named: list[str] = []
        while not self.take_if("}"):
            if self.take_if(";", ","):
                continue
            if self.next_is(*defaults) and self.next_is("[", ahead=1):
                defaults[self.take().text.lower()].update(self.attributes())
            elif self.next_is("=", ahead=1):
                key, _ = self.name("before ="), self.take()
                value = self.name(f"after {key}=")
                if self.depth == 1:
                    self.graph.graph[key] = value
            else:
                named += self.path(defaults)
        self.depth -= 1
        return named

    def path(self, defaults: Defaults) -> list[str]:
        """One node, or nodes and groups of nodes with edges between them."""
        ends = [self.nodes(defaults)]
        pairs: list[tuple[str, str, int]] = []
        while self.tokens[self.at].kind == "edge":
            arrow = self.take()
            ends.append(self.nodes(defaults))
            left, right = ends[-2:] if arrow.text == "->" else (ends[-1], ends[-2])
            if arrow.text not in ("->", "<-" if self.format == "dagitty" else "->"):
                raise self.fault(
                    arrow.line,
                    f"the edge {ends[-2][:1]} {arrow.text} {ends[-1][:1]} does not say which is "
                    "cause and which effect; write cause -> effect",
                )
            pairs += [(cause, effect, arrow.line) for cause in left for effect in right]
        given = self.attributes()
        if not pairs:
            for node in ends[0]:
                self.graph.nodes[node].update(given)
        look = {**defaults["edge"], **given}
        for cause, effect, line in pairs:
            if self.format == "dot" and self.turned(look, line):
                cause, effect = effect, cause
            if self.graph.has_edge(cause, effect):
                raise self.fault(
                    line, f"the edge {cause} -> {effect} is listed twice; remove one of them"
                )
            self.graph.add_edge(cause, effect, **look)
        return [node for group in ends for node in group]

    def turned(self, look: Mapping[str, str], line: int) -> bool:
        """Whether an edge is drawn, and meant, from its second node to its first."""
        way = look.get("dir", "forward").lower()
        head = "arrowtail" if way == "back" else "arrowhead"
        said = ""
        if way not in ("forward", "back"):
            said = f"dir={way}"
        elif look.get(head, "normal").lower() == "none":
            said = f"{head}=none"
        if said:
            raise self.fault(
                line,
                f"an edge with {said} does not say which is cause and which effect; take {said} "
                "out, or write dir=forward or dir=back",
            )
        return way == "back"

    def nodes(self, defaults: Defaults) -> list[str]:
        """A node or a group of nodes, at one end of an edge or alone."""
        if self.take_if("subgraph") and not self.next_is("{"):
            self.name("after subgraph")
        if self.next_is("{"):
            return self.group(defaults)
        node = self.name("for a node")
        while self.take_if(":"):
            self.name("after :")
        if node not in self.graph:
            self.graph.add_node(node, **defaults["node"])
        return [node]

    def attributes(self) -> dict[str, str]:
        """Lists of attributes in brackets, if any; one without a value gets an empty one."""
        found: dict[str, str] = {}
        while self.take_if("["):
            while not self.take_if("]"):
                if not self.take_if(",", ";"):
                    key = self.name("in brackets")
                    found[key] = self.name(f"after {key}=") if self.take_if("=") else ""
        return found
