"""Many rooms during their trials: the rooms of sessions, environments and meta-training.

An action moves a room to another row of its schema's table and pays a reward. An attempt is over
when the door is open or no action is left. A trial is over when every solution is found or no
attempt is left; then the caller begins another one (:meth:`Rooms.begin_trials`).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from causal_openlock.schemas.fsm import FSM, BoolArray, FloatArray, IntArray, compile_schema
from causal_openlock.schemas.schema import Schema
from causal_openlock.world import kernel
from causal_openlock.world.rewards import RewardFunction, rewards_by_event
from causal_openlock.world.room import Layout


class RoomTables(NamedTuple):
    """The attempts of G schemas, unrolled and stacked, their levers at the first of P positions.

    R rows, one for each state that an attempt can be in after each number of actions: few, since it
    is short. The first of a schema is the start: no action used, all levers pulled, door closed.
    K solutions, and W columns: the 2P + 1 actions, to try what has a chance and fail, and to wait,
    which changes and pays nothing. The kernel looks up the first six.

    Example:
        >>> from causal_openlock import find_schema
        >>> tables = RoomTables.of([(find_schema("CC3"), 3)], positions=7)
        >>> tables.used[tables.after[0, :2]]  # after one action
        array([1, 1])
    """

    after: NDArray[np.uint32]  #: ``[R, W]`` the row after an action that takes effect
    event: NDArray[np.uint16]  #: ``[R, W]`` its event, a word of the kernel's bits
    chance: FloatArray  #: ``[R, W]`` the probability that it takes effect; 0 if it can do nothing
    solution: NDArray[np.int32]  #: ``[R]`` the solution whose levers are pushed, -1 for none
    begins: BoolArray  #: ``[R, K]`` whether the actions so far are the beginning of each solution
    actions_left: NDArray[np.int32]  #: ``[R]`` the actions left in the attempt; 0 if it is over
    state: IntArray  #: ``[R]`` the state of the schema's machine
    used: IntArray  #: ``[R]`` actions used so far in the attempt
    start: IntArray  #: ``[G]`` the first row of each schema, where its attempts begin
    levers: IntArray  #: ``[G]`` how many levers each schema has
    solutions: IntArray  #: ``[G]`` how many solutions

    @classmethod
    def of(cls, schemas: Sequence[tuple[Schema, int]], positions: int) -> RoomTables:
        """Unroll the attempts of schemas, each with the number of actions in an attempt."""
        most, first = max(len(schema.solutions) for schema, _ in schemas), 0
        tables = []
        for schema, limit in schemas:
            tables.append(_table(compile_schema(schema), limit, first, positions, most))
            first += len(tables[-1].state)
        return cls(*map(np.concatenate, zip(*tables, strict=True)))

    @property
    def positions(self) -> int:
        """Number of positions, P."""
        return self.fails // 2

    @property
    def fails(self) -> int:
        """The column of an action that has a chance and moves nothing; the number of actions."""
        return self.after.shape[1] - 2

    @property
    def waits(self) -> int:
        """The column of no action at all."""
        return self.after.shape[1] - 1

    @property
    def stochastic(self) -> bool:
        """Whether any action can fail by chance."""
        return bool((self.event & kernel.UNSURE).any())


def _table(fsm: FSM, limit: int, first: int, positions: int, solutions: int) -> RoomTables:
    """The table of one schema, whose rows begin at ``first``."""
    layers = [np.zeros(1, dtype=np.int64)]
    for _ in range(limit):
        playing = layers[-1][~fsm.opened[layers[-1]]]
        layers.append(np.union1d(playing, fsm.next_state[playing].ravel()))
    state, rows = np.concatenate(layers), np.arange(sum(map(len, layers)))
    used = np.repeat(np.arange(limit + 1), list(map(len, layers)))
    over = (used == limit) | fsm.opened[state]

    # Rows are in the order of their keys. The last action of a role moves nothing.
    levers, roles = fsm.levers, Layout(tuple(range(fsm.levers)), positions).role_actions()
    moved = np.column_stack([fsm.next_state[state], state])[:, [*roles, -1]]
    key, key_after = used * fsm.states + state, (used[:, None] + 1) * fsm.states + moved
    after = np.where(over[:, None], 0, np.searchsorted(key, key_after))
    after = np.column_stack([after, rows])
    chance = np.pad(fsm.chance[state] * ~over[:, None], ((0, 0), (0, 1)))[:, roles]

    # If as many bits are set as actions were used, every action was a push that took effect.
    pushes_only = np.bitwise_count(state) == used
    needed = np.array([fsm.schema.mask(solution) for solution in fsm.schema.solutions])
    begins = (state[:, None] & ~needed == 0) | (state[:, None] == needed | 1 << levers)
    table = RoomTables(
        after=(first + after).astype(np.uint32),
        event=np.zeros(0, np.uint16),
        chance=np.pad(chance, ((0, 0), (0, 2))),
        solution=fsm.solution[state].astype(np.int32),
        begins=np.pad(begins & pushes_only[:, None], ((0, 0), (0, solutions - len(needed)))),
        actions_left=np.where(over, 0, limit - used).astype(np.int32),
        state=state,
        used=used,
        start=np.array([first]),
        levers=np.array([levers]),
        solutions=np.array([len(needed)]),
    )
    event = events_of(table, fsm, rows[:, None], after)
    event[:, levers:positions] |= kernel.INACTIVE
    event[:, positions + levers : 2 * positions] |= kernel.INACTIVE
    event[(table.chance > 0) & (table.chance < 1)] |= kernel.UNSURE
    event[over] = kernel.IDLE | kernel.PUT_BACK
    event[:, -1] = kernel.IDLE
    return table._replace(event=event)


def events_of(table: RoomTables, fsm: FSM, row: IntArray, after: IntArray) -> NDArray[np.uint16]:
    """The events of actions that lead from rows of a schema to others, as far as these two say."""
    unlocked, opened = fsm.unlocked[table.state], fsm.opened[table.state]
    facts = {
        kernel.FIRST: table.used[row] == 0,
        kernel.LAST: table.actions_left[after] == 0,
        kernel.CHANGED: table.state[row] != table.state[after],
        kernel.UNLOCKS: unlocked[after] & ~unlocked[row],
        kernel.UNLOCKED: unlocked[after],
        kernel.OPENS: opened[after] & ~opened[row],
        kernel.ON_PATH: np.asarray(table.begins.any(axis=1))[after],
    }
    event = np.zeros(after.shape, np.uint16)
    for bit, holds in facts.items():
        event |= np.uint16(bit) * holds
    return event


class State(NamedTuple):
    """All that changes in B rooms of P positions."""

    situation: NDArray[np.uint32]
    """``[B, 6]`` the row, the first row of the schema, the row that the last action led to and its
    event, the action before the next one in the attempt (to wait for none), and which of the
    rewards is paid."""
    console: NDArray[np.int32]  #: ``[B, 4]`` solutions left and found, attempts left, actions left
    found: BoolArray  #: ``[B, K]`` which solutions are found in the trial
    column: NDArray[np.uint8]  #: ``[B, W]`` the same action on the lever that is at that position
    observation: NDArray[np.int8]  #: ``[B, 2P + 2]``
    luck: NDArray[np.uint64]  #: ``[B]`` generators of rooms that are given no luck; none is 0


class Outcome(NamedTuple):
    """What an action in each of B rooms led to."""

    reward: FloatArray  #: ``[B]``
    attempt_over: BoolArray  #: ``[B]``
    trial_over: BoolArray  #: ``[B]``
    new_solution: BoolArray  #: ``[B]`` whether a solution was found, the first time in the trial
    seen: NDArray[np.int8]
    """``[B, 2P + 2]`` the observation before rooms are put back; empty if nobody asked."""


class Rooms:
    """B rooms, each somewhere in an attempt and a trial.

    Args:
        tables: The tables of their schemas.
        rewards: Reward functions; each room is paid by one of them.
        size: B.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        put_back: Whether a room is put back as soon as its attempt is over; otherwise its next
            action puts it back and does nothing else.

    Example:
        >>> from causal_openlock import find_schema
        >>> from causal_openlock.world.rewards import find_reward
        >>> tables = RoomTables.of([(find_schema("CC3"), 3)], positions=7)
        >>> rooms = Rooms(tables, [find_reward("basic")], size=1, attempt_limit=30)
        >>> rooms.begin_trials(slice(None), schema=np.array([0]), lever=np.arange(7)[None])
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
        most = min(solutions, attempt_limit)  # an attempt finds at most one
        self._paid = rewards_by_event(rewards, tables.event, most)
        self.state = State(
            situation=np.zeros((size, 6), np.uint32),
            console=np.zeros((size, 4), np.int32),
            found=np.zeros((size, solutions), bool),
            column=np.tile(np.arange(tables.waits + 1, dtype=np.uint8), (size, 1)),
            observation=np.zeros((size, 2 * tables.positions + 2), np.int8),
            luck=np.ones(size, np.uint64),
        )

    def begin_trials(self, which: IntArray | slice, schema: IntArray, lever: IntArray) -> None:
        """Begin a trial for some of the rooms.

        Args:
            which: Indices of n of the B rooms.
            schema: ``[n]`` index of the schema of each trial.
            lever: ``[n, P]`` which lever is at each position; those that the schema does not have
                are inactive.
        """
        tables, (situation, console, found, column, observation, _) = self.tables, self.state
        positions, start = tables.positions, tables.start[schema]
        situation[which, kernel.ROW] = situation[which, kernel.START] = start
        situation[which, kernel.PREVIOUS] = tables.waits
        console[which, kernel.SOLUTIONS_LEFT] = tables.solutions[schema]
        console[which, kernel.SOLUTIONS_FOUND] = 0
        console[which, kernel.ATTEMPTS_LEFT] = self.attempt_limit
        console[which, kernel.ACTIONS_LEFT] = tables.actions_left[start]
        found[which] = False
        column[which, :positions] = lever
        column[which, positions : 2 * positions] = positions + lever
        observation[which, :positions] = 0
        observation[which, positions:-2] = lever < tables.levers[schema][:, None]
        observation[which, -2:] = 1, 0

    def now(self, what: int) -> IntArray:
        """``[B]`` a column of the situation, such as :data:`causal_openlock.world.kernel.ROW`."""
        return self.state.situation[:, what].astype(np.int64)

    @property
    def observation(self) -> NDArray[np.int8]:
        """``[B, 2P + 2]`` what is seen in each room; a copy."""
        return self.state.observation.copy()

    @property
    def console(self) -> NDArray[np.int32]:
        """``[B, 4]`` solutions left and found, attempts left, actions left; a copy."""
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
        over, ends, new = (np.empty(size, bool) for _ in range(3))
        shown = np.empty_like(self.state.observation) if seen else _NOTHING_SEEN
        outcome = Outcome(np.empty(size), over, ends, new, shown)
        # Plain tuples and one type of each array, which numba recognises fastest.
        taken = kernel.compiled_step()(
            tuple(self.state),
            self.tables[:6],
            self._paid,
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
