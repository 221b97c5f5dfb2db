"""Worth of knowing the schema of a room, to an ideal observer and in attempts.

Two observers solve a room in the least expected number of attempts. One knows which of several
schemas governs the room, the other only how probable each is. Both have to find out which lever
is which. The difference of their expected attempts is the worth of the knowledge: it is never
negative, and it is exact (:mod:`causal_openlock.belief.optimal`).

Where the search is too large, the expected attempts lie between two bounds. More knowledge cannot
cost attempts, so who knows the schema, or which levers are active, needs no more; and planning from
attempt to attempt needs no less than the optimum.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from causal_openlock.belief.optimal import OneAttemptAhead, Optimum, by_weight, weighed
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
"""States that a search may take by default; about ten seconds."""
BIT = 0.3
"""Attempts that a missing bit costs in planning where the optimum is too large."""
POSITIONS, PAPER_LIMIT = 7, 3


@dataclass(frozen=True)
class Expected:
    """The least expected attempts of an observer.

    Attributes:
        lower, upper: Attempts until all solutions are found; two bounds, equal if it is exact.
        each: Attempts for the first, second, ... solution, under the optimal policy that finds
            earlier ones soonest; empty if not exact.
        until: Least expected attempts until the first, second, ... solution is found, each by a
            policy of its own, which needs no others; empty if not exact.
        states: States searched.
    """

    lower: float
    upper: float
    each: tuple[float, ...] = ()
    until: tuple[float, ...] = ()
    states: int = 0


@dataclass(frozen=True)
class SchemaWorth:
    """Worth of knowing the schema: the answer of :func:`schema_worth`.

    Attributes:
        schema: The schema that governs the room.
        among: The schemas that are possible for who does not know, with their probabilities.
        action_limit: Actions in an attempt.
        levers_known: Whether it is known which levers are active.
        lock_seen: Whether it is seen that the door is unlocked.
        known: Who knows which schema holds; the mean over the possible schemas.
        unknown: Who does not; the mean over the possible schemas.
        here_known: Who knows it, in rooms of the schema.
        here_least, here_most: Who does not, in rooms of the schema: attempts for the first,
            second, ... solution under the optimal policies that need least and most there. Empty
            if not exact.
    """

    schema: Schema
    among: Possible
    action_limit: int
    levers_known: bool
    lock_seen: bool
    known: Expected
    unknown: Expected
    here_known: Expected
    here_least: tuple[float, ...]
    here_most: tuple[float, ...]

    @property
    def exact(self) -> bool:
        """Whether the worth is exact."""
        return self.known.lower == self.known.upper and self.unknown.lower == self.unknown.upper

    @property
    def bounds(self) -> tuple[float, float]:
        """Lower and upper bound of the worth, in attempts; equal if it is exact."""
        low = max(0.0, self.unknown.lower - self.known.upper)
        return low, max(low, self.unknown.upper - self.known.lower)

    @property
    def worth(self) -> float:
        """Attempts that knowing which schema holds saves, until all solutions are found.

        Raises:
            OpenLockError: If only bounds are known.
        """
        low, high = self.bounds
        if not self.exact:
            raise OpenLockError(
                f"the exact worth takes too many states; it is between {low:.3f} and {high:.3f} "
                "attempts (.bounds), and more states may give it (most_states)"
            )
        return low

    @property
    def states(self) -> int:
        """States searched in all."""
        return self.known.states + self.unknown.states

    def __str__(self) -> str:
        low, high = self.bounds
        saved = f"{low:.3f} attempts, exact" if self.exact else f"{low:.3f} to {high:.3f} attempts"
        schemas = counted(len(self.among), "schema")
        levers = "active levers known" if self.levers_known else "active levers unknown"
        lock = "lock seen" if self.lock_seen else "lock unseen"
        return (
            f"Knowing which of {schemas} governs the room saves {saved}.\n"
            f"Observer: {levers}, {lock}, {counted(self.action_limit, 'action')} an attempt. "
            f"States searched: {self.states:,}."
        )

    @cached_property
    def table(self) -> pd.DataFrame:
        """Attempts of who knows the schema and of who does not.

        Columns ``attempts`` (what is counted), ``known``, ``unknown`` and ``worth``, their
        difference. Where it is not exact, there are two rows of bounds alone: ``at least`` and
        ``at most``.
        """
        import pandas as pd

        known, unknown = self.known, self.unknown
        rows: list[tuple[str, float, float, float]] = []
        if not self.exact:
            low, high = self.bounds
            rows.append(("until all solutions, at least", known.lower, unknown.lower, low))
            rows.append(("until all solutions, at most", known.upper, unknown.upper, high))
        else:
            pairs = [("until all solutions", known.upper, unknown.upper)]
            for number, each in enumerate(zip(known.each, unknown.each, strict=True), 1):
                pairs.append((f"for solution {number}", *each))
            until = [*zip(known.until, unknown.until, strict=True)]
            for number, each in enumerate(until[:-1], 1):
                pairs.append((f"until solution {number}, if it is the aim", *each))
            for end, split in (("least", self.here_least), ("most", self.here_most)):
                name = f"in rooms of {self.schema.name}, {end}"
                pairs.append((name, self.here_known.upper, sum(split)))
            rows = [(name, known, unknown, unknown - known) for name, known, unknown in pairs]
        table = pd.DataFrame(rows, columns=["attempts", "known", "unknown", "worth"])
        return table.round(9)


def schema_worth(
    schema: str | Schema,
    among: Among = "all",
    *,
    action_limit: int | None = None,
    levers_known: bool = True,
    lock_seen: bool = True,
    concentration: float = 1.0,
    after: Iterable[str | Schema] = (),
    most_states: int | None = None,
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
        lock_seen: Whether it is seen that the door is unlocked, or only found by pushing it.
        concentration: For the grammar: how many rooms its prior is worth (Dirichlet).
        after: For the grammar: schemas of rooms that are known wholly before this one.
        most_states: States that a search may take before bounds replace it; by default 200,000.
        report: Called with the name of each step when it begins.

    Raises:
        OpenLockError: If schemas do not go together, or are too many to list, or if even bounds
            take too many states.

    Example:
        >>> found = schema_worth("CC4", among="CE4")
        >>> found.known.upper, found.unknown.upper, found.worth
        (3.75, 3.875, 0.125)
        >>> found.unknown.each
        (1.75, 1.125, 1.0)
    """
    own = declared(schema)
    limit = default_action_limit(own) if action_limit is None else action_limit
    limit = whole_number(limit, "action_limit", 1)
    if limit > MAX_ACTION_LIMIT:
        raise OpenLockError(f"no attempt can have more than {MAX_ACTION_LIMIT} actions")
    states = MOST_STATES if most_states is None else whole_number(most_states, "most_states", 1)
    possible = possible_schemas(own, among, limit, concentration, after)
    positions = None if levers_known else max(POSITIONS, len(own.levers))
    # Within three actions a pull never helps; with more it may show which levers move alone.
    pulls = limit > PAPER_LIMIT
    options: dict[str, Any] = {"lock_seen": lock_seen, "node_limit": states, "pulls": pulls}
    each = []
    for number, (one, _) in enumerate(possible, 1):
        report(f"who knows the schema, {number} of {len(possible)} schemas")
        each.append(_expected(((one, 1.0),), limit, positions, options)[0])
    known = _mean(each, [chance for _, chance in possible])
    report(f"who does not know the schema, up to {states:,} states")
    unknown, here = _expected(possible, limit, positions, options, known.lower)
    return SchemaWorth(
        own, possible, limit, levers_known, lock_seen, known, unknown, each[0], *here
    )  # fmt: skip


