"""The presets of the authors' rewards, against their program."""

from functools import cache
from itertools import chain, combinations, product

import numpy as np
import pytest

from causal_openlock.world.kernel import SOLUTIONS_FOUND
from causal_openlock.world.rewards import PRESETS, find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.rooms import Rooms, RoomTables
from support.authors_program import LAYOUTS, SCHEMAS, authors_reward, authors_room

PREFIX = "authors_2018_"
MODES = [name.removeprefix(PREFIX) for name in PRESETS if name.startswith(PREFIX)]
SEQUENCES = np.array([*product(range(15), repeat=3)])
authors_room = cache(authors_room)


def rewards_of_all(name, reward, found):
    """``[3375, 3]`` what every sequence of three actions is paid."""
    schema = SCHEMAS[name]
    tables = RoomTables.of([(schema, 3)], 7)
    rooms = Rooms(tables, [find_reward(reward)], len(SEQUENCES), attempt_limit=9)
    lever = np.tile(Layout.of(schema, LAYOUTS[name]).lever_at(), (len(SEQUENCES), 1))
    rooms.begin_trials(slice(None), np.zeros(len(SEQUENCES), int), lever)
    rooms.state.found[:, list(found)] = True
    rooms.state.console[:, SOLUTIONS_FOUND] = len(found)
    return np.stack([rooms.step(action).reward for action in SEQUENCES.T], axis=1)


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("mode", MODES)
def test_the_authors_presets_pay_what_their_program_paid_for_every_sequence(name, mode):
    happened, solutions = authors_room(name)
    numbers = range(len(solutions))
    # Every set of solutions found before; solution k is the one with the k-th other lever.
    for which in chain.from_iterable(combinations(numbers, k) for k in range(len(numbers) + 1)):
        found = [solutions[index] for index in which]
        expected = [
            [authors_reward(mode, step, solutions, found) for step in steps] for steps in happened
        ]
        paid = rewards_of_all(name, f"authors_2018_{mode}", which)
        np.testing.assert_array_equal(paid, expected, err_msg=f"found before: {which}")
