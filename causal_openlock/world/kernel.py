"""One step of many rooms: a loop over the rooms, compiled.

A room is a row of the tables of its schema and a permutation: which lever is at which position.
What an action leads to is looked up by row and column: the row after it, and its *event*, a word in
which each bit is a fact about the action. Three facts depend on the past and are added here. The
reward is then looked up by the event and the number of solutions found before.

Whatever is compiled, and the constants in it, stand in this one file, since numba's cache notices
no change elsewhere. Unsigned numbers keep the loop fast: an index that may be negative counts from
the end, which has to be tested.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.files.compiling import compiled
from causal_openlock.schemas.fsm import FloatArray

FIRST, LAST, INACTIVE, CHANGED, UNLOCKS, UNLOCKED, OPENS, ON_PATH = (1 << bit for bit in range(8))
"""Bits of an event, as in :class:`~causal_openlock.world.rewards.Events`."""
REPEATED, NEW, RETRACED = 1 << 8, 1 << 9, 1 << 10
"""Bits of an event that depend on the past."""
IDLE = 1 << 11
"""Bit of the event where nothing is done: the room waits, or is put back."""
WORDS = 1 << 12
"""Number of words of the bits so far, by which rewards are looked up."""
UNSURE, PUT_BACK = 1 << 12, 1 << 13
"""The action can fail by chance; the attempt was over before, so the room is put back."""

ROW, START, AFTER, EVENT, PREVIOUS, PAYER = range(6)
"""Columns of :attr:`causal_openlock.world.rooms.State.situation`."""
SOLUTIONS_LEFT, SOLUTIONS_FOUND, ATTEMPTS_LEFT, ACTIONS_LEFT = range(4)
"""Columns of :attr:`causal_openlock.world.rooms.State.console`."""


def step(
    state: tuple[Any, ...],
    tables: tuple[Any, ...],
    paid: FloatArray,
    action: NDArray[np.int64],
    given_luck: FloatArray,
    outcome: tuple[Any, ...],
    legal: int,
    stop_when_solved: bool,
    put_back: bool,
) -> bool:
    """Take one action in each room; False, and nothing is changed, if one is not legal.

    The arguments are those of :class:`~causal_openlock.world.rooms.Rooms`: its state, which is
    changed, the first six of its tables, and an outcome to be written. ``paid`` is
    ``[F, WORDS, K + 1]``, rewards by function, event and number of solutions found before; without
    any ``given_luck`` each room draws its own.
    """
    situation, console, found, columns, observation, luck = state
    afters, events, chances, solutions, begins, actions_left = tables
    reward, attempt_over, trial_over, new_solution, seen = outcome
    rooms, width = columns.shape
    fails, waits = width - 2, width - 1
    lock, door = observation.shape[1] - 2, observation.shape[1] - 1
    positions = lock // 2
    for room in range(rooms):
        if not 0 <= action[room] < legal:
            return False
    for room in range(rooms):
        does = np.uint32(action[room])
        row, column = situation[room, ROW], columns[room, does]
        event = events[row, column]
        if event & UNSURE:
            if len(given_luck):
                number = given_luck[room]
            else:  # xorshift64 (Marsaglia, 2003)
                bits = luck[room]
                bits ^= bits << np.uint64(13)
                bits ^= bits >> np.uint64(7)
                bits ^= bits << np.uint64(17)
                luck[room] = bits
                number = (bits >> np.uint64(11)) * 2.0**-53
            if number >= chances[row, column]:
                column = fails
                event = events[row, column]
        after = afters[row, column]

        # What depends on the past.
        solutions_found = np.uint32(console[room, SOLUTIONS_FOUND])
        if event & UNLOCKED:
            solution = solutions[after]
            if solution >= 0 and not found[room, solution]:
                event |= NEW
        if does == situation[room, PREVIOUS]:
            event |= REPEATED
        if solutions_found and event & ON_PATH:
            for solution in range(found.shape[1]):
                if found[room, solution] and begins[after, solution]:
                    event |= RETRACED
        reward[room] = paid[situation[room, PAYER], event & (WORDS - 1), solutions_found]

        if event & CHANGED:
            if does < positions:
                observation[room, does] = 1
            elif does < 2 * positions:
                observation[room, does - positions] = 0
            observation[room, lock] = event & UNLOCKED == 0
            observation[room, door] = event & OPENS != 0
        if len(seen):
            seen[room] = observation[room]

        # Whether the attempt and the trial are over.
        new = event & OPENS != 0 and event & NEW != 0
        if new:
            found[room, solutions[after]] = True
            console[room, SOLUTIONS_FOUND] += 1
            console[room, SOLUTIONS_LEFT] -= 1
        solved = stop_when_solved and console[room, SOLUTIONS_LEFT] == 0
        over = event & LAST != 0
        ends = over and (solved or console[room, ATTEMPTS_LEFT] == 1)
        attempt_over[room], trial_over[room], new_solution[room] = over, ends, new
        if ends:
            console[room, ATTEMPTS_LEFT] = 0
        situation[room, AFTER], situation[room, EVENT] = after, event
        if event & PUT_BACK or (over and put_back):
            console[room, ATTEMPTS_LEFT] -= not ends
            observation[room, :positions] = 0
            observation[room, lock], observation[room, door] = 1, 0
            after, does = situation[room, START], np.uint32(waits)
        situation[room, ROW], situation[room, PREVIOUS] = after, does
        console[room, ACTIONS_LEFT] = actions_left[after]
    return True


@cache
def compiled_step() -> Callable[..., bool]:
    """:func:`step`, compiled; here and not above, since numba takes a while to load."""
    return compiled(step)
