"""Fits read back as learners that predict."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import causal_openlock as ol
from causal_openlock.cli import app
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.fitting.actions import FILE, WHOLE, ActionPlan, fit_all, jobs_of
from causal_openlock.fitting.hierarchical import GroupFit
from causal_openlock.fitting.kept import keep_fit
from causal_openlock.fitting.predicting import FitOfActions, read_fit, score_fits
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.running.runner import run
from causal_openlock.scoring.scores import Scores, followed
from causal_openlock.scoring.teacher_forcing import recorded_subjects
from causal_openlock.storage.store import Store

pytest.importorskip("optuna")
SPACE = search_space("associative", {"temperature": Range(0.02, 2.0, log=True)})
PLAN = ActionPlan(SPACE, candidates=2, restarts=1, moves=0)
WAYS = ("all", "each", "group", "all_held", "each_held")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two subjects of two trials, and fits of all kinds."""
    brief = ol.Protocol("brief", 4, stop_when_solved=True, baseline_trials=2)
    folder = tmp_path_factory.mktemp("predicting")
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=brief, seed=5)
    run(made, folder, workers=0)
    parts = recorded_subjects(*Store(folder).record())
    for way in WAYS:
        plan = replace(PLAN, hold_out="trials" if way.endswith("held") else "none")
        if way == "group":
            GroupFit(parts, {plan.space.learner: plan}, folder / way).run()
        else:
            fit_all(jobs_of(parts, plan, way.startswith("each")), folder / way)
    return folder


def scored(folder: Path, *fits: FitOfActions) -> Scores:
    return score_fits(*Store(folder).record(), fits)


def test_a_fit_predicts_as_it_did_and_its_parameters_have_a_price(folder: Path) -> None:
    whole, each, group = (read_fit(folder / way) for way in ("all", "each", "group"))
    found = scored(folder, whole, each, group)
    table = found.subjects.groupby("scored").agg(
        {"nll": list, "bic": list, "actions": list, "subject": list}
    )
    ((_, fitted),) = whole.fits.items()
    assert sum(table.loc["all", "nll"]) == pytest.approx(fitted.nll)
    assert sum(table.loc["all", "bic"]) == pytest.approx(fitted.bic)
    assert fitted.bic == pytest.approx(2 * fitted.nll + np.log(fitted.actions))
    for label, fit in (("each", each), ("group", group)):
        own = [fit.of(who, WHOLE) for who in fit.subjects]
        assert table.loc[label, "nll"] == pytest.approx([one.nll for one in own])
        assert table.loc[label, "bic"] == pytest.approx([one.bic for one in own])
    assert followed(found.subjects)["frequency"].sum() == pytest.approx(1)


@pytest.mark.parametrize("way", ["all_held", "each_held"])
def test_what_was_held_out_is_predicted_by_what_was_fitted_to_the_rest(
    folder: Path, way: str
) -> None:
    fit = read_fit(folder / way)
    found = scored(folder, fit)
    apart = sum(one.held_out for (_, fold), one in fit.fits.items() if fold != WHOLE)
    assert found.subjects["nll"].sum() == pytest.approx(apart)
    assert (found.subjects["bic"] == 2 * found.subjects["nll"]).all()
    order = ["subject", "trial", "attempt", "action"]
    assert found.actions[order].equals(found.actions[order].sort_values(order))
    assert not found.actions.duplicated(order).any()


def test_on_the_command_line(folder: Path, tmp_path: Path) -> None:
    words = ["score", str(folder), "--fits", str(folder / "each_held"), "-l", "random",
             "--workers", "1", "--out", str(tmp_path)]  # fmt: skip
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    said = " ".join(result.output.split())
    assert "each_held predicts each action by what was fitted without it" in said
    table = ol.open_results(folder).score(fits=[folder / "each_held"]).ranking
    assert table["scored"].tolist() == ["each_held"]


def changed(folder: Path, to: Path, **plan: object) -> Path:
    kept = json.loads((folder / FILE).read_text())
    done = plan.pop("done", kept["done"])
    to.mkdir()
    keep_fit(to / FILE, {**kept["plan"], **plan}, done=done)
    return to


def test_mistakes_are_explained(folder: Path, tmp_path: Path) -> None:
    whole = folder / "all"
    with pytest.raises(StoreError, match="holds no fit to actions"):
        read_fit(tmp_path)
    with pytest.raises(StoreError, match="not whole; give its command again"):
        read_fit(changed(whole, tmp_path / "part", done=[]))
    with pytest.raises(StoreError, match="this is not a fit"):
        read_fit(changed(whole, tmp_path / "spoiled", subjects=3))
    with pytest.raises(StoreError, match="this is not a fit"):
        read_fit(changed(whole, tmp_path / "endless", folds=float("inf")))
    (first, *_) = json.loads((whole / FILE).read_text())["done"]
    for name, wrong in (("nll", float("nan")), ("chosen", dict.fromkeys(first["chosen"], 99.0))):
        with pytest.raises(StoreError, match="this is not a fit"):
            read_fit(changed(whole, tmp_path / name, done=[{**first, name: wrong}]))
    other = read_fit(changed(whole, tmp_path / "lapsing", lapse=0.1))
    with pytest.raises(OpenLockError, match=r"give --lapse 0\.1"):
        scored(folder, other)
    with pytest.raises(OpenLockError, match="held something out and the other nothing"):
        scored(folder, read_fit(whole), read_fit(folder / "all_held"))
    with pytest.raises(OpenLockError, match="there twice"):
        scored(folder, read_fit(whole), read_fit(whole))
    names = json.loads((whole / FILE).read_text())["plan"]["subjects"]
    other = read_fit(changed(whole, tmp_path / "others", subjects=dict.fromkeys(names, "0")))
    with pytest.raises(StoreError, match="fitted to other actions"):
        scored(folder, other)
    nobody = read_fit(changed(whole, tmp_path / "nobody", subjects={"somebody else": "0"}))
    with pytest.raises(StoreError, match="no subject was fitted in each of all and nobody"):
        scored(folder, read_fit(whole), nobody)


def test_a_fit_runs_no_code_and_opens_no_file_unasked(folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text("raise SystemExit")
    space = {**SPACE.as_dict(), "learner": "mine:Learner"}
    with pytest.raises(StoreError, match="is code next to it; if you trust it, name it too"):
        read_fit(changed(folder / "all", tmp_path / "code", space=space))
    rl2 = search_space("rl2", {"gamma": Range(0.5, 0.9)}).as_dict()
    space = {**rl2, "fixed": {"checkpoint": "/etc/passwd"}}
    with pytest.raises(StoreError, match="sets checkpoint, which may name a file"):
        read_fit(changed(folder / "all", tmp_path / "file", space=space))
