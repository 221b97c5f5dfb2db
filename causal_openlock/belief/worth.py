"""Worth of knowing the schema of a room, to an ideal observer and in attempts.

Two observers solve a room in the least expected number of attempts. One knows which of several
schemas governs the room, the other only how probable each is. Both have to find out which lever
is which. The difference of their expected attempts is the worth of the knowledge: it is never
negative, and it is exact (:mod:`causal_openlock.belief.optimal`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from causal_openlock.belief.optimal import Optimum
from causal_openlock.belief.placements import TooLargeError, mixture
from causal_openlock.belief.possible_schemas import Among, Possible, possible_schemas
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import MAX_ACTION_LIMIT, default_action_limit
from causal_openlock.files.validation import whole_number
from causal_openlock.schemas.finding import schema as declared
from causal_openlock.schemas.schema import Schema
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pandas as pd

MOST_STATES = 200_000
"""States that a search may take; about ten seconds."""
POSITIONS, PAPER_LIMIT = 7, 3


@dataclass(frozen=True)
class Expected:
    """The least expected attempts of an observer.

    Attributes:
        attempts: Attempts until all solutions are found.
        each: Attempts for the first, second, ... solution, under the optimal policy that finds
            earlier ones soonest.
        here: The same in rooms of the schema, under the optimal policy that needs least there.
        states: States searched.
    """

    attempts: float
    each: tuple[float, ...]
    here: tuple[float, ...]
    states: int


@dataclass(frozen=True)
class SchemaWorth:
    """Worth of knowing the schema: the answer of :func:`schema_worth`.

    Attributes:
        schema: The schema that governs the room.
        among: The schemas that are possible for who does not know, with their probabilities.
        action_limit: Actions in an attempt.
        levers_known: Whether it is known which levers are active.
        known: Who knows which schema holds; the mean over the possible schemas.
        unknown: Who does not; the mean over the possible schemas.
    """

    schema: Schema
    among: Possible
    action_limit: int
    levers_known: bool
    known: Expected
    unknown: Expected

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
        levers = "active levers known" if self.levers_known else "active levers unknown"
        return (
            f"Knowing which of {schemas} governs the room saves {self.worth:.3f} attempts, exact.\n"
            f"Observer: {levers}, {counted(self.action_limit, 'action')} an attempt. "
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
    among: Among = "all",
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
    declared_schema = declared(schema)
    limit = default_action_limit(declared_schema) if action_limit is None else action_limit
    limit = whole_number(limit, "action_limit", 1)
    if limit > MAX_ACTION_LIMIT:
        raise OpenLockError(f"no attempt can have more than {MAX_ACTION_LIMIT} actions")
    possible = possible_schemas(declared_schema, among, limit)
    positions = None if levers_known else max(POSITIONS, len(declared_schema.levers))
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
    return SchemaWorth(declared_schema, possible, limit, levers_known, known, unknown)


def _expected(among: Possible, limit: int, positions: int | None) -> Expected:
    """The expected attempts if one of these schemas governs the room, the first one here."""
    (first, _), *others = among
    # Within three actions a pull never helps; with more it may show which levers move alone.
    pulls = limit > PAPER_LIMIT
    try:
        hypotheses, weight = mixture(among, limit, positions)
        optimum = Optimum(hypotheses, weight, limit, MOST_STATES, pulls)
        attempts = optimum.attempts()
        only_first = [(first, 1.0), *((schema, 0.0) for schema, _ in others)]
        in_rooms_of_first = mixture(only_first, limit, positions)[1]
        each = optimum.by_solution(weight / weight.sum())
        here = optimum.by_solution(in_rooms_of_first)
    except TooLargeError as error:
        raise OpenLockError(f"{error}; name fewer schemas, or schemas with fewer levers") from None
    return Expected(attempts, each, here, optimum.nodes)
