"""A fit holds the code that it was made with: whatever changes in it, no old fit is shown."""

import sys

import pytest

import causal_openlock as ol
from causal_openlock.errors import StoreError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.fitting.candidates import FILE, Plan, fit
from causal_openlock.fitting.kept import keep_fit
from causal_openlock.fitting.search import Range, bundled_search, search_space
from causal_openlock.running.runner import run
from causal_openlock.usercode.own_files import look_beside
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
WORDS = ("--hold-out", "none", "--candidates", "1", "--workers", "1")
WAYS = {
    "all": (),
    "each": ("--each",),
    "hierarchical": ("--hierarchical",),
}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    folder = tmp_path_factory.mktemp("fits_of_changed_code")
    short = ol.Protocol("short", 3, stop_when_solved=True, baseline_trials=1)
    simulated = make_experiment(["CC3"], ["associative"], subjects=2, protocol=short)
    run(simulated, folder / "made", workers=0)
    return folder


@pytest.fixture
def folder(made, monkeypatch):
    (made / "a_fitted.py").write_text(MINE)
    (made / "a_fitted_helper.py").write_text("AWAY = 0.1\n")
    (made / "a_table.txt").write_text("1")
    monkeypatch.chdir(made)
    monkeypatch.setattr(sys, "path", [*sys.path])
    return made


def fault_of(folder, way, out):
    """The refusal of a fit; empty if it is made."""
    words = "fit", "a_fitted:Mine", "--to", "made", "-s", "temperature=0.1:2", *WORDS, "-o", out
    with modules_of(folder):
        return at_once(*words, *WAYS[way]).stderr


@pytest.mark.parametrize("way", WAYS)
def test_a_fit_of_other_code_is_not_continued(folder, way):
    assert fault_of(folder, way, way) == ""
    assert fault_of(folder, way, way) == ""
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    assert "another fit" in fault_of(folder, way, way)
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.1\n")
    (folder / "a_table.txt").write_text("2")
    assert "the learner's code" in fault_of(folder, way, way)


def test_a_fit_to_points_of_other_code_is_not_continued(folder):
    def plan():
        return Plan(search_space("a_fitted:Mine", {"temperature": Range(0.1, 2.0)}))

    look_beside()
    with modules_of(folder):
        keep_fit(folder / "points" / FILE, plan().as_dict(), done=[], again={})
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    with modules_of(folder), pytest.raises(StoreError, match="the learner's code"):
        fit(plan(), folder / "points")
    assert "code" not in bundled_search("bayes").as_dict()  # that is known by its version


def test_a_fit_of_other_code_does_not_predict(folder):
    words = "score", "made", "--fits", "scored", "-l", "a_fitted:Mine", "--lapse", "0.01"
    assert fault_of(folder, "all", "scored") == ""
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    with modules_of(folder):
        done = at_once(*words)
    assert done.status == 2
    assert "fit it again" in done.stderr
