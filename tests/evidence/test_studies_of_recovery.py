"""Studies that ask which learners, and which parameters, are found again."""

import shutil

import numpy as np
import pandas as pd
import pytest

from causal_openlock.design.telling import by_size
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.confusions import (
    confusion_of,
    subjects_of,
    units_of_parameters,
    units_of_subjects,
)
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import Contrast, Selection, read_study
from causal_openlock.evidence.study_files import read_run, read_units
from causal_openlock.evidence.verdicts import compared, correlation
from causal_openlock.fitting.space import bundled_search

EXPERIMENT = """
name: two
seed: 4
subjects: 5
protocol: brief
conditions: [CC3]
protocols: {brief: {attempt_limit: 6, stop_when_solved: true, baseline_trials: 2}}
learners:
  - random
  - win_stay
  - {learner: bayes, name: thompson, parameters: {policy: thompson, forgets: failures}}
"""
RECOVERY = """
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
  parameters:
    text: Forgetting is recovered
    contrasts:
      forgetting:
        {measure: r, of: {learner: thompson, parameter: forgetting}, minus: 0.7, expected: more}
figures: [derived]
"""
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
      rooms:
        {measure: per_minute, of: {learner: random}, minus: {learner: win_stay}, expected: same,
         smallest: 9}
tables:
  certain: {measure: certain, columns: [CC3], rows: {thompson: Thompson}}
figures: [derived]
"""


@pytest.fixture
def study_of(tmp_path):
    """Make a study of a text."""

    def made(text):
        folder = tmp_path / "evidence" / "small"
        folder.mkdir(parents=True)
        (folder / "study.yaml").write_text(text)
        (folder / "experiment.yaml").write_text(EXPERIMENT)
        return read_study(folder)

    return made


def test_a_study_of_recovery_from_the_run_to_its_page(study_of, tmp_path):
    study, results = study_of(RECOVERY), tmp_path / "results"
    assert not study.faults()
    run_study(study, results, Watched(workers=0))
    found, units = Evidence(study), read_units(study)
    assert found.complete
    assert len(units) == 3 * (5 + 1 + 2) + 4 * 4  # subjects, groups, halves; parameters of sets
    assert found.text("claim told_apart verdict") == "holds"
    assert float(found.text("single win_stay")) > 0.8
    assert found.text("groups everyone units") == "3"
    single = float(found.text("single win_stay"))
    assert float(found.text("derived win_stay win_stay")) == pytest.approx(single)
    head = found.block("derived").splitlines()[0]
    assert head == "|  | random | win_stay | thompson | groups | taken for | bits |"
    assert found.derived.loc["random", "bits"] == pytest.approx(np.log2(15))
    changed, faults = write(tmp_path / "evidence")
    assert not faults
    assert {path.name for path in changed} == {"README.md", "verdicts.csv", "derived.svg"}
    assert not check(tmp_path / "evidence")
    shutil.rmtree(results)
    run_study(study, results, Watched(workers=0))  # all is stored: nothing is run
    assert not results.exists()
    pd.testing.assert_frame_equal(read_units(study), units)
    assert read_run(study)["complete"]


def test_a_study_of_unknown_parameters_from_the_run_to_its_page(study_of, tmp_path):
    study, results = study_of(DESIGN), tmp_path / "results"
    run_study(study, results, Watched(workers=0))
    found, units = Evidence(study), read_units(study)
    assert found.complete
    assert len(units) == 3 * 5 + 2 * (1 + 2)  # subjects; groups and halves of the two theories
    own = units.dropna(subset="information")
    assert set(own["learner"]) == {"random", "win_stay"}
    information = float(found.text("information everyone"))
    assert information == pytest.approx(own["information"].mean(), abs=0.006)
    assert found.estimates["by_the_minute", "rooms"][0].units == (5,)  # same rooms, so in pairs
    assert found.text("claim told_apart verdict") == "holds"
    assert found.text("certain thompson units") == "5"
    assert units["unlike"].isna().all()  # of too few subjects to say
    assert not write(tmp_path / "evidence")[1]
    assert not check(tmp_path / "evidence")
    shutil.rmtree(results)
    run_study(study, results, Watched(workers=0))  # all is stored: nothing is run
    assert not results.exists()


def test_units_hold_all_that_the_confusion_needs():
    about = {"condition": "CC3", "protocol": "human", "attempts": 5, "actions": 15}
    subjects = pd.DataFrame(
        {"learner": maker, "subject": number, "nats a": difference - 9.0, "nats b": -9.0, **about}
        for maker, differences in {"a": [3, 3, 3, -1, 0], "b": [-2, -2, -2, -2, -2]}.items()
        for number, difference in enumerate(differences)
    )
    units = units_of_subjects(subjects)
    assert units.query("learner == 'a'")["single"].dropna().tolist() == [1, 1, 1, 0, 0.5]
    # Of all five of `a`, of its first three and of the other two; and of all of `b`, and so on.
    groups = units[units["subjects"] > 1]
    assert groups["groups"].dropna().tolist() == [1, 1]
    assert groups["halves"].dropna().tolist() == [1, 0, 1, 1]
    assert sorted(groups["subjects"]) == [2, 2, 3, 3, 5, 5]
    again = confusion_of(by_size(subjects_of(units)))
    assert again.to_numpy() == pytest.approx(np.array([[0.7, 0.3], [0.0, 1.0]]))


def test_correlations_are_on_the_scale_that_was_searched():
    truth = (0.1, 0.2, 0.3, 0.5, 0.9)
    pairs = pd.DataFrame({"set": range(5), "parameter": "local_gain", "true": truth})
    pairs["fitted"] = pairs["true"] ** 2
    units = units_of_parameters("thompson", pairs, bundled_search("theory_based"))
    assert np.exp(units["true"]).tolist() == pytest.approx(truth)
    one = Selection.parse(["thompson", "parameter", "local_gain"])
    units["fitted"] += [0.5, -0.5, 0.2, 0.4, -0.1]
    found = correlation(units, one)
    r = np.corrcoef(units["true"], units["fitted"])[0, 1]
    assert found.value == pytest.approx(r)
    z = np.arctanh(r) + np.array([-1, 1]) * 1.959964 / np.sqrt(5 - 3)
    assert found.interval == pytest.approx(np.tanh(z), abs=1e-6)
    assert found.n == "5"
    contrast = Contrast(measure="r", of=one, minus=0.2, expected="more")
    assert compared(units, contrast, "subject").value == pytest.approx(r - 0.2)
    with pytest.raises(EvidenceError, match="too few"):
        correlation(units[:3], one)
