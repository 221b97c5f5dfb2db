"""Parameters fitted to single actions: what is found, how a fit continues, what is marked."""

import json
from dataclasses import replace

import pytest

import causal_openlock as ol
from causal_openlock.errors import LearnerError, OpenLockError, StoreError
from causal_openlock.experiment.making import make_experiment
from causal_openlock.files.checksums import json_bytes
from causal_openlock.fitting.hierarchical import GROUP, fit_group
from causal_openlock.fitting.plan import Range, make_plan
from causal_openlock.fitting.steps import STEPS, fitting_in
from causal_openlock.fitting.to_actions import (
    FILE,
    WHOLE,
    check_folds,
    fit_all,
    fit_fold,
    fit_table,
    groups_of,
)
from causal_openlock.running.runner import run
from causal_openlock.scoring.recorded import recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once
from support.fits import with_settings
from support.scores import score_actions

pytestmark = pytest.mark.slow

SPACE = make_plan("associative", {"temperature": Range(0.02, 2.0, log=True)})
PLAN = with_settings(SPACE, candidates=20)
QUICK = with_settings(PLAN, candidates=1)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    short = ol.Protocol("short", 10, stop_when_solved=True, baseline_trials=2)
    kinds = [
        ol.learner("associative", label="cool", temperature=0.06),
        ol.learner("associative", label="warm", temperature=0.5),
    ]
    made = make_experiment(["CC3"], kinds, subjects=6, protocol=short, seed=5)
    folder = tmp_path_factory.mktemp("fitted")
    run(made, folder, workers=0)
    return folder


def parts(folder, *learners):
    return recorded_subjects(*Store(folder).record(), learners)


@pytest.mark.parametrize(("learner", "true"), [("cool", 0.06), ("warm", 0.5)])
def test_the_temperature_that_made_subjects_is_found(folder, learner, true):
    found = fit_fold("all", parts(folder, learner), WHOLE, PLAN)
    assert found.chosen["temperature"] == pytest.approx(true, rel=0.25)
    assert found.held_out_actions == 0
    record, experiment = Store(folder).record()
    made = make_experiment(["CC3"], [ol.learner("associative", **found.chosen)])
    scored = score_actions(record, experiment, made.learners, PLAN.fit.lapse, of=[learner])
    assert found.nll == pytest.approx(-scored["log_probability"].sum())
    assert found.actions == len(scored)


@pytest.mark.parametrize("hold_out", ["trials", "subjects"])
def test_every_action_is_held_out_once_and_predicted_no_better(folder, tmp_path, hold_out):
    plan = with_settings(PLAN, hold_out=hold_out)
    whole, *folds = fit_all(groups_of(parts(folder, "warm"), plan), plan, tmp_path)
    assert whole.actions == sum(one.held_out_actions for one in folds)
    assert all(one.actions + one.held_out_actions == whole.actions for one in folds)
    table = fit_table([whole, *folds], plan)
    assert table["held_out_bits"].iloc[0] >= table["bits"].iloc[0] - 0.02
    assert len({one.chosen["temperature"] for one in folds}) == 2


def test_a_fit_continues_where_it_was_stopped(folder, tmp_path):
    plan = with_settings(PLAN, candidates=2, each=True)
    groups = groups_of(parts(folder, "cool"), plan)
    assert len(groups) == 6
    two = dict([*groups.items()][:2])

    def stop(done, _):
        if done == 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        fit_all(two, plan, tmp_path, report=stop)
    assert not (tmp_path / FILE).exists()
    stored = {path: path.stat().st_mtime_ns for path in (tmp_path / STEPS).iterdir()}
    counted = []
    resumed = fit_all(two, plan, tmp_path, report=lambda *both: counted.append(both))
    assert counted == [(done, 6) for done in range(1, 7)]
    assert resumed == [fit_fold(who, two[who], fold, plan) for who in two for fold in (-1, 0, 1)]
    assert (
        stored.items()
        <= {path: path.stat().st_mtime_ns for path in (tmp_path / STEPS).iterdir()}.items()
    )
    assert len(stored) == 2
    (who, own), *_ = two.items()
    fit_all({who: own}, plan, tmp_path)
    assert len(json.loads((tmp_path / FILE).read_text())["done"]) == 3
    assert len([*(tmp_path / STEPS).iterdir()]) == 6


def test_one_fit_at_a_time_works_in_a_folder(folder, tmp_path):
    words = ["fit", "associative", "--to", folder, "--of", "cool", "--set", "hold_out=none"]
    words += ["-s", "temperature=0.02:2:log", "--set", "candidates=1", "--workers", 1]
    words += ["--out", tmp_path]
    writing = tmp_path / ".fit_to_actions.json.x.partial"
    with fitting_in(tmp_path, 1):
        writing.touch()
        for more in ([], ["--hierarchical"]):
            assert "in use" in at_once(*words, *more).stderr
        assert writing.exists()
    assert at_once(*words).status == 0
    assert not writing.exists()


