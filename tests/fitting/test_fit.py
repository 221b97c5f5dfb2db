"""Fits: what can be searched, what a fit comes to however it is run, and what the fitted do."""

from __future__ import annotations

import importlib.util
import json
import shutil
import sys
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
import pytest
from pydantic import Field

from causal_openlock.analysis.results.references import POINT
from causal_openlock.belief.beliefs import Beliefs
from causal_openlock.belief.knowledge import Prior
from causal_openlock.cli import main
from causal_openlock.contract.learner import Brief, View
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.session import Session
from causal_openlock.fitting import candidates as study
from causal_openlock.fitting.candidates import FILE, Plan, fit
from causal_openlock.fitting.kept import keep_fit
from causal_openlock.fitting.objective import (
    HOLD_OUT,
    Job,
    conditions_to_fit,
    held_out,
    jobs,
    joined,
    play,
    score,
)
from causal_openlock.fitting.outcome import fitted_learner, write_fitted_learner
from causal_openlock.fitting.search import (
    BUNDLED,
    Kind,
    Range,
    SearchSpace,
    bundled_search,
    changed,
    parse_range,
    parse_setting,
    read_search,
    search_space,
)
from causal_openlock.paper.likeness import (
    distance,
    distance_with_spreads,
    points_of,
    points_of_model,
    points_of_people,
    published_points,
)
from causal_openlock.schemas.finding import bundled, find_schema
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.testing import LearnerContract
from causal_openlock.world.randomness import Streams
from openlock_learners.oracle import Oracle
from support.figures import drawn
from support.processes import start_prepared

pytestmark = pytest.mark.slow

ME = "test_fit:Careless"


@dataclass(frozen=True)
class CarelessParameters:
    """How careless it is."""

    lapse: Annotated[float, Field(ge=0, le=1), "share of actions that are random"] = 0.0
    whole: Annotated[int, "does nothing"] = 3
    mood: Annotated[str, "does nothing"] = "good"


class Careless(Oracle):
    """Knows everything, and acts at random every now and then."""

    Parameters = CarelessParameters
    parameters: CarelessParameters

    def begin(self, brief: Brief) -> None:
        super().begin(brief)
        self._draws = Streams(brief.generators, width=2)

    def act(self, view: View) -> IntArray:
        right, draws = super().act(view), self._draws.uniform()
        lapses = draws[:, 0] < self.parameters.lapse
        return np.where(lapses, (draws[:, 1] * 15).astype(np.int64), right)


def plan(**changes: object) -> Plan:
    space = search_space(ME, {"lapse": Range(0.0, 1.0), "whole": Range(1, 9)})
    usual = Plan(space, "transfer", candidates=6, subjects=4, finalists=2, final_subjects=6, seed=3)
    return replace(usual, **changes)  # type: ignore[arg-type]


