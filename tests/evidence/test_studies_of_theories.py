"""Studies that ask which theories, and which parameters, are found again."""

import numpy as np
import pandas as pd
import pytest

from causal_openlock.design.apart import NATS
from evidence.measured import Evidence
from evidence.pages import check
from evidence.run import read_units, run_study
from evidence.study import read_studies
from evidence.theories import units_of_subjects

pytestmark = pytest.mark.slow

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
KNOWN = """
title: Whether three learners are told apart
experiment: experiment.yaml
measured: theories
theories: {parameters: [thompson], sets: 5, candidates: 1}
derived: confusion
hours: 0.01
claims:
  told_apart:
    text: At least half of all subjects, and of halves, are attributed right
    contrasts:
      single: {measure: single, of: everyone, minus: 0.5, expected: more}
      halves: {measure: halves, of: everyone, minus: 0.5, expected: more}
  parameters:
    text: Forgetting is recovered
    contrasts:
      forgetting: {measure: r, of: thompson parameter forgetting, minus: 0.7, expected: more}
figures: [derived]
"""


def ran(tmp_path):
    """The evidence of a study that was run."""
    folder = tmp_path / "evidence" / "small"
    folder.mkdir(parents=True)
    (folder / "study.yaml").write_text(KNOWN)
    (folder / "experiment.yaml").write_text(EXPERIMENT)
    (study,) = read_studies(tmp_path / "evidence")
    assert not study.faults()
    run_study(study, tmp_path / "results", 0)
    return Evidence(study)


def test_a_study_of_known_parameters_from_the_run_to_its_page(tmp_path):
    found = ran(tmp_path)
    units = read_units(found.study)
    assert len(units) == 3 * (5 + 1 + 2) + 5 * 4  # subjects, groups, halves; parameters of sets
    assert found.text("claim told_apart single verdict") == "holds"
    assert found.text("claim told_apart verdict") == "undecided"  # three groups are too few
    single = float(found.text("single win_stay"))
    assert single > 0.8
    assert found.decided["told_apart"]["halves"].found.n == "3"  # of groups
    assert float(found.text("derived win_stay win_stay")) == pytest.approx(single)
    head = found.block("derived").splitlines()[0]
    assert head == "|  | random | win_stay | thompson | groups | bits |"
    assert found.derived.loc["random", "bits"] == pytest.approx(np.log2(15))
    (fault,) = check(tmp_path / "evidence", write=True)
    assert "derived.png is missing" in fault


def test_subjects_and_groups_are_attributed_to_the_likeliest_theory():
    nats = {"a": [3, 3, 3, -1, 0], "b": [-2, -2, -2, -2, -2]}  # under `a`, more than under `b`
    about = {"condition": "CC3", "protocol": "human", "attempts": 3, "actions": 9}
    subjects = pd.DataFrame(
        {"learner": maker, "subject": subject, NATS + "a": -9.0 + more, NATS + "b": -9.0, **about}
        for maker, own in nats.items()
        for subject, more in enumerate(own)
    )
    units = units_of_subjects(subjects)
    assert units.query("learner == 'a'")["single"].dropna().tolist() == [1, 1, 1, 0, 0.5]
    # Of all five of `a`, of its first three and of the other two; and of all of `b`, and so on.
    groups = units[units["subjects"] > 1]
    assert groups["groups"].dropna().tolist() == [1, 1]
    assert groups["halves"].dropna().tolist() == [1, 0, 1, 1]
    assert sorted(groups["subjects"]) == [2, 2, 3, 3, 5, 5]
