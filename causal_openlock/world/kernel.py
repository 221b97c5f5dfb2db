"""One step of many rooms, compiled: where actions lead, what they pay, which attempts end.

Only :class:`causal_openlock.world.batch.RoomBatch` calls it, and imports this module when it is
first needed, since numba takes a while to load. The argument types never change, so that there is
one compiled version, kept on disk.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numba
import numpy as np

from causal_openlock.world.reward_table import ALWAYS, IF_FOUND, IF_REPEATED
from causal_openlock.world.tables import ACTIONS_LEFT, OPENED, UNLOCKED

Compiled = TypeVar("Compiled", bound=Callable[..., Any])

ATTEMPT, FOUND, SOLUTIONS, PREVIOUS, REWARD = range(5)
"""Rows of ``counts``."""


def compiled(function: Compiled) -> Compiled:
    """Compile at the first call, once for an installation."""
    return cast(Compiled, numba.njit(cache=True)(function))


@compiled
def step(
    row: Any,
    action: Any,
    luck: Any,
    effect: Any,
    status: Any,
    chance: Any,
    paid: Any,
    matters: Any,
    solution: Any,
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
    put_back: bool,
    history: int,
) -> tuple[int, int, int, int]:
    """Take one action in each of B rooms; B, R, W, F as in ``RoomBatch`` and ``RoomTables``.

    Args:
        row: ``[B]`` where each room is.
        action: ``[B]`` what is done, an index of a column.
        luck: ``[B]`` numbers in [0, 1); empty if no room leaves anything to chance.
        effect: ``[R * W]`` see ``RoomTables``.
        status: ``[R]`` see there.
        chance: ``[R * W]`` see there; empty if no room leaves anything to chance.
        paid: ``[F, R * W]`` the rewards; see ``RewardTable``.
        matters: ``[F, R * W]`` see there.
        solution: ``[R]`` see ``RoomTables``.
        counts: ``[5, B]`` attempt, solutions found, solutions of the room, action before, and
            which of the F rewards is paid; changed.
        found: ``[B, K]`` which solutions are found; changed.
        after: ``[B]`` out: the row that the action led to.
        next_row: ``[B]`` out: the row of the next action; it may be the same array.
        actions_left: ``[B]`` out: how many actions are left at ``next_row``.
        reward: ``[B]`` out: the reward, where nothing that went before matters.
        attempt_over: ``[B]`` of False; out: whether the attempt is over.
        trial_over: ``[B]`` of False; out: whether the trial is over.
        new_solution: ``[B]`` of False; out: whether a new solution was found.
        judged: ``[2, B]`` out: rooms whose reward depends on what went before, and whether their
            action repeats the one before it.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        put_back: Whether a room is put back as soon as its attempt is over; otherwise its next
            action does that.
        history: What of the past any reward depends on: ``IF_FOUND``, which only matters once the
            door is unlocked, ``IF_REPEATED``, or both.

    Returns:
        How many attempts ended, how many trials, how many solutions were new, and how many rooms
        there are in ``judged``.
    """
    # Unsigned numbers as indices: signed ones could count from the end, which takes time to check.
    width = np.uint64(len(effect) // len(status))
    failed = np.uint64(width - np.uint64(2))
    noisy, several = len(chance) > 0, len(paid) > 1
    for room in range(len(row)):
        first = np.uint64(row[room]) * width
        choice = first + np.uint64(action[room])
        if noisy:
            fails = (luck[room] >= chance[choice]) & (chance[choice] > 0.0)
            choice = first + failed if fails else choice
        after[room] = effect[choice]
        reward[room] = paid[counts[REWARD, room] if several else 0, choice]
    attempts = trials = new = 0
    for room in range(len(row)):
        now = status[np.uint64(after[room])]
        actions_left[room] = now  # with its other bits, for the time being
        attempts += now & ACTIONS_LEFT == 0
    judgements = 0
    if history:
        for room in range(len(row)):
            if history == IF_FOUND and actions_left[room] < UNLOCKED:
                continue
            at = np.uint64(row[room])
            same = action[room] == counts[PREVIOUS, room]
            choice = at * width + np.uint64(action[room])
            if noisy and after[room] != effect[choice]:
                choice = at * width + failed
            why = matters[counts[REWARD, room], choice]
            if (
                why & ALWAYS
                or (why & IF_FOUND and counts[FOUND, room] > 0)
                or (why & IF_REPEATED and same)
            ):
                judged[0, judgements] = room
                judged[1, judgements] = same
                judgements += 1
            if history & IF_REPEATED:
                counts[PREVIOUS, room] = action[room] if status[at] & ACTIONS_LEFT else -1
    if attempts:
        attempt = counts[ATTEMPT]
        for room in range(len(row)):
            over = actions_left[room] & ACTIONS_LEFT == 0
            spent = over & (attempt[room] >= attempt_limit)
            attempt_over[room] = over
            trial_over[room] = spent
            trials += spent
            attempt[room] += over
        for room in range(len(row)):
            if actions_left[room] >= OPENED:
                solution_now = solution[np.uint64(after[room])]
                if solution_now >= 0 and not found[room, solution_now]:
                    found[room, solution_now] = True
                    counts[FOUND, room] += 1
                    new_solution[room] = True
                    new += 1
                solved = stop_when_solved and counts[FOUND, room] == counts[SOLUTIONS, room]
                if solved and not trial_over[room]:
                    trial_over[room] = True
                    trials += 1
        if history & IF_REPEATED:
            for room in range(len(row)):
                if attempt_over[room]:
                    counts[PREVIOUS, room] = -1
    if put_back:
        for room in range(len(row)):
            next_row[room] = after[room]
            if actions_left[room] & ACTIONS_LEFT == 0:
                start = effect[np.uint64(after[room]) * width]
                next_row[room] = start
                actions_left[room] = status[np.uint64(start)]
    for room in range(len(row)):
        actions_left[room] &= ACTIONS_LEFT
    return attempts, trials, new, judgements
