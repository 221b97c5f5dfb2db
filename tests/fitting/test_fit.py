"""Fits to published means: what can be searched, and what a fit comes to however it is run."""

from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pandas as pd
import pytest
from pydantic import Field

from causal_openlock.analysis.results.references import POINT
from causal_openlock.belief.beliefs import Beliefs
from causal_openlock.belief.knowledge import BeliefParameters
from causal_openlock.experiment.condition import PAPER_CONDITIONS, find_condition
from causal_openlock.experiment.making import read_experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.files.checksums import read_json
from causal_openlock.fitting.plan import FitSettings, Range, bundled_plan, make_plan, read_plan
from causal_openlock.fitting.steps import STEPS, seeds_of
from causal_openlock.fitting.to_means import FILE, fit, means_plan, parts_of, play, points_towards
from causal_openlock.paper.likeness import distance, points_of, points_of_model, points_of_people
from causal_openlock.schemas.finding import bundled
from causal_openlock.world.randomness import Streams
from openlock_learners.oracle import Oracle
from support.command import at_once
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

    def begin(self, brief):
        super().begin(brief)
        self._draws = Streams(brief.generators, width=2)

    def act(self, view):
        right, draws = super().act(view), self._draws.uniform()
        lapses = draws[:, 0] < self.parameters.lapse
        return np.where(lapses, (draws[:, 1] * 15).astype(np.int64), right)


def plan(**changes):
    usual = FitSettings(candidates=4, subjects=2, finalists=2, final_subjects=3, seed=3)
    searched = {"lapse": Range(0.0, 1.0), "whole": Range(1, 9)}
    return means_plan(make_plan(ME, searched, fit=usual.model_copy(update=changes)))


def stored(folder):
    return read_json((folder / FILE).read_bytes())


def played(lapse, conditions, subjects, seed):
    """Points of a learner that lapses this often."""
    parts = [play(ME, {"lapse": lapse}, name, range(subjects), seed) for name in conditions]
    return points_of(pd.concat(parts))


def test_whole_parameters_stay_whole():
    space = make_plan(ME, {"whole": Range(1, 9), "lapse": Range(0, 1)}, {"mood": "bad"})
    assert space.ranges["whole"].whole
    assert not space.ranges["lapse"].whole
    parameters = space.parameters({"whole": 4.0, "lapse": 0.25})
    assert parameters == {"mood": "bad", "whole": 4, "lapse": 0.25}
    assert isinstance(parameters["whole"], int)


def test_the_command_line_replaces_ranges_and_adds_settings(tmp_path):
    (tmp_path / "space.yaml").write_text(
        f"learner: {ME}\nfixed: {{mood: bad}}\n"
        "search:\n  lapse: {low: 0, high: 1}\n  whole: {low: 1, high: 9}\n"
    )
    space = read_plan(tmp_path / "space.yaml")
    assert set(space.ranges) == {"lapse", "whole"}
    fewer = space.changed([], ["whole=5"], [])
    assert (set(fewer.ranges), dict(fewer.fixed)) == ({"lapse"}, {"mood": "bad", "whole": 5})
    narrow = space.changed(["lapse=0.2:0.3:log"], ["mood=good"], ["candidates=8"])
    assert narrow.ranges == {"lapse": Range(0.2, 0.3, log=True)}
    assert dict(narrow.fixed) == {"mood": "good"}
    assert (narrow.fit.candidates, space.fit.candidates) == (8, 160)


def test_the_bundled_search_of_bayes_is_what_its_fitted_experiment_varies():
    space = bundled_plan("bayes")
    assert 1 <= len(space.ranges) <= 4
    assert bundled_plan("random") is None
    experiment = read_experiment(bundled("experiments") / "bayes_like_people.yaml")
    own = {one.name: one.parameters for one in experiment.learners}
    for name, one in space.ranges.items():
        assert one.low <= own["bayes_like_people"][name] <= one.high
    differing = {
        name for name, value in own["bayes_like_people"].items() if own["bayes"][name] != value
    }
    assert differing == {*space.ranges, *space.fixed}


def test_held_out_are_the_four_tests_or_nothing():
    fitted, out, every = parts_of(points_of_people(), "transfer")
    assert out["phase"].tolist() == ["test"] * 4
    assert {*fitted["condition"]} == {"CC4", "CE4"}
    assert len(every) == 14
    assert parts_of(points_of_people(), "none")[1].empty


def test_a_candidate_plays_the_same_however_its_subjects_are_cut():
    cut = [play(ME, {"lapse": 0.5}, "CC4", some, 1) for some in (range(2), range(2, 5))]
    whole = play(ME, {"lapse": 0.5}, "CC4", range(5), 1)
    order = ["subject", "trial"]
    joined = pd.concat(cut).sort_values(order)["attempts"]
    assert joined.tolist() == whole.sort_values(order)["attempts"].tolist()


def test_the_target_may_be_the_published_model():
    trials = play(ME, {}, "CC4", range(3), 1)
    points = points_towards(trials, "model")
    theirs = points_of_model().query("condition == 'CC4'")["mean"]
    assert points["people_mean"].tolist() == theirs.tolist()
    # Who makes no mistake needs three attempts everywhere.
    assert distance(points)[0] == pytest.approx(np.sqrt(((theirs - 3.0) ** 2).mean()))


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """Where a fit lies that was never interrupted."""
    folder = tmp_path_factory.mktemp("whole")
    fit(plan(), folder).write(folder)
    return folder


