"""A schema as one line of text: ``A -> B, C; B | C -> door``.

========================================= =========================================================
``A -> B, C``                             A enables B, and A enables C
``A -> B -> door``                        the same as ``A -> B; B -> door``
``A | B -> door``, ``A -> door; B -> ..`` the gate ``any``: one of the causes is enough
``A & B -> door``                         the gate ``all``
``2 of (A, B, C) -> door``                the gate ``at_least 2``; ``any of`` and ``all of`` as well
``A (0.8) -> B``, ``A -> B (0.8), C``     the strength of the edges from, or to, the name before it
``inert lamp``                            a lever that is on no path to the door on purpose
``A, B, C``                               all levers, in the order in which layouts place them
``safe: ...``, ``safe "A safe": ...``     a name, and a title as a JSON string, before all the rest
========================================= =========================================================

Semicolons or new lines separate statements, and ``#`` begins a comment. Without a list of levers,
their order is that in which they first appear. The gates ``all`` and ``at_least`` hold for all
causes of a lever, so these stand in one statement. Nothing of a schema is lost in such a line.
"""

from __future__ import annotations

import json
import re
from typing import NamedTuple

from causal_openlock.errors import SchemaError
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.wording import nearest

TOKEN = re.compile(
    r"""(?P<skip>[ \t\r\ufeff]+|\#[^\n]*)
      | (?P<title>"(?:[^"\\\n]|\\.)*")
      | (?P<mark>->|[;:,|&()\n])
      | (?P<number>(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)
      | (?P<name>[^\W\d]\w*)
      | (?P<unknown>\S+)""",
    re.VERBOSE,
)
MOST_HINTS = 20
"""Names that lead nowhere for which a nearest one is searched."""
JOINED = {"any": " | ", "all": " & "}


class _Token(NamedTuple):
    kind: str
    text: str
    at: int

    def __str__(self) -> str:
        return {"": "the end", "\n": "a new line"}.get(self.text, repr(self.text))


_Names = tuple[list[_Token], str, dict[str, float]]


class _Side(NamedTuple):
    """One side of an arrow: its names, the sign that joins them, and strengths of some."""

    names: list[_Token]
    gate: Gate | None
    mark: str
    strengths: dict[str, float]


def parse_line(text: str, name: str = "schema") -> Schema:
    """The schema of a line of text.

    Args:
        text: The line, or several lines.
        name: Its name if the text begins with none.

    Raises:
        SchemaError: Where the text cannot be understood, or is not a schema; the message names the
            column.

    Example:
        >>> parse_line("A -> B, C; B | C -> door").solutions
        (('A', 'B'), ('A', 'C'))
    """
    return _Reader(text, name).read()


def one_line(schema: Schema) -> str:
    """A schema as a line of text that :func:`parse_line` reads back, name and all.

    >>> one_line(parse_line("safe: A -> B (0.8); A & B -> door"))
    'safe: A (0.8) -> B; A & B -> door'
    """
    effects: dict[tuple[Gate, tuple[tuple[str, float], ...]], list[str]] = {}
    for node in [*schema.levers, DOOR]:
        if causes := schema.causes(node):
            sources = tuple(zip(causes, schema.strengths(node), strict=True))
            effects.setdefault((schema.gate(node), sources), []).append(node)
    statements = []
    for (gate, sources), nodes in effects.items():
        names = [name if p == 1.0 else f"{name} ({p!r})" for name, p in sources]
        if gate.kind == "any" or (gate.kind == "all" and len(names) > 1):
            group = JOINED[gate.kind].join(names)
        else:
            enough = gate.k if gate.kind == "at_least" else "all"
            group = f"{enough} of ({', '.join(names)})"
        statements.append(f"{group} -> {', '.join(nodes)}")
    if schema.inert:
        statements.append(f"inert {', '.join(schema.inert)}")
    if parse_line("; ".join(statements)).levers != schema.levers:
        statements.insert(0, ", ".join(schema.levers))
    title = schema.title != schema.name
    head = f"{schema.name} {json.dumps(schema.title, ensure_ascii=False)}" if title else schema.name
    return f"{head}: {'; '.join(statements)}"


