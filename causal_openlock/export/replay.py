"""Observations and rewards of every step, from the record alone.

A record keeps the actions of every attempt and what came of it, not what was seen on the way: in a
room that is known, that follows from the actions. So they are carried out once more, all attempts
of a cell side by side, in the tables that every environment steps; where a lever may fail, the
record says whether it did. What comes of it must be what is on record, to the last attempt.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import StoreError
from causal_openlock.experiment.declare import Condition, Protocol
from causal_openlock.schemas.fsm import BoolArray, FloatArray, IntArray
from causal_openlock.world.kernel import CHANGED, EVENT, ROW, SOLUTIONS_FOUND
from causal_openlock.world.rewards import RewardFunction
from causal_openlock.world.room import Layout, positions_for
from causal_openlock.world.rooms import Rooms, RoomTables

if TYPE_CHECKING:
    import pyarrow as pa

TRIAL = ("subject", "phase", "loop", "trial")
"""The columns that identify a trial of a cell."""


@dataclass(frozen=True, eq=False)
class Steps:
    """The steps of N attempts, padded to the longest; P positions.

    Attributes:
        positions: P.
        begins: ``[N, 2P + 2]`` what is seen before the first action.
        seen: ``[N, L, 2P + 2]`` what is seen right after each action.
        actions: ``[N, L]`` what was done.
        rewards: ``[N, L]`` what it paid.
        used: ``[N]`` how many actions each attempt has.
    """

    positions: int
    begins: NDArray[np.int8]
    seen: NDArray[np.int8]
    actions: IntArray
    rewards: FloatArray
    used: IntArray


def replay(
    record: pa.Table, condition: Condition, protocol: Protocol, reward: RewardFunction
) -> Steps:
    """Carry out the attempts of a record of one condition, sorted by subject and time, once more.

    Raises:
        StoreError: If something else comes of it than is on record.
    """
    columns = {name: record[name].combine_chunks() for name in record.column_names}
    tables, schema, lever = _rooms(columns, condition, protocol)
    used = columns["actions"].value_lengths().to_numpy().astype(np.int64)
    actions, moved = (_padded(columns[name], used) for name in ("actions", "moved"))
    # Each attempt is carried out in a room of its own, where all else may have been found before.
    most = max(protocol.attempt_limit, int(tables.solutions.max()))
    rooms = Rooms(tables, [reward], len(schema), most, put_back=False)
    rooms.begin_trials(slice(None), schema, lever)
    rooms.state.found[:] = _found_before(columns, rooms.state.found.shape[1])
    rooms.state.console[:, SOLUTIONS_FOUND] = rooms.state.found.sum(axis=1)
    begins = rooms.observation
    seen = np.zeros((*actions.shape, begins.shape[1]), np.int8)
    rewards = np.zeros(actions.shape)
    agrees = actions.max(axis=1, initial=0) < tables.fails
    actions = np.where(agrees[:, None], actions, 0).astype(np.int64)
    for number in range(actions.shape[1]):
        going = number < used
        action = np.where(going, actions[:, number], tables.waits)
        # No luck is as bad as none at all: an action takes effect where it did, and only there.
        outcome = rooms.step(action, np.where(moved[:, number], 0.0, 1.0))
        rewards[:, number] = outcome.reward
        agrees &= ((rooms.now(EVENT) & CHANGED != 0) == moved[:, number]) | ~going
        seen[going, number] = rooms.observation[going]
    row = rooms.now(ROW)
    agrees &= tables.actions_left[row] == 0
    solution = np.where(tables.opened[row], tables.solution[row], -1)
    agrees &= solution == columns["solution"].to_numpy()
    agrees &= np.isclose(rewards.sum(axis=1), columns["reward"].to_numpy())
    if not agrees.all():
        raise _disagreement(columns, int(np.argmin(agrees)), condition)
    return Steps(tables.positions, begins, seen, actions, rewards, used)


def trial_numbers(record: pa.Table) -> IntArray:
    """``[N]`` which trial each attempt belongs to, from 0, if sorted by subject and time."""
    starts = np.ones(record.num_rows, bool)
    for name in TRIAL:
        column = record[name].combine_chunks()
        values = (getattr(column, "indices", column)).to_numpy(zero_copy_only=False)
        starts[1:] &= values[1:] == values[:-1]
    starts[1:] = ~starts[1:]
    return np.cumsum(starts) - 1


def _rooms(
    columns: Mapping[str, Any], condition: Condition, protocol: Protocol
) -> tuple[RoomTables, IntArray, IntArray]:
    """The tables of a condition; of each attempt the schema, ``[N]``, and levers, ``[N, P]``."""
    schemas = {schema.name: schema for schema in condition.schemas}
    tables = RoomTables.of(
        [(schema, protocol.actions_for(schema)) for schema in schemas.values()],
        max(map(positions_for, condition.schemas)),
    )
    names = [columns[name].dictionary.to_pylist() for name in ("schema", "layout")]
    codes = [columns[name].indices.to_numpy().astype(np.int64) for name in ("schema", "layout")]
    met, which = np.unique(codes[0] * len(names[1]) + codes[1], return_inverse=True)
    numbers, levers = [], []
    for code in met.tolist():
        schema, layout = names[0][code // len(names[1])], names[1][code % len(names[1])]
        if schema not in schemas:
            raise StoreError(f"the record has a room of {schema}, which {condition.name} has not")
        placed = Layout.of(schemas[schema], layout, tables.positions)
        numbers.append(list(schemas).index(schema))
        levers.append(placed.lever_at())
    return tables, np.array(numbers)[which], np.array(levers)[which]


def _padded(lists: Any, used: IntArray) -> NDArray[Any]:
    """``[N, L]`` the values of lists, with zeros after their ends."""
    values = lists.flatten().to_numpy(zero_copy_only=False)
    padded = np.zeros((len(used), int(used.max(initial=0))), values.dtype)
    padded[np.arange(padded.shape[1]) < used[:, None]] = values
    return padded


def _found_before(columns: Mapping[str, Any], most: int) -> BoolArray:
    """``[N, K]`` which solutions were found in the trial before each attempt."""
    new = columns["new_solution"].to_numpy(zero_copy_only=False)
    solution = columns["solution"].to_numpy().astype(np.int64)
    attempt = columns["attempt"].to_numpy()
    gained = np.zeros((len(new) + 1, most), np.int64)
    gained[1:][np.flatnonzero(new), solution[new]] = 1
    total = gained.cumsum(axis=0)
    first = np.arange(len(new)) - attempt + 1  # where the trial begins
    found: BoolArray = total[:-1] > total[first]
    return found


def _disagreement(columns: Mapping[str, Any], row: int, condition: Condition) -> StoreError:
    at = {name: columns[name][row].as_py() for name in ("learner", *TRIAL, "attempt")}
    return StoreError(
        f"attempt {at['attempt']} of subject {at['subject']} of {at['learner']} in "
        f"{condition.name} ({at['phase']} {at['trial']}, loop {at['loop']}) differs from "
        "the record when it is replayed; the record is damaged or another version’s: "
        "compare again"
    )
