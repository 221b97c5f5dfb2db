"""Rewards of actions told by role, and of many actions at once."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from causal_openlock.envs import OpenLockEnv
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.world.batch import RoomBatch
from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.room import Layout

SCHEMAS = bundled_schemas()
# One of the published rooms of each schema.
LAYOUTS = {"CC3": "trial3", "CE3": "trial1", "CC4": "trial7", "CE4": "trial10"}


class Play:
    """A trial in one room, acted out by role; ``white`` is an inactive lever."""

    def __init__(
        self,
        reward: str | Iterable[str],
        schema: str | Schema = "CC4",
        action_limit: int | None = None,
    ) -> None:
        schema = SCHEMAS[schema] if isinstance(schema, str) else schema
        self.places = dict(zip(schema.levers, range(len(schema.levers)), strict=True))
        self.places["white"] = 6
        self.env = OpenLockEnv(
            schema,
            Layout(tuple(range(len(schema.levers)))),
            reward,
            action_limit=action_limit,
        )
        self.env.reset(seed=0)

    def attempt(self, words: str) -> list[float]:
        """The rewards of actions such as ``L0 -L0 door``: push L0, pull it back, push the door."""
        self.env.reset()
        return [float(self.env.step(self.action(word))[1]) for word in words.split()]

    def action(self, word: str) -> int:
        if word == DOOR:
            return 14
        return self.places[word.removeprefix("-")] + 7 * word.startswith("-")


def pay(
    table: RewardTable,
    row: np.ndarray,
    action: Sequence[int] | np.ndarray,
    previous: Sequence[int] | np.ndarray,
    found: np.ndarray,
    luck: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """The rows after some actions, which take effect without ``luck``, and the rewards for them."""
    tables = table.tables
    batch = RoomBatch(tables, [table.reward], len(row), attempt_limit=2, put_back=False)
    batch.begin_trials(slice(None), tables.room[row])
    batch.row = row.copy()
    batch.previous[:] = previous
    batch.found[:] = found
    batch.found_count[:] = found.sum(axis=1)
    taken = batch.step(np.array(action), np.zeros(len(row)) if luck is None else luck)
    return taken.after, taken.reward