class _Reader:
    def __init__(self, text: str, name: str) -> None:
        self.text, self.name, self.title, self.at = text, name, "", 0
        self.tokens = [
            _Token(str(match.lastgroup), match[0], match.start())
            for match in TOKEN.finditer(text)
            if match.lastgroup != "skip"
        ]
        self.tokens += [_Token("end", "", len(text))] * 3  # the grammar looks two tokens ahead
        self.levers: dict[str, int] = {}  # where each first appears
        self.listed: list[str] | None = None
        self.inert: list[str] = []
        self.edges: dict[str, dict[str, float]] = {}
        self.gates: dict[str, Gate] = {}
        self.places: dict[tuple[str, ...], int] = {}  # of each edge, and each gate

    def fault(self, at: int, problem: str) -> SchemaError:
        line, column = self.text.count("\n", 0, at) + 1, at - self.text.rfind("\n", 0, at)
        where = f"line {line}, column {column}" if "\n" in self.text.strip() else f"column {column}"
        return SchemaError(f"{where} of this schema: {problem}")

    # -- tokens -----------------------------------------------------------------------------------

    def next_is(self, *texts: str, ahead: int = 0) -> bool:
        return self.tokens[self.at + ahead].text in texts

    def take(self, kind: str, possible: str) -> _Token:
        token = self.tokens[self.at]
        if token.kind != kind:
            hint = ""
            if token.text.startswith("-0"):
                hint = "; a strength stands in brackets, as in A (0.8) -> B"
            raise self.fault(token.at, f"{token} cannot come here; possible: {possible}{hint}")
        self.at += 1
        return token

    def take_if(self, *texts: str) -> bool:
        found = self.next_is(*texts) and self.tokens[self.at].kind != "end"
        self.at += found
        return found

    def need(self, mark: str, possible: str = "") -> None:
        if not self.take_if(mark):
            self.take("", possible or repr(mark))

    def end_of_statement(self, possible: str) -> None:
        if self.tokens[self.at].kind != "end" and not self.take_if("\n"):
            self.need(";", possible)

    # -- the grammar ------------------------------------------------------------------------------

    def read(self) -> Schema:
        while self.take_if("\n"):
            pass
        if self.next_is(":", ahead=1) or self.tokens[self.at + 1].kind == "title":
            self.name = self.take("name", "the name of the schema").text
            if self.tokens[self.at].kind == "title":
                token = self.take("title", "a title")
                try:
                    self.title = str(json.loads(token.text))
                except ValueError as error:
                    raise self.fault(token.at, f"the title is not a JSON string: {error}") from None
            self.need(":", "':' after name and title")
        while self.tokens[self.at].kind != "end":
            if not self.take_if(";", "\n"):
                self.statement()
        return self.schema()

    def statement(self) -> None:
        if self.next_is("inert") and self.tokens[self.at + 1].kind == "name":
            self.at += 1
            names, _, strengths = self.names("a lever", ",")
            if strengths:
                raise self.fault(names[0].at, "after inert are levers alone, without strengths")
            self.inert += [token.text for token in names]
            self.end_of_statement("',', ';' or a new line")
            return
        sides = [self.side()]
        while self.take_if("->"):
            sides.append(self.side())
        *rest, last = sides
        first = last.names[0]
        if rest and last.mark not in ("", ","):
            raise self.fault(first.at, "effects are separated by ','; a gate joins causes")
        if not rest and (last.mark not in ("", ",") or last.strengths):
            self.take("", "'->' and what these enable")
        self.end_of_statement("'->', ',', '|', '&', a strength in brackets, ';' or a new line")
        if not rest:
            if self.listed is not None:
                raise self.fault(first.at, "all levers are listed already; name them in one list")
            self.listed = [token.text for token in last.names]
        for middle in sides[1:-1]:
            if middle.strengths:
                raise self.fault(
                    middle.names[0].at,
                    "a strength between two arrows could be of either; write two statements",
                )
        for causes, effects in zip(rest, sides[1:], strict=True):
            self.enable(causes, effects)

    def side(self) -> _Side:
        """Names before or after an arrow."""
        start = self.tokens[self.at]
        if not self.next_is("of", ahead=1):
            names, mark, strengths = self.names("a lever, the door, or '2 of ('")
            gate = {"|": Gate(), "&": Gate("all")}.get(mark)
            return _Side(names, gate, mark, strengths)
        if start.text in ("any", "all"):
            gate = Gate(start.text)
        elif start.text.isdecimal() and start.text.isascii() and len(start.text) < 4:
            gate = Gate("at_least", int(start.text))
        else:
            raise self.fault(start.at, f"before 'of' is {start}; write any, all or a whole number")
        self.at += 2
        self.need("(")
        names, mark, strengths = self.names("a lever", ",")
        self.need(")", "',' or ')'")
        return _Side(names, gate, "of", strengths)

    def names(
        self, possible: str, marks: str = ",|&"
    ) -> tuple[list[_Token], str, dict[str, float]]:
        names, mark, strengths = [], "", {}
        while True:
            token = self.take("name", possible)
            names.append(token)
            if token.text != DOOR:
                self.levers.setdefault(token.text, token.at)
            if self.take_if("("):
                strengths[token.text] = float(self.take("number", "a strength such as 0.8").text)
                self.need(")")
            here = self.tokens[self.at]
            if here.text not in (*marks,):
                return names, mark, strengths
            if mark not in ("", here.text):
                raise self.fault(here.at, f"{here} follows '{mark}'; a node has only one gate")
            mark = here.text
            self.at += 1

    def enable(self, causes: _Side, effects: _Side) -> None:
        """The edges of one arrow, and the gates of its effects."""
        for effect in effects.names:
            known = [cause for cause, enabled in self.edges.items() if effect.text in enabled]
            gate = self.gates.get(effect.text, Gate())
            if known and Gate() != (gate if gate != Gate() else causes.gate or Gate()):
                raise self.fault(
                    effect.at,
                    f"{effect.text} has causes in two statements; under a gate other than any, "
                    "name all its causes in one",
                )
            if causes.gate:
                self.gates[effect.text] = causes.gate
                self.places["gates", effect.text] = causes.names[0].at
            for cause in causes.names:
                own = self.edges.setdefault(cause.text, {})
                place = ("edges", cause.text, effect.text)
                given = [s.strengths[n.text] for s, n in ((causes, cause), (effects, effect))
                         if n.text in s.strengths]  # fmt: skip
                if effect.text in own or len(given) > 1:
                    what = "edge" if effect.text in own else "strength of"
                    raise self.fault(
                        effect.at,
                        f"the {what} {cause.text} -> {effect.text} is given twice; remove one",
                    )
                own[effect.text] = given[0] if given else 1.0
                self.places[place] = effect.at

    def schema(self) -> Schema:
        levers = self.listed or [*self.levers]
        try:
            return Schema(
                self.name, levers, self.edges, gates=self.gates, inert=self.inert, title=self.title
            )
        except SchemaError as all_of_them:
            error = all_of_them.parts[0]
            problem, last = str(error), max(self.places.values(), default=0)
            named = self.levers.get(str(error.at[-1]), last)
            at = self.places.get(tuple(map(str, error.at[:3])), named)
            if error.at[0] in ("levers", "inert") and len(error.at) == 2:
                name = (levers if error.at[0] == "levers" else self.inert)[int(error.at[1])]
                at = self.levers.get(name, 0)
            if error.at[0] == "levers" or error.at == ("edges",):
                # A name that leads nowhere may be another one, misspelt.
                nowhere = [name for name in self.levers if name not in {*self.edges, *self.inert}]
                for name in nowhere[:MOST_HINTS]:
                    hint = nearest(name, {*self.levers, DOOR} - {name})
                    if hint.startswith("did you"):
                        at, problem = self.levers[name], f"{problem}; for {name}, {hint}"
                        break
            raise self.fault(at, problem) from None
