"""Results that share no condition stand beside each other without being compared."""

from __future__ import annotations

import numpy as np

import causal_openlock as ol


def test_learners_without_a_condition_in_common_are_not_compared() -> None:
    one = ol.compare("CC3", ["oracle", "bayes"], subjects=2, workers=0)
    other = ol.compare("CE3", ["random"], subjects=2, workers=0)
    table = (one + other).leaderboard.set_index("learner")
    assert np.isnan(table.loc["random", "to_best"])
    assert (one + other).pairs["learner"].tolist() == ["oracle"]
