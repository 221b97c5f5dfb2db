"""Causal structures in plain words."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from causal_openlock.world.schema import DOOR, Schema


def told(schema: Schema) -> str:
    """A structure in plain words, such as ``UPPER enables LEFT and LOWER; LEFT unlocks the door``.

    Levers with the same causes and gate are told together, causes before effects.
    """
    groups: dict[tuple[tuple[str, ...], int], list[str]] = {}
    for lever in _causes_first(schema):
        if causes := schema.causes(lever):
            groups.setdefault((causes, schema.threshold(lever)), []).append(lever)
    clauses = [
        f"{_needed(causes, enough, 'enable')} {_listed(effects, 'and')}"
        for (causes, enough), effects in groups.items()
    ]
    clauses.append(f"{_needed(schema.causes(DOOR), schema.threshold(DOOR), 'unlock')} the door")
    if schema.inert:
        idle = _listed(schema.inert, "and")
        clauses.append(f"{idle} {'do' if len(schema.inert) > 1 else 'does'} nothing for the door")
    strengths = {strength for *_, strength in schema.graph.edges(data="strength")}
    if strengths != {1.0}:
        low, high = min(strengths), max(strengths)
        clauses.append(
            f"strength {low:.2f}" if low == high else f"strengths {low:.2f} to {high:.2f}"
        )
    return "; ".join(clauses)


def _causes_first(schema: Schema) -> list[str]:
    left, ordered = list(schema.levers), list[str]()
    while left:
        ready = [lever for lever in left if not {*schema.causes(lever)} & {*left}]
        ordered += ready
        left = [lever for lever in left if lever not in ready]
    return ordered


def _needed(causes: Sequence[str], enough: int, verb: str) -> str:
    if len(causes) == 1:
        return f"{causes[0]} {verb}s"
    if enough == 1:
        return f"{_listed(causes, 'or')} {verb}s"
    if enough == len(causes):
        return f"{_listed(causes, 'and')} together {verb}"
    return f"any {enough} of {_listed(causes, 'and')} {verb}"


def _listed(names: Iterable[str], word: str) -> str:
    *before, last = names
    return f"{', '.join(before)} {word} {last}" if before else last
