"""Hierarchical fits: against direct maximisation, and on simulated subjects of cheap learners."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy.optimize import minimize
from scipy.special import expit, log_expit, logit
from scipy.stats import norm
from typer.testing import CliRunner

import causal_openlock as ol
from causal_openlock.cli import app
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.fitting.actions import WHOLE, ActionPlan, fit_table, of_share, share_of
from causal_openlock.fitting.group import (
    Group,
    Peak,
    derivatives,
    evidence_of,
    group_of,
    peak,
)
from causal_openlock.fitting.group_progress import PROGRESS
from causal_openlock.fitting.hierarchical import GroupFit
from causal_openlock.fitting.kept import fitting_in, keep_fit
from causal_openlock.fitting.mixture import mixture_of
from causal_openlock.fitting.predicting import read_fit
from causal_openlock.fitting.search import Range, search_beside, search_space
from causal_openlock.running.runner import run
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.model_selection import frequencies_of
from causal_openlock.scoring.teacher_forcing import Recorded, recorded_subjects
from causal_openlock.storage.store import Store

pytestmark = pytest.mark.slow

HEAT = Range(0.02, 2.0, log=True)
SPACE = search_space("associative", {"temperature": HEAT})
PLAN = ActionPlan(SPACE, candidates=4, hold_out="none")
BEGIN = Group.wide(1)
DRAWN = np.array([-1.2, -0.4, 0.4, 1.2])
"""Log-odds of the temperatures of four subjects."""


def test_the_group_is_that_of_greatest_likelihood() -> None:
    """Where likelihoods are normal, it can be found directly."""
    measured = np.array([[0.2, -1.0], [1.4, 0.3], [-0.3, 0.8], [0.9, -0.2], [2.0, 1.1]])
    variance = np.array([[0.3, 0.5], [0.1, 0.2], [0.8, 0.1], [0.2, 0.4], [0.4, 0.3]])

    def against(x: FloatArray) -> float:
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
    outsider = Peak([4.0, 4.0], [0.0, 0.0], np.eye(2).tolist(), 0.0)
    counts = np.array([1.0] * len(peaks) + [0.0])
    assert group_of([*peaks, outsider], group, counts).mean == pytest.approx(found.mean)
    assert group_of([*peaks, outsider], group).mean[0] > found.mean[0] + 0.1
    assert group_of(peaks, group, np.full(len(peaks), 0.1)) is group
    nobody = Peak([9.0, 9.0], [0.0, 0.0], np.zeros((2, 2)).tolist(), 0.0, actions=0)
    assert group_of([*peaks, nobody], group).mean == pytest.approx(found.mean)


def test_a_group_that_nothing_is_known_of_stays_as_it_is() -> None:
    """However far from its peak the search for it has stopped."""
    for start in (0.05, -0.05):
        group = Group.wide(1)
        peaks = [peak(lambda x: 100.0, group, np.full(1, start)) for _ in range(10)]
        found = group_of(peaks, group)
        assert [*found.mean, *found.spread] == pytest.approx([*group.mean, *group.spread], abs=0.01)


@pytest.mark.parametrize("seed", range(3))
def test_who_follows_whom_settles(seed: int) -> None:
    """A price that fewer followers share drives them away, and does not bring them back."""
    generator = np.random.default_rng(seed)
    for _ in range(10):
        subjects, learners = generator.integers(1, 9), generator.integers(2, 5)
        evidence = generator.normal(-100, generator.choice([1, 4, 20]), (subjects, learners))
        actions = generator.integers(50, 190, subjects)
        parameters = generator.choice([0, 2, 8], learners)
        found = mixture_of(evidence, actions, parameters)
        assert found.followed.sum(axis=1) == pytest.approx(1)
        # With the price that it states, the same comes out.
        assert frequencies_of(-found.bic / 2)[1] == pytest.approx(found.followed, abs=1e-4)
    alone = mixture_of(np.array([[-97.0, -100.0]]), np.array([100]), np.array([2, 0]))
    assert alone.followed[0, 0] < 0.2  # three nats are less than two parameters cost


def test_derivatives_are_those_of_a_function() -> None:
    x = np.array([0.3, -0.7, 1.1])
    made = np.array([[2.0, 0.5, -0.3], [0.5, 1.0, 0.2], [-0.3, 0.2, 3.0]])
    slope, bent = derivatives(lambda x: float(x @ made @ x / 2 + x.sum()), x)
    assert slope == pytest.approx(made @ x + 1)
    assert bent == pytest.approx(made)


def of_coins(heads: FloatArray, actions: FloatArray) -> tuple[Group, list[Peak]]:
    """A hierarchical fit of a learner of two actions, which does one with some log-odds."""
    group, peaks = BEGIN, []
    for _ in range(6):
        start = [np.zeros(1)] * len(heads) if not peaks else [np.array(one.at) for one in peaks]
        before = group
        peaks = [
            peak(lambda x, k=k, n=n: float(-k * log_expit(x[0]) - (n - k) * log_expit(-x[0])),
                 before, at)
            for k, n, at in zip(heads, actions, start, strict=True)
        ]  # fmt: skip
        group = group_of(peaks, before)
    return before, peaks


def test_a_group_is_recovered_better_than_one_by_one() -> None:
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


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    brief = ol.Protocol("brief", 6, stop_when_solved=True, baseline_trials=1)
    kinds = [
        ol.learner("associative", label=f"one{number}", temperature=of_share(HEAT, expit(x)))
        for number, x in enumerate(DRAWN)
    ]
    folder = tmp_path_factory.mktemp("group")
    run(make_experiment(["CC3"], kinds, subjects=1, protocol=brief, seed=5), folder, workers=0)
    return folder


def parts(folder: Path) -> list[Recorded]:
    return recorded_subjects(*Store(folder).record())


def test_a_group_of_subjects_is_fitted(folder: Path, tmp_path: Path) -> None:
    words = ["fit", "associative", "--to", str(folder), "--hierarchical", "--hold-out", "none",
             "-s", "temperature=0.02:2:log", "--candidates", "4", "--workers", "1",
             "--out", str(tmp_path / "fit")]  # fmt: skip
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "Two thirds of such a group have temperature from" in " ".join(result.output.split())
    table = pd.read_csv(tmp_path / "fit" / "fits.csv")
    assert table["who"].tolist() == [
        "group",
        *(f"one{n}/CC3/brief/comparison/5/0" for n in range(4)),
    ]
    at = logit([share_of(HEAT, one) for one in table["temperature"]])
    assert at[0] == pytest.approx(at[1:].mean(), abs=0.05)
    assert np.corrcoef(at[1:], DRAWN)[0, 1] > 0.9
    assert at[1:].std() < logit(share_of(HEAT, table["temperature_high"][0])) - at[0]
    assert (table["temperature_low"] < table["temperature"]).all()
    assert table["bic"][0] == pytest.approx(table["bic"][1:].sum(), rel=1e-5)

    def stop(what: str) -> None:
        if "round 2" in what:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        GroupFit(parts(folder), {"associative": PLAN}, tmp_path / "again").run(report=stop)
    resumed = GroupFit(parts(folder), {"associative": PLAN}, tmp_path / "again")
    again = fit_table(resumed.run())
    pd.testing.assert_frame_equal(again.round(6), table, check_dtype=False)
    assert resumed.rounds[WHOLE] >= 2
    with pytest.raises(StoreError, match="holds another fit to actions"):
        GroupFit(parts(folder)[:3], {"associative": PLAN}, tmp_path / "again").run()
    with fitting_in(tmp_path / "again"), pytest.raises(StoreError, match="use by another fit"):
        resumed.run()
    path = tmp_path / "again" / PROGRESS
    kept = json.loads(path.read_text())
    keep_fit(path, kept["plan"], starts=kept["starts"][::-1], peaks=kept["peaks"])
    with pytest.raises(StoreError, match="this is not a fit"):
        resumed.run()
    first = kept["peaks"][0]
    for spoiled in (
        {"peaks": [{**first, "at": [0.0, 1.0]}]},
        {"peaks": [{**first, "curvature": []}]},
        {"peaks": [{**first, "curvature": [[-1.0]]}]},
        {"peaks": [{**first, "slope": [1e300]}]},
        {"peaks": [{**first, "actions": 0}]},
        {"peaks": kept["peaks"] * 2},
        {"starts": [{**kept["starts"][0], who: [[]]} for who in kept["starts"][0]], "peaks": []},
    ):
        changed = {"starts": kept["starts"], "peaks": kept["peaks"], **spoiled}
        keep_fit(path, kept["plan"], **changed)
        with pytest.raises(StoreError, match="this is not a fit"):
            resumed.run()


def test_who_is_held_out_is_predicted_by_the_group(tmp_path: Path) -> None:
    brief = ol.Protocol("brief", 4, stop_when_solved=True, baseline_trials=1)
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=brief, seed=5)
    run(made, tmp_path / "played", workers=0)
    plan = replace(PLAN, hold_out="subjects", candidates=2)
    fits = GroupFit(parts(tmp_path / "played"), {"associative": plan}, tmp_path).run()
    fold = {one.who[-2:]: one for one in fits if one.fold == 0}
    assert (fold["/0"].actions, fold["/1"].held_out_actions) == (0, 0)
    assert fold["/0"].chosen == fold["up"].chosen != fold["/1"].chosen
    assert fold["up"].held_out == fold["/0"].held_out > 0
    table = fit_table(fits)
    assert (table["held_out_bits"] > table["bits"] - 0.02).all()


def test_what_cannot_be_fitted_so_is_refused(folder: Path, tmp_path: Path) -> None:
    whole = ActionPlan(search_space("bayes", {"particles": Range(10, 20)}))
    with pytest.raises(LearnerError, match="particles of bayes takes whole numbers only"):
        GroupFit(parts(folder), {"bayes": whole}, tmp_path)
    twice = {"associative": PLAN, "associative_2": replace(PLAN)}
    with pytest.raises(LearnerError, match="associative and associative_2 are the same learner"):
        GroupFit(parts(folder), twice, tmp_path)
    asked = replace(PLAN, space=search_beside("posterior_sampling"))
    with pytest.raises(LearnerError, match="posterior_sampling gives no probabilities"):
        GroupFit(parts(folder), {"own": PLAN, "asked": asked}, tmp_path / "asked").run()
    assert not (tmp_path / "asked").exists()
    drawn = replace(PLAN, space=search_space("theory_based", {"schema_gain": Range(0.1, 10)}))
    with pytest.raises(LearnerError, match=r"estimates .* from draws, .* beliefs=mean"):
        GroupFit(parts(folder), {"theory_based": drawn}, tmp_path / "asked").run()
    nothing = dict.fromkeys(("lever", "position", "colour"), 0.0)
    sure = search_space("associative", {"temperature": HEAT}, nothing)
    with pytest.raises(LearnerError, match="temperature makes no difference to how likely"):
        GroupFit(parts(folder), {"associative": replace(PLAN, space=sure)}, tmp_path / "sure").run()
    result = CliRunner().invoke(app, ["fit", "associative", "--hierarchical"])
    assert isinstance(result.exception, OpenLockError)
    assert "give --to" in str(result.exception)


def test_a_mixture_finds_who_follows_whom_and_fits_only_them(tmp_path: Path) -> None:
    """Four subjects learn by association, all with one temperature; two act at random."""
    brief = ol.Protocol("brief", 8, stop_when_solved=True, baseline_trials=1)
    cold = ol.learner("associative", label="cold", subjects=4, temperature=0.1)
    others = ol.learner("random", subjects=2)
    made = make_experiment(["CC3"], [cold, others], subjects=5, protocol=brief, seed=5)
    run(made, tmp_path / "played", workers=0)
    words = ["fit", "associative", "--to", str(tmp_path / "played"), "--hierarchical", "--or",
             "random", "-s", "temperature=0.02:2:log", "--candidates", "4", "--workers", "1",
             "--folds", "2", "--hold-out", "subjects", "--out", str(tmp_path / "fit")]  # fmt: skip
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "Two thirds of such a group of associative have" in " ".join(result.output.split())
    table = pd.read_csv(tmp_path / "fit" / "fits.csv")
    own = table[(table["learner"] == "associative") & (table["who"] != "group")]
    is_cold = own["who"].str.startswith("cold")
    assert (own["followed"] > 0.9).tolist() == is_cold.tolist()
    groups = table[table["who"] == "group"].set_index("learner")
    assert groups.loc["associative", "followed"] == pytest.approx(5 / 8, abs=0.01)
    assert groups.loc["mixture", "held_out_bits"] < groups["held_out_bits"][:2].min()
    others = table[(table["learner"] == "random") & (table["who"] != "group")]
    both = own.merge(others, on="who")
    assert np.allclose(both["followed_x"] + both["followed_y"], 1)

    alone = ["--hold-out", "none", "--out", str(tmp_path / "alone")]
    words = [word for word in words[:-4] if word not in ("--or", "random")]
    assert CliRunner().invoke(app, [*words, *alone]).exit_code == 0
    everyone = pd.read_csv(tmp_path / "alone" / "fits.csv").iloc[0]
    own = groups.loc["associative"]
    wide = [np.log(one["temperature_high"] / one["temperature_low"]) for one in (own, everyone)]
    assert wide[0] < 0.5 * wide[1]  # those who follow another learner would make it wide

    with pytest.raises(StoreError, match="this is a mixture of learners"):
        read_fit(tmp_path / "fit")
    plans = {name: replace(PLAN, space=search_beside(name)) for name in ("win_stay", "random")}
    kept = parts(tmp_path / "played")
    fits = GroupFit(kept, plans, tmp_path / "fixed").run()
    assert [one.chosen for one in fits] == [{}] * len(fits)
    assert [one.who for one in fits].count("group") == 3

    def stop(what: str) -> None:
        if "fold 2 of 3" in what:
            raise KeyboardInterrupt

    plan = replace(PLAN, hold_out="subjects")
    pair = {"associative": plan, "random": replace(plan, space=search_beside("random"))}
    with pytest.raises(KeyboardInterrupt):
        GroupFit(kept, pair, tmp_path / "again").run(report=stop)
    again = fit_table(GroupFit(kept, pair, tmp_path / "again").run())
    pd.testing.assert_frame_equal(again.round(6), table, check_dtype=False)


def test_a_mixture_needs_groups(folder: Path) -> None:
    result = CliRunner().invoke(app, ["fit", "bayes", "--to", str(folder), "--or", "random"])
    assert isinstance(result.exception, OpenLockError)
    assert "give --hierarchical" in str(result.exception)
