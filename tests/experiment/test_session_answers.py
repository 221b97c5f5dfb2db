"""What a session takes for an answer, from whom, and what it refuses."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from causal_openlock.contract.learner import View
from causal_openlock.errors import LearnerError, ProtocolError
from causal_openlock.experiment.session import Session
from support.cc4_in_trial7 import DOOR, L0, L1, L2, L3, WHITE
from support.session_play import HUMAN, Scripted, named, one_room, play


@pytest.mark.parametrize(
    ("answer", "message"),
    [
        (
            [0],
            "answers with 2 integers, one for each subject, and not with int64 of shape \\(1,\\)",
        ),
        ([[0, 0]], "shape \\(1, 2\\)"),
        (3, "shape \\(\\)"),
        (None, "object"),
        ([[0], [0, 1]], "object"),
        ([0.0, 1.0], "float64 of shape \\(2,\\)"),
        ([True, False], "bool"),
        (["push", "pull"], "of shape \\(2,\\)"),
        ([0, 15], "action 15 is outside the action space; .* 7 positions has actions 0 to 14"),
        ([-1, 0], "action -1 is outside the action space"),
        ([0, 10**12], "action 1000000000000 is outside"),
    ],
)
def test_an_answer_that_is_none_is_refused_in_one_sentence(answer: Any, message: str) -> None:
    class Wrong(Scripted):
        def act(self, view: View) -> Any:
            return answer

    with pytest.raises(LearnerError, match=message) as caught:
        play(Wrong(), "CC3", subjects=2)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).endswith(".")


@pytest.mark.parametrize("kind", [np.int8, np.uint8, np.int32, np.uint64, list])
def test_any_integers_are_an_answer(kind: Any) -> None:
    session = Session(one_room("CC4", "trial7"), HUMAN, 2)
    actions = [L0, DOOR] if kind is list else np.array([L0, DOOR], dtype=kind)
    assert session.step(actions).action.tolist() == [L0, DOOR]


def test_actions_of_subjects_that_have_finished_are_ignored() -> None:
    solve = [L0, L1, DOOR, L0, L2, DOOR, L0, L3, DOOR]
    idle = [WHITE] * 90
    learner = Scripted(solve, idle, afterwards=-1)
    record = play(learner, one_room("CC4", "trial7"), HUMAN, 2)
    assert record.subject.value_counts().to_dict() == {0: 3, 1: 30}
    playing = np.array([step.view.playing for step in learner.steps])
    assert playing[:, 0].tolist() == [True] * 9 + [False] * 81
    assert playing[:, 1].all()
    for step in learner.steps[9:]:
        for flags in (step.attempt_over, step.trial_over, step.new_solution):
            assert not flags[0]


def test_a_session_needs_subjects_each_of_them_once() -> None:
    for subjects in (0, [], [1, 2, 1]):
        with pytest.raises(ProtocolError, match="at least one subject, and each subject only once"):
            Session(named("CC4"), HUMAN, subjects)
