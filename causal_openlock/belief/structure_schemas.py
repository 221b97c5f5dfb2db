"""A believed structure as a schema: beside the true one, and in words.

Levers are named by their positions, as people see the room. Two schemas are the same structure if
they have the same edges and gates, and behave alike if no attempt can tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence

from causal_openlock.wording import joined
from causal_openlock.world.room import Room, position_names
from causal_openlock.world.schema import DOOR, Schema


def by_position(room: Room) -> Schema:
    """The schema of a room with its levers named by their positions."""
    schema = room.schema
    name = {**room.layout.as_mapping(schema), DOOR: DOOR}
    order = position_names(room.positions).index
    edges: dict[str, dict[str, float]] = {}
    for cause, effect, strength in schema.graph.edges(data="strength"):
        edges.setdefault(name[cause], {})[name[effect]] = strength
    return Schema(
        schema.name,
        sorted((name[lever] for lever in schema.levers), key=order),
        edges,
        gates={name[node]: schema.gate(node) for node in name if schema.causes(node)},
        inert=[name[lever] for lever in schema.inert],
        title=schema.title,
    )


def same_structure(one: Schema, other: Schema) -> bool:
    """Whether two schemas have the same levers, edges and gates, whatever their strengths.

    >>> one = Schema("one", ["A", "B"], {"A": {"B": 0.5}, "B": ["door"]})
    >>> same_structure(one, Schema("other", ["A", "B"], {"A": ["B"], "B": ["door"]}))
    True
    """
    return _gates(one) == _gates(other)


def _gates(schema: Schema) -> dict[str, tuple[frozenset[str], int]]:
    return {
        node: (frozenset(schema.causes(node)), schema.threshold(node))
        for node in [*schema.levers, DOOR]
    }


def behave_alike(one: Schema, other: Schema, actions: int) -> bool:
    """Whether no attempt of so many actions tells two schemas apart, whatever their strengths.

    Args:
        one: A schema.
        other: Another; levers of equal names stand at the same position, and a lever that it lacks
            never moves in it.
        actions: Actions in an attempt.
    """
    levers = {*one.levers, *other.levers}
    reached: set[frozenset[str]] = {frozenset()}
    seen: set[frozenset[str]] = set()
    for depth in range(actions + 1):
        following = set()
        for pushed in reached:
            if _shown(one, pushed) != _shown(other, pushed):
                return False
            if depth < actions:
                moving = {lever for lever in levers if _holds(one, lever, pushed)}
                if moving != {lever for lever in levers if _holds(other, lever, pushed)}:
                    return False
                following |= {pushed ^ {lever} for lever in moving}
        seen |= reached
        reached = following - seen
    return True


def _holds(schema: Schema, node: str, pushed: frozenset[str]) -> bool:
    known = node == DOOR or node in schema.levers
    return known and len(pushed & {*schema.causes(node)}) >= schema.threshold(node)


def _shown(schema: Schema, pushed: frozenset[str]) -> tuple[bool, frozenset[str] | None]:
    """Whether the door is unlocked, and the solution that opening it would complete."""
    relevant = pushed - {*schema.inert}
    completes = any(relevant == {*levers} for levers in schema.solutions)
    return _holds(schema, DOOR, pushed), relevant if completes else None


def in_words(schema: Schema) -> str:
    """A structure in words; levers with the same causes and gate share a clause.

    >>> in_words(Schema("CC3", ["A", "B", "C"], {"A": ["B", "C"], "B": ["door"], "C": ["door"]}))
    'A enables B and C; B or C unlocks the door'
    """
    groups: dict[tuple[tuple[str, ...], int], list[str]] = {}
    for lever in _causes_first(schema):
        if causes := schema.causes(lever):
            groups.setdefault((causes, schema.threshold(lever)), []).append(lever)
    clauses = [
        f"{_needed(causes, enough, 'enable')} {joined(effects)}"
        for (causes, enough), effects in groups.items()
    ]
    clauses.append(f"{_needed(schema.causes(DOOR), schema.threshold(DOOR), 'unlock')} the door")
    if schema.inert:
        verb = "do" if len(schema.inert) > 1 else "does"
        clauses.append(f"{joined(schema.inert)} {verb} nothing for the door")
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
        ordered += [lever for lever in left if not {*schema.causes(lever)} & {*left}]
        left = [lever for lever in left if lever not in ordered]
    return ordered


def _needed(causes: Sequence[str], enough: int, verb: str) -> str:
    if len(causes) == 1:
        return f"{causes[0]} {verb}s"
    if enough == 1:
        return f"{', '.join(causes[:-1])} or {causes[-1]} {verb}s"
    if enough == len(causes):
        return f"{joined(causes)} together {verb}"
    return f"any {enough} of {joined(causes)} {verb}"
