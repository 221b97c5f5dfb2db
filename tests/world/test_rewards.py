"""The paper's reward terms on worked examples, one by one and together."""

from __future__ import annotations

from itertools import permutations

import pytest

from causal_openlock.envs import OpenLockEnv
from support.reward_play import LAYOUTS, Play


def test_basic_pays_10_for_unlocking_and_50_for_opening() -> None:
    assert Play("basic").attempt("L0 L1 door") == [0, 10, 50]
    assert Play("basic", "CE4").attempt("L3 L0 door") == [0, 10, 50]


def test_unlocking_pays_once_while_the_door_stays_unlocked() -> None:
    assert Play("basic").attempt("L0 L1 white") == [0, 10, 0]
    assert Play("basic").attempt("L0 L1 L2") == [0, 10, 0]
    assert Play("basic").attempt("L0 L1 -L0") == [0, 10, 0], "pulling L0 back does not lock"
    # Locked again and unlocked again is unlocked twice.
    play = Play("basic", action_limit=5)
    assert play.attempt("L0 L1 -L1 L1 door") == [0, 10, 0, 10, 50]


def test_basic_pays_a_repeated_solution_in_full() -> None:
    play = Play("basic")
    assert [play.attempt("L0 L1 door") for _ in range(2)] == [[0, 10, 50]] * 2


def test_unique_solutions_pays_a_solution_only_once_in_a_trial() -> None:
    play = Play("unique_solutions")
    assert play.attempt("L0 L1 door") == [0, 10, 50]
    assert play.attempt("L0 L1 door") == [0, 0, 0]
    assert play.attempt("L0 L2 door") == [0, 10, 50]
    assert play.attempt("L0 L1 white") == [0, 0, 0]
    play.env.reset(options={"new_trial": True})
    assert play.attempt("L0 L1 door") == [0, 10, 50]


def test_unlocking_without_opening_finds_nothing_and_so_stays_unique() -> None:
    play = Play("unique_solutions")
    assert [play.attempt("L0 L1 white") for _ in range(2)] == [[0, 10, 0]] * 2


def test_state_change_adds_a_half_to_whatever_changed_the_observation() -> None:
    play = Play("state_change")
    assert play.attempt("L0 L1 door") == [0.5, 10.5, 50.5]
    assert play.attempt("L1 L0 L0") == [0, 0.5, 0], "locked, free, pushed already"
    assert play.attempt("L0 -L0 door") == [0.5, 0.5, 0]


def test_negative_immovable_takes_a_half_where_nothing_moved_levers_and_door_alike() -> None:
    play = Play("negative_immovable")
    assert play.attempt("white L1 door") == [-0.5, -0.5, -0.5]
    assert play.attempt("-L0 L0 L0") == [-0.5, 0, -0.5]
    assert play.attempt("L0 L1 door") == [0, 10, 50]


def test_negative_repeat_takes_a_quarter_for_the_same_action_twice_in_a_row() -> None:
    play = Play("negative_repeat")
    assert play.attempt("L0 L0 L0") == [0, -0.25, -0.25]
    assert play.attempt("L0 white L0") == [0, 0, 0], "the attempt before does not count"
    assert play.attempt("door L0 -L0") == [0, 0, 0]


def test_partial_sequence_pays_1_for_a_first_action_that_begins_a_solution() -> None:
    terms = ["basic", "partial_sequence"]
    assert Play(terms).attempt("L0 L1 door") == [1, 10, 50]
    assert Play(terms).attempt("L1 L0 L1") == [0, 0, 10], "L1 is no first action"
    assert Play(terms).attempt("white L0 L1") == [0, 0, 10], "and L0 comes second here"
    assert Play(terms, "CE4").attempt("L2 L1 L0") == [1, 0, 10]


