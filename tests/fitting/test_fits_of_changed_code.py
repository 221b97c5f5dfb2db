"""A fit holds the code that it was made with: whatever changes in it, no old fit is shown."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

import causal_openlock as ol
from causal_openlock.errors import StoreError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.fitting.candidates import FILE, Plan, fit
from causal_openlock.fitting.kept import keep_fit
from causal_openlock.fitting.search import Range, Second, bundled_search, search_space
from causal_openlock.running.runner import run
from causal_openlock.usercode.module_source import look_beside
from support.command import at_once, modules_of

pytest.importorskip("optuna")
MINE = """\
from a_fitted_helper import AWAY
from openlock_learners.associative import Associative

class Mine(Associative):
    @classmethod
    def artifact_hash(cls, parameters):
        return open("a_table.txt").read()

    def probabilities(self, view):
        found = super().probabilities(view)
        return (1 - AWAY) * found + AWAY / found.shape[1]
"""
RANGE = ("-s", "temperature=0.1:2")
FITS = {
    "all": ("--to", "made", "--hold-out", "none", "--candidates", "1"),
    "each": ("--to", "made", "--each", "--hold-out", "none", "--candidates", "1"),
    "hierarchical": ("--to", "made", "--hierarchical", "--hold-out", "none", "--candidates", "1"),
    "mixture": ("--to", "made", "--hierarchical", "--or", "random", "--hold-out", "none",
                "--candidates", "1"),
}  # fmt: skip


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("fits_of_changed_code")
    short = ol.Protocol("short", 3, stop_when_solved=True, baseline_trials=1)
    simulated = make_experiment(["CC3"], ["associative"], subjects=2, protocol=short)
    run(simulated, folder / "made", workers=0)
    return folder


@pytest.fixture
def folder(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (made / "a_fitted.py").write_text(MINE)
    (made / "a_fitted_helper.py").write_text("AWAY = 0.1\n")
    (made / "a_table.txt").write_text("1")
    monkeypatch.chdir(made)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return made


def fitted(folder: Path, way: str) -> str:
    """What goes wrong in a fit, if anything does."""
    with modules_of(folder):
        done = at_once("fit", "a_fitted:Mine", *RANGE, *FITS[way], "--workers", "1", "-o", way)
    return done.stderr


@pytest.mark.parametrize("way", FITS)
def test_a_fit_of_other_code_is_not_continued(folder: Path, way: str) -> None:
    assert fitted(folder, way) == ""
    assert way != "all" or fitted(folder, way) == ""
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    assert "holds another fit" in fitted(folder, way)
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.1\n")
    (folder / "a_table.txt").write_text("2")
    assert "the learner's code" in fitted(folder, way)


def test_a_fit_to_points_of_other_code_is_not_continued(folder: Path) -> None:
    def plan() -> Plan:
        return Plan(search_space("a_fitted:Mine", {"temperature": Range(0.1, 2.0)}))

    look_beside()
    with modules_of(folder):
        keep_fit(folder / "points" / FILE, plan().as_dict(), done=[], again={})
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    with modules_of(folder), pytest.raises(StoreError, match="the learner's code, seed"):
        fit(plan(), folder / "points")


def test_a_fit_of_other_code_does_not_predict(folder: Path) -> None:
    words = "score", "made", "--fits", "scored", "-l", "a_fitted:Mine", "--lapse", "0.01"
    with modules_of(folder):
        done = at_once(
            "fit", "a_fitted:Mine", *RANGE, *FITS["all"], "--workers", "1", "-o", "scored"
        )
        assert done.status == 0, done.stderr
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    with modules_of(folder):
        assert "is not what it was fitted with; fit it again" in at_once(*words).stderr


def test_bundled_learners_have_no_code_of_their_own_in_a_plan() -> None:
    space = bundled_search("bayes")
    assert space is not None
    assert "code" not in space.as_dict()
    second = Second("random", {}, Range(0.0, 0.5))
    assert not search_space("bayes", dict(space.ranges), space.fixed, second).code
