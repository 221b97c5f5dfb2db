"""The presets of the authors' rewards, against their program and worked examples."""

from functools import cache
from itertools import chain, combinations, product

import numpy as np
import pytest

from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.rewards import find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.tables import RoomTables
from support.authors_program import AUTHORS_MODES, authors_reward, authors_room
from support.reward_play import LAYOUTS, SCHEMAS, Play, pay

SEQUENCES = np.array([*product(range(15), repeat=3)])
authors_room = cache(authors_room)


def table_rewards(name, reward, found):
    """``[3375, 3]`` what every sequence of three actions is paid."""
    tables, schema = RoomTables(7), SCHEMAS[name]
    tables.add([(schema, Layout.of(schema, LAYOUTS[name]), 3)])
    table = RewardTable(find_reward(reward), tables)
    known = np.zeros((len(SEQUENCES), len(schema.solutions)), dtype=bool)
    known[:, list(found)] = True
    row = np.repeat(tables.start, len(SEQUENCES))
    previous, paid = np.full(len(SEQUENCES), -1), []
    for action in SEQUENCES.T:
        row, reward_then = pay(table, row, action, previous, known)
        previous = action
        paid.append(reward_then)
    return np.stack(paid, axis=1)


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("mode", AUTHORS_MODES)
def test_the_authors_presets_pay_what_their_program_paid_for_every_sequence(name, mode):
    happened, solutions = authors_room(name)
    numbers = range(len(solutions))
    # Every set of solutions found before; solution k is the one with the k-th other lever.
    for which in chain.from_iterable(combinations(numbers, k) for k in range(len(numbers) + 1)):
        found = [solutions[index] for index in which]
        expected = [
            [authors_reward(mode, step, solutions, found) for step in steps] for steps in happened
        ]
        paid = table_rewards(name, f"authors_2018_{mode}", which)
        np.testing.assert_array_equal(paid, expected, err_msg=f"found before: {which}")


@pytest.mark.parametrize(
    ("preset", "words", "paid"),
    [
        ("authors_2018_basic", "L0 L1 white", [0, 10, 10]),  # 10 as long as it is unlocked
        ("authors_2018_negative_immovable", "white L1 door", [-0.5, 0, 0]),  # white levers only
        ("authors_2018_negative_immovable", "L0 L0 L0", [0, 0, 0]),
        ("authors_2018_negative_immovable_negative_repeat", "white white L0", [-0.5, -0.25, 0]),
        ("authors_2018_change_state", "L0 L1 door", [0.5, 10, 50]),  # one case hides the others
    ],
)
def test_the_authors_cases(preset, words, paid):
    assert Play(preset).attempt(words) == paid