@pytest.fixture(autouse=True, scope="module")
def _learns_from_the_first_round() -> Iterator[None]:
    """The search learns from what was tried within the few candidates that there is time for."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(study, "RANDOM_FIRST", 2)
        yield


def text_of(folder: Path) -> str:
    return (folder / FILE).read_text(encoding="utf-8")


# -- what is searched -----------------------------------------------------------------------------


def test_ranges_and_settings_are_read_as_they_are_written():
    assert parse_range("lapse=0.1:0.5") == ("lapse", Range(0.1, 0.5))
    assert parse_range("c=1:100:log") == ("c", Range(1, 100, log=True))
    assert parse_setting("policy=solve") == ("policy", "solve")
    assert parse_setting("planned=3") == ("planned", 3)


@pytest.mark.parametrize("text", ["lapse", "lapse=", "lapse=1", "lapse=a:b", "lapse=0:1:lin"])
def test_what_is_no_range_is_refused_with_the_form_it_should_have(text):
    with pytest.raises(OpenLockError, match="name=low:high"):
        parse_range(text)


@pytest.mark.parametrize(
    ("ranges", "fixed", "said"),
    [
        ({}, {}, "nothing is searched"),
        ({"laps": Range(0, 1)}, {}, "did you mean lapse"),
        ({"mood": Range(0, 1)}, {}, "is not a number"),
        ({"lapse": Range(0.5, 0.5)}, {}, "low must be below high"),
        ({"lapse": Range(0.0, 0.5, log=True)}, {}, "above 0 for a logarithm"),
        ({"lapse": Range(0.0, 1.5)}, {}, "lapse"),
        ({"whole": Range(0.5, 3)}, {}, "whole numbers"),
        ({"lapse": Range(0, 1)}, {"lapse": 0.5}, "both fixed and searched"),
        ({"lapse": Range(0, 1)}, {"mood": 3}, "mood"),
    ],
)
def test_a_space_that_does_not_fit_the_learner_is_refused(ranges, fixed, said):
    with pytest.raises(LearnerError, match=said):
        search_space(ME, ranges, fixed)


def test_whole_parameters_stay_whole():
    space = search_space(ME, {"whole": Range(1, 9), "lapse": Range(0, 1)}, {"mood": "bad"})
    assert space.ranges["whole"].whole
    assert not space.ranges["lapse"].whole
    parameters = space.parameters({"whole": 4.0, "lapse": 0.25})
    assert parameters == {"mood": "bad", "whole": 4, "lapse": 0.25}
    assert isinstance(parameters["whole"], int)


def test_the_command_line_replaces_ranges_and_adds_settings(tmp_path):
    path = tmp_path / "space.yaml"
    path.write_text(
        f"learner: {ME}\nfixed: {{mood: bad}}\n"
        "search:\n  lapse: {low: 0, high: 1}\n  whole: {low: 1, high: 9}\n"
    )
    space = read_search(path)
    assert set(space.ranges) == {"lapse", "whole"}
    fewer = changed(space, ME, [], ["whole=5"])
    assert (set(fewer.ranges), dict(fewer.fixed)) == ({"lapse"}, {"mood": "bad", "whole": 5})
    other = changed(space, ME, ["lapse=0.2:0.3"], [])
    assert other.ranges == {"lapse": Range(0.2, 0.3)}


def test_a_fault_in_a_space_file_has_a_line(tmp_path):
    path = tmp_path / "space.yaml"
    path.write_text(f"learner: {ME}\nsearch:\n  lapse: {{low: 0, hihg: 1}}\n")
    with pytest.raises(OpenLockError, match=r"space\.yaml:3:"):
        read_search(path)


def test_bayes_comes_with_a_space_of_at_most_four_parameters():
    space = bundled_search("bayes")
    assert space is not None
    assert 1 <= len(space.ranges) <= 4
    assert bundled_search("random") is None


# -- what is fitted, and what is held out ---------------------------------------------------------


def test_held_out_are_the_four_tests_or_every_other_point_or_nothing():
    points = published_points()
    assert points[held_out(points, "transfer")]["phase"].tolist() == ["test"] * 4
    other = held_out(points, "alternate")
    assert other.tolist() == [False, True] * 7
    assert held_out(points.iloc[::-1], "alternate").tolist() == other[::-1].tolist()
    assert not held_out(points, "none").any()
    with pytest.raises(OpenLockError, match="alternate"):
        held_out(points, "alternat")


def test_conditions_without_a_point_to_fit_are_not_played():
    assert conditions_to_fit("transfer") == ("CC4", "CE4")
    assert len(conditions_to_fit("none")) == 6
    assert conditions_to_fit("alternate") == ("CC4", "CE4", "CC3-CC4", "CC3-CE4")


def test_what_a_candidate_plays_does_not_depend_on_how_it_is_cut():
    parameters = {"lapse": 0.5}
    whole = play(Job(ME, parameters, "CC4", 0, 5, 1))
    parts = [play(Job(ME, parameters, "CC4", first, many, 1)) for first, many in ((0, 2), (2, 3))]
    cut = joined(parts).sort_values(["subject", "trial"])["attempts"].to_numpy()
    assert cut.tolist() == whole.sort_values(["subject", "trial"])["attempts"].tolist()
    assert [job.subjects for job in jobs([Kind(ME, {}, 0, 90)], ("CC4",), 1)] == [40, 40, 10]


def test_the_score_takes_the_points_apart_as_they_are_held_out():
    trials = joined([play(job) for job in jobs([Kind(ME, {}, 0, 3)], conditions_to_fit("none"), 1)])
    found = score(points_of(trials), "transfer")
    points = points_of(trials)
    tests = points["phase"] == "test"
    assert found.fitted == pytest.approx(distance(points[~tests])[0])
    assert found.held_out == pytest.approx(distance(points[tests])[0])
    assert found.all == pytest.approx(np.sqrt((10 * found.fitted**2 + 4 * found.held_out**2) / 14))
    # Who makes no mistake needs three attempts everywhere.
    assert found.all == pytest.approx(np.sqrt(((points_of_people()["mean"] - 3.0) ** 2).mean()))
    baselines = trials[trials["condition"].isin(["CC4", "CE4"])]
    assert np.isnan(score(points_of(baselines), "transfer").held_out)


# -- the search -----------------------------------------------------------------------------------


def test_a_fit_finds_what_is_nearer_to_people_than_either_extreme(tmp_path):
    extremes = []
    for lapse in (0.0, 1.0):
        trials = [play(job) for job in jobs([Kind(ME, {"lapse": lapse}, 0, 6)], ("CC4", "CE4"), 3)]
        extremes.append(score(points_of(joined(trials)), "transfer").fitted)
    fitted, trials = fit(plan(candidates=8, subjects=6), tmp_path)
    assert fitted.table()["rmse"].min() < min(extremes) - 1
    assert 0.2 < fitted.best.chosen["lapse"] < 0.95
    assert set(trials["condition"]) == {"CC4", "CE4", "CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4"}
    assert set(trials["seed"]) == {5}  # neither that of the search nor that of the choice


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where a fit lies that was never interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    fit(plan(), folder)
    return folder


@pytest.mark.parametrize("stops", [6, 14])
def test_a_fit_that_was_killed_comes_to_the_same(whole, tmp_path, monkeypatch, stops):
    calls = 0

    def killed(job: Job) -> pd.DataFrame:
        nonlocal calls
        calls += 1
        if calls == stops:
            raise KeyboardInterrupt
        return play(job)

    with monkeypatch.context() as patch:
        patch.setattr(study, "play", killed)
        with pytest.raises(KeyboardInterrupt):
            fit(plan(), tmp_path / "killed")
    path = tmp_path / "killed" / FILE
    before = json.loads(path.read_text())["done"] if path.exists() else []
    monkeypatch.setattr(study, "play", lambda job: (seen.append(job), play(job))[1])
    seen: list[Job] = []
    fit(plan(), tmp_path / "killed")
    assert text_of(tmp_path / "killed") == text_of(whole)
    searched = [job for job in seen if job.seed == 3]
    assert len(searched) == 2 * (6 - len(before))  # what was done is not done again


def test_a_fit_does_not_depend_on_the_number_of_workers(whole, tmp_path, monkeypatch):
    start_prepared(monkeypatch)
    fit(plan(), tmp_path, workers=2)
    assert text_of(tmp_path) == text_of(whole)


def test_another_seed_tries_other_candidates(tmp_path):
    one, _ = fit(plan(candidates=1), tmp_path / "one")
    other, _ = fit(plan(candidates=1, seed=4), tmp_path / "other")
    assert one.done[0].chosen != other.done[0].chosen


def test_more_candidates_go_on_from_those_that_were_tried(whole, tmp_path):
    fit(plan(candidates=4), tmp_path)
    fit(plan(candidates=6), tmp_path)
    more, once = (json.loads(text_of(folder))["done"] for folder in (tmp_path, whole))
    assert more == once


def test_the_best_few_are_played_again_and_that_decides(tmp_path):
    fitted, _ = fit(plan(finalists=3), tmp_path)
    table = fitted.table()
    assert table["again"].notna().tolist() == [True] * 3 + [False] * 3
    assert fitted.best.number == table.loc[table["again"].idxmin(), "number"]
    fitted.again = {one: -float(rank) for rank, one in enumerate(table["number"][:3])}
    assert fitted.best.number == table["number"][2]  # whatever it came to at first


@pytest.mark.parametrize(
    "change",
    [{"seed": 4}, {"subjects": 5}, {"hold_out": "none"}, {"objective": "means_and_spreads"}],
)
def test_a_folder_with_another_fit_is_refused(tmp_path, change):
    keep_fit(tmp_path / FILE, plan().as_dict(), done=[], again={})
    with pytest.raises(StoreError, match="another fit"):
        fit(plan(**change), tmp_path)


def test_a_folder_with_something_else_is_refused(tmp_path):
    (tmp_path / FILE).write_text("[1, 2", encoding="utf-8")
    with pytest.raises(StoreError, match="this is not a fit"):
        fit(plan(), tmp_path)


RIGHT = {"lapse": 0.5, "whole": 2}


@pytest.mark.parametrize(
    ("chosen", "rmse"),
    [(None, 1.0), ({"lapse": 0.5}, 1.0), ({"lapse": "high", "whole": 2}, 1.0),
     ({**RIGHT, "lapse": 9.0}, 1.0), (RIGHT, float("nan"))],
)  # fmt: skip
def test_a_candidate_without_its_parameters_is_refused(tmp_path, chosen, rmse):
    keep_fit(tmp_path / FILE, plan().as_dict(), done=[], again={})
    study._opened(plan(), tmp_path / FILE)
    done = [{"number": 0, "chosen": chosen, "rmse": rmse}]
    keep_fit(tmp_path / FILE, plan().as_dict(), done=done, again={})
    with pytest.raises(StoreError, match="this is not a fit"):
        fit(plan(), tmp_path)


# -- a mixture of subjects, and spreads -----------------------------------------------------------

MIXED = f"""
learner: {ME}
search:
  lapse: {{low: 0.0, high: 0.6}}
