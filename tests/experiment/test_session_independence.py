"""No subject's data depend on other subjects, and no room on what a learner does or draws."""

import numpy as np
import pandas as pd
import pytest

from openlock_learners.random import RandomLearner
from support.session_play import Curious, Scripted, play


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


@pytest.mark.parametrize("condition", ["CC3-CE4", "noisy_CC3"])
def test_rooms_and_luck_are_the_same_for_all_learners(condition):
    script = np.random.default_rng(0).integers(15, size=7 * 90).tolist()
    first, second = (
        play(Scripted(*[script] * 5, afterwards=0), condition, subjects=5, learner=label)
        for label in ("one", "other")
    )
    different = ["learner", "wall_time"]
    pd.testing.assert_frame_equal(first.drop(columns=different), second.drop(columns=different))
    # One that draws as another does draws other numbers under another label.
    one, other = (
        np.concatenate(play(RandomLearner(), condition, learner=label).actions.tolist())
        for label in ("one", "other")
    )
    assert one.tolist() != other.tolist()