def test_a_fit_is_nearer_to_people_than_either_extreme(tmp_path):
    extremes = [distance(played(lapse, ("CC4", "CE4"), 6, 3))[0] for lapse in (0.0, 1.0)]
    fitted = fit(plan(candidates=12, subjects=6), tmp_path)
    fitted.write(tmp_path)
    assert fitted.table()["rmse"].min() < min(extremes) - 1
    assert 0.2 < fitted.tried[fitted.best].chosen["lapse"] < 0.95
    assert {*fitted.trials["condition"]} == {*PAPER_CONDITIONS}
    assert set(fitted.trials["seed"]) == {5}  # neither that of the search nor that of the choice
    assert 5 in seeds_of(tmp_path / FILE)
    assert fitted.idle == ("whole",)


@pytest.mark.parametrize("stop", [2, 5])
def test_a_fit_that_was_stopped_continues_to_the_same(whole, tmp_path, stop):
    seen = []

    def stopping(step):
        seen.append(step)
        if len(seen) == stop:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit(plan(), tmp_path, report=stopping)
    before = {path: path.stat().st_mtime_ns for path in (tmp_path / STEPS).iterdir()}
    assert len(before) < len([*(whole / STEPS).iterdir()])
    fit(plan(), tmp_path).write(tmp_path)
    assert stored(tmp_path) == stored(whole)
    after = {path.name: path.stat().st_mtime_ns for path in (tmp_path / STEPS).iterdir()}
    assert {*after} == {path.name for path in (whole / STEPS).iterdir()}
    assert len(after) == 4 + 2 + 4  # candidates; the best again; it, and ends of ranges
    assert before.items() <= {tmp_path / STEPS / name: at for name, at in after.items()}.items()


def test_workers_change_nothing_and_what_was_played_is_not_played_again(
    whole, tmp_path, monkeypatch
):
    start_prepared(monkeypatch)
    fit(plan(), tmp_path / "workers", workers=2).write(tmp_path / "workers")
    assert stored(tmp_path / "workers") == stored(whole)
    fit(plan(candidates=3), tmp_path / "more")
    played_before = {path.name for path in (tmp_path / "more" / STEPS).iterdir()}
    fit(plan(), tmp_path / "more").write(tmp_path / "more")
    assert stored(tmp_path / "more") == stored(whole)
    assert played_before & {path.name for path in (whole / STEPS).iterdir()}
    other = fit(plan(candidates=1, seed=4), tmp_path / "more")
    assert other.tried[0].chosen != stored(whole)["done"][0]["chosen"]


def test_the_best_few_are_played_again_and_that_decides(tmp_path):
    fitted = fit(plan(finalists=3), tmp_path)
    table = fitted.table()
    assert table["again"].notna().tolist() == [True] * 3 + [False]
    assert fitted.best == table.loc[table["again"].idxmin(), "number"]


def test_the_fitted_learner_is_written_as_an_experiment_that_can_be_run(tmp_path):
    fitted = fit(plan(candidates=2), tmp_path)
    fitted.write(tmp_path)
    experiment = read_experiment(tmp_path / "experiment.yaml")
    assert experiment.learners[-1].parameters["lapse"] == fitted.tried[fitted.best].chosen["lapse"]
    assert experiment.seed not in (3, 4, 5)
    points = pd.read_csv(tmp_path / "points.csv")
    assert points["held_out"].tolist() == [False] * 10 + [True] * 4
    assert (points[POINT].to_numpy() == points_of_people()[POINT].to_numpy()).all()
    distances, _ = fitted.compared()
    far = distances.loc["published model", "all 14 points"]
    assert far == pytest.approx(3.057, abs=1e-3)


def test_the_command_fits_by_a_plan_that_options_override(tmp_path):
    path = tmp_path / "plan.yaml"
    path.write_text(
        f"learner: {ME}\nsearch: {{lapse: {{low: 0.3, high: 0.9}}}}\n"
        "fit: {candidates: 3, subjects: 2, finalists: 1, final_subjects: 2, target: model}\n"
    )
    words = ["fit", ME, "--plan", path, "--set", "candidates=1", "--workers", 1]
    words += ["-o", tmp_path / "f"]
    done = at_once(*words)
    assert done.status == 0, done.stderr
    assert "Distance from the published model" in done.stdout
    assert len(pd.read_csv(tmp_path / "f" / "candidates.csv")) == 1
    assert "fitted to the published model" in (tmp_path / "f" / "experiment.yaml").read_text()
    words = ["fit", ME, "--search", "lapse=0.3:0.9", "--workers", 1, "--out", tmp_path / "g"]
    for setting in ("candidates=2", "subjects=2", "finalists=1", "final_subjects=3"):
        words += ["--set", setting]
    done = at_once(*words)
    assert done.status == 0, done.stderr
    for named in ("held out", "0.68", "χ²(10) = 5.7, p = .843", "congruency, CE4", "lapse:"):
        assert named in done.stdout
    assert (tmp_path / "g" / "fit.svg").exists()


def test_directness_weighs_each_lever_that_acts_on_the_door():
    def belief(nats):
        cc4 = find_condition("CC4")
        played = Session(cc4, PROTOCOLS["human"], 1, seed=0)
        prior = BeliefParameters(by_colour=0.999, directness=nats)
        beliefs = Beliefs(played.brief, prior, played.brief.generators)
        beliefs.enter(played.view)
        return beliefs.of[0]

    plain, direct = belief(0.0), belief(0.7)
    many = np.bitwise_count(plain.space.hypotheses.causes[plain.which, -1])
    assert len(set(many.tolist())) > 1
    expected = plain.weight * np.exp(0.7 * many)
    assert direct.weight == pytest.approx(expected / expected.sum())
