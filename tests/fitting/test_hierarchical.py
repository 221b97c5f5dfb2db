"""Hierarchical fits: against direct maximisation, and on simulated subjects of cheap learners."""

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize
from scipy.special import expit, log_expit, logit
from scipy.stats import norm

import causal_openlock as ol
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.fitting.group import Group, Peak, derivatives, evidence_of, group_of, peak
from causal_openlock.fitting.hierarchical import fit_group
from causal_openlock.fitting.plan import Range, make_plan
from causal_openlock.fitting.steps import STEPS
from causal_openlock.fitting.to_actions import FILE, fit_table
from causal_openlock.running.runner import run
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once
from support.fits import with_settings

pytestmark = pytest.mark.slow

HEAT = Range(0.02, 2.0, log=True)
SPACE = make_plan("associative", {"temperature": HEAT})
PLAN = with_settings(SPACE, candidates=8, hold_out="none")
DRAWN = np.array([-1.2, -0.4, 0.4, 1.2])
"""Log-odds of the temperatures of four subjects."""


def test_the_group_is_that_of_greatest_likelihood():
    """Where likelihoods are normal, it can be found directly."""
    measured = np.array([[0.2, -1.0], [1.4, 0.3], [-0.3, 0.8], [0.9, -0.2], [2.0, 1.1]])
    variance = np.array([[0.3, 0.5], [0.1, 0.2], [0.8, 0.1], [0.2, 0.4], [0.4, 0.3]])

    def against(x):
        return float(-norm.logpdf(measured, x[:2], np.sqrt(variance + x[2:] ** 2)).sum())

    wanted = minimize(against, [0, 0, 1, 1], method="Nelder-Mead", options={"maxiter": 4000}).x
    group = Group(np.zeros(2), np.ones(2))
    peaks = []
    for one, spread in zip(measured, variance, strict=True):
        bent = 1 / spread
        at = (bent * one + group.mean / group.spread**2) / (bent + 1 / group.spread**2)
        slope = bent * (at - one)
        peaks.append(Peak(at.tolist(), slope.tolist(), np.diag(bent).tolist(), 0.0))
    found = group_of(peaks, group)
    assert [*found.mean, *found.spread] == pytest.approx([*wanted[:2], *abs(wanted[2:])], abs=2e-3)
    nobody = Peak([9.0, 9.0], [0.0, 0.0], np.zeros((2, 2)).tolist(), 0.0, actions=0)
    assert group_of([*peaks, nobody], group).mean == pytest.approx(found.mean)


def test_subjects_without_information_leave_the_group_as_it_is():
    """However far from its peak the search for it has stopped."""
    for start in (0.05, -0.05):
        group = Group.wide(1)
        peaks = [peak(lambda x: 100.0, group, np.full(1, start)) for _ in range(10)]
        found = group_of(peaks, group)
        assert [*found.mean, *found.spread] == pytest.approx([*group.mean, *group.spread], abs=0.01)


def test_derivatives_are_those_of_a_function():
    x = np.array([0.3, -0.7, 1.1])
    made = np.array([[2.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 3.0]])
    slope, bent = derivatives(lambda x: float(x @ made @ x / 2 + x.sum()), x)
    assert slope == pytest.approx(made @ x + 1)
    assert bent == pytest.approx(made)


def loss_of_coins(heads, actions):
    """The surprise at some heads among some actions, by log-odds."""
    return lambda x: float(-heads * log_expit(x[0]) - (actions - heads) * log_expit(-x[0]))


def of_coins(heads, actions):
    """A hierarchical fit of a learner of two actions, which does one with some log-odds."""
    group, starts = Group.wide(1), [np.zeros(1)] * len(heads)
    for _ in range(6):
        before = group
        peaks = [
            peak(loss_of_coins(k, n), before, start)
            for k, n, start in zip(heads, actions, starts, strict=True)
        ]
        group, starts = group_of(peaks, before), [np.array(one.at) for one in peaks]
    return before, peaks


