"""Studies of what learners measure of themselves, while they play."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.checking import check, write
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import Study, read_study

EXPERIMENT = """
name: two
seed: 4
subjects: 2
cell_size: 1
protocol: brief
conditions: [CC3]
protocols: {brief: {based_on: rl, attempt_limit: 4, baseline_loops: 1, baseline_trials: 2}}
learners:
  - {learner: ddqn, name: basic, reward: basic, parameters: *small}
  - {learner: ddqn, name: unique, reward: unique_solutions, parameters: *small}
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
      CC3: {measure: differing_pairs, of: {learner: unique, condition: CC3}, minus: 0.01, expected: more}
tables:
  differing_pairs: {measure: differing_pairs, columns: [CC3], rows: {basic: basic, unique: unique}}
"""  # noqa: E501


def study(root: Path, experiment: str = EXPERIMENT) -> Study:
    folder = root / "evidence" / "small"
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "experiment.yaml").write_text(experiment.replace("*small", SMALL), encoding="utf-8")
    (folder / "study.yaml").write_text(STUDY, encoding="utf-8")
    return read_study(folder)


SMALL = "{hidden_units: 4, batch_size: 4}"


def test_metrics_of_visits_are_the_units_and_are_not_played_twice(tmp_path: Path) -> None:
    one, said = study(tmp_path), list[str]()
    run_study(one, tmp_path / "results", Watched(said.append))
    assert len(said) == 4
    units = Evidence(one).own_units.set_index("learner")
    assert units["unit"].tolist() == [0, 1] * 2
    assert set(units["trials"]) == {2}
    assert units["differing_pairs"].between(0, 1).all()
    write(tmp_path / "evidence")
    assert check(tmp_path / "evidence") == []
    run_study(one, tmp_path / "results", Watched(said.append))
    assert len(said) == 4
    assert Evidence(one).verdict("differ") == "undecided"


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        (("cell_size: 1", "cell_size: 3"), "write cell_size: 1"),
        (("learner: ddqn, name: basic, reward: basic, parameters: *small", "learner: random, "
          "name: basic"), "has no metric differing_pairs and"),
    ],
)  # fmt: skip
def test_what_has_no_metrics_of_its_own_is_an_error(
    tmp_path: Path, change: tuple[str, str], reason: str
) -> None:
    one = study(tmp_path, EXPERIMENT.replace(*change))
    with pytest.raises(EvidenceError, match=reason):
        run_study(one, tmp_path / "results", Watched())
