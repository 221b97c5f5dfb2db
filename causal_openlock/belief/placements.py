"""The hypotheses of somebody who knows the schema: all the ways in which its levers can stand.

Levers that play the same role change places without a difference, and placements that no attempt
can tell apart are one hypothesis. Several schemas may be possible, each with its probability, and
any levers of the room may be the active ones.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from itertools import combinations

import numpy as np

from causal_openlock.belief.catalogue import solution_masks
from causal_openlock.belief.space import Hypotheses
from causal_openlock.belief.structures import NEVER, Structures, merge, renamed
from causal_openlock.world.fsm import FloatArray
from causal_openlock.world.schema import DOOR, Schema

TABLE_LIMIT = 1 << 20
"""Placements of a schema that are listed, times the sets of its levers."""


class TooLargeError(Exception):
    """An exact answer would take too long; for callers that have something else to offer."""


def placements(schema: Schema, action_limit: int) -> Hypotheses:
    """Every way in which a schema's levers can stand on as many slots, alike behaviours merged.

    Args:
        schema: What governs the room; strengths are left aside.
        action_limit: Actions in an attempt.

    Raises:
        TooLargeError: If there are too many to list.
    """
    own = _structure(schema)
    roles, many = _alike(own), ways_to_place(schema)
    if many << len(schema.levers) > TABLE_LIMIT:
        raise TooLargeError(f"{schema.name} can be placed in {many:,} ways")
    dealt = [own.relabelled(np.array(order)) for order in _deals(roles, len(schema.levers))]
    structures = Structures(
        np.concatenate([one.causes for one in dealt]),
        np.concatenate([one.threshold for one in dealt]),
    )
    first, _ = merge(structures.behaviour(action_limit))
    structures = structures[np.sort(first)]
    return Hypotheses(
        structures.causes,
        structures.threshold,
        structures.inert(),
        solution_masks(structures),
        np.zeros(len(structures), dtype=np.uint8),
    )


def ways_to_place(schema: Schema) -> int:
    """In how many ways a schema's levers can stand, those of one role being alike."""
    many = math.factorial(len(schema.levers))
    for role in _alike(_structure(schema)):
        many //= math.factorial(len(role))
    return many


def _structure(schema: Schema) -> Structures:
    """The schema as one structure, its levers in their order."""
    names = [*schema.levers, DOOR]
    return Structures(
        np.array([[schema.mask(schema.causes(node)) for node in names]], dtype=np.uint16),
        np.array([[schema.threshold(node) for node in names]], dtype=np.uint8),
    )


def mixture(
    schemas: Sequence[tuple[Schema, float]], action_limit: int, positions: int | None = None
) -> tuple[Hypotheses, FloatArray]:
    """What is possible if one of some schemas governs the room, on any of its levers.

    Args:
        schemas: Each with its prior probability; all with equally many levers and solutions, since
            grey levers and the console tell others apart.
        action_limit: Actions in an attempt.
        positions: Levers of the room, if colour does not show which of them are active; by default
            it does.

    Returns:
        H hypotheses and ``[H]`` their probabilities. Placements of a schema are equally probable;
        what several schemas allow is there once.

    Raises:
        TooLargeError: If they are too many to list.
    """
    parts = [placements(schema, action_limit) for schema, _ in schemas]
    every = Hypotheses.joined(parts)
    first, group = merge(Structures(every.causes, every.threshold).behaviour(action_limit))
    each = [prior / len(part) for part, (_, prior) in zip(parts, schemas, strict=True)]
    weight = np.bincount(group, np.repeat(each, [len(part) for part in parts]))
    own = every[first]
    levers = len(schemas[0][0].levers)
    room = positions or levers
    places = list(combinations(range(room), levers))
    whole = Hypotheses.joined([on_slots(own, slots, room) for slots in places])
    return whole, np.tile(weight / len(places), len(places))


def on_slots(own: Hypotheses, slots: tuple[int, ...], room: int) -> Hypotheses:
    """Hypotheses about few levers as hypotheses about these slots of a larger room.

    Args:
        own: Hypotheses about n levers.
        slots: The slot of each of them.
        room: Levers of the room.
    """
    names = np.array(slots)
    causes = np.zeros((len(own), room + 1), dtype=np.uint16)
    threshold = np.full((len(own), room + 1), NEVER, dtype=np.uint8)
    where = [*slots, room]
    causes[:, where], threshold[:, where] = renamed(own.causes, names), own.threshold
    return Hypotheses(
        causes,
        threshold,
        renamed(own.inert, names),
        renamed(own.solutions, names),
        own.strength,
    )


def _alike(one: Structures) -> list[list[int]]:
    """The levers in groups of those that play the same role: swapping them changes nothing."""
    roles: list[list[int]] = []
    for lever in range(one.levers):
        for role in roles:
            order = np.arange(one.levers)
            order[[lever, role[0]]] = order[[role[0], lever]]
            swapped = one.relabelled(order)
            if (swapped.causes == one.causes).all() and (swapped.threshold == one.threshold).all():
                role.append(lever)
                break
        else:
            roles.append([lever])
    return roles


def _deals(roles: list[list[int]], slots: int) -> Iterator[list[int]]:
    """Where each lever stands, in every way that matters."""

    def deal(index: int, free: tuple[int, ...], order: list[int]) -> Iterator[list[int]]:
        if index == len(roles):
            yield order.copy()
            return
        for chosen in combinations(free, len(roles[index])):
            for lever, slot in zip(roles[index], chosen, strict=True):
                order[lever] = slot
            rest = tuple(slot for slot in free if slot not in chosen)
            yield from deal(index + 1, rest, order)

    return deal(0, tuple(range(slots)), [0] * slots)
