"""Studies that ask which learners, and which parameters, are found again."""

from __future__ import annotations

import shutil
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import causal_openlock.evidence.recovery_runs as recovering
from causal_openlock.errors import EvidenceError, FileError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.confusions import (
    recovery_of,
    units_of_parameters,
    units_of_recovery,
)
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import Contrast, Selection, read_study
from causal_openlock.evidence.study_files import read_run, read_units
from causal_openlock.evidence.units import selected
from causal_openlock.evidence.verdicts import compared, correlation, mean_of
from causal_openlock.fitting.actions import ActionPlan
from causal_openlock.fitting.recovery import recovery
from causal_openlock.fitting.search import bundled_search

EXPERIMENT = """
name: two
seed: 4
subjects: 5
protocol: brief
conditions: [CC3]
protocols: {brief: {attempt_limit: 8, stop_when_solved: true, baseline_trials: 2}}
learners:
  - random
  - win_stay
  - {learner: bayes, name: thompson, parameters: {policy: thompson, forgets: failures}}
"""
STUDY = """
title: Whether three learners are told apart
experiment: experiment.yaml
measured: recovery
recovery: {parameters: [thompson], sets: 4, candidates: 1}
derived: confusion
hours: 0.01
claims:
  told_apart:
    text: At least half of all subjects, and of halves, are attributed right
    contrasts:
      single: {measure: single, of: {learner: everyone}, minus: 0.5, expected: more}
      halves: {measure: halves, of: {learner: everyone}, minus: 0.5, expected: more}
      win_stay in CC3: {measure: single, of: {learner: win_stay, condition: CC3}, minus: 0.3, expected: more}
  parameters:
    text: Forgetting is recovered
    contrasts:
      forgetting: {measure: r, of: {learner: thompson, parameter: forgetting}, minus: 0.7, expected: more}
tables:
  r: {measure: r, interval: true, columns: [parameter forgetting, parameter directness], rows: {thompson: Thompson}}
figures: [derived]
"""  # noqa: E501


@pytest.fixture
def root(tmp_path: Path) -> Path:
    folder = tmp_path / "evidence" / "small"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text(STUDY)
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    return tmp_path / "evidence"


def test_a_study_of_recovery_from_the_run_to_its_page(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "causal_openlock.fitting.recovering.ActionPlan", partial(ActionPlan, moves=1)
    )
    study, results = read_study(root / "small"), root.parent / "results"
    assert not study.faults()
    with monkeypatch.context() as patched:
        patched.setattr(recovering, "parameters_recovered", _stopped)
        with pytest.raises(KeyboardInterrupt):
            run_study(study, results, Watched(workers=0))
    assert not read_run(study)["complete"]
    assert Evidence(study).text("claim parameters verdict") == "undecided"
    assert len(read_units(study)) == 3 * (5 + 1 + 2)  # subjects, groups, halves

    with monkeypatch.context() as patched:  # what is scored is not scored again
        patched.setattr("causal_openlock.scoring.teacher_forcing.score_part", None)
        patched.setattr(recovering, "parameters_recovered", _stopped)
        with pytest.raises(KeyboardInterrupt):
            run_study(study, results, Watched(workers=0))
    spent = read_run(study)["parts"]["played"]["seconds"]
    shutil.copytree(results, root / "part")
    shutil.rmtree(results)  # on another machine, for instance
    with monkeypatch.context() as patched:
        patched.setattr(recovering, "predicted", None)
        run_study(study, results, Watched(workers=0))
    assert read_run(study)["parts"]["played"]["seconds"] >= spent
    found = Evidence(study)
    assert found.complete
    units = read_units(study)
    assert len(units) == 3 * (5 + 1 + 2) + 4 * 4
    assert found.text("claim told_apart verdict") == "holds"
    assert float(found.text("single win_stay")) > 0.8
    assert found.text("groups everyone units") == "3"
    # Of one candidate everything comes out the same.
    assert found.text("claim parameters verdict") == "undecided"
    assert "comes out the same, whatever made subjects" in found.block("claims")
    assert found.text("derived win_stay win_stay") == found.text("single win_stay").replace(
        ".", "0.", 1
    ).replace("10.", "1.")
    shown = found.block("derived").splitlines()
    assert shown[0] == "|  | random | win_stay | thompson | groups | taken for | bits |"
    assert found.derived.loc["random", "bits"] == pytest.approx(np.log2(15))

    changed, faults = write(root)
    assert not faults
    assert not check(root)
    names = {path.name for path in changed}
    assert names == {"README.md", "verdicts.csv", "derived.svg"}
    page = (root / "small" / "README.md").read_text()
    assert "lets every learner predict every subject" in page
    assert "parameters" in (root / "small" / "verdicts.csv").read_text()
    assert "| Thompson | – | – | – |" in page

    before = read_units(study)
    shutil.rmtree(results)
    shutil.move(root / "part", results)  # parameters are stored, and their records gone
    with monkeypatch.context() as patched:
        patched.setattr(recovering, "parameters_recovered", _stopped)
        run_study(study, results, Watched(workers=0))
    pd.testing.assert_frame_equal(read_units(study)[list(before)], before)
    shutil.rmtree(results)
    run_study(study, results, Watched(workers=0))  # all is stored: nothing is run
    assert not results.exists()
    pd.testing.assert_frame_equal(read_units(study), before)


