"""One step of many rooms, compiled: the next rows, the rewards, the attempts and trials that end.

Only :class:`causal_openlock.world.batch.RoomBatch` calls :func:`step`. Modules that need this one
import it at the first step or reset, since numba takes a while to load. The argument types never
change, so there is only one compiled version, cached on disk.

Rooms are stepped in blocks that stay in the processor's cache. What takes time is to look up and
store one value for each room. So where an action leads and the status there are one word
(:meth:`causal_openlock.world.tables.RoomTables.words`), which is also how a room is held; word,
reward and observation are looked up in one loop. The compiler turns the loops that take words
apart, like all loops without look-ups or branches, into vector instructions.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from causal_openlock.files.compiling import compiled
from causal_openlock.world.reward_table import ALWAYS, IF_FOUND, IF_REPEATED, PASTS
from causal_openlock.world.tables import (
    ACTIONS_LEFT,
    LISTED,
    OVER,
    STATUS,
    WITH_OPENED,
    WITH_UNLOCKED,
)

ATTEMPT, FOUND, SOLUTIONS, PREVIOUS, REWARD = range(5)
"""Rows of ``counts``."""
BLOCK = 1024


@compiled
def all_below(action: Any, limit: int) -> bool:
    """Whether all of some actions, ``[B]``, are from 0 to ``limit`` - 1."""
    outside: Any = False
    for index in range(len(action)):
        # As unsigned numbers, negative ones are very large: one comparison finds both.
        outside |= np.uint64(action[index]) >= np.uint64(limit)
    return not outside


@compiled
def uniform(numbers: Any, moment: int, first_key: int, second_key: int) -> None:
    """Give each room its number in [0, 1) at a moment, by Philox4x32-10.

    The generator is a bijection of 128 bits for each key, ten rounds of two multiplications (Salmon
    et al., 2011, Parallel random numbers: as easy as 1, 2, 3). Room *i* gets word *i* mod 4, over
    2 ** 32, of the block whose counter has *i* // 4 in its first word, 0 in its second, and the
    moment in its third and fourth. So each room has a stream of its own, whatever the others are.

    Args:
        numbers: ``[B]`` out: the numbers; B is a multiple of 4.
        moment: How many times before the rooms got a number.
        first_key: First word of the key, 32 bits.
        second_key: Second word.
    """
    low, half = np.uint64(0xFFFFFFFF), np.uint64(32)
    for block in range(len(numbers) // 4):
        one, two = np.uint64(block), np.uint64(0)
        three, four = np.uint64(moment) & low, np.uint64(moment) >> half
        key, other_key = np.uint64(first_key), np.uint64(second_key)
        for _ in range(10):
            left, right = one * np.uint64(0xD2511F53), three * np.uint64(0xCD9E8D57)
            one, three = (right >> half) ^ two ^ key, (left >> half) ^ four ^ other_key
            two, four = right & low, left & low
            key = (key + np.uint64(0x9E3779B9)) & low
            other_key = (other_key + np.uint64(0xBB67AE85)) & low
        numbers[4 * block] = one * 2.0**-32
        numbers[4 * block + 1] = two * 2.0**-32
        numbers[4 * block + 2] = three * 2.0**-32
        numbers[4 * block + 3] = four * 2.0**-32


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
    at: Any,
    action: Any,
    luck: Any,
    after: Any,
    seen: Any,
    actions_left: Any,
    reward: Any,
    attempt_over: Any,
    trial_over: Any,
    new_solution: Any,
    room_of: Any,
    shift: Any,
    column: Any,
    move: Any,
    chance: Any,
    observation: Any,
    solution: Any,
    begun: Any,
    paid: Any,
    past: Any,
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
        at: ``[B]`` the word of each room, whose listed row is where it is; changed to the word of
            its action: see ``RoomTables.words``.
        action: ``[B]`` its action, an index of a column.
        luck: ``[B]`` numbers in [0, 1); empty if all rooms are deterministic.
        after: ``[B]`` out: the row that the action led to; empty if nobody asks.
        seen: ``[B, 16]`` out: the observation at the row of the next action; empty if nobody asks.
        actions_left: ``[B]`` out: how many actions are left at the row of the next action.
        reward: ``[B]`` out: the reward, where it does not depend on an unknown past.
        attempt_over: ``[B]`` out: whether the attempt is over.
        trial_over: ``[B]`` out: whether the trial is over.
        new_solution: ``[B]`` out: whether a new solution was found.
        room_of: ``[B]`` index of each room in the tables.
        shift: ``[G]`` see ``RoomTables``.
        column: ``[G * W]`` see there.
        move: ``[2, M * W]`` the word of each action (``RoomTables.words``), and the listed row that
            the action leads to.
        chance: ``[M * W]`` see there; empty if all rooms are deterministic.
        observation: ``[R]`` see there; the 16 bytes of a row as one complex number.
        solution: ``[M]`` see there, of the listed rows.
        begun: ``[M, K]`` see there.
        paid: ``[F, M * W]`` the rewards; see ``RewardTable``.
        past: ``[F, M * W]`` what of the past matters (``RewardTable.matters``), plus 8 times where
            in ``known`` the rewards of each action are, -8 for nowhere.
        known: The rewards of actions for each possible past; NaN where not known yet.
        counts: ``[5, B]`` attempt, solutions found, solutions of the room, action before, and
            which of the F rewards is paid; changed.
        found: ``[B, K]`` which solutions are found; changed.
        judged: ``[5, B]`` out: rooms whose reward is not known, whether their action repeats the
            one before it, the index of the reward in ``known``, and the listed rows before and
            after the action.
        attempt_limit: Attempts in a trial.
        stop_when_solved: Whether a trial is over once all solutions are found.
        history: What any reward depends on in the past: ``IF_FOUND``, which only matters once the
            door is unlocked, ``IF_REPEATED``, or both.
        legal: Actions are below it, or nothing is changed.

    Returns:
        Whether any attempt ended, any trial, and any solution was new, and how many rooms there
        are in ``judged``, -1 if an action is not legal.
    """
    many = len(at)
    # Actions are read once from far, and are small enough to stay near.
    small = np.empty(many, np.uint8)
    outside: Any = False
    for i in range(many):
        # As unsigned numbers, negative ones are very large: one comparison finds both.
        outside |= np.uint64(action[i]) >= np.uint64(legal)
        small[i] = action[i]
    if outside:
        return False, False, False, -1
    width = len(column) // len(shift)
    failed = width - 2
    noisy, one_room, several = len(chance) > 0, len(shift) == 1, len(paid) > 1
    looking, looks = len(seen) > 0, seen.view(np.complex128)[:, 0]
    first_paid, word_after, row_after = paid[0], move[0], move[1]
    choice_in_block = np.empty(min(BLOCK, many), np.uint32)
    odds_in_block = np.empty(len(choice_in_block) if noisy else 0)
    ended = finished = found_new = False
    judgements = 0
    for first in range(0, many, BLOCK):
        last = min(first + BLOCK, many)
        words, actions, rooms = at[first:last], small[first:last], room_of[first:last]
        lefts, overs = actions_left[first:last], attempt_over[first:last]
        rewards, choices = reward[first:last], choice_in_block[: last - first]
        # Unsigned numbers as indices: signed ones could count from the end, which takes time.
        if one_room:
            for i in range(last - first):
                choices[i] = (words[i] & LISTED) * np.uint32(width) + np.uint32(actions[i])
        else:
            for i in range(last - first):
                own = column[np.uint64(rooms[i]) * np.uint64(width) + np.uint64(actions[i])]
                choices[i] = (words[i] & LISTED) * np.uint32(width) + np.uint32(own)
        if noisy:
            lucks, odds = luck[first:last], odds_in_block[: last - first]
            for i in range(last - first):
                odds[i] = chance[np.uint64(choices[i])]
            for i in range(last - first):
                fails = (lucks[i] >= odds[i]) & (odds[i] > 0.0)
                instead = (words[i] & LISTED) * np.uint32(width) + np.uint32(failed)
                choices[i] = instead if fails else choices[i]
        sights = looks[first:last]
        if looking and one_room:
            for i in range(last - first):
                choice = np.uint64(choices[i])
                word = word_after[choice]
                words[i], rewards[i] = word, first_paid[choice]
                sights[i] = observation[np.uint64(word & LISTED)]
        else:
            for i in range(last - first):
                choice = np.uint64(choices[i])
                words[i], rewards[i] = word_after[choice], first_paid[choice]
        if looking and not one_room:
            for i in range(last - first):
                listed = np.uint64(words[i] & LISTED)
                sights[i] = observation[listed - np.uint64(shift[np.uint64(rooms[i])])]
        if several:
            payers = counts[REWARD, first:last]
            for i in range(last - first):
                rewards[i] = paid[np.uint64(payers[i]), np.uint64(choices[i])]
        if len(after):
            afters = after[first:last]
            for i in range(last - first):
                afters[i] = np.int64(row_after[np.uint64(choices[i])]) - shift[np.uint64(rooms[i])]
        for i in range(last - first):
            lefts[i] = words[i] >> STATUS & ACTIONS_LEFT
        for i in range(last - first):
            overs[i] = words[i] & OVER != 0
        trials, news = trial_over[first:last], new_solution[first:last]
        trials[:], news[:] = False, False
        bits = np.uint32(0)
        for i in range(last - first):
            bits |= words[i]
        ends, unlocked, opened = bits & OVER, bits >= WITH_UNLOCKED, bits >= WITH_OPENED
        if history & IF_REPEATED or (history and unlocked):
            for i in range(last - first):
                if history == IF_FOUND and words[i] < WITH_UNLOCKED:
                    continue
                room, choice = first + i, np.uint64(choices[i])
                listed = np.uint64(row_after[choice])
                same = actions[i] == counts[PREVIOUS, room]
                paid_by = np.uint64(counts[REWARD, room])
                why = past[paid_by, choice]
                if (
                    why & ALWAYS
                    or (why & IF_FOUND and counts[FOUND, room] > 0)
                    or (why & IF_REPEATED and same)
                ):
                    where = why >> 3
                    if where >= 0:
                        old = solution[listed]
                        retraced = False
                        for each in range(found.shape[1]):
                            retraced |= found[room, each] and begun[listed, each]
                        before = 4 * same + 2 * (old >= 0 and found[room, old]) + retraced
                        where += PASTS * counts[FOUND, room] + before
                    if where >= 0 and not np.isnan(known[where]):
                        rewards[i] = known[where]
                    else:
                        judged[0, judgements] = room
                        judged[1, judgements] = same
                        judged[2, judgements] = where
                        judged[3, judgements] = choice // np.uint64(width)
                        judged[4, judgements] = listed
                        judgements += 1
                if history & IF_REPEATED:
                    # Nothing is repeated after the end of an attempt, nor after a reset.
                    fresh = overs[i] or not why & IF_REPEATED
                    counts[PREVIOUS, room] = -1 if fresh else actions[i]
        if ends:
            ended = True
            attempts = counts[ATTEMPT, first:last]
            for i in range(last - first):
                trials[i] = overs[i] & (attempts[i] >= attempt_limit)
                attempts[i] += overs[i]
            if opened:
                for i in range(last - first):
                    if words[i] >= WITH_OPENED:
                        room = first + i
                        solved = solution[np.uint64(row_after[np.uint64(choices[i])])]
                        if solved >= 0 and not found[room, solved]:
                            found[room, solved] = True
                            counts[FOUND, room] += 1
                            news[i] = found_new = True
                        if stop_when_solved and counts[FOUND, room] == counts[SOLUTIONS, room]:
                            trials[i] = True
            for i in range(last - first):
                finished |= trials[i]
    return ended, finished, found_new, judgements
