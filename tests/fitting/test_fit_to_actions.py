"""Parameters fitted to single actions."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import causal_openlock as ol
from causal_openlock.cli import app
from causal_openlock.comparison import progress_bar
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.fitting import actions
from causal_openlock.fitting.actions import FILE, ActionPlan, fit_all, fit_job, fit_table, jobs_of
from causal_openlock.fitting.kept import fitting_in, keep_fit
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.running.runner import run
from causal_openlock.scoring.teacher_forcing import Recorded, recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once

pytestmark = pytest.mark.slow

pytest.importorskip("optuna")
SHORT = ol.Protocol("short", 10, stop_when_solved=True, baseline_trials=2)
SPACE = search_space("associative", {"temperature": Range(0.02, 2.0, log=True)})
PLAN = ActionPlan(SPACE, candidates=8, restarts=1, moves=12)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    kinds = [ol.learner("associative", label=name, temperature=heat)
             for name, heat in (("cool", 0.06), ("warm", 0.5))]  # fmt: skip
    made = make_experiment(["CC3"], kinds, subjects=6, protocol=SHORT, seed=5)
    folder = tmp_path_factory.mktemp("fitted")
    run(made, folder, workers=0)
    return folder


def parts(folder: Path, learner: str) -> list[Recorded]:
    return recorded_subjects(*Store(folder).record(), [learner])


@pytest.mark.parametrize(("learner", "true"), [("cool", 0.06), ("warm", 0.5)])
def test_what_subjects_were_made_with_is_found(folder: Path, learner: str, true: float) -> None:
    (job,) = jobs_of(parts(folder, learner), replace(PLAN, hold_out="none"), each=False)
    found = fit_job(job)
    assert found.chosen["temperature"] == pytest.approx(true, rel=0.25)
    assert found.held_out_actions == 0
    truth = fit_job(replace(job, plan=replace(job.plan, candidates=1, moves=0, restarts=1)))
    assert found.nll <= truth.nll


def test_what_is_held_out_is_not_fitted(folder: Path) -> None:
    for how, key in (("trials", "trial"), ("subjects", "subject")):
        jobs = jobs_of(parts(folder, "warm"), replace(PLAN, hold_out=how), each=False)
        whole, *folds = [fit_job(job) for job in jobs]
        assert whole.actions == sum(one.held_out_actions for one in folds), key
        table = fit_table([whole, *folds])
        assert table["held_out_bits"].iloc[0] >= table["bits"].iloc[0] - 0.02
        assert len({one.chosen["temperature"] for one in folds}) == 2


def test_it_goes_on_where_it_was_stopped(folder: Path, tmp_path: Path) -> None:
    jobs = jobs_of(parts(folder, "cool"), replace(PLAN, candidates=2, moves=0), each=True)
    assert len(jobs) == 6 * 3

    def stop(done: int, total: int) -> None:
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_all(jobs[:4], tmp_path, report=stop)
    counted: list[int] = []
    resumed = fit_all(jobs[:4], tmp_path, report=lambda done, _: counted.append(done))
    assert counted == [3, 4]
    assert resumed == [fit_job(job) for job in jobs[:4]]
    with pytest.raises(StoreError, match="holds another fit to actions"):
        fit_all(jobs[:3], tmp_path)
    with pytest.raises(OpenLockError, match="hold out trials"):
        jobs_of(parts(folder, "cool"), replace(PLAN, hold_out="subjects"), each=True)


def test_one_fit_at_a_time_works_in_a_folder(folder: Path, tmp_path: Path) -> None:
    words = ["fit", "associative", "--to", str(folder), "--of", "cool", "--hold-out", "none",
             "-s", "temperature=0.02:2:log", "--candidates", "1", "--workers", "1",
             "--out", str(tmp_path)]  # fmt: skip
    writing = tmp_path / ".fit_to_actions.json.x.partial"
    with fitting_in(tmp_path):
        writing.touch()
        for more in ([], ["--hierarchical"]):
            refused = CliRunner().invoke(app, [*words, *more])
            assert isinstance(refused.exception, StoreError)
            assert "is in use by another fit; wait for it" in str(refused.exception)
        assert writing.exists()
    assert CliRunner().invoke(app, words).exit_code == 0
    assert not writing.exists()


def test_what_is_kept_is_what_was_fitted(folder: Path, tmp_path: Path) -> None:
    jobs = jobs_of(parts(folder, "cool"), replace(PLAN, candidates=1, moves=0), each=True)[:4]
    fit_all(jobs, tmp_path)
    path = tmp_path / FILE
    content = path.read_bytes()
    kept = json.loads(content)
    path.write_bytes(content.replace(b'"actions": ', b'"actions": 1', 1))
    with pytest.raises(StoreError, match="its checksum does not match"):
        fit_all(jobs, tmp_path)
    done = kept["done"]
    for wrong in (
        done[1:],
        done[::-1],
        [*done, done[0]],
        [{**done[0], "nll": float("nan")}],
        [{**done[0], "chosen": {"temperature": 2.5}}],
    ):
        keep_fit(path, kept["plan"], done=wrong)
        with pytest.raises(StoreError, match="this is not a fit"):
            fit_all(jobs, tmp_path)
    keep_fit(path, kept["plan"], done=done[:3])
    assert fit_all(jobs, tmp_path) == [fit_job(job) for job in jobs]


def test_nothing_can_be_held_out_of_a_single_trial(folder: Path) -> None:
    (part,) = parts(folder, "cool")
    short = part.rows[(part.rows["subject"] != 3) | (part.rows["trial"] == 1)]
    short = replace(part, rows=short[short["phase"] == "train"])
    with pytest.raises(OpenLockError, match=r"cool/CC3/.*/3 played one trial only"):
        jobs_of([short], PLAN, each=True)
    assert len(jobs_of([short], replace(PLAN, hold_out="none"), each=True)) == 6
    assert len(jobs_of([short], PLAN, each=False)) == 3


def test_on_the_command_line(folder: Path, tmp_path: Path) -> None:
    words = ["fit", "associative", "--to", str(folder), "--of", "warm", "--hold-out", "none",
             "-s", "temperature=0.02:2:log", "--candidates", "4", "--workers", "1",
             "--out", str(tmp_path / "fit")]  # fmt: skip
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, result.output
    assert "name: associative_fitted" in result.output
    assert np.isfinite(pd.read_csv(tmp_path / "fit" / "fits.csv")["bits"]).all()
    wrong = CliRunner().invoke(app, [*words[:-1], str(tmp_path / "other"), "--hold-out", "points"])
    assert "'points' cannot be held out" in str(wrong.exception)


# -- what the commands say ------------------------------------------------------------------------


def test_a_fit_says_what_it_is_of_what_stands_at_a_bound_and_how_far_it_is(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Temperatures of 10 and more fit worse and worse, so the best is at the bound."""
    monkeypatch.setattr(progress_bar, "FIRST_AFTER", 0.01)
    out = tmp_path / "fit"
    done = at_once(
        "fit", "associative", "--to", folder, "--of", "warm", "--search", "temperature=10:100:log",
        "--fix", "partial=0.25", "--candidates", 3, "--hold-out", "none", "--out", out,
    )  # fmt: skip
    assert done.status == 0, done.stderr
    assert "* at a bound of what was searched (temperature)" in done.stdout
    assert "associative was fitted with partial 0.25 (fixed)." in done.stdout
    assert "warning: 6 subjects are too few to generalise" in done.stdout
    assert "temperature: 10\n" in done.stdout
    (kept,) = json.loads((out / FILE).read_bytes())["done"]
    assert kept["chosen"]["temperature"] == 10.000000000000002
    assert "fit: 0 of 1 fit done, " in done.stderr
    assert "of up to 123 sets of parameters tried" in done.stderr


def test_sets_of_parameters_are_counted_here_and_in_workers(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(actions, "LOOK_EVERY", 0.01)
    jobs = jobs_of(parts(folder, "cool"), replace(PLAN, candidates=3, moves=5), each=False)[:2]
    counts: dict[int, list[int]] = {1: [], 2: []}
    for workers, own in counts.items():
        fits = fit_all(jobs, tmp_path / str(workers), workers=workers, tried=own.append)
        assert len(fits) == 2
    every = counts[1][-1]
    # Whether a parameter makes a difference is tried once the fit is found.
    assert every >= sum(one.evaluations for one in fits)
    assert counts[1] == [*range(1, every + 1)]
    assert counts[2] == sorted(counts[2])
    assert 0 < counts[2][-1] <= every


def test_scores_of_few_subjects_are_cautioned_against(folder: Path, tmp_path: Path) -> None:
    done = at_once("score", folder, "-l", "associative", "-l", "random", "--out", tmp_path / "own")
    assert done.status == 0, done.stderr
    assert "warning: 12 subjects are too few to rank learners\n" in done.stdout
