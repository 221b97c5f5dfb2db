"""Steps of rooms in tables, without trials and rewards."""

from __future__ import annotations

from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.world.batch import RoomBatch
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.tables import RoomTables


def step(
    tables: RoomTables, row: IntArray, action: IntArray, luck: FloatArray | None = None
) -> IntArray:
    """``[B]`` the rows after an action in each of B rooms."""
    batch = RoomBatch(tables, [find_reward("basic")], len(row), 1, put_back=False)
    batch.begin_trials(slice(None), tables.room[row])
    batch.row = row
    return batch.step(action, luck).after
