"""One step of many rooms, compiled: the next rows, the rewards, the attempts and trials that end.

Only :class:`causal_openlock.world.batch.RoomBatch` calls it, and imports this module at its first
step, since numba takes a while to load. The argument types never change, so there is only one
compiled version, cached on disk.

Rooms are stepped in blocks that fit into the processor's first-level cache, and within a block one
result after the other: writing to a single array at a time is twice as fast as to all of them.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from causal_openlock.world.reward_table import ALWAYS, IF_FOUND, IF_REPEATED, PASTS
from causal_openlock.world.tables import ACTIONS_LEFT, OPENED, UNLOCKED

Compiled = TypeVar("Compiled", bound=Callable[..., Any])

ATTEMPT, FOUND, SOLUTIONS, PREVIOUS, REWARD = range(5)
"""Rows of ``counts``."""
BLOCK = 256


def compiled(function: Compiled) -> Compiled:
    """Compile at the first call, once for each installation."""
    return cast(Compiled, numba.njit(cache=True)(function))


@numba.njit
def look_up(table: Any, where: Any, out: Any) -> None:
    """``out = table[where]``."""
    for index in range(len(where)):
        # Unsigned numbers as indices: signed ones could count from the end, which takes time.
        out[index] = table[np.uint64(where[index])]


@compiled
def step(
    row: Any,
    action: Any,
    luck: Any,
    room_of: Any,
    start: Any,
    shift: Any,
    column: Any,
    effect: Any,
    chance: Any,
    status: Any,
    solution: Any,
    begun: Any,
    paid: Any,
    matters: Any,
    case: Any,
    known: Any,
    counts: Any,
    found: Any,
    after: Any,
    next_row: Any,
    actions_left: Any,
    reward: Any,
    attempt_over: Any,
    trial_over: Any,
    new_solution: Any,
    judged: Any,
    attempt_limit: int,
    stop_when_solved: bool,
    history: int,
) -> tuple[bool, bool, bool, int]:
    """Take one action in each of B rooms; B, R, M, W, G, K, F as in ``RoomBatch``, ``RoomTables``.

    Args:
        row: ``[B]`` where each room is.
        action: ``[B]`` its action, an index of a column.
        luck: ``[B]`` numbers in [0, 1); empty if all rooms are deterministic.
        room_of: ``[B]`` index of each room in the tables.
        start: ``[G]`` see ``RoomTables``.
        shift: ``[G]`` see there.
        column: ``[G * W]`` see there.
        effect: ``[M * W]`` see there.
        chance: ``[M * W]`` see there; empty if all rooms are deterministic.
        status: ``[R]`` see there.
        solution: ``[R]`` see there.
        begun: ``[M, K]`` see there.
        paid: ``[F, M * W]`` the rewards; see ``RewardTable``.
        matters: ``[F, M * W]`` see there.
        case: ``[F, M * W]`` where in ``known`` the rewards of each action are; -1 for nowhere.
        known: The rewards of actions for each possible past; NaN where not known yet.
        counts: ``[5, B]`` attempt, solutions found, solutions of the room, action before, and
            which of the F rewards is paid; changed.
        found: ``[B, K]`` which solutions are found; changed.
        after: ``[B]`` out: the row that the action led to.
        next_row: ``[B]`` out: the row of the next action, after rooms whose attempt is over are
            reset; empty if the next action does that.
        actions_left: ``[B]`` out: how many actions are left at the row of the next action.
        reward: ``[B]`` out: the reward, where it does not depend on an unknown past.
        attempt_over: ``[B]`` of False; out: whether the attempt is over.
        trial_over: ``[B]`` of False; out: whether the trial is over.
        new_solution: ``[B]`` of False; out: whether a new solution was found.
        judged: ``[3, B]`` out: rooms whose reward is not known, whether their action repeats the
            one before it, and the index of the reward in ``known``.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        history: What any reward depends on in the past: ``IF_FOUND``, which only matters once the
            door is unlocked, ``IF_REPEATED``, or both.

    Returns:
        Whether any attempt ended, any trial, and any solution was new, and how many rooms there
        are in ``judged``.
    """
    width = np.uint64(len(column) // len(shift))
    failed = np.uint64(width - np.uint64(2))
    noisy, one_room, several = len(chance) > 0, len(shift) == 1, len(paid) > 1
    first_paid = paid[0]
    choice_in_block = np.empty(BLOCK, np.uint32)
    judgements = 0
    for first in range(0, len(row), BLOCK):
        last = min(first + BLOCK, len(row))
        rows, actions, rooms = row[first:last], action[first:last], room_of[first:last]
        afters, choices = after[first:last], choice_in_block[: last - first]
        if one_room:
            for i in range(last - first):
                choices[i] = np.uint64(rows[i]) * width + np.uint64(actions[i])
        else:
            for i in range(last - first):
                which = np.uint64(rooms[i])
                own = column[which * width + np.uint64(actions[i])]
                choices[i] = np.uint64(rows[i] + shift[which]) * width + own
        if noisy:
            for i in range(last - first):
                odds = chance[choices[i]]
                if (luck[first + i] >= odds) & (odds > 0.0):
                    listed = np.uint64(rows[i] + shift[np.uint64(rooms[i])])
                    choices[i] = listed * width + failed
        look_up(effect, choices, afters)
        if not one_room:
            for i in range(last - first):
                afters[i] -= shift[np.uint64(rooms[i])]
        if several:
            for i in range(last - first):
                reward[first + i] = paid[counts[REWARD, first + i], choices[i]]
        else:
            look_up(first_paid, choices, reward[first:last])
        look_up(status, afters, actions_left[first:last])  # with its other bits, for now
        if not history:
            continue
        if history == IF_FOUND:
            seen = np.uint8(0)
            for i in range(first, last):
                seen |= actions_left[i]
            if seen < UNLOCKED:
                continue
        for room in range(first, last):
            if history == IF_FOUND and actions_left[room] < UNLOCKED:
                continue
            choice = choices[room - first]
            same = action[room] == counts[PREVIOUS, room]
            paid_by = counts[REWARD, room]
            why = matters[paid_by, choice]
            if (
                why & ALWAYS
                or (why & IF_FOUND and counts[FOUND, room] > 0)
                or (why & IF_REPEATED and same)
            ):
                at = case[paid_by, choice]
                if at >= 0:
                    old = solution[np.uint64(after[room])]
                    retraced = False
                    for each in range(found.shape[1]):
                        retraced |= found[room, each] and begun[effect[choice], each]
                    past = 4 * same + 2 * (old >= 0 and found[room, old]) + retraced
                    at += PASTS * counts[FOUND, room] + past
                if at >= 0 and not np.isnan(known[at]):
                    reward[room] = known[at]
                else:
                    judged[0, judgements] = room
                    judged[1, judgements] = same
                    judged[2, judgements] = at
                    judgements += 1
            if history & IF_REPEATED:
                before = status[np.uint64(row[room])] & ACTIONS_LEFT
                counts[PREVIOUS, room] = action[room] if before else -1
    ended = finished = found_new = False
    for room in range(len(row)):
        ended |= actions_left[room] & ACTIONS_LEFT == 0
    if ended:
        attempt = counts[ATTEMPT]
        for room in range(len(row)):
            attempt_over[room] = actions_left[room] & ACTIONS_LEFT == 0
        for room in range(len(row)):
            trial_over[room] = attempt_over[room] & (attempt[room] >= attempt_limit)
            finished |= trial_over[room]
            attempt[room] += attempt_over[room]
        for room in range(len(row)):
            if actions_left[room] >= OPENED:
                solution_now = solution[np.uint64(after[room])]
                if solution_now >= 0 and not found[room, solution_now]:
                    found[room, solution_now] = True
                    counts[FOUND, room] += 1
                    new_solution[room] = found_new = True
                if stop_when_solved and counts[FOUND, room] == counts[SOLUTIONS, room]:
                    trial_over[room] = finished = True
        if history & IF_REPEATED:
            for room in range(len(row)):
                if attempt_over[room]:
                    counts[PREVIOUS, room] = -1
    if len(next_row):
        for room in range(len(row)):
            next_row[room] = after[room]
        if ended:
            for room in range(len(row)):
                if attempt_over[room]:
                    next_row[room] = start[np.uint64(room_of[room])]
                    actions_left[room] = status[np.uint64(next_row[room])]
    for room in range(len(row)):
        actions_left[room] &= ACTIONS_LEFT
    return ended, finished, found_new, judgements
