"""Fits read back as learners that predict."""

import json

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.files.checksums import json_bytes
from causal_openlock.fitting.hierarchical import fit_group
from causal_openlock.fitting.plan import Range, make_plan
from causal_openlock.fitting.predicting import read_fit, score_folder
from causal_openlock.fitting.to_actions import FILE, WHOLE, fit_all, groups_of
from causal_openlock.running.runner import run
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once
from support.fits import with_settings

SPACE = make_plan("associative", {"temperature": Range(0.02, 2.0, log=True)})
PLAN = with_settings(SPACE, candidates=2)
WAYS = ("all", "each", "group", "all_held", "each_held")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two subjects of two trials, and fits of all kinds."""
    brief = ol.Protocol("brief", 4, stop_when_solved=True, baseline_trials=2)
    folder = tmp_path_factory.mktemp("predicting")
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=brief, seed=5)
    run(made, folder, workers=0)
    parts = recorded_subjects(*Store(folder).record())
    for way in WAYS:
        held_out = "trials" if way.endswith("held") else "none"
        plan = with_settings(PLAN, hold_out=held_out, each=way.startswith("each"))
        if way == "group":
            fit_group(parts, plan, folder / way)
        else:
            fit_all(groups_of(parts, plan), plan, folder / way)
    return folder


def scored(folder, *fits):
    return score_folder(folder, fits=fits)


def test_a_fit_predicts_as_it_did_and_its_parameters_have_a_price(folder):
    whole, each, group = (read_fit(folder / way) for way in ("all", "each", "group"))
    found = scored(folder, *(folder / way for way in ("all", "each", "group")))
    table = found.subjects.groupby("scored").agg({"nll": list, "bic": list})
    ((_, fitted),) = whole.fits.items()
    assert sum(table.loc["all", "nll"]) == pytest.approx(fitted.nll)
    assert sum(table.loc["all", "bic"]) == pytest.approx(fitted.bic)
    assert fitted.bic == pytest.approx(2 * fitted.nll + np.log(fitted.actions))
    for label, fit in (("each", each), ("group", group)):
        own = [fit.of(who, WHOLE) for who in fit.subjects]
        assert table.loc[label, "nll"] == pytest.approx([one.nll for one in own])
        assert table.loc[label, "bic"] == pytest.approx([one.bic for one in own])
    assert found.followed["frequency"].sum() == pytest.approx(1)


@pytest.mark.parametrize("way", ["all_held", "each_held"])
def test_actions_that_were_held_out_are_predicted_by_the_fit_to_the_rest(folder, way):
    fit = read_fit(folder / way)
    found = scored(folder, folder / way)
    apart = sum(one.held_out for (_, fold), one in fit.fits.items() if fold != WHOLE)
    assert found.subjects["nll"].sum() == pytest.approx(apart)
    assert (found.subjects["bic"] == 2 * found.subjects["nll"]).all()
    order = ["subject", "trial", "attempt", "action"]
    assert found.actions[order].equals(found.actions[order].sort_values(order))
    assert not found.actions.duplicated(order).any()


def test_score_takes_fits_by_their_folders(folder, tmp_path):
    words = ["score", folder, "--fits", folder / "each_held", "-l", "random", "--workers", 1]
    done = at_once(*words, "--out", tmp_path)
    assert done.status == 0, done.stderr
    assert "each_held" in done.stdout
    table = ol.open_results(folder).score(fits=str(folder / "each_held")).ranking
    assert table["scored"].tolist() == ["each_held"]


@pytest.fixture
def changed(folder, tmp_path):
    """Store the fit to all again, with another plan."""

    def store(name, **plan):
        kept = json.loads((folder / "all" / FILE).read_text())
        done = plan.pop("done", kept["done"])
        (tmp_path / name).mkdir()
        about = {"plan": {**kept["plan"], **plan}, "done": done}
        (tmp_path / name / FILE).write_bytes(json_bytes(about))
        return tmp_path / name

    return store


def test_a_fit_that_cannot_be_read_is_refused(folder, changed):
    (first, *_) = json.loads((folder / "all" / FILE).read_text())["done"]
    outside = dict.fromkeys(first["chosen"], 99.0)
    for name, plan in {
        "part": {"done": []},
        "spoiled": {"subjects": 3},
        "endless": {"folds": float("inf")},
        "outside": {"done": [{**first, "chosen": outside}]},
    }.items():
        with pytest.raises(StoreError, match=name):
            read_fit(changed(name, **plan))


def test_fits_that_do_not_compare_are_named(folder, changed):
    whole = folder / "all"
    names = json.loads((folder / "all" / FILE).read_text())["plan"]["subjects"]
    others = changed("others", subjects=dict.fromkeys(names, "0"))
    nobody = changed("nobody", subjects={"somebody else": "0"})
    for fits, named in (
        ([changed("lapsing", lapse=0.1)], r"--lapse 0\.1"),
        ([whole, folder / "all_held"], "held something out"),
        ([whole, whole], "all"),
        ([others], "others"),
        ([whole, nobody], "all and nobody"),
    ):
        with pytest.raises(OpenLockError, match=named):
            scored(folder, *fits)


def test_a_fit_of_the_release_before_is_read(folder, changed):
    (fit, *_) = json.loads((folder / "all" / FILE).read_text())["done"]
    old = {name: value for name, value in fit.items() if name not in ("idle", "at_bound")}
    more = {"draws": {"most": 1500}, "restarts": 2, "moves": 60, "version": "0.2.0+1"}
    found = scored(folder, changed("old", done=[old], **more))
    assert found.subjects["nll"].sum() == pytest.approx(fit["nll"])


def test_a_fit_runs_no_code_and_opens_no_file_unasked(tmp_path, changed):
    (tmp_path / "mine.py").write_text("raise SystemExit")
    space = {**SPACE.as_dict()["space"], "learner": "mine:Learner"}
    with pytest.raises(StoreError, match=r"code .* name it too"):
        read_fit(changed("code", space=space))
    trained = make_plan("llm", {"temperature": Range(1, 2)}).as_dict()["space"]
    space = {**trained, "fixed": {"model": "/etc/passwd"}}
    with pytest.raises(StoreError, match="model"):
        read_fit(changed("file", space=space))
