"""The schemas that may govern a room, and their probabilities before anything is tried.

Schemas that differ in the names of their levers alone, or that no attempt can distinguish, are one.
Up to four levers all of them are listed (:mod:`causal_openlock.belief.catalogue`), with equal odds
or with the prior of the learner ``bayes``: a grammar of schema classes
(:mod:`causal_openlock.belief.grammar`), and a Dirichlet distribution over these classes that known
rooms sharpen (:mod:`causal_openlock.belief.knowledge`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import permutations
from numbers import Real

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS, Catalogue, catalogue, feasible
from causal_openlock.belief.hypotheses import Block, RoomSight, Space, strengths
from causal_openlock.belief.knowledge import Knowledge, Prior
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


def possible_schemas(
    schema: Schema,
    among: Among,
    action_limit: int,
    concentration: float = 1.0,
    after: Iterable[str | Schema] = (),
) -> Possible:
    """Return the schemas that may govern a room, the one that does first, with their probabilities.

    Args:
        schema: The schema that governs the room.
        among: Other schemas, each with the weight 1 or with its own, the first schema having the
            weight 1 unless it is given; ``all`` schemas with as many levers and solutions, equally
            probable; or those schemas with the prior of the ``grammar``.
        action_limit: Actions in an attempt.
        concentration: How many rooms the prior over classes is worth; for the grammar.
        after: Schemas of rooms known wholly before this one; for the grammar.

    Raises:
        OpenLockError: If schemas do not go together, or are too many to list.

    Example:
        >>> from causal_openlock import find_schema
        >>> len(possible_schemas(find_schema("CC3"), "all", 3))
        12
    """
    if isinstance(after, str | Schema) or not isinstance(after, Iterable):
        raise OpenLockError(f"after is a list of schemas, not {after!r}")
    before = [declared(one) for one in after]
    if before and among != GRAMMAR:
        raise OpenLockError(f"rooms known before change the prior of the {GRAMMAR} alone")
    if not (isinstance(concentration, Real) and concentration > 0):
        raise OpenLockError(f"a concentration has to be more than 0, not {concentration!r}")
    if among in (ALL, GRAMMAR):
        _check(schema, action_limit)
        for one in (schema, *before):
            if len(one.levers) > FREE_FORM_LEVERS:
                raise OpenLockError(
                    f"{one.name} has {len(one.levers)} levers, and the schemas with more than "
                    f"{FREE_FORM_LEVERS} are too many to list; name the schemas that are possible"
                )
        return _listed(schema, action_limit, None if among == ALL else (concentration, before))
    weights: dict[Schema, float] = {}
    if not isinstance(among, str | Schema | Iterable):
        raise OpenLockError(f"among is schemas, {ALL!r} or {GRAMMAR!r}, not {among!r}")
    given = among if isinstance(among, Mapping) else dict.fromkeys(
        [among] if isinstance(among, str | Schema) else among, 1.0
    )  # fmt: skip
    for source, weight in given.items():
        if source in (ALL, GRAMMAR):
            raise OpenLockError(f"{source} stands alone and has no weight; leave out the others")
        one = declared(source)
        if not (isinstance(weight, Real) and 0 < weight < np.inf):
            raise OpenLockError(f"the weight of {one.name} has to be more than 0, not {weight!r}")
        weights[one] = float(weight)
    weights = {schema: weights.pop(schema, 1.0), **weights}
    sizes = (len(schema.levers), len(schema.solutions))
    for one in weights:
        _check(one, action_limit)
        if (len(one.levers), len(one.solutions)) != sizes:
            raise OpenLockError(
                f"{one.name} has {counted(len(one.levers), 'lever')} and "
                f"{counted(len(one.solutions), 'solution')}, {schema.name} has {sizes[0]} and "
                f"{sizes[1]}: colours and console distinguish them; name schemas with the same "
                "numbers"
            )
    whole = sum(weights.values())
    return tuple((one, weight / whole) for one, weight in weights.items())


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


def _listed(
    schema: Schema, action_limit: int, grammar: tuple[float, Sequence[Schema]] | None
) -> Possible:
    """Every schema of the same size, with equal odds or with the prior of the grammar."""
    every = _catalogue(schema, action_limit)
    structures = _structures(every)
    kind = _up_to_renaming(Structures.joined([structure_of(schema), structures]), action_limit)
    own, kind = kind[0], kind[1:]
    kinds, first, place = np.unique(kind, return_index=True, return_inverse=True)
    chance: FloatArray = np.full(len(kinds), 1.0 / len(kinds))
    if grammar is not None:
        classes = _classes(*grammar)[None] * feasible(len(schema.levers))
        weight = every.prior(classes / classes.sum())[0]
        chance = np.bincount(place, weight / weight.sum()).astype(float)
    names = [f"L{lever}" for lever in range(len(schema.levers))]
    found = [
        (schema if one == own else schema_of(structures[at : at + 1], names, 1.0), float(share))
        for one, at, share in zip(kinds, first, chance, strict=True)
    ]
    return tuple(sorted(found, key=lambda pair: (pair[0] is not schema, -pair[1])))


def _classes(concentration: float, before: Sequence[Schema]) -> FloatArray:
    """``[C + 1]`` probability of each class after rooms that are known wholly."""
    certain, prior = strengths(0.0, 1.0, 1.0, 1), Prior(concentration=concentration)
    knowledge = Knowledge(1, FREE_FORM_LEVERS, prior, certain)
    for schema in before:
        levers, limit = len(schema.levers), default_action_limit(schema)
        every = _catalogue(schema, limit)
        both = Structures.joined([structure_of(schema), _structures(every)])
        _, group = merge(both.behaviour(limit))
        sight = RoomSight(FREE_FORM_LEVERS, levers, len(schema.solutions), limit)
        block = Block(tuple(range(levers)), every)
        space = Space(sight, certain, (block,), every.behaviours)
        which = np.flatnonzero(group[1:] == group[0])
        knowledge.absorb(0, space, which, np.ones(1), np.arange(FREE_FORM_LEVERS))
    return knowledge.classes(np.array([0]))[0]


def _catalogue(schema: Schema, action_limit: int) -> Catalogue:
    own = Prior()
    return catalogue(
        len(schema.levers), len(schema.solutions), action_limit, False, own.simplicity,
        own.hypothesis_limit,
    )  # fmt: skip


def _structures(every: Catalogue) -> Structures:
    return Structures(every.behaviours.causes, every.behaviours.threshold)


def _up_to_renaming(structures: Structures, action_limit: int) -> IntArray:
    """``[M]`` numbers that are equal for structures of equal behaviour up to names of levers."""
    orders = [*permutations(range(structures.levers))]
    images = [structures.on_slots(order, structures.levers) for order in orders]
    _, group = merge(np.concatenate([image.behaviour(action_limit) for image in images]))
    smallest: IntArray = group.reshape(len(orders), len(structures)).min(axis=0)
    return smallest
