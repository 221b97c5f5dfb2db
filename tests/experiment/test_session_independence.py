"""No subject's data depend on other subjects, and no room on what a learner does or draws."""

from itertools import permutations

import numpy as np
import pandas as pd
import pytest

from causal_openlock.experiment.protocol import Condition, Protocol, Trials
from causal_openlock.experiment.session import Session
from causal_openlock.world.randomness import generators
from causal_openlock.world.room import Layout, published_layouts
from openlock_learners.oracle import Oracle
from openlock_learners.random import RandomLearner
from support.cc4_in_trial7 import DOOR
from support.session_play import HUMAN, SCHEMAS, Curious, Scripted, named, one_room, play, trials_of


def rows(*arguments, **options):
    """What a learner played, without what differs at each run."""
    record = play(*arguments, **options).drop(columns="wall_time")
    return [tuple(map(str, row)) for row in record.itertuples(index=False)]


@pytest.mark.parametrize("learner", [RandomLearner, Curious])
@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_a_subjects_data_do_not_depend_on_who_shares_its_batch(learner, condition):
    together = rows(learner(), condition, subjects=10, seed=7)
    number = play(learner(), condition, subjects=10, seed=7).subject
    assert number.unique().tolist() == list(range(10))  # in order
    for split in ([[one] for one in range(10)], [[9, 0], [7, 2, 5], [1, 3, 4, 6, 8]]):
        for batch in split:
            apart = rows(learner(), condition, subjects=batch, seed=7)
            assert apart == [row for row, one in zip(together, number, strict=True) if one in batch]


def test_a_trials_layout_is_called_the_same_whoever_is_in_the_batch():
    """Some train in random layouts, and meet there what others are tested on under its name."""
    cc3 = SCHEMAS["CC3"]
    published = published_layouts(cc3)
    everywhere = tuple(Layout(places) for places in permutations(range(7), 3))
    condition = Condition(
        "both",
        train=(Trials(cc3, everywhere, number=40),),
        test=(Trials(cc3, "published", number=len(published)),),
    )
    protocol = Protocol("short", attempt_limit=1, stop_when_solved=True)
    together = play(RandomLearner(), condition, protocol, subjects=6)
    by_position = {Layout(Layout.of(cc3, name).places).name for name in published}
    train, test = (together[together.phase == phase] for phase in ("train", "test"))
    assert set(test.layout) == set(published)
    assert set(train.layout) & by_position, "somebody has trained in a published room"
    assert not set(train.layout) & set(published)
    for subject in range(6):
        alone = play(RandomLearner(), condition, protocol, subjects=[subject])
        assert alone.layout.tolist() == together[together.subject == subject].layout.tolist()


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_rooms_and_luck_are_the_same_for_all_learners(condition):
    script = np.random.default_rng(0).integers(15, size=7 * 90).tolist()
    first, second = (
        play(Scripted(*[script] * 5, afterwards=0), condition, subjects=5, learner=label)
        for label in ("one", "other")
    )
    different = ["learner", "wall_time"]
    pd.testing.assert_frame_equal(first.drop(columns=different), second.drop(columns=different))
    # Even a learner that ends its trials sooner meets the same rooms.
    oracle, chance = (
        trials_of(play(learner, condition)).layout for learner in (Oracle(), RandomLearner())
    )
    assert oracle.tolist() == chance.tolist()
    # And one that draws as another does draws other numbers under another label.
    one, other = (
        np.concatenate(play(RandomLearner(), condition, learner=label).actions.tolist())
        for label in ("one", "other")
    )
    assert one.tolist() != other.tolist()


def test_seed_and_subject_determine_the_rooms():
    def layouts(seed):
        return trials_of(play(Oracle(), "CC4", subjects=20, seed=seed)).layout.tolist()

    assert layouts(1) == layouts(1)
    assert layouts(1) != layouts(2)
    assert len(np.unique(np.array(layouts(1)).reshape(20, 5), axis=0)) > 10


def test_noisy_rooms_obey_as_often_as_their_strengths_say():
    many, attempts = 40, 100
    protocol = Protocol("mine", attempt_limit=attempts, stop_when_solved=False)
    learner = Scripted(*[[0, 4, DOOR] * attempts] * many)  # trial1: L0, L1, the door
    record = play(learner, one_room("noisy_CC3", "trial1"), protocol, many)
    moved = np.array([row.tolist() for row in record.moved])
    tolerance = 5 * np.sqrt(0.16 / len(record))
    assert moved[:, 0].all()
    assert moved[:, 1].mean() == pytest.approx(0.8, abs=tolerance)
    assert not moved[~moved[:, 1], 2].any(), "the door is locked then"
    assert moved[moved[:, 1], 2].mean() == pytest.approx(0.8, abs=2 * tolerance)
    # Every subject has luck of its own.
    assert len(np.unique(moved[:, 1].reshape(many, attempts), axis=0)) == many


def test_a_learners_luck_is_not_the_rooms():
    session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
    rooms = generators(4, "environment/noisy_CC3", range(3))
    for mine, room in zip(session.brief.generators, rooms, strict=True):
        assert (mine.random(5) != room.random(5)).any()
    # A learner that draws no number and one that draws many meet the same luck.
    records = []
    for numbers in (1000, 0):
        session = Session(named("noisy_CC3"), HUMAN, 3, seed=4)
        for generator in session.brief.generators:
            generator.random(numbers)
        table = session.play(Scripted(*[[0, 4, DOOR] * 150] * 3, afterwards=0))
        records.append(table.drop_columns("wall_time").to_pylist())
    assert records[0] == records[1]
