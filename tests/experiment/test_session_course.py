"""The course of a session: what each subject meets, and when attempts and trials end."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np
import pandas as pd
import pytest

from causal_openlock.contract.learner import Console
from causal_openlock.envs import OpenLockEnv
from causal_openlock.experiment.protocol import PAPER_CONDITIONS, Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.schema import Schema
from causal_openlock.world.room import Layout
from openlock_learners.oracle import Oracle
from openlock_learners.random import RandomLearner
from support.cc4_in_trial7 import DOOR, L0, L1, L2, L3
from support.session_play import (
    HUMAN,
    RL,
    SCHEMAS,
    Curious,
    Scripted,
    named,
    one_room,
    play,
    trials_of,
)


@pytest.mark.parametrize("condition", PAPER_CONDITIONS)
def test_the_oracle_needs_as_many_attempts_as_there_are_solutions(condition: str) -> None:
    trials = trials_of(play(Oracle(), condition, subjects=12))
    assert len(trials) == 12 * (5 if "-" not in condition else 7)
    three = trials.schema.isin(["CC3", "CE3"])
    assert (trials.attempts[three] == 2).all()
    assert (trials.attempts[~three] == 3).all()
    assert (trials.found == trials.solutions).all()


def test_the_random_learner_almost_never_solves_a_trial() -> None:
    record = play(RandomLearner(), "CC4", subjects=100)
    trials = trials_of(record)
    assert (trials.found == trials.solutions).mean() < 0.01
    assert (trials.attempts == 30).mean() > 0.99
    # Three of the 3,375 sequences open the door.
    assert record.opened.mean() == pytest.approx(3 / 3375, abs=5 * np.sqrt(3 / 3375 / len(record)))


# -- the same rooms as an environment's -----------------------------------------------------------


def layout_of(name: str, schema: Schema) -> Any:
    if name.startswith("trial"):
        return name
    return dict(zip(schema.levers, name.split(), strict=True))


@pytest.mark.parametrize("reward", ["paper", "unique_solutions", "negative_repeat", "authors_2018"])
@pytest.mark.parametrize("layouts", ["published", "random"])
def test_a_session_is_what_each_subject_would_have_met_alone(reward: str, layouts: Any) -> None:
    """Replayed subject by subject through the environment, action by action."""
    learner = Curious()
    protocol = replace(HUMAN, layouts=layouts, attempt_limit=20, test_trials=2)
    record = play(learner, "CC3-CE4", protocol, 4, reward=reward, seed=3)
    assert record.new_solution.sum() > 10
    for number, (_, attempts) in enumerate(record.groupby("subject")):
        moment = 0
        for _, trial in attempts.groupby(["phase", "loop", "trial"], observed=True, sort=False):
            schema = SCHEMAS[trial.schema.iloc[0]]
            env = OpenLockEnv(
                schema,
                layout_of(trial.layout.iloc[0], schema),
                reward,
                "attempt",
                attempt_limit=20,
                reveal=True,
            )
            seen, info = env.reset(seed=0)
            found = 0
            for row in trial.itertuples():
                total = 0.0
                for index, action in enumerate(row.actions):
                    step = learner.steps[moment]
                    moment += 1
                    assert step.action[number] == action
                    assert (step.view.observation[number] == seen).all()
                    console = {
                        field.name: int(getattr(step.view.console, field.name)[number])
                        for field in fields(Console)
                    }
                    assert console == info["console"]
                    before = seen
                    seen, paid, terminated, _, info = env.step(int(action))
                    assert (step.outcome[number] == seen).all()
                    assert step.reward[number] == paid
                    assert step.attempt_over[number] == terminated
                    assert row.moved[index] == (seen != before).any()
                    total += float(paid)
                assert terminated
                assert step.new_solution[number] == row.new_solution
                assert row.new_solution == (len(info["latent"]["found"]) > found)
                found = len(info["latent"]["found"])
                assert row.reward == pytest.approx(total)
                assert row.opened == seen[-1]
                assert row.solutions_found == info["console"]["solutions_found"] == found
                seen, info = env.reset()
                if not step.trial_over[number]:
                    assert (step.next.observation[number] == seen).all()
            # The environment goes on to a new trial exactly where the session does.
            assert info["console"]["attempts_left"] == 20
            assert info["console"]["solutions_found"] == 0
            assert step.trial_over[number]


def test_under_the_rl_protocol_a_trial_goes_on_after_everything_is_found() -> None:
    protocol = replace(RL, attempt_limit=12, baseline_loops=2)
    record = play(Oracle(), "CC4", protocol, 5)
    trials = trials_of(record)
    assert len(trials) == 5 * 5 * 2
    assert (trials.attempts == 12).all()
    assert (trials.rows == 12).all()
    assert (trials.found == 3).all()
    # Found afresh in every visit, and not again afterwards.
    assert (record[record.attempt > 3].category == "open1").all()
    firsts = record[record.attempt <= 3].groupby("attempt").category.unique()
    assert [list(values) for values in firsts] == [["open1"], ["open2"], ["open3"]]
    assert record.new_solution.sum() == 3 * len(trials)


def test_under_the_human_protocol_the_solving_attempt_is_the_last() -> None:
    record = play(Curious(), "CC3", replace(HUMAN, attempt_limit=40), 20)
    trials = trials_of(record)
    assert (trials.rows == trials.attempts).all()
    solved = trials.found == trials.solutions
    assert solved.any()
    assert (trials.attempts[~solved] == 40).all()
    last = record.groupby(["subject", "loop", "trial"]).tail(1)
    assert (last.new_solution.to_numpy() >= solved.to_numpy()).all()


# -- attempts and trials --------------------------------------------------------------------------


F, T = False, True
ONE = Schema("one", ["A"], {"A": ["door"]})


def test_a_new_trial_forgets_what_was_found_and_shows_the_next_room() -> None:
    solve = [L0, L1, DOOR, L0, L2, DOOR, L0, L3, DOOR]
    condition = one_room("CC4", "trial7", trials=2)
    learner = Scripted(solve + solve)
    record = play(learner, condition, HUMAN, 1)
    assert record.trial.tolist() == [1, 1, 1, 2, 2, 2]
    assert record.attempt.tolist() == [1, 2, 3] * 2
    assert record.category.tolist() == ["open1", "open2", "open3"] * 2
    assert record.reward.tolist() == [61, 91, 136] * 2
    after = learner.steps[8].next
    assert (after.trial[0], after.attempt[0]) == (2, 1)
    assert (after.console.solutions_left[0], after.console.attempts_left[0]) == (3, 30)


def test_an_attempt_ends_as_soon_as_the_door_opens() -> None:
    layout = Layout((3,))
    learner = Scripted([3, DOOR, 1, 3, DOOR, DOOR, DOOR, 3])
    protocol = Protocol("mine", attempt_limit=3, stop_when_solved=False)
    record = play(learner, one_room(ONE, layout), protocol, 1, reward="basic")
    assert [row.tolist() for row in record.actions] == [[3, DOOR], [1, 3, DOOR], [DOOR, DOOR, 3]]
    assert [row.tolist() for row in record.moved] == [[T, T], [F, T, T], [F, F, T]]
    assert record.category.tolist() == ["open1", "open1", "unlock"]
    assert record.new_solution.tolist() == [T, F, F]
    assert record.reward.tolist() == [60, 60, 10]
    assert [int(step.view.console.actions_left[0]) for step in learner.steps] == [
        *(3, 2),
        *(3, 2, 1),
        *(3, 2, 1),
    ]


def test_rooms_of_different_sizes_and_limits_meet_in_one_condition() -> None:
    eight = Schema("eight", [f"A{i}" for i in range(8)], {f"A{i}": ["door"] for i in range(8)})
    condition = Condition("mixed", (Trials(SCHEMAS["chain3"], number=2), Trials(eight, number=1)))
    session = Session(condition, HUMAN, 3)
    assert (session.brief.positions, session.brief.actions) == (8, 17)
    assert session.brief.action_limit == 4
    record = session.play(Oracle()).to_pandas()
    trials = trials_of(record)
    assert trials.attempts.tolist() == [1, 1, 8] * 3
    assert [len(actions) for actions in record.actions[:3]] == [4, 4, 2]


# -- played, or driven by hand --------------------------------------------------------------------


def test_a_session_by_hand_is_the_same_as_one_that_is_played() -> None:
    learner = Curious()
    session = Session(named("CE3"), HUMAN, 4, seed=2)
    learner.begin(session.brief)
    while not session.over:
        learner.learn(session.step(learner.act(session.view)))
    by_hand = session.record().to_pandas().drop(columns="wall_time")
    played = play(Curious(), "CE3", subjects=4, seed=2).drop(columns="wall_time")
    pd.testing.assert_frame_equal(by_hand, played)