def test_partial_sequence_takes_the_place_of_state_change_on_a_first_move_and_only_there() -> None:
    # L2 of two_keys is a decoy: it moves and begins no solution.
    play = Play("partial_sequence", "two_keys")
    assert play.attempt("L0 L2 L1") == [1, 0.5, 10.5]
    assert play.attempt("L2 L0 L1") == [0.5, 0.5, 10.5]
    assert play.attempt("white L0 L1") == [0, 0.5, 10.5]


@pytest.mark.parametrize("name", ["CC3", "CE3", "CC4", "CE4"])
def test_exactly_one_of_partial_sequence_and_state_change_pays_for_a_first_move(name: str) -> None:
    for reward in ("partial_sequence", ["state_change", "partial_sequence"]):
        env = OpenLockEnv(name, LAYOUTS[name], reward)
        for action in range(15):
            before, _ = env.reset(seed=0)
            after, paid, *_ = env.step(action)
            assert paid == (1 if (after != before).any() else 0)


@pytest.mark.parametrize(("schema", "paths"), [("CC4", "L0 {}"), ("CE4", "{} L0")])
def test_solution_multiplier_pays_60_90_135_and_plain_60_for_a_repeat(
    schema: str, paths: str
) -> None:
    play = Play("solution_multiplier", schema)
    totals = [
        sum(play.attempt(f"{paths.format(lever)} door")) for lever in ("L2", "L2", "L1", "L2")
    ]
    assert totals == [60, 60, 90, 60]
    assert sum(play.attempt(f"{paths.format('L3')} door")) == 135


def test_solution_multiplier_raises_the_unlocking_and_the_opening_alike() -> None:
    play = Play("solution_multiplier")
    assert play.attempt("L0 L3 door") == [0, 10, 50]
    assert play.attempt("L0 L1 white") == [0, 15, 0]
    assert play.attempt("L0 L1 door") == [0, 15, 75]
    assert play.attempt("L0 L3 door") == [0, 10, 50]
    assert play.attempt("L0 L2 door") == [0, 22.5, 112.5]


def test_a_door_opened_with_more_levers_than_needed_is_no_new_solution() -> None:
    play = Play("solution_multiplier", action_limit=4)
    assert play.attempt("L0 L1 door") == [0, 10, 50]
    assert play.attempt("L0 L2 L3 door") == [0, 15, 0, 50]
    assert Play("unique_solutions", action_limit=4).attempt("L0 L2 L3 door") == [0, 10, 0, 0]


def test_the_papers_best_combination_on_worked_attempts() -> None:
    play = Play("paper")
    assert play.attempt("white L1 door") == [-0.5, -0.5, -0.5]
    assert play.attempt("L0 L1 white") == [1, 10, -0.5]
    assert play.attempt("L0 L1 door") == [1, 10, 50]
    assert play.attempt("L0 L1 door") == [1, 10, 50]
    assert play.attempt("L0 L2 door") == [1, 15, 75]
    assert play.attempt("L0 L0 L3") == [1, -0.5, 22.5]
    assert play.attempt("L0 L3 door") == [1, 22.5, 112.5]


def test_a_noisy_room_that_does_not_obey_pays_as_for_nothing_moved() -> None:
    env = OpenLockEnv("noisy_CC3", "trial1", "negative_immovable", action_limit=10)
    root, leaf = 0, 4
    rewards = []
    for seed in range(20):
        env.reset(seed=seed)
        env.step(root)
        pushed = False
        while not pushed:
            seen, paid, *_ = env.step(leaf)
            pushed = bool(seen[leaf])
            assert paid == (10 if pushed else -0.5)
            rewards.append(paid)
    assert rewards.count(-0.5) > 0


def test_the_terms_of_a_reward_add_up_in_any_order() -> None:
    for terms in (["basic", "state_change", "partial_sequence"], ["negative_repeat", "basic"]):
        plays = [Play(order) for order in permutations(terms)]
        for words in ("L0 L1 door", "L1 L1 L0", "white white L0"):
            rewards = [play.attempt(words) for play in plays]
            assert all(reward == rewards[0] for reward in rewards)
