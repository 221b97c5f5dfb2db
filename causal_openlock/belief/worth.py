"""Worth of knowing the schema of a room, to an ideal observer and in attempts.

Two observers solve a room in the least expected number of attempts. One knows which of several
schemas governs the room, the other only how probable each is. Both have to find out which lever
is which. The difference of their expected attempts is the worth of the knowledge: it is never
negative, and it is exact (:mod:`causal_openlock.belief.optimal`).

Schemas that differ in the names of their levers alone, or that no attempt can distinguish, are one.
Up to four levers all of them are listed, with equal odds or with the prior of the learner
``bayes``, which known rooms sharpen (:mod:`causal_openlock.belief.knowledge`).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from numbers import Real
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.belief.catalogue import FREE_FORM_LEVERS, Catalogue, catalogue
from causal_openlock.belief.hypotheses import strengths
from causal_openlock.belief.knowledge import BeliefParameters, Knowledge
from causal_openlock.belief.optimal import Optimum
from causal_openlock.belief.placements import TooLargeError, mixture
from causal_openlock.belief.structure_schemas import schema_of, structure_of
from causal_openlock.belief.structures import Structures, merge
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import MAX_ACTION_LIMIT, default_action_limit
from causal_openlock.files.validation import whole_number
from causal_openlock.schemas.finding import schema as declared
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pandas as pd

MOST_STATES = 200_000
"""States that a search may take; about ten seconds."""
POSITIONS, PAPER_LIMIT = 7, 3
ALL, GRAMMAR = "all", "grammar"
Possible = tuple[tuple[Schema, float], ...]
"""Schemas with their probabilities."""
Among = str | Schema | Iterable[str | Schema] | Mapping[str | Schema, float]


@dataclass(frozen=True)
class Expected:
    """The least expected attempts of an observer."""

    attempts: float  #: attempts until all solutions are found
    each: tuple[float, ...]
    """For the first, second, ... solution, under the optimal policy with earlier ones soonest."""
    here: tuple[float, ...]
    """The same in rooms of the schema, under the optimal policy that needs least there."""
    states: int  #: states searched


@dataclass(frozen=True)
class SchemaWorth:
    """Worth of knowing the schema: the answer of :func:`schema_worth`."""

    schema: Schema  #: the schema that governs the room
    among: Possible  #: the schemas possible for who does not know, with their probabilities
    action_limit: int  #: actions in an attempt
    levers_known: bool  #: whether it is known which levers are active
    known: Expected  #: who knows which schema holds; the mean over the possible schemas
    unknown: Expected  #: who does not; the mean over the possible schemas

    @property
    def worth(self) -> float:
        """Attempts that knowing which schema holds saves, until all solutions are found."""
        return max(0.0, self.unknown.attempts - self.known.attempts)

    @property
    def states(self) -> int:
        """States searched in all."""
        return self.known.states + self.unknown.states

    def __str__(self) -> str:
        schemas = counted(len(self.among), "schema")
        levers = "known" if self.levers_known else "unknown"
        return (
            f"Knowing which of {schemas} governs the room saves {self.worth:.3f} attempts, exact.\n"
            f"Observer: active levers {levers}, {counted(self.action_limit, 'action')} an attempt. "
            f"States searched: {self.states:,}."
        )

    @cached_property
    def table(self) -> pd.DataFrame:
        """Attempts of who knows the schema and of who does not.

        Columns ``attempts`` (what is counted), ``known``, ``unknown`` and ``worth``, their
        difference.
        """
        import pandas as pd

        known, unknown = self.known, self.unknown
        rows = [("until all solutions", known.attempts, unknown.attempts)]
        for number, attempts in enumerate(zip(known.each, unknown.each, strict=True), 1):
            rows.append((f"for solution {number}", *attempts))
        rows.append((f"in rooms of {self.schema.name}", sum(known.here), sum(unknown.here)))
        table = pd.DataFrame(rows, columns=["attempts", "known", "unknown"])
        return table.assign(worth=table["unknown"] - table["known"]).round(9)


def schema_worth(
    schema: str | Schema,
    among: Among = ALL,
    *,
    action_limit: int | None = None,
    levers_known: bool = True,
    report: Callable[[str], None] = lambda step: None,
) -> SchemaWorth:
    """Return the worth of knowing the schema of a room to an ideal observer, in attempts.

    Args:
        schema: The schema that governs the room; all that :func:`causal_openlock.schema` takes.
        among: What else may govern it: a schema, several, or ``{schema: weight}``, the weight of
            ``schema`` being 1 unless it is given; ``"all"`` schemas with as many levers and
            solutions, equally probable; ``"grammar"``, the prior of the learner ``bayes``.
        action_limit: Actions in an attempt; by default the paper's 3, or as many as it needs.
        levers_known: Whether it is known which levers are active; if not, any of seven are.
        report: Called with the name of each step when it begins.

    Raises:
        OpenLockError: If schemas do not go together, or are too many to list, or if the search
            takes too many states.

    Example:
        >>> found = schema_worth("CC4", among="CE4")
        >>> found.known.attempts, found.unknown.attempts, found.worth
        (3.75, 3.875, 0.125)
        >>> found.unknown.each
        (1.75, 1.125, 1.0)
    """
    here = declared(schema)
    limit = default_action_limit(here) if action_limit is None else action_limit
    limit = whole_number(limit, "action_limit", 1)
    if limit > MAX_ACTION_LIMIT:
        raise OpenLockError(f"no attempt can have more than {MAX_ACTION_LIMIT} actions")
    if among in (ALL, GRAMMAR):
        possible = listed_schemas(here, limit, None if among == ALL else ())
    else:
        possible = _named_schemas(here, among, limit)
    positions = None if levers_known else max(POSITIONS, len(here.levers))
    knowing = []
    for number, (which, _) in enumerate(possible, 1):
        report(f"who knows the schema, {number} of {len(possible)} schemas")
        knowing.append(_expected(((which, 1.0),), limit, positions))
    report("who does not know the schema")
    unknown = _expected(possible, limit, positions)
    chances = [chance for _, chance in possible]
    attempts = float(np.average([part.attempts for part in knowing], weights=chances))
    each = np.average([part.each for part in knowing], axis=0, weights=chances).tolist()
    states = sum(part.states for part in knowing)
    known = Expected(attempts, tuple(each), knowing[0].here, states)
    return SchemaWorth(here, possible, limit, levers_known, known, unknown)


def _expected(among: Possible, limit: int, positions: int | None) -> Expected:
    """The expected attempts if one of these schemas governs the room, the first one here."""
    # Within three actions a pull never helps; with more it may show which levers move alone.
    pulls = limit > PAPER_LIMIT
    only_first = [(schema, float(number == 0)) for number, (schema, _) in enumerate(among)]
    try:
        hypotheses, weight = mixture(among, limit, positions)
        optimum = Optimum(hypotheses, weight, limit, MOST_STATES, pulls)
        attempts, each = optimum.attempts(), optimum.by_solution(weight / weight.sum())
        here = optimum.by_solution(mixture(only_first, limit, positions)[1])
    except TooLargeError as error:
        raise OpenLockError(f"{error}; name fewer schemas, or schemas with fewer levers") from None
    return Expected(attempts, each, here, optimum.nodes)


# -- the schemas that may govern a room -----------------------------------------------------------


def _named_schemas(schema: Schema, among: Among, action_limit: int) -> Possible:
    """The schemas that are named, this one first, by their weights."""
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
    schema: Schema, action_limit: int, known_rooms: Sequence[Schema] | None = None
) -> Possible:
    """Return every schema with as many levers and solutions, this one first, with probabilities.

    Args:
        schema: The schema that governs the room.
        action_limit: Actions in an attempt.
        known_rooms: For the prior of the grammar, the schemas of rooms known wholly before this
            one; None makes all schemas equally probable.

    Raises:
        OpenLockError: If schemas are too many to list.

    Example:
        >>> from causal_openlock import find_schema
        >>> len(listed_schemas(find_schema("CC3"), 3))
        12
    """
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
        weight = every.prior(_classes(known_rooms))
        chance = np.bincount(place, weight / weight.sum()).astype(float)
    names = [f"L{lever}" for lever in range(len(schema.levers))]
    found = [
        (schema if same == kind[0] else schema_of(structures[at : at + 1], names, 1.0), share)
        for same, at, share in zip(kinds, first, chance.tolist(), strict=True)
    ]
    return tuple(sorted(found, key=lambda pair: (pair[0] is not schema, -pair[1])))


def _classes(known_rooms: Sequence[Schema]) -> FloatArray:
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
