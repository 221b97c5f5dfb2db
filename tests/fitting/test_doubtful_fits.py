"""What is no estimate is not shown as one: the impossible, what makes no difference, bounds."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import causal_openlock as ol
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.fitting.actions import (
    FILE,
    ActionPlan,
    check_folds,
    fit_all,
    fit_table,
    jobs_of,
)
from causal_openlock.fitting.hierarchical import GROUP, GroupFit
from causal_openlock.fitting.kept import keep_fit
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.running.runner import run
from causal_openlock.scoring.teacher_forcing import Recorded, recorded_subjects
from causal_openlock.storage.store import Store
from support.command import at_once

pytest.importorskip("optuna")
SPACE = search_space("associative", {"temperature": Range(0.02, 2.0, log=True)})
PLAN = ActionPlan(SPACE, hold_out="none", candidates=1, restarts=1, moves=3)
SURE = replace(PLAN, lapse=0.0)
NOTHING = dict.fromkeys(("lever", "position", "colour"), 0.0)
IDLE = replace(PLAN, space=search_space("associative", dict(SPACE.ranges), NOTHING))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One who pushes levers that are out already, and two who never do."""
    short = ol.Protocol("short", 6, stop_when_solved=True, baseline_trials=1)
    kinds = [
        ol.learner("random", subjects=1),
        ol.learner("associative", label="own", temperature=0.2),
    ]
    folder = tmp_path_factory.mktemp("doubtful")
    run(make_experiment(["CC3"], kinds, subjects=2, protocol=short, seed=5), folder, workers=0)
    return folder


def parts(folder: Path, *of: str) -> list[Recorded]:
    return recorded_subjects(*Store(folder).record(), of)


NEVER = r"associative cannot have done what random/CC3/.*/0 did, with the best .*; the first such "
NEVER += r"action is (push|pull)_\w+ \(trial 1, attempt \d, action \d\); allow for lapses"


@pytest.mark.parametrize("each", [False, True])
def test_what_a_learner_never_does_is_not_fitted_with_a_penalty(
    folder: Path, tmp_path: Path, each: bool
) -> None:
    jobs = jobs_of(parts(folder), SURE, each)
    for _ in range(2):  # what is stored is not shown either
        with pytest.raises(LearnerError, match=NEVER):
            fit_all(jobs, tmp_path)
        assert json.loads((tmp_path / FILE).read_text())["done"][-1]["nll"] >= 1e6


def test_a_group_is_not_fitted_to_what_its_learner_never_does(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(LearnerError, match=NEVER):
        GroupFit(parts(folder), {"associative": SURE}, tmp_path / "group").run()


def test_who_cannot_follow_a_learner_follows_another(folder: Path, tmp_path: Path) -> None:
    words = "fit", "associative", "--to", folder, "--hierarchical", "--or", "random", "-s"
    done = at_once(
        *(*words, "temperature=0.02:2:log", "--lapse", 0, "--hold-out", "none"),
        *("--candidates", 1, "--workers", 1, "-o", tmp_path / "f"),
    )
    assert done.status == 0, done.stderr
    table = pd.read_csv(tmp_path / "f" / "fits.csv").set_index(["learner", "who"])["bits"]
    assert np.isinf(table.loc["associative", GROUP])
    assert np.isfinite(table["associative"].filter(like="own/")).all()
    assert np.isfinite(table.loc["mixture", GROUP])


@pytest.mark.parametrize("each", [False, True])
def test_a_parameter_without_effect_is_refused_in_all_ways(
    folder: Path, tmp_path: Path, each: bool
) -> None:
    says = "temperature makes no difference to how likely associative finds what was done, as it is"
    for _ in range(2):
        with pytest.raises(LearnerError, match=says):
            fit_all(jobs_of(parts(folder), IDLE, each), tmp_path)


def test_it_is_marked_where_it_makes_a_difference_to_others(folder: Path, tmp_path: Path) -> None:
    """Who acted once had learnt nothing, so that the temperature was all the same."""
    (part,) = parts(folder, "own")
    brief = replace(part, rows=part.rows[(part.rows["subject"] == 1) | (part.rows["attempt"] == 1)])
    brief.rows["actions"] = [own[:1] for own in brief.rows["actions"]]
    jobs = [*jobs_of([part], PLAN, each=True)[1:], *jobs_of([brief], PLAN, each=True)[:1]]
    table = fit_table(fit_all(jobs, tmp_path))
    assert table["without_effect"].tolist() == ["none", "temperature"]


def test_an_estimate_at_a_bound_is_marked(folder: Path, tmp_path: Path) -> None:
    done = at_once(
        *("fit", "associative", "--to", folder, "-s", "temperature=3:4", "--of", "own"),
        *("--hold-out", "none", "--candidates", 1, "--workers", 1, "-o", tmp_path / "f"),
    )
    assert done.status == 0, done.stderr
    assert "all 3* " in " ".join(done.stdout.split())
    assert "* at a bound of what was searched" in done.stdout
    assert pd.read_csv(tmp_path / "f" / "fits.csv")["at_bound"].tolist() == ["temperature"]


def test_a_group_at_its_bound_is_marked(folder: Path, tmp_path: Path) -> None:
    low = search_space("associative", {"temperature": Range(3.0, 4.0)})
    fits = GroupFit(parts(folder, "own"), {"a": replace(PLAN, space=low)}, tmp_path).run()
    assert fits[0].who == GROUP
    assert fits[0].at_bound == ("temperature",)


def test_folds_that_cannot_all_have_subjects_are_told_with_what_can_be(folder: Path) -> None:
    plan = replace(PLAN, hold_out="subjects", folds=3)
    with pytest.raises(OpenLockError, match="and there are 2; give --folds 2"):
        jobs_of(parts(folder), plan, each=False)
    with pytest.raises(OpenLockError, match="and there is 1; give --hold-out trials or --hold"):
        jobs_of(parts(folder, "random"), plan, each=False)
    with pytest.raises(OpenLockError, match="3 folds would not each have a subject"):
        GroupFit(parts(folder), {"associative": plan}, folder)
    check_folds(parts(folder), replace(plan, folds=2))


def test_a_group_of_one_is_refused_and_nothing_is_said_of_its_spread(
    folder: Path, tmp_path: Path
) -> None:
    with pytest.raises(LearnerError, match=r"a group has two subjects at least; .* --each"):
        GroupFit(parts(folder, "random"), {"associative": PLAN}, tmp_path)
    words = "fit", "associative", "--to", folder, "--hierarchical", "--or", "random", "-s"
    done = at_once(
        *(*words, "temperature=0.02:2:log", "--of", "own", "--hold-out", "none"),
        *("--candidates", 1, "--workers", 1, "-o", tmp_path / "f"),
    )
    assert done.status == 0, done.stderr
    said = " ".join(done.stdout.split())
    assert "Fewer than two subjects follow associative, so that the spread" in said
    assert "Two thirds" not in said


def test_fits_of_earlier_versions_are_read(folder: Path, tmp_path: Path) -> None:
    jobs = jobs_of(parts(folder, "own"), PLAN, each=False)
    (found,) = fit_all(jobs, tmp_path)
    kept = json.loads((tmp_path / FILE).read_text())
    old = [{k: v for k, v in one.items() if k not in ("idle", "at_bound")} for one in kept["done"]]
    keep_fit(tmp_path / FILE, kept["plan"], done=old)
    assert fit_all(jobs, tmp_path) == [replace(found, idle=(), at_bound=())]
