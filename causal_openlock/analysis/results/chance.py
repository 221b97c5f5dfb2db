"""How often chance alone opens the door: a learner that draws every action uniformly, exactly.

The attempt is unrolled into its states (:class:`causal_openlock.world.rooms.RoomTables`), and the
probability of being in each of them is carried forward action by action. What is in the end on a
state in which the door is open, is the chance of opening it; no play is simulated. Where the levers
stand makes no difference, only how many positions there are, since every inactive lever wastes an
action.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from causal_openlock.schemas.fsm import FloatArray, compile_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.rooms import RoomTables


def chance_of_opening(schema: Schema, action_limit: int, positions: int) -> float:
    """Probability that an attempt of random actions opens the door, in a room of some size."""
    return _outcomes(schema, action_limit, positions)[0]


def chance_of_finding_all(
    schema: Schema, action_limit: int, positions: int, attempts: int
) -> float:
    """Probability that random actions find every solution within ``attempts`` attempts."""
    return float(_found_within(schema, action_limit, positions, attempts)[-1])


def attempts_at_random(schema: Schema, action_limit: int, positions: int, attempts: int) -> float:
    """Mean attempts of random actions to find every solution; at the limit ``attempts`` they stop.

    >>> from causal_openlock import find_schema
    >>> round(attempts_at_random(find_schema("CC3"), 3, 7, 30), 3)
    29.999
    """
    return float((1 - _found_within(schema, action_limit, positions, attempts)[:-1]).sum())


@lru_cache(maxsize=256)
def _found_within(schema: Schema, action_limit: int, positions: int, attempts: int) -> FloatArray:
    """``[attempts + 1]`` probability that every solution is found within 0, 1, ... attempts."""
    from scipy.special import gammaln

    _, solutions = _outcomes(schema, action_limit, positions)
    n = np.arange(attempts + 1)
    if not (solutions > 0).all():
        return np.zeros(len(n))
    # ways[n]: probability that n given attempts find nothing, or solutions considered so far,
    # each of these at least once. One solution after the other is given j of the n attempts.
    ways: FloatArray = (1.0 - solutions.sum()) ** n
    log_choose = gammaln(n[:, None] + 1) - gammaln(n + 1) - gammaln(n[:, None] - n + 1.0)
    share = np.where((n >= 1) & (n <= n[:, None]), log_choose, -np.inf)
    for chance in solutions:
        ways = (np.exp(share + n * np.log(chance)) * ways[n[:, None] - n]).sum(axis=1)
    return ways


@lru_cache(maxsize=256)
def _outcomes(schema: Schema, action_limit: int, positions: int) -> tuple[float, FloatArray]:
    """The chance that an attempt opens the door, and ``[K]`` that it does so by each solution."""
    tables = RoomTables.of([(schema, action_limit)], positions)
    actions, over = tables.fails, tables.actions_left == 0
    effect, chance = tables.after[:, :actions], tables.chance[:, :actions]
    idle = tables.after[:, tables.fails, None]
    reached = np.zeros(len(tables.state))
    reached[0] = 1.0
    for _ in range(action_limit):
        going = np.where(over, 0.0, reached)[:, None] / actions
        after = np.where(over, reached, 0.0)
        np.add.at(after, effect, going * chance)
        np.add.at(after, np.broadcast_to(idle, effect.shape), going * (1.0 - chance))
        reached = after
    opened = compile_schema(schema).opened[tables.state]
    each = [reached[opened & (tables.solution == k)].sum() for k in range(len(schema.solutions))]
    return float(reached[opened].sum()), np.array(each)
