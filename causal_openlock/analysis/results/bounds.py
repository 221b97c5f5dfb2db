"""The ideal observer: how few attempts a trial can take, on average, for whoever knows the schema.

It knows which schema governs the room and that the grey levers are the active ones; where each of
them stands it has to find out, in the least expected number of attempts (see
:mod:`causal_openlock.belief.optimal`). The number depends on nothing but the schema and how many
actions an attempt has, so it stands in every report, whoever played. Where the exact number is out
of reach, because levers may fail to move or can be placed in too many ways, there is none.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from typing import Any, NamedTuple

from causal_openlock.analysis.results.description import mappings_with
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import default_action_limit
from causal_openlock.formats.schema_file import schema_from_dict
from causal_openlock.world.schema import Schema


class Bound(NamedTuple):
    """What the ideal observer needs in some trials.

    Attributes:
        schema: Name of the schema that governs their rooms.
        attempts: Mean attempts to find every solution.
    """

    schema: str
    attempts: float


Bounds = Mapping[tuple[str, str, str], Bound]
"""By condition, protocol and phase."""


def ideal_bounds(experiment: Mapping[str, Any]) -> Bounds:
    """What the ideal observer needs in each phase of each condition.

    Args:
        experiment: As :meth:`causal_openlock.experiment.experiment.Experiment.as_dict` gives it;
            descriptions of another form do not tell what was played, and bound nothing.

    Returns:
        The bounds of those phases that stay with one schema for which the number is known, unless
        the protocol has so few attempts that even the ideal observer may not finish, or has
        several meanings.
    """
    learners: Any = experiment.get("learners")
    conditions: Any = experiment.get("conditions")
    if not mappings_with(learners, {"name", "protocol"}) or not mappings_with(
        conditions, {"name", "train"}
    ):
        return {}
    protocols: dict[str, list[Any]] = {}
    for one in learners:
        if mappings_with([one["protocol"]], {"name", "attempt_limit"}):
            meanings = protocols.setdefault(str(one["protocol"]["name"]), [])
            if one["protocol"] not in meanings:
                meanings.append(one["protocol"])
    found: dict[tuple[str, str, str], Bound] = {}
    for condition in conditions:
        for phase in ("train", "test"):
            schema = _schema(condition.get(phase) or ())
            for name, meanings in protocols.items():
                if schema is not None and len(meanings) == 1:
                    attempts = _under(schema, meanings[0])
                    if attempts is not None:
                        key = (str(condition["name"]), name, phase)
                        found[key] = Bound(schema.name, attempts)
    return found


def ideal_attempts(schema: Schema, action_limit: int) -> float | None:
    """Mean attempts that the ideal observer needs, or None if the exact number is out of reach.

    Args:
        schema: What governs the room.
        action_limit: Actions in an attempt.
    """
    return _solved(schema, action_limit)[0]


def said(bounds: Iterable[Bound]) -> str:
    """Bounds in words: ``2.67 in rooms of CC3 and CE3, 3.75 in rooms of CC4``."""
    schemas: dict[str, list[str]] = {}
    for schema, attempts in sorted(set(bounds), key=lambda bound: (bound.attempts, bound.schema)):
        schemas.setdefault(f"{attempts:.2f}", []).append(schema)
    return ", ".join(
        f"{attempts} in rooms of {' and '.join(filter(None, [', '.join(names[:-1]), names[-1]]))}"
        for attempts, names in schemas.items()
    )


def _schema(groups: Iterable[Any]) -> Schema | None:
    """The schema of all these trials, if it is one."""
    data = [group.get("schema") for group in groups]
    if not data or data[0] is None or any(one != data[0] for one in data):
        return None
    try:
        return schema_from_dict(data[0])
    except OpenLockError:
        return None


def _under(schema: Schema, protocol: Mapping[str, Any]) -> float | None:
    attempts, most = _solved(schema, protocol.get("action_limit") or default_action_limit(schema))
    return attempts if most <= protocol["attempt_limit"] else None


@lru_cache(maxsize=256)
def _solved(schema: Schema, action_limit: int) -> tuple[float | None, int]:
    """The mean attempts, and the most that there can be."""
    from causal_openlock.belief.optimal import Optimum
    from causal_openlock.belief.placements import TooLargeError, mixture

    if not schema.deterministic or action_limit < schema.least_action_limit:
        return None, 0
    try:
        optimum = Optimum(*mixture([(schema, 1.0)], action_limit), action_limit)
        return optimum.attempts(), optimum.most()
    except TooLargeError:
        return None, 0
