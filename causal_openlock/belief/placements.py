"""The hypotheses of an observer who knows the schema: every placement of its levers.

Levers with the same role are interchangeable, and placements that no attempt can distinguish are
one hypothesis. Several schemas may be possible, each with its probability, and any levers of the
room may be the active ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import combinations

import numpy as np

from causal_openlock.belief.grammar import assignments
from causal_openlock.belief.structure_schemas import structure_of
from causal_openlock.belief.structures import Hypotheses, Structures, merge
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.schemas.schema import Schema

TABLE_LIMIT = 1 << 20
"""The most placements of a schema that are listed, times the subsets of its levers."""


class TooLargeError(Exception):
    """An exact answer would take too long; callers have an alternative."""


def placements(schema: Schema, action_limit: int) -> Hypotheses:
    """Every placement of a schema's levers on an equal number of slots, equal behaviours merged.

    Strengths are ignored.

    Raises:
        TooLargeError: If there are too many to list.

    Example:
        >>> from causal_openlock import find_schema
        >>> len(placements(find_schema("CC3"), 3))  # which of the three is the common cause
        3
    """
    own = structure_of(schema)
    roles, many = _alike(own), ways_to_place(schema)
    if many << len(schema.levers) > TABLE_LIMIT:
        raise TooLargeError(f"{schema.name} can be placed in {many:,} ways")
    by_role = np.argsort([lever for role in roles for lever in role])
    placed = [
        own.on_slots(np.array(slots)[by_role], own.levers)
        for slots in assignments([*map(len, roles)])
    ]
    structures = Structures.joined(placed)
    first, _ = merge(structures.behaviour(action_limit))
    return Hypotheses.of(structures[np.sort(first)])


def ways_to_place(schema: Schema) -> int:
    """The number of placements of a schema's levers, those of one role being interchangeable."""
    roles = _alike(structure_of(schema))
    return math.factorial(len(schema.levers)) // math.prod(math.factorial(len(r)) for r in roles)


def mixture(
    schemas: Sequence[tuple[Schema, float]], action_limit: int, positions: int | None = None
) -> tuple[Hypotheses, FloatArray]:
    """H hypotheses and ``[H]`` their probabilities, if one of several schemas governs the room.

    Each schema has its prior probability, and all have equally many levers and solutions, as grey
    levers and the console show these. ``positions`` are the levers of the room if colour does not
    show which are active. Placements of a schema are equally probable; behaviours that several
    schemas share are merged.

    Raises:
        TooLargeError: If they are too many to list.
    """
    parts = [placements(schema, action_limit) for schema, _ in schemas]
    every = Hypotheses.joined(parts)
    first, group = merge(every.structures.behaviour(action_limit))
    each = [prior / len(part) for part, (_, prior) in zip(parts, schemas, strict=True)]
    weight = np.bincount(group, np.repeat(each, [len(part) for part in parts]))
    own = every[first]
    levers = len(schemas[0][0].levers)
    room = positions or levers
    active = list(combinations(range(room), levers))
    whole = Hypotheses.joined([own.on_slots(slots, room) for slots in active])
    return whole, np.tile(weight / len(active), len(active))


def _alike(one: Structures) -> list[list[int]]:
    """The levers grouped by role: swapping two of a group changes nothing."""
    roles: list[list[int]] = []
    for lever in range(one.levers):
        for role in roles:
            order = np.arange(one.levers)
            order[[lever, role[0]]] = order[[role[0], lever]]
            if (one.on_slots(order, one.levers).labels() == one.labels()).all():
                role.append(lever)
                break
        else:
            roles.append([lever])
    return roles
