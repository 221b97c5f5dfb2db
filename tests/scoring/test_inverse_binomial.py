"""Log-likelihoods by asking what copies of a learner would do."""

from __future__ import annotations

import tracemalloc

import numpy as np
import pyarrow as pa
import pytest

import causal_openlock as ol
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.experiment import LearnerSpec
from causal_openlock.running.runner import run
from causal_openlock.scoring.inverse_binomial import (
    TERMS,
    Draws,
    Tally,
    expected_rest,
    largest_bias,
)
from causal_openlock.scoring.teacher_forcing import score_actions
from causal_openlock.storage.store import Store
from causal_openlock.storage.stored import StoredExperiment
from openlock_learners.associative import Associative
from openlock_learners.theory_based import TheoryBased
from openlock_learners.win_stay import WinStay

pytestmark = pytest.mark.slow

SHORT = ol.Protocol("short", 6, stop_when_solved=True, baseline_trials=2)
LEARNERS = ["win_stay", "associative", "theory_based", "posterior_sampling"]
Played = tuple[pa.Table, StoredExperiment]


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Played:
    made = make_experiment(["CC3"], LEARNERS, subjects=3, protocol=SHORT, seed=3)
    folder = tmp_path_factory.mktemp("drawn")
    run(made, folder, workers=0)
    return Store(folder).record()


def spec(name: str) -> LearnerSpec:
    (found,) = (one for one in make_experiment(["CC3"], LEARNERS).learners if one.name == name)
    return found


def of(played: Played, learner: str) -> Played:
    record, experiment = played
    own = [name == learner for name in record["learner"].to_pylist()]
    return record.filter(pa.array(own)), experiment


@pytest.mark.parametrize("probability", [0.9, 0.3, 0.02])
def test_the_estimate_and_its_variance_are_right_in_the_mean(probability: float) -> None:
    many, lapse = 300, 0.1
    mixed = 0.9 * probability + 0.1 / 15
    tally = Tally(np.ones((many, 1), bool), np.ones((many, 1)), Draws(), lapse, 15)
    generator = np.random.default_rng(1)
    while tally.open.any():
        for subject in np.flatnonzero(tally.open[:, 0]).tolist():
            own = generator.random(64) < probability
            tally.note(subject, 0, own, np.ones(64, bool), generator.random(64))
    estimates, variances, _, at_limit = tally.estimates()
    assert not at_limit.any()
    error = estimates.std() / np.sqrt(many)
    assert estimates.mean() == pytest.approx(np.log(mixed), abs=4 * error)
    assert variances.mean() == pytest.approx(estimates.var(), rel=0.35)


def test_what_no_copy_does_is_left_to_lapses() -> None:
    tally = Tally(np.ones((1, 1), bool), np.ones((1, 1)), Draws(), 0.1, 15)
    assert np.isneginf(Tally(np.ones((1, 1), bool), np.ones((1, 1)), Draws(), 0, 15).estimates()[0])
    assert tally.estimates()[0] == pytest.approx(np.log(0.1 / 15))
    assert tally.estimates().impossible.all()
    assert tally.estimates().at_limit.all()


@pytest.mark.parametrize("probability", [0.0, 0.001, 0.003])
def test_a_limit_makes_no_more_bias_than_is_said_and_the_default_hardly_any(
    probability: float,
) -> None:
    many, lapse = 3000, 0.01
    exact = np.log((1 - lapse) * probability + lapse / 15)

    def drawn(most: int) -> tuple[float, float, float]:
        """Mean error, its standard error, and the share of actions at the limit."""
        tally = Tally(np.ones((many, 1), bool), np.ones((many, 1)), Draws(), lapse, 15)
        generator = np.random.default_rng(2)
        for subject in range(many):
            own, luck = generator.random((2, most))
            tally.note(subject, 0, own < probability, np.ones(most, bool), luck)
        found = tally.estimates()
        off = found.log_probability[:, 0] - exact
        return off.mean(), off.std() / np.sqrt(many), found.at_limit.mean()

    for most in (256, Draws().limit(lapse, 15)):
        bias, error, at_limit = drawn(most)
        assert -largest_bias(most, lapse, 15) - 3 * error < bias < 3 * error
        expected = (1 - np.exp(exact)) ** most
        assert at_limit == pytest.approx(expected, abs=4 * np.sqrt(expected / many))
    assert abs(bias) < 0.035 + 3 * error
    if probability:
        assert drawn(256)[0] < -0.3  # the limit of before


@pytest.mark.parametrize("misses", [0, 3, 256])
@pytest.mark.parametrize("probability", [1e-3, 40 / TERMS, 39.9 / TERMS, 1e-5, 1e-7, 1e-12, 1e-300])
def test_the_rest_of_a_rare_action_needs_no_long_sum(misses: int, probability: float) -> None:
    k = np.arange(1, misses + 1)
    terms = np.exp(np.log1p(-probability) * (k - misses)) / k
    whole = -np.log(probability) * np.exp(-misses * np.log1p(-probability))
    tracemalloc.start()
    assert expected_rest(misses, probability) == pytest.approx(whole - terms.sum(), abs=1e-9)
    assert tracemalloc.get_traced_memory()[1] < 100 * TERMS
    tracemalloc.stop()


@pytest.mark.parametrize("learner", [WinStay, Associative, TheoryBased])
def test_it_agrees_with_probabilities(
    played: Played, monkeypatch: pytest.MonkeyPatch, learner: type
) -> None:
    """All others that give them: ``benchmarks/likelihoods.py``."""
    kinds = {WinStay: "win_stay", Associative: "associative", TheoryBased: "theory_based"}
    name, lapse = kinds[learner], 0.2
    scored, estimated = spec(name), learner is TheoryBased
    for acted in (name, "posterior_sampling"):
        own = of(played, acted)
        exact = score_actions(*own, scored, lapse)
        with monkeypatch.context() as patched:
            patched.setattr(learner, "probabilities", lambda *_: None)
            drawn = score_actions(*own, scored, lapse, draws=Draws(hits=2, most=300))
        gap = (drawn["log_probability"] - exact["log_probability"]).sum()
        error = np.sqrt((drawn["standard_error"] ** 2).sum())
        own_error = np.sqrt((exact["standard_error"] ** 2).sum())
        assert (own_error > 0) == estimated
        assert error > 3 * own_error
        assert abs(gap) < 4 * error, (acted, gap, error)


def test_a_plan_that_nobody_sees_is_filtered_by_what_was_done(played: Played) -> None:
    own = of(played, "posterior_sampling")
    scored = spec("posterior_sampling")
    actions = score_actions(*own, scored, 0.2, draws=Draws(most=100))
    again = score_actions(*own, scored, 0.2, draws=Draws(most=100))
    assert actions.equals(again)
    assert np.isnan(actions["entropy"]).all()
    by_place = np.exp(actions["log_probability"]).groupby(actions["action"]).mean()
    # It carries a plan out: once the first lever is known, the rest is known better.
    assert by_place[3] > by_place[1]
    assert -actions["log_probability"].mean() < np.log(15)
