"""How fast attempts and exploration shrink: fits of known curves, and epsilon's course."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.paper.exploration import (
    PAPER_MEAN,
    PAPER_MEDIAN,
    exponential_fit,
    fitted,
    learning_curves,
    log_linear_fit,
    offset_fit,
    people_over_trials,
    random_actions,
    steps_until,
)
from support.fabricated_records import table, trial_rows


@settings(max_examples=30, deadline=None)
@given(st.floats(1, 100), st.floats(0.1, 0.95), st.floats(0, 20), st.integers(5, 12))
def test_exact_curves_are_recovered(scale: float, decay: float, offset: float, n: int) -> None:
    falling = scale * decay ** np.arange(n)
    for fit in (exponential_fit, log_linear_fit):
        found = fit(falling)
        assert (found.scale, found.decay) == pytest.approx((scale, decay), rel=1e-5)
        assert found.error == pytest.approx(0, abs=1e-5 * scale)
    found = offset_fit(falling + offset)
    assert found.error < 1e-4 * scale
    if 0.2 < decay < 0.8:
        assert found.decay == pytest.approx(decay, abs=1e-3)
        assert found.offset == pytest.approx(offset, abs=0.01 * scale + 1e-6)


def test_least_squares_beats_every_decay_nearby() -> None:
    values = people_over_trials()["CC3 training"]
    for fit, offset in ((exponential_fit, False), (offset_fit, True)):
        best = fit(values)
        for decay in np.linspace(0.3, 0.95, 66):
            columns = np.stack([decay ** np.arange(6), np.ones(6)][: 1 + offset], axis=1)
            rest = np.linalg.lstsq(columns, np.array(values), rcond=None)[1]
            assert best.error <= math.sqrt(rest[0] / 6) + 1e-9


def test_a_level_curve_does_not_decay_and_a_rising_one_grows() -> None:
    assert exponential_fit([30.0] * 6).decay == pytest.approx(1.0, abs=1e-4)
    assert exponential_fit([10.0, 12.0, 14.4, 17.28]).decay == pytest.approx(1.2, abs=1e-4)


def test_people_in_training_fit_as_was_found_before() -> None:
    """Both conditions averaged: the line through the logarithms is near the paper's .743."""
    found = fitted(people_over_trials())
    both = found[found["curve"] == "CC3 and CE3 training"].set_index("form")
    assert both["decay"].round(2).to_dict() == {
        "exponential": 0.70,
        "log-linear": 0.76,
        "with offset": 0.50,
    }
    assert both["near"].to_dict() == {
        "exponential": False,
        "log-linear": True,
        "with offset": False,
    }
    assert len(found) == 15
    assert found["trials"].tolist() == [6] * 9 + [5] * 6


def test_short_curves_are_not_fitted() -> None:
    assert fitted({"three": [3.0, 2.0, 1.0]}).empty


def test_learning_curves_of_a_record_are_means_by_trial() -> None:
    rows = []
    for subject, more in ((0, 0), (1, 2)):
        for trial, length in enumerate((9, 6, 4, 3), 1):
            found = [0] * (length + more - 3) + [1, 2, 3]
            rows += trial_rows(found, subject=subject, trial=trial)
    rows += trial_rows([1, 2, 3], phase="test") + trial_rows([1, 2, 3], protocol="rl")
    curves = learning_curves(attempts_to_solve(table(rows)), "human")
    assert curves == {("a", "CC4"): [10.0, 7.0, 5.0, 4.0]}


# -- epsilon --------------------------------------------------------------------------------------


def test_the_papers_decay_ends_exploration_within_16_steps() -> None:
    assert [steps_until(decay) for decay in (PAPER_MEAN, PAPER_MEDIAN, 0.995)] == [16, 8, 919]
    assert steps_until(PAPER_MEAN, start=0.5) == 14
    assert steps_until(0.1, floor=0.01) == 3  # .01 itself is not below it
    assert steps_until(0.5, floor=2.0) == 0
    with pytest.raises(ValueError, match="never gets below"):
        steps_until(1.0)


@settings(max_examples=50, deadline=None)
@given(st.floats(0.01, 0.9999), st.floats(1e-4, 0.5))
def test_steps_are_the_fewest_that_suffice(decay: float, floor: float) -> None:
    steps = steps_until(decay, floor)
    assert decay**steps < floor <= decay ** (steps - 1)


@pytest.mark.parametrize("shrinks_with", ["action", "attempt", "trial"])
@pytest.mark.parametrize("after_trial", [0.5, 0.0, None])
def test_expected_random_actions_are_those_of_the_learner(
    shrinks_with: str, after_trial: float | None
) -> None:
    pytest.importorskip("torch")
    from openlock_learners.ddqn import DDQN, DDQNParameters

    attempts, limit = 7, 3
    parameters = DDQNParameters(
        epsilon_decay=0.8,
        epsilon_decays_with=shrinks_with,  # type: ignore[arg-type]
        epsilon_after_trial=after_trial,
    )
    learner = DDQN(parameters)
    learner.epsilon = np.ones(1)

    class Playing:
        playing = np.ones(1, bool)

    class Led:
        view = Playing()

    sums = []
    for _ in range(2):
        explored = 0.0
        for action in range(1, attempts * limit + 1):
            explored += float(learner.epsilon[0])
            step = Led()
            step.attempt_over = np.array([action % limit == 0])  # type: ignore[attr-defined]
            step.trial_over = np.array([action == attempts * limit])  # type: ignore[attr-defined]
            learner._decay_epsilon(step)  # type: ignore[arg-type]
        sums.append(explored)
    assert random_actions(vars(parameters), attempts, limit) == pytest.approx(tuple(sums))


def test_people_of_the_baseline_are_the_published_means() -> None:
    curves = people_over_trials()
    assert curves["CC4 baseline"] == [19.375, 12.825, 8.525, 7.225, 6.45]
    assert curves["CC3 and CE3 training"][0] == pytest.approx((17.53 + 16.89) / 2)