Here = tuple[tuple[float, ...], tuple[float, ...]]


def _expected(
    among: Possible, limit: int, positions: int | None, options: dict[str, Any], least: float = 0.0
) -> tuple[Expected, Here]:
    """Return the expected attempts, and the least and most in rooms of the first schema."""
    try:
        hypotheses, weight = mixture(among, limit, positions)
    except TooLargeError as error:
        raise OpenLockError(f"{error}; name fewer schemas, or schemas with fewer levers") from None
    try:
        optimum = Optimum(hypotheses, weight, limit, **options)
        attempts = optimum.attempts()
        solutions = range(hypotheses.solutions.shape[1])
        every = by_weight(weight / weight.sum())
        alone = [(one, chance * (not at)) for at, (one, chance) in enumerate(among)]
        own = by_weight(mixture(alone, limit, positions)[1] / among[0][1])

        def charged(weights: list[tuple[float, int]], sign: int) -> tuple[float, ...]:
            """Attempts for each solution; policies with the least sum, or the most, come first."""

            def charge(possible: int, found: int) -> tuple[float, ...]:
                here = weighed(weights, possible)
                return (sign * here, *(here * (found == one) for one in solutions))

            return optimum.split(charge)[1:]

        each = charged(every, 1)
        here = charged(own, 1), charged(own, -1)
        until: tuple[float, ...] = ()
        for find in solutions[1:]:
            part = Optimum(hypotheses, weight, limit, find=find, **options)
            until = (*until, part.attempts())
            optimum.nodes += part.nodes
    except TooLargeError:
        pass
    else:
        until = (*until, attempts)
        return Expected(attempts, attempts, each, until, optimum.nodes), here
    return _bounded(among, limit, positions, options, least), ((), ())


def _bounded(
    among: Possible, limit: int, positions: int | None, options: dict[str, Any], least: float
) -> Expected:
    """Return bounds: planning an attempt ahead, and what more knowledge would take."""
    hypotheses, weight = mixture(among, limit, positions)
    try:
        lower = OneAttemptAhead(hypotheses, weight, limit, **options)
        upper = OneAttemptAhead(hypotheses, weight, limit, **options)
    except TooLargeError as error:
        raise OpenLockError(f"{error}; name fewer schemas, or schemas with fewer levers") from None
    upper.worth_of_a_bit = BIT
    every = by_weight(weight / weight.sum())
    if positions is not None:
        least = max(least, _expected(among, limit, None, options)[0].lower)
    try:
        low = max(least, lower.attempts())
        high = upper.split(lambda possible, _: (weighed(every, possible),))[0]
    except TooLargeError:
        raise OpenLockError(
            f"even bounds take more than {options['node_limit']:,} states; allow more states "
            "(most_states), or name fewer schemas"
        ) from None
    return Expected(low, high, states=lower.nodes + upper.nodes)


def _mean(each: list[Expected], chances: list[float]) -> Expected:
    """The mean over schemas; split by solutions if all are exact."""

    def mean(name: str) -> tuple[float, ...]:
        rows = [getattr(one, name) for one in each]
        whole = all(rows)
        return tuple(np.average(rows, axis=0, weights=chances).tolist()) if whole else ()

    ends = np.average([(one.lower, one.upper) for one in each], axis=0, weights=chances)
    low, high = ends.tolist()
    return Expected(low, high, mean("each"), mean("until"), sum(one.states for one in each))
