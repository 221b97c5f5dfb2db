"""One step of many rooms, compiled: the next rows, the rewards, the attempts and trials that end.

Only :class:`causal_openlock.world.batch.RoomBatch` calls :func:`step`. Modules that need this one
import it at the first step or reset, since numba takes a while to load. The argument types never
change, so there is only one compiled version, cached on disk.

Rooms are stepped in blocks that stay in the processor's cache, and within a block one result after
the other: writing to a single array at a time is twice as fast as to all of them. What takes time
is to look up and store one value for each room. So the row after a move and its status are packed
into one word (:func:`packed`), and the compiler turns the loop that takes these words apart, like
all loops without look-ups or branches, into vector instructions.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.files.compiling import compiled
from causal_openlock.world.reward_table import ALWAYS, IF_FOUND, IF_REPEATED, PASTS
from causal_openlock.world.tables import ACTIONS_LEFT, OPENED, UNLOCKED, RoomTables

ATTEMPT, FOUND, SOLUTIONS, PREVIOUS, REWARD = range(5)
"""Rows of ``counts``."""
BLOCK = 2048
AFTER, OVER, STATUS = np.uint32((1 << 23) - 1), np.uint32(1 << 23), np.uint32(24)
"""Parts of a packed word: the bits of the row, the bit for the end of the attempt, and the first
bit of the status."""
WITH_UNLOCKED, WITH_OPENED = int(UNLOCKED) << 24, int(OPENED) << 24
"""Words from these up are those of an unlocked and of an open door."""


def packed(tables: RoomTables) -> NDArray[np.uint32]:
    """``[M * W]`` where each action leads: the listed row, whether it is the end, and the status.

    Raises:
        ValueError: If there are more than 2 ** 23 listed rows.
    """
    if len(tables.begun) > AFTER:
        raise ValueError(f"rooms have {len(tables.begun):,} rows in all, more than {AFTER:,}")
    # The status does not depend on the positions of the levers: that of any room of a list will do.
    status = np.zeros(len(tables.begun), np.uint32)
    status[tables.listed] = tables.status
    words = np.arange(len(status), dtype=np.uint32) | status << STATUS
    return (words | OVER * (status & ACTIONS_LEFT == 0))[tables.effect]


@compiled
def all_below(action: Any, limit: int) -> bool:
    """Whether all of some actions, ``[B]``, are from 0 to ``limit`` - 1."""
    outside: Any = False
    for index in range(len(action)):
        # As unsigned numbers, negative ones are very large: one comparison finds both.
        outside |= np.uint64(action[index]) >= np.uint64(limit)
    return not outside


@compiled
def drawn(numbers: Any, levers: int, codes: Any) -> tuple[Any, Any]:
    """Layouts by chance: lever *k* stands where *k* numbers are smaller.

    Args:
        numbers: ``[N, P]`` random numbers, one for each position.
        levers: How many levers are placed.
        codes: ``[C]`` layouts that are known, in ascending order: position times ``P ** k``, summed
            over the levers *k*.

    Returns:
        The layouts as numbers, ``[N]``, and their indices in ``codes``, ``[N]``, -1 for none.
    """
    many, positions = numbers.shape
    layouts, indices = np.empty(many, np.int64), np.empty(many, np.int64)
    weight = np.zeros(positions, np.int64)
    for lever in range(levers):
        weight[lever] = positions**lever
    columns, ranks = np.empty((positions, BLOCK)), np.empty(BLOCK, np.uint8)
    for first in range(0, many, BLOCK):
        last = min(first + BLOCK, many)
        mine = layouts[first:last]
        for i in range(last - first):
            mine[i] = 0
            for position in range(positions):
                columns[position, i] = numbers[first + i, position]
        for position in range(positions):
            own = columns[position]
            ranks[:] = 0
            for other in range(positions):
                its = columns[other]
                if other < position:
                    for i in range(last - first):
                        ranks[i] += its[i] <= own[i]
                else:
                    for i in range(last - first):
                        ranks[i] += its[i] < own[i]
            for i in range(last - first):
                mine[i] += position * weight[np.uint64(ranks[i])]
        # Search for all of the block side by side: each halving is the same for all.
        at, left = indices[first:last], len(codes)
        at[:] = 0 if left else -1
        while left > 1:
            half = left // 2
            for i in range(last - first):
                at[i] += half * (codes[np.uint64(at[i] + half)] <= mine[i])
            left -= half
        if left:
            for i in range(last - first):
                at[i] = at[i] if codes[np.uint64(at[i])] == mine[i] else -1
    return layouts, indices


@compiled
def step(
    row: Any,
    action: Any,
    luck: Any,
    after: Any,
    next_row: Any,
    seen: Any,
    actions_left: Any,
    reward: Any,
    attempt_over: Any,
    trial_over: Any,
    new_solution: Any,
    room_of: Any,
    start: Any,
    shift: Any,
    column: Any,
    move: Any,
    chance: Any,
    status: Any,
    observation: Any,
    solution: Any,
    begun: Any,
    paid: Any,
    matters: Any,
    case: Any,
    known: Any,
    counts: Any,
    found: Any,
    judged: Any,
    attempt_limit: int,
    stop_when_solved: bool,
    history: int,
    legal: int,
) -> tuple[bool, bool, bool, int]:
    """Take one action in each of B rooms; B, R, M, W, G, K, F as in ``RoomBatch``, ``RoomTables``.

    Args:
        row: ``[B]`` where each room is.
        action: ``[B]`` its action, an index of a column.
        luck: ``[B]`` numbers in [0, 1); empty if all rooms are deterministic.
        after: ``[B]`` out: the row that the action led to.
        next_row: ``[B]`` out: the row of the next action, after rooms whose attempt is over are
            reset; empty if the next action does that.
        seen: ``[B, 16]`` out: the observation at the row of the next action; empty if nobody asks.
        actions_left: ``[B]`` out: how many actions are left at the row of the next action.
        reward: ``[B]`` out: the reward, where it does not depend on an unknown past.
        attempt_over: ``[B]`` out: whether the attempt is over.
        trial_over: ``[B]`` of False; out: whether the trial is over.
        new_solution: ``[B]`` of False; out: whether a new solution was found.
        room_of: ``[B]`` index of each room in the tables.
        start: ``[G]`` see ``RoomTables``.
        shift: ``[G]`` see there.
        column: ``[G * W]`` see there.
        move: ``[M * W]`` see :func:`packed`.
        chance: ``[M * W]`` see ``RoomTables``; empty if all rooms are deterministic.
        status: ``[R]`` see there.
        observation: ``[R, 2]`` see there; each as two words.
        solution: ``[R]`` see there.
        begun: ``[M, K]`` see there.
        paid: ``[F, M * W]`` the rewards; see ``RewardTable``.
        matters: ``[F, M * W]`` see there.
        case: ``[F, M * W]`` where in ``known`` the rewards of each action are; -1 for nowhere.
        known: The rewards of actions for each possible past; NaN where not known yet.
        counts: ``[5, B]`` attempt, solutions found, solutions of the room, action before, and
            which of the F rewards is paid; changed.
        found: ``[B, K]`` which solutions are found; changed.
        judged: ``[3, B]`` out: rooms whose reward is not known, whether their action repeats the
            one before it, and the index of the reward in ``known``.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        history: What any reward depends on in the past: ``IF_FOUND``, which only matters once the
            door is unlocked, ``IF_REPEATED``, or both.
        legal: Actions are below it, or nothing is changed; 0 for actions that were checked before.

    Returns:
        Whether any attempt ended, any trial, and any solution was new, and how many rooms there
        are in ``judged``, -1 if an action is not legal.
    """
    if legal and not all_below(action, legal):
        return False, False, False, -1
    width = np.uint64(len(column) // len(shift))
    failed = width - np.uint64(2)
    noisy, one_room, several = len(chance) > 0, len(shift) == 1, len(paid) > 1
    put_back, looking = len(next_row) > 0, len(seen) > 0
    seen_words = seen.view(np.uint64)
    first_paid = paid[0]
    most = min(BLOCK, len(row))
    choice_in_block, word_in_block = np.empty(most, np.uint32), np.empty(most, np.uint32)
    shift_in_block = np.zeros(most, np.int64)
    ended = finished = found_new = False
    judgements = 0
    for first in range(0, len(row), BLOCK):
        last = min(first + BLOCK, len(row))
        rows, actions, rooms = row[first:last], action[first:last], room_of[first:last]
        afters, lefts, overs = after[first:last], actions_left[first:last], attempt_over[first:last]
        rewards = reward[first:last]
        choices, words = choice_in_block[: last - first], word_in_block[: last - first]
        # Unsigned numbers as indices: signed ones could count from the end, which takes time.
        if one_room:
            for i in range(last - first):
                choices[i] = np.uint64(rows[i]) * width + np.uint64(actions[i])
        else:
            for i in range(last - first):
                which = np.uint64(rooms[i])
                own = column[which * width + np.uint64(actions[i])]
                shift_in_block[i] = shift[which]
                choices[i] = np.uint64(rows[i] + shift[which]) * width + own
        if noisy:
            lucks = luck[first:last]
            for i in range(last - first):
                odds = chance[np.uint64(choices[i])]
                fails = (lucks[i] >= odds) & (odds > 0.0)
                instead = np.uint64(rows[i] + shift_in_block[i]) * width + failed
                choices[i] = instead if fails else choices[i]
        for i in range(last - first):
            words[i] = move[np.uint64(choices[i])]
        if one_room:
            for i in range(last - first):
                afters[i] = words[i] & AFTER
        else:
            for i in range(last - first):
                afters[i] = np.int64(words[i] & AFTER) - shift_in_block[i]
        for i in range(last - first):
            lefts[i] = words[i] >> STATUS & ACTIONS_LEFT
        if several:
            payers = counts[REWARD, first:last]
            for i in range(last - first):
                rewards[i] = paid[np.uint64(payers[i]), np.uint64(choices[i])]
        else:
            for i in range(last - first):
                rewards[i] = first_paid[np.uint64(choices[i])]
        for i in range(last - first):
            overs[i] = words[i] & OVER != 0
        bits = np.uint64(0)
        for i in range(last - first):
            bits |= words[i]
        ends, unlocked, opened = bits & OVER, bits >= WITH_UNLOCKED, bits >= WITH_OPENED
        if history & IF_REPEATED or (history and unlocked):
            for i in range(last - first):
                if history == IF_FOUND and words[i] < WITH_UNLOCKED:
                    continue
                room, choice = first + i, np.uint64(choices[i])
                same = actions[i] == counts[PREVIOUS, room]
                paid_by = np.uint64(counts[REWARD, room])
                why = matters[paid_by, choice]
                if (
                    why & ALWAYS
                    or (why & IF_FOUND and counts[FOUND, room] > 0)
                    or (why & IF_REPEATED and same)
                ):
                    at = case[paid_by, choice]
                    if at >= 0:
                        old = solution[np.uint64(afters[i])]
                        retraced = False
                        for each in range(found.shape[1]):
                            retraced |= (
                                found[room, each] and begun[np.uint64(words[i] & AFTER), each]
                            )
                        past = 4 * same + 2 * (old >= 0 and found[room, old]) + retraced
                        at += PASTS * counts[FOUND, room] + past
                    if at >= 0 and not np.isnan(known[at]):
                        rewards[i] = known[at]
                    else:
                        judged[0, judgements] = room
                        judged[1, judgements] = same
                        judged[2, judgements] = at
                        judgements += 1
                if history & IF_REPEATED:
                    goes_on = status[np.uint64(rows[i])] & ACTIONS_LEFT and not overs[i]
                    counts[PREVIOUS, room] = actions[i] if goes_on else -1
        if ends:
            ended = True
            attempts, trials = counts[ATTEMPT, first:last], trial_over[first:last]
            for i in range(last - first):
                trials[i] = overs[i] & (attempts[i] >= attempt_limit)
                attempts[i] += overs[i]
            if opened:
                for i in range(last - first):
                    if words[i] >= WITH_OPENED:
                        room, solved = first + i, solution[np.uint64(afters[i])]
                        if solved >= 0 and not found[room, solved]:
                            found[room, solved] = True
                            counts[FOUND, room] += 1
                            new_solution[room] = found_new = True
                        if stop_when_solved and counts[FOUND, room] == counts[SOLUTIONS, room]:
                            trials[i] = True
            for i in range(last - first):
                finished |= trials[i]
        rows = afters
        if put_back:
            rows = next_row[first:last]
            if ends:
                for i in range(last - first):
                    begin = start[np.uint64(rooms[i])]
                    rows[i] = begin if overs[i] else afters[i]
                for i in range(last - first):
                    lefts[i] = status[np.uint64(rows[i])] & ACTIONS_LEFT
            else:
                for i in range(last - first):
                    rows[i] = afters[i]
        if looking:
            looks = seen_words[first:last]
            for i in range(last - first):
                here = np.uint64(rows[i])
                one, other = observation[here, 0], observation[here, 1]
                looks[i, 0], looks[i, 1] = one, other
    return ended, finished, found_new, judgements
