"""Studies of what learners measure of themselves, while they play."""

import pytest

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import read_study

BASIC = "{learner: ddqn, name: basic, reward: basic, parameters: {hidden_units: 4, batch_size: 4}}"
EXPERIMENT = f"""
name: two
seed: 4
subjects: 2
cell_size: 1
protocol: brief
conditions: [CC3]
protocols: {{brief: {{based_on: rl, attempt_limit: 4, baseline_loops: 1, baseline_trials: 2}}}}
learners:
  - {BASIC}
  - {BASIC.replace("basic", "unique", 1).replace("basic", "unique_solutions")}
"""
STUDY = """
title: Whether rewards differ
experiment: experiment.yaml
measured: metrics
hours: 0.01
claims:
  differ:
    text: Rewards for unique solutions differ
    contrasts:
      CC3:
        {measure: differing_pairs, of: {learner: unique, condition: CC3}, minus: 0.01,
         expected: more}
tables:
  differing_pairs: {measure: differing_pairs, columns: [CC3], rows: {basic: basic, unique: unique}}
"""


@pytest.fixture
def folder(tmp_path):
    folder = tmp_path / "evidence" / "small"
    folder.mkdir(parents=True)
    (folder / "experiment.yaml").write_text(EXPERIMENT, encoding="utf-8")
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    return folder


def test_metrics_of_visits_are_the_units_and_are_not_played_twice(folder, tmp_path):
    study, said = read_study(folder), []
    run_study(study, tmp_path / "results", Watched(said.append))
    assert len(said) == 4
    units = Evidence(study).own_units.set_index("learner")
    assert units["unit"].tolist() == [0, 1] * 2
    assert set(units["trials"]) == {2}
    assert units["differing_pairs"].between(0, 1).all()
    write(tmp_path / "evidence")
    assert check(tmp_path / "evidence") == []
    run_study(study, tmp_path / "results", Watched(said.append))
    assert len(said) == 4
    assert Evidence(study).verdict("differ") == "undecided"


@pytest.mark.parametrize(
    ("old", "new", "named"),
    [("cell_size: 1", "cell_size: 3", "cell_size: 1"), (BASIC, "random", "differing_pairs")],
)
def test_a_learner_without_metrics_of_its_own_is_refused(folder, tmp_path, old, new, named):
    (folder / "experiment.yaml").write_text(EXPERIMENT.replace(old, new))
    (folder / "study.yaml").write_text(STUDY.replace("basic: basic, ", ""))
    with pytest.raises(EvidenceError, match=named):
        run_study(read_study(folder), tmp_path / "results", Watched())
