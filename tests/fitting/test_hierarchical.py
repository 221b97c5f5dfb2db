"""Hierarchical fits: against direct maximisation, and on simulated subjects of cheap learners."""

from __future__ import annotations

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
from causal_openlock.experiment.runner import run
from causal_openlock.experiment.store import Store
from causal_openlock.fitting.actions import WHOLE, ActionPlan, fit_table, of_share, share_of
from causal_openlock.fitting.hierarchical import (
    SPREADS,
    Group,
    GroupFit,
    Peak,
    derivatives,
    evidence_of,
    group_of,
    peak,
)
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.scoring.teacher_forcing import Recorded, recorded_subjects
from causal_openlock.world.fsm import FloatArray

HEAT = Range(0.02, 2.0, log=True)
SPACE = search_space("associative", {"temperature": HEAT})
PLAN = ActionPlan(SPACE, candidates=4, hold_out="none")
BEGIN = Group(np.zeros(1), np.full(1, SPREADS[1]))
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
        peaks.append(Peak(at.tolist(), np.diag(bent).tolist(), 0.0))
    found = group_of(peaks, group)
    assert [*found.mean, *found.spread] == pytest.approx([*wanted[:2], *abs(wanted[2:])], abs=2e-3)
    nobody = Peak([9.0, 9.0], np.zeros((2, 2)).tolist(), 0.0, actions=0)
    assert group_of([*peaks, nobody], group).mean == pytest.approx(found.mean)


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
        GroupFit(parts(folder), PLAN, tmp_path / "again").run(report=stop)
    resumed = GroupFit(parts(folder), PLAN, tmp_path / "again")
    again = fit_table(resumed.run())
    pd.testing.assert_frame_equal(again.round(6), table, check_dtype=False)
    assert resumed.rounds[WHOLE] >= 2
    with pytest.raises(StoreError, match="holds another fit to actions"):
        GroupFit(parts(folder)[:3], PLAN, tmp_path / "again")


def test_who_is_held_out_is_predicted_by_the_group(tmp_path: Path) -> None:
    brief = ol.Protocol("brief", 4, stop_when_solved=True, baseline_trials=1)
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=brief, seed=5)
    run(made, tmp_path / "played", workers=0)
    plan = replace(PLAN, hold_out="subjects", candidates=2)
    fits = GroupFit(parts(tmp_path / "played"), plan, tmp_path).run()
    fold = {one.who[-2:]: one for one in fits if one.fold == 0}
    assert (fold["/0"].actions, fold["/1"].held_out_actions) == (0, 0)
    assert fold["/0"].chosen == fold["up"].chosen != fold["/1"].chosen
    assert fold["up"].held_out == fold["/0"].held_out > 0
    table = fit_table(fits)
    assert (table["held_out_bits"] > table["bits"] - 0.02).all()


def test_what_cannot_be_fitted_so_is_refused(folder: Path, tmp_path: Path) -> None:
    whole = ActionPlan(search_space("bayes", {"particles": Range(10, 20)}))
    with pytest.raises(LearnerError, match="particles of bayes takes whole numbers only"):
        GroupFit(parts(folder), whole, tmp_path)
    result = CliRunner().invoke(app, ["fit", "associative", "--hierarchical"])
    assert isinstance(result.exception, OpenLockError)
    assert "give --to" in str(result.exception)
