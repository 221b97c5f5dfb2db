"""No subject's data depend on other subjects, and no room on what a learner does or draws."""

from __future__ import annotations

from collections.abc import Callable
from itertools import permutations

import numpy as np
import pandas as pd
import pytest

from causal_openlock.contract.learner import Learner, Step
from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.world.randomness import generators
from causal_openlock.world.room import Layout, published_layouts
from openlock_learners.oracle import Oracle
from openlock_learners.random import RandomLearner
from support.cc4_in_trial7 import DOOR
from support.session_play import HUMAN, Curious, Scripted, named, one_room, play, trials_of


@pytest.mark.parametrize("learner", [RandomLearner, Curious])
@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_a_subjects_data_do_not_depend_on_who_shares_its_batch(
    learner: Callable[[], Learner], condition: str
) -> None:
    together = play(learner(), condition, subjects=10, seed=7).drop(columns="wall_time")
    assert together.subject.unique().tolist() == list(range(10))
    batches: list[list[list[int]]] = [
        [[subject] for subject in range(10)],
        [[0, 1], [2, 3], [4, 5], [6, 7], [8, 9]],
        [[9, 0], [7, 2, 5], [1, 3, 4, 6, 8]],
    ]
    for split in batches:
        parts = [play(learner(), condition, subjects=batch, seed=7) for batch in split]
        apart = pd.concat(
            [part.astype(dict.fromkeys(texts(part), str)) for part in parts]
        ).sort_values("subject", kind="stable", ignore_index=True)
        expected = together.astype(dict.fromkeys(texts(together), str))
        pd.testing.assert_frame_equal(apart.drop(columns="wall_time"), expected)


def test_a_trials_layout_is_called_the_same_whoever_is_in_the_batch() -> None:
    """Some train in random layouts, and meet there what others are tested on under its name."""
    cc3 = named("CC3").train[0].schema
    published = published_layouts(cc3)
    everywhere = tuple(Layout(places) for places in permutations(range(7), 3))
    condition = Condition(
        "both",
        train=(Trials(cc3, everywhere, number=40),),
        test=(Trials(cc3, "published", number=len(published)),),
    )
    protocol = Protocol("short", attempt_limit=1, stop_when_solved=True)
    together = play(RandomLearner(), condition, protocol, subjects=6)
    places = {Layout.of(cc3, name).places for name in published}
    by_position = {Layout(one).name for one in places}
    train, test = (together[together.phase == phase] for phase in ("train", "test"))
    assert set(test.layout) == set(published)
    assert set(train.layout) & by_position, "somebody has trained in a published room"
    assert not set(train.layout) & set(published)
    for subject in range(6):
        alone = play(RandomLearner(), condition, protocol, subjects=[subject])
        assert alone.layout.tolist() == together[together.subject == subject].layout.tolist()


def texts(record: pd.DataFrame) -> list[str]:
    return [name for name in record if record[name].dtype == "category"]


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_rooms_and_luck_are_the_same_for_all_learners(condition: str) -> None:
    script = np.random.default_rng(0).integers(15, size=7 * 90).tolist()
    labels = ("one", "other")
    first, second = (
        play(Scripted(*[script] * 5, afterwards=0), condition, subjects=5, learner=label)
        for label in labels
    )
    different = ["learner", "wall_time"]
    pd.testing.assert_frame_equal(first.drop(columns=different), second.drop(columns=different))
    # Even a learner that ends its trials sooner meets the same rooms.
    oracle, chance = (
        trials_of(play(Oracle(), condition)),
        trials_of(play(RandomLearner(), condition)),
    )
    assert oracle.layout.tolist() == chance.layout.tolist()
    # And one that draws as another does draws other numbers under another label.
    alike = [play(RandomLearner(), condition, learner=label).actions.tolist() for label in labels]
    assert any((a.tolist() != b.tolist()) for a, b in zip(*alike, strict=True))


def test_seed_and_subject_determine_the_rooms() -> None:
    def layouts(seed: int) -> list[str]:
        return trials_of(play(Oracle(), "CC4", subjects=20, seed=seed)).layout.tolist()

    assert layouts(1) == layouts(1)
    assert layouts(1) != layouts(2)
    orders = np.array(layouts(1)).reshape(20, 5)
    assert len(np.unique(orders, axis=0)) > 10


def test_noisy_rooms_obey_as_often_as_their_strengths_say() -> None:
    many, attempts = 40, 100
    protocol = Protocol("mine", attempt_limit=attempts, stop_when_solved=False)
    learner = Scripted(*[[0, 4, DOOR] * attempts] * many)  # trial1: L0, L1, the door
    record = play(
        learner, one_room("noisy_CC3", "trial1"), protocol, many, reward="negative_immovable"
    )
    moved = np.array([row.tolist() for row in record.moved])
    tolerance = 5 * np.sqrt(0.16 / len(record))
    assert moved[:, 0].all()
    assert moved[:, 1].mean() == pytest.approx(0.8, abs=tolerance)
    assert not moved[~moved[:, 1], 2].any(), "the door is locked then"
    assert moved[moved[:, 1], 2].mean() == pytest.approx(0.8, abs=2 * tolerance)
    expected = np.where(moved[:, 1], 10, -0.5) + np.where(moved[:, 2], 50, -0.5)
    np.testing.assert_array_equal(record.reward, expected)
    # Every subject has luck of its own.
    by_subject = moved[:, 1].reshape(many, attempts)
    assert len(np.unique(by_subject, axis=0)) == many


def test_a_learners_luck_is_not_the_rooms() -> None:
    session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
    rooms = generators(4, "environment/noisy_CC3", range(3))
    for mine, room in zip(session.brief.generators, rooms, strict=True):
        assert mine.bit_generator.state != room.bit_generator.state
        assert (mine.random(5) != room.random(5)).any()
    # A learner that draws no number and one that draws many meet the same luck.
    generous, thrifty = ([0, 4, DOOR] * 150 for _ in range(2))
    records = []
    for script, numbers in ((generous, 1000), (thrifty, 0)):
        learner = Scripted(*[script] * 3, afterwards=0)
        session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
        for generator in session.brief.generators:
            generator.random(numbers)
        records.append(session.play(learner).to_pandas().drop(columns="wall_time"))
    pd.testing.assert_frame_equal(*records)


def test_what_a_learner_does_to_what_it_was_handed_does_not_change_the_session() -> None:
    class Vandal(Scripted):
        def learn(self, step: Step) -> None:
            for array in (step.action, step.reward, step.outcome, step.attempt_over):
                array[:] = 1
            for array in (step.trial_over, step.new_solution, step.view.observation):
                array[:] = 1

    arguments = {"condition": "CC3-CC4", "reward": "negative_repeat"}
    curious = Curious()
    expected = play(curious, **arguments).drop(columns="wall_time")
    scripts = np.stack([step.action for step in curious.steps], axis=1).tolist()
    record = play(Vandal(*scripts), **arguments).drop(columns="wall_time")
    pd.testing.assert_frame_equal(record, expected)