def test_a_stored_fit_that_cannot_be_is_refused(folder, tmp_path):
    groups = groups_of(parts(folder, "cool"), QUICK)
    fit_all(groups, QUICK, tmp_path)
    path = next((tmp_path / STEPS).iterdir())
    content = path.read_bytes()
    path.write_bytes(content.replace(b'"actions": ', b'"actions": 1', 1))
    with pytest.raises(StoreError, match="checksum"):
        fit_all(groups, QUICK, tmp_path)
    for wrong in (json_bytes({"result": {"who": "me"}}), json_bytes({}), b"[1, 2"):
        path.write_bytes(wrong)
        with pytest.raises(StoreError, match=f"{path.name}.* delete it"):
            fit_all(groups, QUICK, tmp_path)
    path.unlink()
    fit_all(groups, QUICK, tmp_path)
    assert path.read_bytes() == content


def test_folds_need_trials_and_subjects_enough(folder):
    (part,) = parts(folder, "cool")
    short = part.rows[(part.rows["subject"] != 3) | (part.rows["trial"] == 1)]
    short = replace(part, rows=short[short["phase"] == "train"])
    with pytest.raises(OpenLockError, match=r"cool/CC3/.*/3"):
        groups_of([short], with_settings(PLAN, each=True))
    assert len(groups_of([short], with_settings(PLAN, hold_out="none", each=True))) == 6
    assert [*groups_of([short], PLAN)] == ["all"]
    plan = with_settings(PLAN, hold_out="subjects", folds=7)
    with pytest.raises(OpenLockError, match="there are 6; give fewer"):
        groups_of([part], plan)
    one = replace(part, rows=part.rows[part.rows["subject"] == 0])
    with pytest.raises(OpenLockError, match="hold_out=trials"):
        groups_of([one], plan)
    with pytest.raises(OpenLockError, match="7 folds"):
        fit_group([part], plan, folder)
    check_folds([part], with_settings(plan, folds=6))
    with pytest.raises(LearnerError, match="each=true"):
        fit_group([one], PLAN, folder)


NEVER = r"associative cannot have done what random/CC3/.*/0 did.*(push|pull)_\w+ \(trial 1, attempt"


@pytest.fixture(scope="module")
def doubtful(tmp_path_factory):
    """One who pushes levers that are out already, and two who never do."""
    short = ol.Protocol("short", 6, stop_when_solved=True, baseline_trials=1)
    own = ol.learner("associative", label="own", temperature=0.2)
    kinds = [ol.learner("random", subjects=1), own]
    folder = tmp_path_factory.mktemp("doubtful")
    run(make_experiment(["CC3"], kinds, subjects=2, protocol=short, seed=5), folder, workers=0)
    return folder


@pytest.mark.parametrize("each", [False, True])
def test_an_action_that_a_learner_never_takes_is_named(doubtful, tmp_path, each):
    sure = with_settings(QUICK, hold_out="none", candidates=4, lapse=0.0, each=each)
    groups = groups_of(parts(doubtful), sure)
    for _ in range(2):  # what is stored is not shown either
        with pytest.raises(LearnerError, match=NEVER):
            fit_all(groups, sure, tmp_path)
        assert not (tmp_path / FILE).exists()
    with pytest.raises(LearnerError, match=NEVER):
        fit_group(parts(doubtful), sure, tmp_path / "group")


def test_a_parameter_without_effect_is_refused_and_marked(doubtful, tmp_path):
    plan = with_settings(QUICK, hold_out="none", candidates=4)
    nothing = dict.fromkeys(("lever", "position", "colour"), 0.0)
    idle = make_plan("associative", SPACE.ranges, nothing, plan.fit)
    for each in (False, True):
        for _ in range(2):
            other = with_settings(idle, each=each)
            with pytest.raises(LearnerError, match="temperature makes no difference"):
                fit_all(groups_of(parts(doubtful), other), other, tmp_path / str(each))
    # Who acted once had learnt nothing, so that the temperature was all the same.
    (part,) = parts(doubtful, "own")
    brief = replace(part, rows=part.rows[(part.rows["subject"] == 1) | (part.rows["attempt"] == 1)])
    brief.rows["actions"] = [own[:1] for own in brief.rows["actions"]]
    each = with_settings(plan, each=True)
    (first, _), (_, second) = (groups_of([who], each).items() for who in (brief, part))
    table = fit_table(fit_all(dict([second, first]), each, tmp_path / "one"), each)
    assert table["without_effect"].tolist() == ["none", "temperature"]


def test_a_group_at_its_bound_is_marked(doubtful, tmp_path):
    low = make_plan("associative", {"temperature": Range(3.0, 4.0)})
    plan = with_settings(low, candidates=1, hold_out="none")
    fits, _ = fit_group(parts(doubtful, "own"), plan, tmp_path)
    assert fits[0].who == GROUP
    assert fit_table(fits, plan)["at_bound"][0] == "temperature"


def test_a_fit_that_predicts_worse_than_chance_says_so(folder, tmp_path):
    (tmp_path / "plan.yaml").write_text(
        "learner: associative\nsearch: {temperature: {low: 0.001, high: 0.002}}\n"
        "fit: {candidates: 1, hold_out: none}\n"
    )
    words = ("fit", "associative", "--plan", tmp_path / "plan.yaml", "--to", folder)
    done = at_once(*words, "-o", tmp_path / "fitted", "--workers", 1)
    assert "all (worse than at random: 3.91 bits)" in done.stdout
