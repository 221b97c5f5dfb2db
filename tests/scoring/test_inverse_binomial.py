"""Log-likelihoods by asking what copies of a learner would do."""

import itertools
import tracemalloc

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.contract.learner import Learner
from causal_openlock.experiment.making import make_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.running.runner import run
from causal_openlock.scoring.inverse_binomial import (
    TERMS,
    Tally,
    expected_rest,
    limit_of_draws,
    mean_over_orders,
)
from causal_openlock.storage.store import Store
from openlock_learners.associative import Associative
from openlock_learners.win_stay import WinStay
from support.scores import score_actions

pytestmark = pytest.mark.slow

SHORT = ol.Protocol("short", 6, stop_when_solved=True, baseline_trials=2)
LEARNERS = ["win_stay", "associative", "theory_based", "posterior_sampling"]


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    made = make_experiment(["CC3"], LEARNERS, subjects=3, protocol=SHORT, seed=3)
    folder = tmp_path_factory.mktemp("drawn")
    run(made, folder, workers=0)
    return Store(folder).record()


def spec(name):
    return next(one for one in make_experiment(["CC3"], LEARNERS).learners if one.name == name)


def tally(subjects, lapse):
    """A count of draws for one action of each subject, among fifteen actions."""
    shape = (subjects, 1)
    return Tally(np.ones(shape, bool), np.ones(shape), lapse, 15)


@pytest.mark.parametrize("probability", [0.9, 0.3, 0.02])
def test_the_estimate_and_its_variance_are_right_in_the_mean(probability):
    many, counts = 300, tally(300, 0.1)
    generator = np.random.default_rng(1)
    while counts.open.any():
        for subject in np.flatnonzero(counts.open[:, 0]).tolist():
            hits = generator.random(64) < probability
            counts.note(subject, 0, hits, np.ones(64, bool), generator.random(64))
    found = counts.scores()
    estimates, variances = found["log_probability"], found["standard_error"] ** 2
    assert not found["at_limit"].any()
    error = estimates.std() / np.sqrt(many)
    mixed = 0.9 * probability + 0.1 / 15
    assert estimates.mean() == pytest.approx(np.log(mixed), abs=4 * error)
    assert variances.mean() == pytest.approx(estimates.var(), rel=0.35)


def test_all_hits_of_a_batch_count_whatever_their_order():
    """The mean over all orders of (misses before, draws, hits), each as its first hit says."""
    for before, draws, hits in ((0, 5, 2), (3, 6, 1), (4, 4, 4)):
        orders = set(itertools.permutations([True] * hits + [False] * (draws - hits)))
        first = [before + order.index(True) for order in orders]
        sums = np.array([sum(1 / k for k in range(1, n + 1)) for n in first])
        squares = np.array([sum(1 / k**2 for k in range(1, n + 1)) for n in first])
        found = mean_over_orders(before, draws, hits)
        assert found == pytest.approx((-sums.mean(), squares.mean() - sums.var()))


def test_an_action_that_no_copy_takes_is_left_to_lapses():
    assert np.isneginf(tally(1, 0).scores()["log_probability"])
    found = tally(1, 0.1).scores()
    assert found["log_probability"] == pytest.approx(np.log(0.1 / 15))
    assert found["impossible"].all()
    assert found["at_limit"].all()


@pytest.mark.parametrize("probability", [0.0, 0.001, 0.003])
def test_the_default_limit_of_draws_makes_hardly_any_bias(probability):
    many, lapse = 3000, 0.01
    most = limit_of_draws(None, lapse, 15)
    exact = np.log((1 - lapse) * probability + lapse / 15)
    counts = tally(many, lapse)
    generator = np.random.default_rng(2)
    for subject in range(many):
        draws, luck = generator.random((2, most))
        counts.note(subject, 0, draws < probability, np.ones(most, bool), luck)
    found = counts.scores()
    off = found["log_probability"][:, 0] - exact
    error = off.std() / np.sqrt(many)
    assert abs(off.mean()) < 0.035 + 3 * error
    expected = (1 - np.exp(exact)) ** most
    assert found["at_limit"].mean() == pytest.approx(expected, abs=4 * np.sqrt(expected / many))


