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
``safe: ...``                             a name, before all the rest
========================================= =========================================================

Semicolons or new lines separate statements, and ``#`` begins a comment. Without a list of levers,
their order is that in which they first appear. The gates ``all`` and ``at_least`` hold for all
causes of a lever, so these stand in one statement. Only a title is lost in such a line.
"""

from __future__ import annotations

import re
from itertools import pairwise

from causal_openlock.errors import SchemaError
from causal_openlock.schemas.schema import DOOR, Gate, Schema

_NAME = r"[^\W\d]\w*"
_HEAD = re.compile(rf"\s*({_NAME})\s*:")
_INERT = re.compile(r"inert\s+(?=\w)")
_TERM = re.compile(rf"({_NAME})\s*(?:\(\s*((?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*\))?")
_GROUP = re.compile(r"(\d{1,3}|any|all)\s+of\s*\((.*)\)", re.DOTALL)
_SIGNS = {"any": " | ", "all": " & "}


def parse_line(text: str, name: str = "schema") -> Schema:
    """The schema of a line of text.

    Args:
        text: The line, or several lines.
        name: Its name if the text begins with none.

    Raises:
        OpenLockError: With the statement that cannot be understood, or what is not a schema.

    Example:
        >>> parse_line("A -> B, C; B | C -> door").solutions
        (('A', 'B'), ('A', 'C'))
    """
    text = re.sub(r"#[^\n]*|\ufeff", "", text)
    if head := _HEAD.match(text):
        name, text = head[1], text[head.end() :]
    listed: list[str] = []
    inert: list[str] = []
    levers: dict[str, None] = {}
    edges: dict[str, dict[str, float]] = {}
    gates: dict[str, str] = {}
    for statement in filter(None, map(str.strip, re.split(r"[;\n]", text))):
        prefix = _INERT.match(statement)
        sides = [_side(side, statement) for side in _INERT.sub("", statement).split("->")]
        levers |= dict.fromkeys(name for strengths, _ in sides for name in strengths)
        strengths, gate = sides[-1]
        if gate and len(sides) > 1:
            raise _fault(statement, "effects are separated by ',', as a gate joins causes,")
        if any(p for strengths, _ in sides[1:-1] for p in strengths.values()):
            raise _fault(statement, "a strength stands between two arrows")
        if prefix or len(sides) == 1:
            if len(sides) > 1 or gate or any(strengths.values()):
                raise _fault(statement, "levers are listed by names and ',' alone")
            (inert if prefix else listed).extend(strengths)
        for (causes, gate), (effects, _) in pairwise(sides):
            for effect, at_effect in effects.items():
                if effect in gates and {gate, gates[effect]} - {"", "any"}:
                    raise _fault(statement, f"not all causes of {effect} stand")
                gates[effect] = gate or "any"
                for cause, at_cause in causes.items():
                    if effect in edges.setdefault(cause, {}) or (at_cause and at_effect):
                        text = f"{cause} -> {effect} or its strength is given twice"
                        raise _fault(statement, text)
                    edges[cause][effect] = float(at_cause or at_effect or 1)
    levers.pop(DOOR, None)
    return Schema(name, listed or [*levers], edges, gates=gates, inert=inert)


def _fault(statement: str, problem: str) -> SchemaError:
    text = f"{problem} in {statement!r:.99}; write it as in A (0.8) -> B, C; B | C -> door"
    return SchemaError(text)


def _side(text: str, statement: str) -> tuple[dict[str, str], str]:
    """The names on one side of an arrow with their strengths, and the gate that joins them."""
    gate, sign, text = "", ",", text.strip()
    if group := _GROUP.fullmatch(text):
        gate = f"at_least {group[1]}" if group[1].isdecimal() else group[1]
        text = group[2]
    elif "&" in text:
        gate, sign = "all", "&"
    elif "|" in text:
        gate, sign = "any", "|"
    strengths: dict[str, str] = {}
    for part in map(str.strip, text.split(sign)):
        term = _TERM.fullmatch(part)
        if not term or term[1] in strengths:
            problem = "is not a name" if not term else "is named twice"
            raise _fault(statement, f"{part!r:.64} {problem}")
        strengths[term[1]] = term[2] or ""
    return strengths, gate


def one_line(schema: Schema) -> str:
    """A schema as a line of text that :func:`parse_line` reads back, but for its title.

    >>> one_line(parse_line("safe: A -> B (0.8); A & B -> door"))
    'safe: A (0.8) -> B; A & B -> door'
    """
    effects: dict[tuple[Gate, tuple[str, ...]], list[str]] = {}
    for node in [*schema.levers, DOOR]:
        strengths = zip(schema.causes(node), schema.strengths(node), strict=True)
        causes = tuple(name if p == 1.0 else f"{name} ({p!r})" for name, p in strengths)
        if causes:
            effects.setdefault((schema.gate(node), causes), []).append(node)
    statements = []
    for (gate, causes), nodes in effects.items():
        if gate.kind == "any" or (gate.kind == "all" and len(causes) > 1):
            side = _SIGNS[gate.kind].join(causes)
        else:
            side = f"{gate.k if gate.kind == 'at_least' else 'all'} of ({', '.join(causes)})"
        statements.append(f"{side} -> {', '.join(nodes)}")
    if schema.inert:
        statements.append(f"inert {', '.join(schema.inert)}")
    if parse_line("; ".join(statements)).levers != schema.levers:
        statements.insert(0, ", ".join(schema.levers))
    return f"{schema.name}: {'; '.join(statements)}"
