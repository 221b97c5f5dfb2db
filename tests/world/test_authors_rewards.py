"""The presets of the authors' rewards, against their program and worked examples."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from itertools import chain, combinations, product

import numpy as np
import pytest

from causal_openlock.world.reward_table import RewardTable
from causal_openlock.world.rewards import PRESETS, find_reward
from causal_openlock.world.room import Layout
from causal_openlock.world.tables import RoomTables
from support.authors_program import AUTHORS_MODES, Happened, authors_reward, authors_room
from support.reward_play import LAYOUTS, SCHEMAS, Play, pay


@cache
def all_sequences(name: str) -> tuple[np.ndarray, list[list[Happened]], list[tuple[str, ...]]]:
    return np.array(list(product(range(15), repeat=3))), *authors_room(name)


def some_sets(solutions: int) -> list[tuple[int, ...]]:
    """Every set of solutions found before, the empty and the full one included."""
    return list(
        chain.from_iterable(combinations(range(solutions), k) for k in range(solutions + 1))
    )


def table_rewards(name: str, reward: str, found: Sequence[int]) -> np.ndarray:
    """``[3375, 3]`` what every sequence of three actions is paid."""
    tables = RoomTables(7)
    schema = SCHEMAS[name]
    tables.add([(schema, Layout.of(schema, LAYOUTS[name]), 3)])
    table = RewardTable(find_reward(reward), tables)
    sequences, *_ = all_sequences(name)
    known = np.zeros((len(sequences), len(schema.solutions)), dtype=bool)
    known[:, list(found)] = True
    row = np.repeat(tables.start, len(sequences))
    previous = np.full(len(sequences), -1)
    paid = []
    for action in sequences.T:
        row, reward_then = pay(table, row, action, previous, known)
        previous = action
        paid.append(reward_then)
    return np.stack(paid, axis=1)


@pytest.mark.parametrize("name", LAYOUTS)
@pytest.mark.parametrize("mode", AUTHORS_MODES)
def test_the_authors_presets_pay_what_their_program_paid_for_every_sequence(
    name: str, mode: str
) -> None:
    _, happened, solutions = all_sequences(name)
    # Solution k of the schema is the one with the k-th other lever, as here.
    for which in some_sets(len(solutions)):
        found = [solutions[index] for index in which]
        expected = [
            [authors_reward(mode, step, solutions, found) for step in steps] for steps in happened
        ]
        paid = table_rewards(name, f"authors_2018_{mode}", which)
        np.testing.assert_array_equal(paid, expected, err_msg=f"found before: {which}")


def test_the_authors_room_behind_this_has_as_many_ways_to_open_as_it_has_solutions() -> None:
    for name in LAYOUTS:
        _, happened, solutions = all_sequences(name)
        opening = [
            steps[-1].so_far
            for steps in happened
            if steps[-1].unlocked and steps[-1].so_far[-1] == "push door"
        ]
        assert sorted(opening) == sorted(solutions)
        assert len(solutions) == int(name[-1]) - 1


def test_every_mode_of_the_authors_is_a_preset_and_their_best_one_has_a_short_name() -> None:
    presets = {name for name in PRESETS if name.startswith("authors_2018_")}
    assert presets == {f"authors_2018_{mode}" for mode in AUTHORS_MODES}
    for which in ((), (0,), (0, 2)):
        np.testing.assert_array_equal(
            table_rewards("CC4", "authors_2018", which),
            table_rewards("CC4", f"authors_2018_{AUTHORS_MODES[-1]}", which),
        )


def test_the_authors_multiplier_pays_60_90_180() -> None:
    play = Play("authors_2018_negative_immovable_solution_multiplier")
    totals = [sum(play.attempt(f"L0 {lever} door")) for lever in ("L1", "L2", "L1", "L3")]
    assert totals == [60, 90, 60, 180]
    play = Play("authors_2018")
    totals = [sum(play.attempt(f"L0 {lever} door")) for lever in ("L1", "L2", "L1", "L3")]
    assert totals == [61, 91, 61, 181]


def test_the_authors_pay_10_for_every_action_that_leaves_the_door_unlocked() -> None:
    assert Play("authors_2018_basic").attempt("L0 L1 white") == [0, 10, 10]
    assert Play("basic").attempt("L0 L1 white") == [0, 10, 0]


def test_to_the_authors_only_a_white_lever_is_immovable() -> None:
    play = Play("authors_2018_negative_immovable")
    assert play.attempt("white L1 door") == [-0.5, 0, 0]
    assert play.attempt("L0 L0 L0") == [0, 0, 0]
    assert Play("negative_immovable").attempt("white L1 door") == [-0.5, -0.5, -0.5]


def test_a_rung_of_the_authors_ladder_hides_those_below_it() -> None:
    play = Play("authors_2018_negative_immovable_negative_repeat")
    assert play.attempt("white white L0") == [-0.5, -0.25, 0]
    assert Play("authors_2018_change_state").attempt("L0 L1 door") == [0.5, 10, 50]