second:
  learner: {ME}
  fixed: {{lapse: 1.0}}
  share: {{low: 0.2, high: 0.8}}
"""


def mixed(tmp_path: Path, text: str = MIXED) -> SearchSpace:
    file = tmp_path / "mixed.yaml"
    file.write_text(text, encoding="utf-8")
    return read_search(file)


def test_a_share_of_the_subjects_is_of_the_second_kind(tmp_path):
    space = mixed(tmp_path)
    assert set(space.searched) == {"lapse", "share"}
    first, second = space.kinds({"lapse": 0.0, "share": 0.3}, 10)
    assert (first.first, first.subjects, first.parameters) == (0, 7, {"lapse": 0.0})
    assert (second.first, second.subjects, second.parameters) == (7, 3, {"lapse": 1.0})
    assert [kind.subjects for kind in space.kinds({"lapse": 0.0, "share": 0.04}, 10)] == [10]
    trials = joined([play(job) for job in jobs([first, second], ("CC4",), 1)])
    assert trials["learner"].nunique() == 1
    last = trials[trials["trial"] == 5].set_index("subject")["attempts"]
    assert sorted(last.index) == [*range(10)]
    assert (last[:7] == 3).all()
    assert (last[7:] > 20).all()


def test_the_share_is_searched_and_both_kinds_are_written(tmp_path):
    space = mixed(tmp_path)
    wanted = plan(space=space, candidates=2, objective="means_and_spreads", hold_out="none")
    fitted, trials = fit(wanted, tmp_path)
    assert 0.2 <= fitted.best.chosen["share"] <= 0.8
    found = fitted_learner(fitted, trials)
    points = points_of(trials)
    assert found.score.all == pytest.approx(distance_with_spreads(points))
    assert found.model.all == pytest.approx(3.789, abs=1e-3)
    assert found.perfect.fitted == found.perfect.all > 1.2
    assert np.isnan(found.perfect.held_out)  # nothing is
    with drawn():
        write_fitted_learner(fitted, found, tmp_path)
    _, first, second = read_experiment(tmp_path / "experiment.yaml").learners
    assert first.subjects + second.subjects == fitted.plan.final_subjects
    assert second.subjects == round(6 * fitted.best.chosen["share"])
    assert second.parameters["lapse"] == 1.0


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (("share: {low: 0.2, high: 0.8}", "share: {low: 0.2, high: 1.8}"), "within 0 and 1"),
        (("share: {low: 0.2, high: 0.8}", "share: {low: 0.8, high: 0.2}"), "within 0 and 1"),
        (("fixed: {lapse: 1.0}", "fixed: {lapses: 1.0}"), "lapses"),
    ],
)
def test_a_second_kind_that_cannot_be_is_one_sentence(change, said, tmp_path):
    with pytest.raises(OpenLockError, match=said):
        mixed(tmp_path, MIXED.replace(*change))


def test_the_bundled_mixture_can_be_read():
    space = read_search(BUNDLED / "bayes_mixture.yaml")
    plain = bundled_search("bayes")
    assert plain is not None
    assert (space.fixed, space.ranges) == (plain.fixed, plain.ranges)
    assert space.second is not None


# -- what comes of it -----------------------------------------------------------------------------


def test_the_fitted_learner_is_written_as_an_experiment_that_can_be_run(tmp_path):
    fitted, trials = fit(plan(candidates=2), tmp_path)
    found = fitted_learner(fitted, trials)
    with drawn():
        files = write_fitted_learner(fitted, found, tmp_path)
    assert all(file.stat().st_size > 100 for file in files)
    experiment = read_experiment(tmp_path / "experiment.yaml")
    entry = experiment.learners[-1]
    assert entry.parameters["lapse"] == fitted.best.chosen["lapse"]
    assert experiment.seed not in (3, 4, 5)
    points = pd.read_csv(tmp_path / "points.csv")
    assert points["held_out"].tolist() == [False] * 10 + [True] * 4
    assert (points[POINT].to_numpy() == published_points()[POINT].to_numpy()).all()
    assert found.model.all == pytest.approx(3.057, abs=1e-3)


def test_a_fit_can_aim_at_the_published_model(tmp_path, monkeypatch, capsys):
    assert score(points_of_model(), "transfer", target="model").all == 0
    people, model = (
        score(points_of_people(), "none", target="model"),
        score(points_of_model(), "none"),
    )
    assert people.all == model.all == pytest.approx(3.057, abs=1e-3)
    words = ["fit", ME, "--search", "lapse=0.3:0.9", "--candidates", "1", "--subjects", "2",
             "--finalists", "1", "--final-subjects", "2", "--workers", "1", "--target", "model",
             "--out", str(tmp_path / "f")]  # fmt: skip
    assert at_once(*words, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    assert "Distance from the published model" in said
    assert "curve of 4 numbers" not in said
    assert "fitted to the published model" in (tmp_path / "f" / "experiment.yaml").read_text()


def at_once(*words: str, monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["causal-openlock", *words])
    with pytest.raises(SystemExit) as stop:
        main()
    return int(stop.value.code or 0)


def test_a_plan_says_how_the_fit_is_made_and_options_override_it(tmp_path, monkeypatch, capsys):
    path = tmp_path / "plan.yaml"
    path.write_text(
        f"learner: {ME}\nsearch: {{lapse: {{low: 0.3, high: 0.9}}}}\n"
        "fit: {candidates: 3, subjects: 2, finalists: 1, final_subjects: 2, target: model}\n"
    )
    words = ["fit", ME, "--plan", str(path), "--candidates", "1", "--workers", "1",
             "--out", str(tmp_path / "f")]  # fmt: skip
    assert at_once(*words, monkeypatch=monkeypatch) == 0
    assert "Distance from the published model" in capsys.readouterr().out
    assert len(pd.read_csv(tmp_path / "f" / "candidates.csv")) == 1
    path.write_text(path.read_text().replace("candidates: 3", "candidates: none, finallists: 2"))
    assert at_once(*words, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert "plan.yaml:3" in error
    assert "did you mean finalists" in error


def test_the_command_fits_and_says_what_it_found(tmp_path, monkeypatch, capsys):
    words = ["fit", ME, "--search", "lapse=0.3:0.9", "--candidates", "2", "--subjects", "2",
             "--finalists", "1", "--final-subjects", "3", "--workers", "1",
             "--out", str(tmp_path / "f")]  # fmt: skip
    assert at_once(*words, monkeypatch=monkeypatch) == 0
    said = capsys.readouterr().out
    told = (
        "held out",
        "published model",
        "perfect model",
        "curve of 4 numbers",
        "0.68",
        "χ²(10) = 5.7, p = .843",
        "Fitted numbers, here 1, each take away a degree of freedom.",
        "congruency, CE4",
        "lapse:",
        "experiment.yaml",
    )
    for text in (*told, "Careless_fitted", "of 6 effects with people's sign"):
        assert text in said
    assert (tmp_path / "f" / "fit.svg").exists()


@pytest.mark.parametrize(("learner", "said"), [("bayes", True), (ME, False)])
def test_it_says_that_ranges_were_narrowed_with_the_tests_in_view(
    learner, said, tmp_path, monkeypatch, capsys
):
    from causal_openlock.comparison.console import Terminal
    from causal_openlock.fitting.command import print_fit

    fitted, trials = fit(plan(candidates=2), tmp_path)
    found = fitted_learner(fitted, trials)
    fitted.plan = replace(fitted.plan, space=replace(fitted.plan.space, learner=learner))
    print_fit(fitted, found, Terminal())
    out = capsys.readouterr().out
    assert ("a check, not an untouched" in out) == said
    assert fitted.idle == {fitted.best.number: ("whole",)}
    assert f" {fitted.best.chosen['whole']}? " in out
    assert "? makes no difference here: any other value would do as well." in out


def test_what_makes_no_difference_is_looked_for_once(whole, tmp_path, monkeypatch):
    shutil.copytree(whole, tmp_path / "again")
    monkeypatch.setattr(study, "without_effect", None)
    assert fit(plan(), tmp_path / "again")[0].idle


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["fit", "random"], "nothing is searched"),
        (["fit", "bayes", "--search", "lapse=2"], "is not a range"),
        (["fit", "bayes", "--hold-out", "half"], "held out"),
        (["fit", "bayes", "--objective", "spreads"], "means_and_spreads"),
        (["fit", "bayes", "--target", "peeple"], "did you mean people"),
        (["fit", "bayes", "--search", "directnes=0:1"], "did you mean directness"),
        (["fit", "nobody"], "there is no learner 'nobody'"),
        (["fit", "baies"], "there is no learner 'baies'; did you mean bayes?"),
        (["fit", "ddqn"], "--search learning_rate="),
    ],
)
def test_what_a_user_gets_wrong_is_one_sentence(words, said, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert at_once(*words, monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert error.startswith("error: ")
    assert error.count("\n") == 1
    assert said in error
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("held", "out", "said"),
    [
        ("experiment.json", "f", "holds results of compare; choose another folder with --out"),
        ("notes.txt", "f", "holds no fit; choose another folder with --out"),
        ("notes.txt", "f/notes.txt", "notes.txt is a file; choose a folder\n"),
    ],
)
def test_a_place_that_holds_something_else_is_refused_at_once(
    held, out, said, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr("causal_openlock.fitting.candidates.fit", None)  # nothing is played
    (tmp_path / "f").mkdir()
    (tmp_path / "f" / held).write_text("{}")
    assert at_once("fit", "bayes", "--out", str(tmp_path / out), monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert said in error
    assert [path.name for path in (tmp_path / "f").iterdir()] == [held]


def test_without_optuna_there_is_one_clear_sentence(monkeypatch, capsys):
    find = importlib.util.find_spec
    monkeypatch.setattr(
        importlib.util, "find_spec", lambda name, *a: None if name == "optuna" else find(name, *a)
    )
    assert at_once("fit", "bayes", monkeypatch=monkeypatch) == 2
    error = capsys.readouterr().err
    assert "causal-openlock[fit]" in error
    assert error.count("\n") == 1


# -- the bounded rationality that is fitted -------------------------------------------------------


def session(condition: str, subjects: int, seed: int = 0) -> Session:
    return Session(Condition.named(condition, find_schema), PROTOCOLS["human"], subjects, seed=seed)


def believing(prior: Prior, played: Session) -> Beliefs:
    brief = played.brief
    beliefs = Beliefs(brief, prior, brief.generators)
    beliefs.enter(played.view)
    return beliefs


SMALL = Prior(by_colour=0.999, hypothesis_limit=600)


def test_directness_weighs_each_lever_that_acts_on_the_door():
    played = session("CC4", 1)
    plain, direct = (
        believing(replace(SMALL, directness=nats), played).of[0] for nats in (0.0, 0.7)
    )
    assert plain is not None
    assert direct is not None
    many = np.bitwise_count(plain.space.hypotheses.causes[plain.which, -1])
    assert len(set(many.tolist())) > 1
    expected = plain.weight * np.exp(0.7 * many)
    assert direct.weight == pytest.approx(expected / expected.sum())


def attempt(played: Session, beliefs: Beliefs, actions: list[int]) -> None:
    for action in actions:
        beliefs.enter(played.view)
        beliefs.update(played.step(np.array([action])))


def test_who_forgets_failures_only_keeps_what_successes_told():
    seen = {}
    for forgets in ("everything", "failures"):
        played = session("CC4", 1)
        beliefs = believing(replace(SMALL, forgetting=1.0, forgets=forgets), played)
        belief = beliefs.of[0]
        assert belief is not None
        start = belief.weight.copy()
        room = played.truth.rooms[int(played.truth.room[0])]
        works = [int(a) for a in room.action_of(room.schema.solutions[0])]
        white = int(np.flatnonzero(played.view.observation[0, 7:14] == 0)[0])
        attempt(played, beliefs, [white, white, works[0]])
        assert belief.weight == pytest.approx(start)  # a failure, forgotten at once
        attempt(played, beliefs, works)  # a new solution
        seen[forgets] = belief.weight
        if forgets == "everything":
            assert belief.weight == pytest.approx(start)
        after = belief.weight.copy()
        attempt(played, beliefs, [white, white, white])
        assert belief.weight == pytest.approx(after)
    kept = seen["failures"]
    assert kept.sum() == pytest.approx(1.0)
    assert (kept > 0).sum() < 0.6 * (seen["everything"] > 0).sum()


def test_without_forgetting_it_makes_no_difference_what_is_forgotten():
    one, other = (
        joined([play(Job("bayes", {"hypothesis_limit": 600, "forgets": forgets}, "CC4", 0, 3, 1))])
        for forgets in ("everything", "failures")
    )
    assert one["attempts"].tolist() == other["attempts"].tolist()


def test_bounded_rationality_is_off_by_default():
    defaults = {field.name: field.default for field in fields(Prior)}
    assert (defaults["forgetting"], defaults["directness"]) == (0.0, 0.0)
    assert defaults["forgets"] == "everything"


class TestBayesLikePeople(LearnerContract):
    """Checkpoints, and all else that a learner promises, with failures forgotten."""

    learner = "bayes"
    parameters = {  # noqa: RUF012
        "policy": "thompson",
        "forgetting": 0.8,
        "forgets": "failures",
        "directness": 1.0,
        "hypothesis_limit": 600,
        "particles": 40,
    }
    schemas = ("CC3", "CE4")


def test_the_bundled_experiment_plays_the_fitted_learner_with_four_free_parameters():
    experiment = read_experiment(bundled("experiments") / "bayes_like_people.yaml")
    space = bundled_search("bayes")
    assert space is not None
    entry = next(one for one in experiment.learners if one.name == "bayes_like_people")
    for name, one in space.ranges.items():
        assert one.low <= entry.parameters[name] <= one.high
    plain = next(one for one in experiment.learners if one.name == "bayes")
    differing = {name for name, value in entry.parameters.items()
                 if value != plain.parameters[name]}  # fmt: skip
    assert differing == {*space.ranges, *space.fixed}


def test_ways_of_holding_out_are_told():
    assert HOLD_OUT == ("transfer", "alternate", "none")
