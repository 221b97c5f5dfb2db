"""A believed structure beside the true one: the same arrows, or at least the same behaviour."""

from __future__ import annotations

from causal_openlock.world.room import Room, position_names
from causal_openlock.world.schema import DOOR, Schema


def by_position(room: Room) -> Schema:
    """The schema of a room with its levers called by the positions where they stand."""
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


def same_arrows(one: Schema, other: Schema) -> bool:
    """Whether two structures have the same levers, arrows and gates, their strengths aside."""
    return _gates(one) == _gates(other)


def _gates(schema: Schema) -> dict[str, tuple[frozenset[str], int]]:
    return {
        node: (frozenset(schema.causes(node)), schema.threshold(node))
        for node in [*schema.levers, DOOR]
    }


def act_alike(one: Schema, other: Schema, actions: int) -> bool:
    """Whether no attempt of so many actions tells two structures apart, their strengths aside.

    Args:
        one: A structure.
        other: Another; levers of equal names stand at the same place, and a lever that it lacks
            never moves in it.
        actions: Actions in an attempt.
    """
    levers = {*one.levers, *other.levers}
    reached: set[frozenset[str]] = {frozenset()}
    seen: set[frozenset[str]] = set()
    for moment in range(actions + 1):
        following = set()
        for pushed in reached:
            if _shown(one, pushed) != _shown(other, pushed):
                return False
            if moment < actions:
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
