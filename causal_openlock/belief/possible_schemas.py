"""The schemas that may govern a room, and their probabilities before anything is tried.

Schemas that differ in the names of their levers alone, or that no attempt can distinguish, are one.
Up to four levers all of them are listed, with equal odds or with the prior of the learner
``bayes``, which known rooms sharpen (:mod:`causal_openlock.belief.knowledge`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import permutations
from numbers import Real

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS, Catalogue, catalogue, feasible
from causal_openlock.belief.hypotheses import strengths
from causal_openlock.belief.knowledge import BeliefParameters, Knowledge
from causal_openlock.belief.structure_schemas import schema_of, structure_of
from causal_openlock.belief.structures import Structures, merge
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import default_action_limit
from causal_openlock.schemas.finding import schema as declared
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted

ALL, GRAMMAR = "all", "grammar"
Possible = tuple[tuple[Schema, float], ...]
"""Schemas with their probabilities."""
Among = str | Schema | Iterable[str | Schema] | Mapping[str | Schema, float]


def possible_schemas(schema: Schema, among: Among, action_limit: int) -> Possible:
    """Return the schemas that may govern a room, the one that does first, with their probabilities.

    ``among`` is that of :func:`causal_openlock.belief.worth.schema_worth`.

    Raises:
        OpenLockError: If schemas do not go together, or are too many to list.

    Example:
        >>> from causal_openlock import find_schema
        >>> len(possible_schemas(find_schema("CC3"), "all", 3))
        12
    """
    if among == ALL:
        return listed_schemas(schema, action_limit)
    if among == GRAMMAR:
        return listed_schemas(schema, action_limit, ())
    if isinstance(among, str | Schema):
        among = [among]
    if not isinstance(among, Iterable):
        raise OpenLockError(f"among is schemas, {ALL!r} or {GRAMMAR!r}, not {among!r}")
    given = among if isinstance(among, Mapping) else dict.fromkeys(among, 1.0)
    weights: dict[Schema, float] = {}
    for source, weight in given.items():
        if source in (ALL, GRAMMAR):
            raise OpenLockError(f"{source} stands alone and has no weight; leave out the others")
        other = declared(source)
        if not (isinstance(weight, Real) and 0 < float(weight) < np.inf):
            raise OpenLockError(f"the weight of {other.name} has to be more than 0, not {weight!r}")
        weights[other] = float(weight)
    weights = {schema: weights.pop(schema, 1.0), **weights}
    sizes = (len(schema.levers), len(schema.solutions))
    for other in weights:
        _check(other, action_limit)
        if (len(other.levers), len(other.solutions)) != sizes:
            raise OpenLockError(
                f"{other.name} has {counted(len(other.levers), 'lever')} and "
                f"{counted(len(other.solutions), 'solution')}, {schema.name} has {sizes[0]} and "
                f"{sizes[1]}: colours and console distinguish them; name schemas with the same "
                "numbers"
            )
    whole = sum(weights.values())
    return tuple((other, weight / whole) for other, weight in weights.items())


def _check(schema: Schema, action_limit: int) -> None:
    """Refuse a schema whose levers may fail to move, or whose solutions are too long."""
    if not schema.deterministic:
        raise OpenLockError(
            f"{schema.name} has strengths below 1, and the exact optimum is for levers that move "
            "surely; set its strengths to 1"
        )
    if action_limit < schema.least_action_limit:
        raise OpenLockError(
            f"{schema.name} needs attempts of {schema.least_action_limit} actions, and the limit "
            f"is {action_limit}; raise the limit"
        )


def listed_schemas(
    schema: Schema, action_limit: int, known_rooms: Iterable[Schema] | None = None
) -> Possible:
    """Every schema with as many levers and solutions, this one first.

    Args:
        schema: The schema that governs the room.
        action_limit: Actions in an attempt.
        known_rooms: For the prior of the grammar, the schemas of rooms known wholly before this
            one; None makes all schemas equally probable.
    """
    known_rooms = known_rooms if known_rooms is None else [*known_rooms]
    _check(schema, action_limit)
    for listed in (schema, *(known_rooms or ())):
        if len(listed.levers) > FREE_FORM_LEVERS:
            raise OpenLockError(
                f"{listed.name} has {len(listed.levers)} levers, and the schemas with more than "
                f"{FREE_FORM_LEVERS} are too many to list; name the schemas that are possible"
            )
    every = _catalogue(schema, action_limit)
    structures = every.behaviours.structures
    kind = _up_to_renaming(Structures.joined([structure_of(schema), structures]), action_limit)
    kinds, first, place = np.unique(kind[1:], return_index=True, return_inverse=True)
    chance: FloatArray = np.full(len(kinds), 1.0 / len(kinds))
    if known_rooms is not None:
        classes = _classes(known_rooms) * feasible(len(schema.levers))
        weight = every.prior(classes / classes.sum())
        chance = np.bincount(place, weight / weight.sum()).astype(float)
    names = [f"L{lever}" for lever in range(len(schema.levers))]
    found = [
        (schema if same == kind[0] else schema_of(structures[at : at + 1], names, 1.0), share)
        for same, at, share in zip(kinds, first, chance.tolist(), strict=True)
    ]
    return tuple(sorted(found, key=lambda pair: (pair[0] is not schema, -pair[1])))


def _classes(known_rooms: Iterable[Schema]) -> FloatArray:
    """``[C + 1]`` probability of each class after rooms that are known wholly."""
    knowledge = Knowledge(1, 0, BeliefParameters(), strengths(0.0))
    for schema in known_rooms:
        limit = default_action_limit(schema)
        every = _catalogue(schema, limit)
        both = Structures.joined([structure_of(schema), every.behaviours.structures])
        _, group = merge(both.behaviour(limit))
        knowledge.rooms[0] += every.classes(1.0 * (group[1:] == group[0]), knowledge.classes(0))
    return knowledge.classes(0)


def _catalogue(schema: Schema, action_limit: int) -> Catalogue:
    levers, solutions = len(schema.levers), len(schema.solutions)
    return catalogue(levers, solutions, action_limit, False, BeliefParameters().simplicity)


def _up_to_renaming(structures: Structures, action_limit: int) -> IntArray:
    """``[M]`` numbers that are equal for structures of equal behaviour up to names of levers."""
    orders = [*permutations(range(structures.levers))]
    images = [structures.on_slots(order, structures.levers) for order in orders]
    _, group = merge(np.concatenate([image.behaviour(action_limit) for image in images]))
    smallest: IntArray = group.reshape(len(orders), len(structures)).min(axis=0)
    return smallest
