"""Schemas as structures and back, side by side, and in words.

Beliefs name levers by their positions, as people see the room. Two schemas are the same structure
if they have the same edges and gates, and behave alike if no attempt can tell them apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import networkx as nx
import numpy as np

from causal_openlock.belief.structures import NEVER, Structures
from causal_openlock.schemas.schema import DOOR, Gate, Schema
from causal_openlock.wording import joined
from causal_openlock.world.room import Room, position_names


def structure_of(schema: Schema) -> Structures:
    """The schema as one structure, its levers in their order."""
    names = [*schema.levers, DOOR]
    return Structures(
        np.array([[schema.mask(schema.causes(node)) for node in names]], dtype=np.uint16),
        np.array([[schema.threshold(node) for node in names]], dtype=np.uint8),
    )


def schema_of(structure: Structures, names: Sequence[str], strength: float) -> Schema:
    """One structure as a schema of the levers that can move; all its edges are equally strong."""
    nodes = [*names, DOOR]
    can_move = np.flatnonzero(structure.threshold[0] < NEVER).tolist()
    edges: dict[str, dict[str, float]] = {}
    gates: dict[str, Gate] = {}
    for node in can_move:
        causes = [nodes[lever] for lever in can_move if structure.causes[0, node] >> lever & 1]
        for cause in causes:
            edges.setdefault(cause, {})[nodes[node]] = strength
        enough = int(structure.threshold[0, node])
        if enough > 1:
            gates[nodes[node]] = Gate("all") if enough == len(causes) else Gate("at_least", enough)
    without_effect = structure.inert()[0]
    inert = [nodes[lever] for lever in can_move if without_effect >> lever & 1]
    levers = [nodes[lever] for lever in can_move[:-1]]
    return Schema("belief", levers, edges, gates=gates, inert=inert, title="Most probable")


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
    first, second = _beside(one, other).labels()
    return bool((first == second).all())


def behave_alike(one: Schema, other: Schema, actions: int) -> bool:
    """Whether no attempt of ``actions`` actions can distinguish two schemas, strengths aside.

    Levers of equal names are at the same position, and a lever that one of them lacks never moves
    in it.
    """
    first, second = _beside(one, other).behaviour(actions)
    return bool((first == second).all())


def _beside(one: Schema, other: Schema) -> Structures:
    """Two schemas as structures on the levers that at least one schema has."""
    names = sorted({*one.levers, *other.levers})
    return Structures.joined(
        [
            structure_of(schema).on_slots([*map(names.index, schema.levers)], len(names))
            for schema in (one, other)
        ]
    )


def in_words(schema: Schema) -> str:
    """A structure in words; levers with the same causes and gate share a clause.

    >>> in_words(Schema("CC3", ["A", "B", "C"], {"A": ["B", "C"], "B": ["door"], "C": ["door"]}))
    'A enables B and C; B or C unlocks the door'
    """
    groups: dict[tuple[tuple[str, ...], int], list[str]] = {}
    generations = [*nx.topological_generations(schema.graph)]  # causes before effects
    for lever in (lever for each in generations for lever in schema.levers if lever in each):
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


def _needed(causes: Sequence[str], enough: int, verb: str) -> str:
    if len(causes) == 1:
        return f"{causes[0]} {verb}s"
    if enough == 1:
        return f"{', '.join(causes[:-1])} or {causes[-1]} {verb}s"
    if enough == len(causes):
        return f"{joined(causes)} together {verb}"
    return f"any {enough} of {joined(causes)} {verb}"
