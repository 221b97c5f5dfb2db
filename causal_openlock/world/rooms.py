"""Many rooms during their trials: the rooms of sessions, environments and meta-training.

An action moves a room to another row of its schema's table and pays a reward. An attempt is over
when the door is open or no action is left. A trial is over when every solution is found or no
attempt is left; then the caller begins another one (:meth:`Rooms.begin_trials`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import (
    Attempt,
    BoolArray,
    FloatArray,
    IntArray,
    compile_schema,
    unroll,
)
from causal_openlock.schemas.schema import Schema
from causal_openlock.world import kernel
from causal_openlock.world.events import RewardFunction, rewards_by_event
from causal_openlock.world.kernel import Outcome, State, Tables
from causal_openlock.world.room import Layout


@dataclass(frozen=True, eq=False)
class RoomTables:
    """The unrolled attempts of G schemas, stacked, in rooms of P positions.

    A *row* is a state of a schema in an attempt (:func:`causal_openlock.schemas.fsm.unroll`); the
    levers are at the first positions. R rows; A = 2P + 1 actions, and two more columns: to try what
    has a chance and fails, and to wait, which changes and pays nothing.

    Attributes:
        positions: P.
        lookup: What the kernel looks up.
        state: ``[R]`` state of the schema's machine.
        used: ``[R]`` actions used so far in the attempt.
        opened: ``[R]`` whether the door is open.
        start: ``[G]`` the first row of each schema, where its attempts begin.
        levers: ``[G]`` how many levers each schema has.
        solutions: ``[G]`` how many solutions.
        action_limit: ``[G]`` how many actions an attempt has.

    Example:
        >>> from causal_openlock import find_schema
        >>> tables = RoomTables.of([(find_schema("CC3"), 3)], positions=7)
        >>> tables.used[tables.lookup.after[0, :2]]  # after one action
        array([1, 1])
    """

    positions: int
    lookup: Tables
    state: IntArray
    used: IntArray
    opened: BoolArray
    start: IntArray
    levers: IntArray
    solutions: IntArray
    action_limit: IntArray

    @classmethod
    def of(cls, schemas: Sequence[tuple[Schema, int]], positions: int) -> RoomTables:
        """Unroll the attempts of schemas, each with the number of actions in an attempt."""
        most = max(len(schema.solutions) for schema, _ in schemas)
        attempts = [unroll(compile_schema(schema), limit) for schema, limit in schemas]
        sizes = [len(attempt.state) for attempt in attempts]
        start = np.cumsum([0, *sizes[:-1]])
        stacked = [
            _lookup(attempt, first, positions, most)
            for attempt, first in zip(attempts, start.tolist(), strict=True)
        ]
        return cls(
            positions=positions,
            lookup=Tables(*map(np.concatenate, zip(*stacked, strict=True))),
            state=np.concatenate([attempt.state for attempt in attempts]),
            used=np.concatenate([attempt.used for attempt in attempts]),
            opened=np.concatenate([attempt.fsm.opened[attempt.state] for attempt in attempts]),
            start=start,
            levers=np.array([len(schema.levers) for schema, _ in schemas]),
            solutions=np.array([len(schema.solutions) for schema, _ in schemas]),
            action_limit=np.array([limit for _, limit in schemas]),
        )

    @property
    def fails(self) -> int:
        """The column of an action that has a chance and moves nothing."""
        return 2 * self.positions + 1

    @property
    def waits(self) -> int:
        """The column of no action at all."""
        return 2 * self.positions + 2

    @property
    def stochastic(self) -> bool:
        """Whether any action can fail by chance."""
        return bool((self.lookup.event & kernel.UNSURE).any())


def _lookup(attempt: Attempt, first: int, positions: int, solutions: int) -> Tables:
    """The tables of one schema, whose rows begin at ``first``."""
    fsm, rows = attempt.fsm, np.arange(len(attempt.state))
    roles = Layout(tuple(range(fsm.levers)), positions).role_actions()
    after = np.column_stack([attempt.effect[:, roles], attempt.effect[:, -1], rows])
    chance = np.pad(attempt.chance[:, roles], ((0, 0), (0, 2)))
    event = events_of(attempt, rows[:, None], after)
    event[:, fsm.levers : positions] |= kernel.INACTIVE
    event[:, positions + fsm.levers : 2 * positions] |= kernel.INACTIVE
    event[(chance > 0) & (chance < 1)] |= kernel.UNSURE
    after[attempt.over, :-1], event[attempt.over] = 0, kernel.IDLE | kernel.PUT_BACK
    event[:, -1] = kernel.IDLE
    return Tables(
        after=(first + after).astype(np.uint32),
        event=event,
        chance=chance,
        solution=fsm.solution[attempt.state].astype(np.int32),
        begins=np.pad(attempt.begins, ((0, 0), (0, solutions - attempt.begins.shape[1]))),
        actions_left=np.where(attempt.over, 0, attempt.action_limit - attempt.used).astype(
            np.int32
        ),
    )


def events_of(attempt: Attempt, row: IntArray, after: IntArray) -> NDArray[np.uint16]:
    """The events of actions that lead from rows to others, as far as these two say."""
    unlocked, opened = attempt.fsm.unlocked[attempt.state], attempt.fsm.opened[attempt.state]
    facts = {
        kernel.FIRST: attempt.used[row] == 0,
        kernel.LAST: attempt.over[after],
        kernel.CHANGED: attempt.state[row] != attempt.state[after],
        kernel.UNLOCKS: unlocked[after] & ~unlocked[row],
        kernel.UNLOCKED: unlocked[after],
        kernel.OPENS: opened[after] & ~opened[row],
        kernel.ON_PATH: attempt.begins.any(axis=1)[after],
    }
    event = np.zeros(after.shape, np.uint16)
    for bit, holds in facts.items():
        event |= np.uint16(bit) * holds
    return event


class Rooms:
    """B rooms, each somewhere in an attempt and a trial.

    Args:
        tables: The schemas there are.
        rewards: Reward functions; each room is paid by one of them.
        size: B.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        put_back: Whether a room is put back as soon as its attempt is over; otherwise its next
            action puts it back and does nothing else.

    Attributes:
        state: All that changes; what is handed out are copies.

    Example:
        >>> from causal_openlock import find_schema
        >>> from causal_openlock.world.rewards import find_reward
        >>> tables = RoomTables.of([(find_schema("CC3"), 3)], positions=7)
        >>> rooms = Rooms(tables, [find_reward("basic")], size=1, attempt_limit=30)
        >>> rooms.begin_trials([0], schema=[0], lever=[range(7)])
        >>> [rooms.step(np.array([action])).reward.item() for action in (0, 1, 14)]
        [0.0, 10.0, 50.0]
    """

    def __init__(
        self,
        tables: RoomTables,
        rewards: Sequence[RewardFunction],
        size: int,
        attempt_limit: int,
        *,
        stop_when_solved: bool = True,
        put_back: bool = True,
    ) -> None:
        self.tables, self.attempt_limit = tables, attempt_limit
        self.stop_when_solved, self.put_back = stop_when_solved, put_back
        solutions = int(tables.solutions.max())
        # An attempt finds at most one.
        most = min(solutions, attempt_limit)
        self.paid = rewards_by_event(rewards, tables.lookup.event, most)
        self.state = State(
            situation=np.zeros((size, 6), np.uint32),
            console=np.zeros((size, 4), np.int32),
            found=np.zeros((size, solutions), bool),
            column=np.tile(np.arange(tables.waits + 1, dtype=np.uint8), (size, 1)),
            observation=np.zeros((size, 2 * tables.positions + 2), np.int8),
            luck=np.ones(size, np.uint64),
        )

    def begin_trials(
        self,
        which: IntArray | Sequence[int] | slice,
        schema: IntArray | Sequence[int],
        lever: IntArray | Sequence[Sequence[int]],
    ) -> None:
        """Begin a trial for some of the rooms.

        Args:
            which: Indices of n of the B rooms.
            schema: ``[n]`` index of the schema of each trial.
            lever: ``[n, P]`` which lever is at each position; those that the schema does not have
                are inactive.
        """
        tables, state, positions = self.tables, self.state, self.tables.positions
        schema, lever = np.asarray(schema), np.asarray(lever)
        start = tables.start[schema]
        state.situation[which, kernel.ROW] = state.situation[which, kernel.START] = start
        state.situation[which, kernel.PREVIOUS] = tables.waits
        state.console[which] = np.column_stack(
            [
                tables.solutions[schema],
                np.zeros_like(schema),
                np.full_like(schema, self.attempt_limit),
                tables.action_limit[schema],
            ]
        )
        state.found[which] = False
        state.column[which, :positions] = lever
        state.column[which, positions : 2 * positions] = positions + lever
        state.observation[which, :positions] = 0
        state.observation[which, positions : 2 * positions] = lever < tables.levers[schema][:, None]
        state.observation[which, -2:] = 1, 0

    @property
    def row(self) -> IntArray:
        """``[B]`` the row of each room, where its next action begins."""
        return self.state.situation[:, kernel.ROW].astype(np.int64)

    @property
    def after(self) -> IntArray:
        """``[B]`` the row that the last action of each room led to."""
        return self.state.situation[:, kernel.AFTER].astype(np.int64)

    @property
    def event(self) -> IntArray:
        """``[B]`` the event of the last action of each room."""
        return self.state.situation[:, kernel.EVENT].astype(np.int64)

    @property
    def observation(self) -> NDArray[np.int8]:
        """``[B, 2P + 2]`` what is seen in each room."""
        return self.state.observation.copy()

    @property
    def console(self) -> NDArray[np.int32]:
        """``[B, 4]`` solutions left, solutions found, attempts left, actions left."""
        return self.state.console.copy()

    def step(
        self,
        action: IntArray,
        luck: FloatArray | None = None,
        *,
        seen: bool = False,
        legal: int | None = None,
    ) -> Outcome:
        """Take one action in each room.

        Args:
            action: ``[B]`` actions; ``tables.waits`` leaves a room as it is.
            luck: ``[B]`` numbers in [0, 1): an action takes effect if its chance is above. By
                default each room draws its own.
            seen: Whether what is seen before rooms are put back is asked for.
            legal: Actions are below it; by default, columns of the tables.

        Raises:
            IndexError: If an action is not legal; nothing has changed then.
        """
        size, legal = len(action), legal or self.tables.waits + 1
        over, ends, new = np.empty(size, bool), np.empty(size, bool), np.empty(size, bool)
        shown = np.empty_like(self.state.observation) if seen else _NOTHING_SEEN
        outcome = Outcome(np.empty(size), over, ends, new, shown)
        # Plain tuples and one type of each array, which numba recognises fastest.
        taken = kernel.compiled_step()(
            tuple(self.state),
            tuple(self.tables.lookup),
            self.paid,
            np.array(action, np.int64),
            _NO_LUCK if luck is None else np.array(luck, np.float64),
            tuple(outcome),
            legal,
            self.stop_when_solved,
            self.put_back,
        )
        if not taken:
            raise IndexError(f"an action is not from 0 to {legal - 1}")
        return outcome


_NO_LUCK: FloatArray = np.zeros(0)
_NOTHING_SEEN: NDArray[np.int8] = np.zeros((0, 0), np.int8)