DESIGN = """
title: Whether two learners are told apart
experiment: experiment.yaml
measured: design
design: {outside: [thompson], draws: 1}
derived: confusion
hours: 0.01
claims:
  told_apart:
    text: Subjects are told apart
    contrasts:
      single: {measure: single, of: {learner: everyone}, minus: 0.5, expected: more}
  by_the_minute:
    text: Visits tell as much a minute, whoever makes them
    contrasts:
      rooms: {measure: per_minute, of: {learner: random}, minus: {learner: win_stay}, expected: same, smallest: 9}
tables:
  information: {measure: information, interval: true, columns: [CC3], rows: {everyone: everyone, random: "`random`"}}
  certain: {measure: certain, columns: [CC3], rows: {thompson: Thompson}}
figures: [derived, information]
"""  # noqa: E501


def test_a_study_of_unknown_parameters_from_the_run_to_its_page(
    root: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (root / "small" / "study.yaml").write_text(DESIGN)
    study, results = read_study(root / "small"), root.parent / "results"
    assert not study.faults()
    run_study(study, results, Watched(workers=0))
    found, units = Evidence(study), read_units(study)
    assert found.complete
    assert len(units) == 3 * 5 + 2 * (1 + 2)  # subjects; groups and halves of the two theories
    own = units.dropna(subset="information")
    assert set(own["learner"]) == {"random", "win_stay"}
    assert found.text("information everyone units") == "10"
    assert float(found.text("information everyone")) == pytest.approx(
        own["information"].mean(), abs=0.006
    )
    mean = found.estimates["by_the_minute", "rooms"][0]
    assert mean.units == (5,)  # in the same rooms, so in pairs
    assert found.text("claim told_apart verdict") == "holds"
    assert found.text("certain thompson units") == "5"
    assert units["unlike"].isna().all()  # of too few subjects to say
    assert not write(root)[1]
    assert not check(root)
    page = (root / "small" / "README.md").read_text()
    assert "lets every theory predict every subject, its parameters unknown" in page
    assert "| Thompson |" in page
    shutil.rmtree(results)
    run_study(study, results, Watched(workers=0))  # all is stored: nothing is run
    assert not results.exists()


def _stopped(*_: object) -> None:
    raise KeyboardInterrupt


def made_up(chances: dict[str, list[float]]) -> pd.DataFrame:
    """By maker, by how many nats the learner `a` predicts each subject better than `b`."""
    return pd.DataFrame(
        [
            {"scored": scored, "learner": maker, "condition": "CC3", "protocol": "human",
             "experiment": "e", "seed": 1, "subject": subject, "trial": trial,
             "log_probability": value / 2}
            for maker, differences in chances.items()
            for subject, difference in enumerate(differences)
            for trial in (1, 2)
            for scored, value in (("a", -9.0 + difference), ("b", -9.0))
        ]
    )  # fmt: skip


def test_units_hold_all_that_the_confusion_needs() -> None:
    actions = made_up({"a": [3, 3, 3, -1, 0], "b": [-2, -2, -2, -2, -2]})
    units = units_of_recovery(actions)
    assert units.query("learner == 'a'")["single"].dropna().tolist() == [1, 1, 1, 0, 0.5]
    # Of all five of `a`, of its first three and of the other two; and of all of `b`, and so on.
    groups = units[units["subjects"] > 1]
    assert groups["groups"].dropna().tolist() == [1, 1]
    assert groups["halves"].dropna().tolist() == [1, 0, 1, 1]
    assert sorted(groups["subjects"]) == [2, 2, 3, 3, 5, 5]
    again, plain = recovery_of(units, 1), recovery(actions, 1)
    pd.testing.assert_frame_equal(again.single, plain.single)
    pd.testing.assert_frame_equal(again.bits, plain.bits, check_names=False)


def test_a_group_counts_once_however_many_subjects_it_has() -> None:
    """Forty-eight groups that are all right cannot show 19 in 20, and their halves can."""
    ones = pd.DataFrame({"groups": np.ones(48), "halves": 1.0, "subjects": 40, "learner": "a"})
    everyone = Selection(learner="everyone")
    for many, measure, shown in ((1, "groups", False), (2, "halves", True)):
        units = pd.concat([ones.assign(judged=True)] * many, ignore_index=True)
        low, high = mean_of(selected(units, everyone, measure)).interval
        assert [low > 0.95, high] == [shown, 1.0]


def test_correlations_are_of_what_was_searched() -> None:
    space = bundled_search("theory_based")
    pairs = pd.DataFrame(
        [
            {"set": number, "parameter": "local_gain", "true": true, "fitted": true**2}
            for number, true in enumerate((0.1, 0.2, 0.3, 0.5, 0.9))
        ]
    )
    units = units_of_parameters("thompson", pairs, space)
    assert np.exp(units["true"]).tolist() == pytest.approx([0.1, 0.2, 0.3, 0.5, 0.9])
    one = Selection.parse(["thompson", "parameter", "local_gain"])
    units["fitted"] += [0.5, -0.5, 0.2, 0.4, -0.1]
    found = correlation(units, one)
    r = np.corrcoef(units["true"], units["fitted"])[0, 1]
    assert found.value == pytest.approx(r)
    z = np.arctanh(r) + np.array([-1, 1]) * 1.959964 / np.sqrt(5 - 3)
    assert found.interval == pytest.approx(np.tanh(z), abs=1e-6)
    assert found.n == "5"
    contrast = Contrast(measure="r", of=one, minus=0.2, expected="more")
    assert compared(units, contrast, "subject")(1.0).value == pytest.approx(r - 0.2)
    with pytest.raises(EvidenceError, match="of too few sets"):
        correlation(units[:3], one)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            ("minus: 0.5", "smallest: 0.1, minus: {learner: random}"),
            "minus: of a recovery is a number",
        ),
        (("measured: recovery\n", ""), "derived: confusion is of measured: recovery"),
        (("derived: confusion\n", "derived: learning_costs\n"), "derives only confusion"),
    ],
)
def test_what_makes_no_sense_is_refused(root: Path, change: tuple[str, str], message: str) -> None:
    path = root / "small" / "study.yaml"
    path.write_text(path.read_text().replace(*change).replace("figures: [derived]\n", ""))
    with pytest.raises(FileError, match=message):
        read_study(root / "small")


def test_what_is_not_played_is_named_before_the_run(root: Path) -> None:
    path = root / "small" / "study.yaml"
    path.write_text(path.read_text().replace("of: {learner: everyone}", "of: {learner: everyon}"))
    with pytest.raises(EvidenceError, match="'everyon' is not played; did you mean everyone"):
        run_study(read_study(root / "small"), root.parent / "results", Watched(workers=0))
    path.write_text(STUDY.replace("measure: r, of", "measure: single, of"))
    with pytest.raises(EvidenceError, match="r is of a parameter, and nothing else is"):
        run_study(read_study(root / "small"), root.parent / "results", Watched(workers=0))
