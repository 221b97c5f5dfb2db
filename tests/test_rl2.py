"""rl2 as it is shipped: it solves rooms that it never saw, with its memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from small_memories import weights_of

from causal_openlock.errors import LearnerError
from causal_openlock.learner import View
from causal_openlock.learner_registry import create
from causal_openlock.protocol import PROTOCOLS, Condition, Protocol
from causal_openlock.schema_file import bundled, find_schema
from causal_openlock.session import Session
from learners.meta_training_file import TrainingFile, read_training
from learners.network_file import BUNDLED, read_network
from learners.rl2 import RL2, RL2Parameters

PROTOCOL = Protocol("t", attempt_limit=12, stop_when_solved=False, baseline_trials=3)


@pytest.fixture(autouse=True)
def one_thread() -> None:
    torch.set_num_threads(1)


def attempts(learner: Any, name: str, subjects: int = 60) -> dict[Any, float]:
    """Mean attempts by phase and trial, where a trial not solved counts as the limit."""
    session = Session(Condition.named(name, find_schema), PROTOCOLS["human"], subjects, seed=1)
    record = session.play(learner).to_pandas()
    last = record.groupby(["subject", "phase", "trial"]).last()
    needed = last["attempt"].where(last["solutions_found"] == last["solutions"], 30)
    means: dict[Any, float] = needed.groupby(["phase", "trial"]).mean().to_dict()
    return means


def test_what_is_shipped_was_trained_by_what_is_shipped() -> None:
    _, about = read_network(BUNDLED)
    file = read_training(bundled("experiments") / "meta_training" / "rl2.yaml")
    assert TrainingFile.model_validate(about["training"]) == file
    assert about["actions"] >= file.actions
    assert BUNDLED.stat().st_size < 1_000_000


# The ideal observer needs 3.75 to 4 attempts in a room of four levers and 2.7 in one of three.
@pytest.mark.parametrize("reward", ["paper", "unique_solutions", "authors_2018"])
def test_the_shipped_network_solves_rooms_it_never_saw(reward: str) -> None:
    for name, most in (("CC4", 4.5), ("CE4", 4.5)):
        condition = Condition.named(name, find_schema)
        session = Session(condition, PROTOCOLS["human"], 40, seed=2, reward=reward)
        record = session.play(create("rl2")).to_pandas()
        last = record.groupby(["subject", "trial"]).last()
        assert (last["solutions_found"] == last["solutions"]).mean() >= 0.98
        assert last["attempt"].mean() < most


def test_it_carries_a_schema_to_the_next_rooms_unless_its_memory_is_reset() -> None:
    gained = {}
    for reset in ("condition", "trial"):
        means = attempts(create("rl2", {"reset": reset}), "CE4")
        later = np.mean([means["train", trial] for trial in (2, 3, 4, 5)])
        gained[reset] = means["train", 1] - later
    assert gained["condition"] > 0.1
    assert abs(gained["trial"]) < 0.05
    congruent, incongruent = (
        attempts(create("rl2"), name, 150)["test", 1] for name in ("CC3-CC4", "CE3-CC4")
    )
    assert incongruent - congruent > 0.1


class Forgetful(RL2):
    """The control: its memory is empty before every action."""

    def act(self, view: View) -> Any:
        self._memory[:] = 0
        return super().act(view)


def test_without_its_memory_it_is_lost() -> None:
    assert min(attempts(Forgetful(), "CC4", 20).values()) > 15


def test_its_weights_are_frozen_unless_it_learns() -> None:
    for learns in (False, True):
        session = Session(Condition.named("CC3", find_schema), PROTOCOL, 2)
        learner = RL2(RL2Parameters(learns=learns, unroll=9))
        learner.begin(session.brief)
        before = [weights_of(learner.network, n) for n in range(2 if learns else 1)]
        while not session.over:
            learner.learn(session.step(learner.act(session.view)))
        after = [weights_of(learner.network, n) for n in range(len(before))]
        changed = [not torch.equal(*pair) for pair in zip(before, after, strict=True)]
        assert changed == [learns] * len(before)
        if learns:  # each from its own experience
            assert not torch.equal(after[0], after[1])


def test_a_subject_that_learns_is_as_it_would_be_alone() -> None:
    courses = []
    for subjects in ([0, 1, 2], [1]):
        session = Session(Condition.named("CC3", find_schema), PROTOCOL, subjects)
        learner = RL2(RL2Parameters(learns=True, unroll=7, reset="trial"))
        learner.begin(session.brief)
        course = []
        while not session.over:
            course.append(learner.act(session.view)[subjects.index(1)])
            learner.learn(session.step(np.full(len(subjects), len(course) % 15)))
        courses.append(weights_of(learner.network, subjects.index(1)))
    assert torch.allclose(*courses, atol=1e-4)


@pytest.mark.parametrize(
    ("content", "says"),
    [(None, "there is no checkpoint"), (b"nonsense", "is no checkpoint of rl2")],
)
def test_a_wrong_checkpoint_is_one_clear_sentence(
    tmp_path: Path, content: bytes | None, says: str
) -> None:
    path = tmp_path / "net.npz"
    if content:
        path.write_bytes(content)
    session = Session(Condition.named("CC3", find_schema), PROTOCOL, 1)
    with pytest.raises(LearnerError, match=says):
        create("rl2", {"checkpoint": str(path)}).begin(session.brief)