def test_a_group_is_recovered_better_than_one_by_one():
    generator = np.random.default_rng(3)
    actions = np.tile([4.0, 24.0], 10)
    errors, spreads = [], []
    for _ in range(6):
        true = generator.normal(0.8, 0.5, len(actions))
        heads = generator.binomial(actions.astype(int), expit(true)).astype(float)
        group, peaks = of_coins(heads, actions)
        alone = logit(np.clip(heads / actions, 0.01, 0.99))
        errors.append([group.mean[0] - 0.8, alone.mean() - 0.8])
        spreads.append([group.spread[0], alone.std()])
        at = np.array([one.at[0] for one in peaks])
        nearer = abs(at - group.mean[0]) / np.maximum(abs(alone - group.mean[0]), 1e-9)
        assert np.median(nearer[actions == 4]) < np.median(nearer[actions == 24]) < 1
        wide = [evidence_of(one, group)[1][0] for one in peaks]
        assert np.mean(wide[::2]) > np.mean(wide[1::2])
    own, one_by_one = np.sqrt(np.square(errors).mean(axis=0))
    assert own < 0.7 * one_by_one
    assert abs(np.mean(spreads, axis=0)[0] - 0.5) < 0.25 < abs(np.mean(spreads, axis=0)[1] - 0.5)


def play(folder, kinds, attempts, subjects):
    brief = ol.Protocol("brief", attempts, stop_when_solved=True, baseline_trials=1)
    made = make_experiment(["CC3"], kinds, subjects=subjects, protocol=brief, seed=5)
    run(made, folder, workers=0)
    return folder


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Four subjects of different temperatures."""
    kinds = [
        ol.learner("associative", label=f"one{number}", temperature=HEAT.at(expit(x)))
        for number, x in enumerate(DRAWN)
    ]
    return play(tmp_path_factory.mktemp("group"), kinds, 6, 1)


def parts(folder):
    return recorded_subjects(*Store(folder).record())


WORDS = ["-s", "temperature=0.02:2:log", "--set", "candidates=8", "--workers", 1]


@pytest.fixture(scope="module")
def fitted(folder, tmp_path_factory):
    """The table of a hierarchical fit by the command."""
    out = tmp_path_factory.mktemp("fitted") / "fit"
    words = ["fit", "associative", "--to", folder, "--hierarchical", "--set", "hold_out=none"]
    done = at_once(*words, *WORDS, "--out", out)
    assert done.status == 0, done.stderr
    assert "temperature from" in " ".join(done.stdout.split())
    return pd.read_csv(out / "fits.csv")


def test_a_group_of_subjects_is_fitted(fitted):
    assert fitted["who"].tolist() == [
        "group",
        *(f"one{n}/CC3/brief/comparison/5/0" for n in range(4)),
    ]
    at = logit([HEAT.share(one) for one in fitted["temperature"]])
    assert at[0] == pytest.approx(at[1:].mean(), abs=0.05)
    assert np.corrcoef(at[1:], DRAWN)[0, 1] > 0.9
    assert at[1:].std() < logit(HEAT.share(fitted["temperature_high"][0])) - at[0]
    assert (fitted["temperature_low"] < fitted["temperature"]).all()
    assert fitted["bic"][0] == pytest.approx(fitted["bic"][1:].sum(), rel=1e-5)


def test_a_hierarchical_fit_that_was_stopped_continues_to_the_same(folder, fitted, tmp_path):
    def stop(step):
        if "round 2" in step:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_group(parts(folder), PLAN, tmp_path, report=stop)
    assert not (tmp_path / FILE).exists()
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / STEPS).iterdir()}
    fits, rounds = fit_group(parts(folder), PLAN, tmp_path)
    pd.testing.assert_frame_equal(fit_table(fits, PLAN).round(6), fitted, check_dtype=False)
    assert rounds >= 2
    assert before == {path: path.stat().st_mtime_ns for path in before}
    fewer, _ = fit_group(parts(folder)[:3], PLAN, tmp_path)
    assert len(fewer) == 1 + 3


def test_a_subject_that_is_held_out_is_predicted_by_the_group(tmp_path):
    play(tmp_path / "played", ["associative"], 4, 2)
    plan = with_settings(PLAN, hold_out="subjects", candidates=4)
    fits, _ = fit_group(parts(tmp_path / "played"), plan, tmp_path)
    fold = {one.who[-2:]: one for one in fits if one.fold == 0}
    assert (fold["/0"].actions, fold["/1"].held_out_actions) == (0, 0)
    assert fold["/0"].chosen == fold["up"].chosen != fold["/1"].chosen
    assert fold["up"].held_out == fold["/0"].held_out > 0
    table = fit_table(fits, PLAN)
    assert (table["held_out_bits"] > table["bits"] - 0.02).all()


def test_a_learner_without_exact_probabilities_is_not_fitted_hierarchically(folder, tmp_path):
    other = make_plan("posterior_sampling", {"concentration": Range(0.1, 1.0)}, fit=PLAN.fit)
    with pytest.raises(LearnerError, match="posterior_sampling"):
        fit_group(parts(folder), other, tmp_path / "asked")
    assert not (tmp_path / "asked").exists()
