"""A fit holds the code that it was made with: whatever changes in it, no old fit is shown."""

import sys

import pytest

import causal_openlock as ol
from causal_openlock.experiment.making import make_experiment
from causal_openlock.fitting.steps import STEPS
from causal_openlock.running.runner import run
from support.command import at_once, modules_of

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
WORDS = ("--set", "hold_out=none", "--set", "candidates=1", "--workers", "1")
WAYS = {
    "all": (),
    "each": ("--set", "each=true"),
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


def steps_of(folder, way, out):
    """Make a fit; the steps that are stored afterwards."""
    words = "fit", "a_fitted:Mine", "--to", "made", "-s", "temperature=0.1:2", *WORDS, "-o", out
    with modules_of(folder):
        assert at_once(*words, *WAYS[way]).status == 0
    return {path.name for path in (folder / out / STEPS).iterdir()}


@pytest.mark.parametrize("way", WAYS)
def test_a_fit_of_other_code_is_made_anew(folder, way):
    first = steps_of(folder, way, way)
    assert steps_of(folder, way, way) == first
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    second = steps_of(folder, way, way) - first
    assert second
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.1\n")
    (folder / "a_table.txt").write_text("2")
    assert steps_of(folder, way, way) - first - second


def test_a_fit_of_other_code_does_not_predict(folder):
    words = "score", "made", "--fits", "scored", "-l", "a_fitted:Mine", "--lapse", "0.01"
    steps_of(folder, "all", "scored")
    (folder / "a_fitted_helper.py").write_text("AWAY = 0.25\n")
    with modules_of(folder):
        done = at_once(*words)
    assert done.status == 2
    assert "fit it again" in done.stderr