@pytest.mark.parametrize("misses", [0, 3, 256])
@pytest.mark.parametrize("probability", [1e-3, 40 / TERMS, 39.9 / TERMS, 1e-5, 1e-7, 1e-12, 1e-300])
def test_the_expected_rest_is_the_series_less_its_first_terms(misses, probability):
    k = np.arange(1, misses + 1)
    terms = np.exp(np.log1p(-probability) * (k - misses)) / k
    whole = -np.log(probability) * np.exp(-misses * np.log1p(-probability))
    tracemalloc.start()
    assert expected_rest(misses, probability) == pytest.approx(whole - terms.sum(), abs=1e-9)
    assert tracemalloc.get_traced_memory()[1] < 100 * TERMS
    tracemalloc.stop()


@pytest.mark.parametrize(
    ("learner", "name"),
    [(WinStay, "win_stay"), (Associative, "associative")],
)
def test_draws_agree_with_exact_probabilities(played, monkeypatch, learner, name):
    scored = spec(name)
    says, acts = learner.probabilities, learner.act

    def draws_silently(self, view):
        self.probabilities = lambda now: says(self, now)
        action = acts(self, view)
        del self.probabilities
        return action

    for acted in (name, "posterior_sampling"):
        exact = score_actions(*played, scored, 0.2, of=[acted])
        with monkeypatch.context() as patched:
            patched.setattr(learner, "probabilities", lambda *_: None)
            patched.setattr(learner, "act", draws_silently)
            drawn = score_actions(*played, scored, 0.2, of=[acted], draws=300)
        gap = (drawn["log_probability"] - exact["log_probability"]).sum()
        error = np.sqrt((drawn["standard_error"] ** 2).sum())
        assert exact["standard_error"].sum() == 0.0 < error
        assert abs(gap) < 4 * error, (acted, gap, error)


def test_copies_carry_on_the_plan_that_the_subject_has_begun(played):
    asked = {"of": ["posterior_sampling"], "draws": 100}
    actions = score_actions(*played, spec("posterior_sampling"), 0.2, **asked)
    assert actions.equals(score_actions(*played, spec("posterior_sampling"), 0.2, **asked))
    assert np.isnan(actions["entropy"]).all()
    by_place = np.exp(actions["log_probability"]).groupby(actions["action"]).mean()
    assert by_place[3] > by_place[1]  # once the first lever is known, the rest is known better
    assert -actions["log_probability"].mean() < np.log(15)


class Habit(Learner):
    """Draws one of two actions at the beginning of an attempt, and repeats it."""

    def begin(self, brief):
        self.brief, self.habit = brief, np.zeros(brief.subjects, int)

    def act(self, view):
        begins = view.playing & (view.console.actions_left == self.brief.action_limit)
        for row in np.flatnonzero(begins):
            self.habit[row] = self.brief.generators[row].integers(2)
        return self.habit.copy()


def test_later_actions_are_asked_of_copies_that_did_the_earlier_ones(played, monkeypatch):
    _, experiment = played
    condition = experiment.conditions[0]
    about = {"seed": 3, "learner": "posterior_sampling", "experiment": experiment.name}
    acted = Session(condition, SHORT, 1, **about).play(Habit())
    monkeypatch.setattr("causal_openlock.scoring.inverse_binomial.create", lambda *_: Habit())
    found = score_actions(acted, experiment, spec("posterior_sampling"), 0.0, draws=64)
    by_place = found.groupby("action")["log_probability"].mean()
    assert by_place[1] == pytest.approx(np.log(0.5), abs=0.2)
    assert by_place[[2, 3]].tolist() == [0.0, 0.0]
