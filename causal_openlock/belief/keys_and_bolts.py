"""Rooms in which knowing the schema pays: bolts that keys release, and which keys is to be found.

Where every push shows whether a lever moves, structure and roles are learned by the same attempts:
between two schemas of three or four levers, none that was tried is worth more than a quarter of an
attempt. Knowledge pays where it names what would otherwise be searched for. In these rooms *keys*
always move, a *bolt* moves while the keys that it needs are pushed, and any bolt unlocks the door.
An attempt has room for one set of keys and one bolt. Who has found the keys of one bolt knows, if
the schema is known, where those of the next are: the same keys, others, or some of both.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, combinations_with_replacement, permutations

from causal_openlock.belief.worth import SchemaWorth, schema_worth
from causal_openlock.errors import OpenLockError
from causal_openlock.schemas.finding import schema
from causal_openlock.schemas.schema import Schema

LEAST_LEVERS, MOST_LEVERS = 4, 7


@dataclass(frozen=True)
class Family:
    """All schemas with these numbers of keys and bolts, and what knowing which one holds is worth.

    Attributes:
        keys, bolts: Levers of each kind.
        needed: Keys that each bolt needs.
        schemas: All of them up to renaming, equally probable for who does not know.
        worth: Of knowing which; the mean over the schemas.
    """

    keys: int
    bolts: int
    needed: int
    schemas: tuple[Schema, ...]
    worth: SchemaWorth


def keys_and_bolts(keys: int, bolts: int, needed: int) -> tuple[Schema, ...]:
    """Return all schemas in which each bolt needs this number of keys, up to renaming.

    Example:
        >>> [one.name for one in keys_and_bolts(4, 2, 2)]
        ['keys_01_01', 'keys_01_02', 'keys_01_23']
    """
    if not 1 <= needed <= keys or bolts < 1:
        raise OpenLockError(
            f"a room cannot have {bolts} bolts that need {needed} of {keys} keys; give at least "
            "one bolt, and as many keys as it needs"
        )
    sets = [*combinations(range(keys), needed)]
    renamed = [*permutations(range(keys))]
    found = {
        min(
            tuple(sorted(tuple(sorted(names[key] for key in own)) for own in each))
            for names in renamed
        )
        for each in combinations_with_replacement(sets, bolts)
    }
    return tuple(_schema(keys, each) for each in sorted(found))


def families(levers: int, most_states: int | None = None) -> Iterator[Family]:
    """Yield every family of two bolts or more and this number of levers, with its worth.

    Args:
        levers: Keys and bolts together, at most 7.
        most_states: As for :func:`~causal_openlock.belief.worth.schema_worth`.
    """
    if not LEAST_LEVERS <= levers <= MOST_LEVERS:
        raise OpenLockError(
            f"rooms of keys and bolts have {LEAST_LEVERS} to {MOST_LEVERS} levers, not {levers}"
        )
    for bolts in range(2, levers - 1):
        for needed in range(1, min(2, levers - bolts - 1) + 1):
            schemas = keys_and_bolts(levers - bolts, bolts, needed)
            worth = schema_worth(
                schemas[0], among=schemas, action_limit=needed + 2, most_states=most_states
            )
            yield Family(levers - bolts, bolts, needed, schemas, worth)


def _schema(keys: int, needs: tuple[tuple[int, ...], ...]) -> Schema:
    edges = {f"B{bolt}": ["door"] for bolt in range(len(needs))}
    for bolt, own in enumerate(needs):
        for key in own:
            edges.setdefault(f"K{key}", []).append(f"B{bolt}")
    levers = [f"K{key}" for key in range(keys)] + [f"B{bolt}" for bolt in range(len(needs))]
    return schema(
        {
            "name": "_".join(["keys", *("".join(map(str, own)) for own in needs)]),
            "levers": levers,
            "edges": edges,
            "gates": {f"B{bolt}": "all" for bolt in range(len(needs))},
            "inert": [lever for lever in levers if lever not in edges],
        }
    )
