"""The record of a session, against a log written by hand."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.world.rewards import PRESETS
from support.cc4_in_trial7 import DOOR, L0, L1, L2, L3, WHITE
from support.session_play import HUMAN, Curious, Scripted, named, one_room, play

F, T = False, True

BY_HAND: list[tuple[list[int], list[bool], bool, bool, int, bool, int, str, float]] = [
    # actions, moved, unlocked, opened, solution, new, found so far, category, the paper's reward
    ([L1, L0, DOOR], [F, T, F], F, F, -1, F, 0, "else", -0.5 - 0.5),
    ([L0, L1, WHITE], [T, T, F], T, F, -1, F, 0, "unlock", 1 + 10 - 0.5),
    ([L0, L2, DOOR], [T, T, T], T, T, 1, T, 1, "open1", 1 + 10 + 50),
    ([L0, L2, DOOR], [T, T, T], T, T, 1, F, 1, "open1", 1 + 10 + 50),
    ([L0, L3, L3 + 7], [T, T, T], T, F, -1, F, 1, "unlock", 1 + 15),
    ([L0, L3, DOOR], [T, T, T], T, T, 2, T, 2, "open2", 1 + 15 + 75),
    ([L0, L0, L1], [T, F, T], T, F, -1, F, 2, "unlock", 1 - 0.5 + 22.5),
    ([L0, L0 + 7, L1], [T, T, F], F, F, -1, F, 2, "else", 1 - 0.5),
    ([L0, L1, DOOR], [T, T, T], T, T, 0, T, 3, "open3", 1 + 22.5 + 112.5),
    ([L0, L3, DOOR], [T, T, T], T, T, 2, F, 3, "open1", 1 + 10 + 50),
]


def test_the_record_is_what_happened() -> None:
    script = [action for actions, *_ in BY_HAND for action in actions]
    learner = Scripted(script, [WHITE] * len(script))
    protocol = Protocol("mine", attempt_limit=len(BY_HAND), stop_when_solved=False)
    record = play(
        learner,
        one_room("CC4", "trial7"),
        protocol,
        [4, 9],
        seed=11,
        learner="scripted",
        experiment="by hand",
    )
    assert record.subject.tolist() == [4] * 10 + [9] * 10
    mine, other = record[record.subject == 4], record[record.subject == 9]
    columns = ["unlocked", "opened", "solution", "new_solution", "solutions_found", "category"]
    assert mine.attempt.tolist() == list(range(1, 11))
    for row, (actions, moved, *rest, reward) in zip(mine.itertuples(), BY_HAND, strict=True):
        assert row.actions.tolist() == actions
        assert row.moved.tolist() == moved
        assert [getattr(row, column) for column in columns] == rest
        assert row.reward == pytest.approx(reward)
    assert (other.category == "else").all()
    assert (other.reward == -1.5).all()
    assert not other.new_solution.any()
    assert (other.solutions_found == 0).all()
    constant = {
        "experiment": "by hand",
        "learner": "scripted",
        "condition": "room",
        "protocol": "mine",
        "seed": 11,
        "phase": "train",
        "loop": 1,
        "trial": 1,
        "schema": "CC4",
        "layout": "trial7",
        "solutions": 3,
    }
    for column, value in constant.items():
        assert set(record[column]) == {value}, column
    assert mine.wall_time.is_monotonic_increasing
    assert record.wall_time.between(0, 60).all()


def test_a_learner_is_told_what_its_own_action_led_to() -> None:
    script = [action for actions, *_ in BY_HAND for action in actions]
    learner = Scripted(script)
    protocol = Protocol("mine", attempt_limit=len(BY_HAND), stop_when_solved=False)
    play(learner, one_room("CC4", "trial7"), protocol, 1)
    steps = learner.steps
    assert [int(step.action[0]) for step in steps] == script
    assert [bool(step.attempt_over[0]) for step in steps] == [F, F, T] * 10
    assert [bool(step.trial_over[0]) for step in steps] == [F] * 29 + [T]
    assert [bool(step.new_solution[0]) for step in steps[2::3]] == [row[5] for row in BY_HAND]
    for step, later in pairwise(steps):
        assert step.next is later.view
    start = steps[0].view.observation
    for step in steps:
        if step.attempt_over[0]:
            assert (step.next.observation == start).all(), "the room is put back"
        else:
            assert (step.next.observation == step.outcome).all()
        moved = (step.outcome != step.view.observation).any()
        changes = [row[1] for row in BY_HAND]
        assert (
            moved
            == changes[int(step.view.attempt[0]) - 1][3 - int(step.view.console.actions_left[0])]
        )


def test_opening_with_more_levers_than_needed_is_open1_and_no_solution() -> None:
    protocol = Protocol("mine", attempt_limit=1, stop_when_solved=True, action_limit=4)
    record = play(Scripted([L0, L1, L2, DOOR]), one_room("CC4", "trial7"), protocol, 1)
    assert record.opened.tolist() == [T]
    assert record.category.tolist() == ["open1"]
    assert record.solution.tolist() == [-1]
    assert record.solutions_found.tolist() == [0]


def test_the_record_can_be_read_while_a_session_goes_on() -> None:
    session = Session(named("CC4"), HUMAN, 3)
    assert session.record().num_rows == 0
    for _ in range(7):
        session.step(np.zeros(3, int))
    assert session.record().num_rows == 6


@pytest.mark.parametrize("reward", PRESETS)
def test_a_reward_by_name_is_the_reward_itself(reward: str) -> None:
    by_name = play(Curious(), "CE4", subjects=3, reward=reward)
    as_object = play(Curious(), "CE4", subjects=3, reward=PRESETS[reward])
    assert by_name.reward.tolist() == as_object.reward.tolist()
