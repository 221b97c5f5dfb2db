"""The ideal observer: how few attempts a trial can take, on average, if the schema is known.

The ideal observer knows the schema of the room and that the grey levers are the active ones; it has
to find out which of them is where, in the least expected number of attempts (see
:mod:`causal_openlock.belief.optimal`). The number depends only on the schema and on how many
actions an attempt has, so every report shows it. It is not computed where levers may fail to move
or can be placed in too many ways.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from functools import lru_cache

import pandas as pd

from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.protocol import default_action_limit
from causal_openlock.schemas.schema import Schema

Bounds = Mapping[tuple[str, str, str], float]
"""The ideal observer's mean attempts, by condition, protocol and phase."""


def ideal_bounds(experiment: Experiment) -> Bounds:
    """The ideal observer's attempts in each phase of each condition.

    Returns:
        The bounds of those phases that stay with one schema for which the number is known, unless
        the protocol has so few attempts that even the ideal observer may not finish, or several
        protocols have its name.
    """
    names = Counter(protocol.name for protocol in experiment.protocols)
    found: dict[tuple[str, str, str], float] = {}
    for condition in experiment.conditions:
        for phase, trials in (("train", condition.train), ("test", condition.test)):
            schemas = {one.schema for one in trials}
            for protocol in experiment.protocols:
                if len(schemas) > 1 or names[protocol.name] > 1:
                    continue
                for schema in schemas:
                    limit = protocol.action_limit or default_action_limit(schema)
                    attempts, most = _solved(schema, limit)
                    if attempts is not None and most <= protocol.attempt_limit:
                        found[condition.name, protocol.name, phase] = attempts
    return found


def bounds_of(bounds: Bounds, table: pd.DataFrame) -> dict[tuple[str, str], float]:
    """The bounds that are known of what is in a table, of one protocol, by condition and phase."""
    keys = table[["condition", "protocol", "phase"]].drop_duplicates().astype(str)
    played = keys.itertuples(index=False, name=None)
    return {(key[0], key[2]): bounds[key] for key in played if key in bounds}


def ideal_attempts(schema: Schema, action_limit: int) -> float | None:
    """Mean attempts that the ideal observer needs, or None if the exact number is not computed.

    >>> from causal_openlock import find_schema
    >>> ideal_attempts(find_schema("CC4"), 3)
    3.75
    """
    return _solved(schema, action_limit)[0]


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
