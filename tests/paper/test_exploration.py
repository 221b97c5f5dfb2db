"""Whether fast exploration learns: the sentence on records whose truth is known."""

from __future__ import annotations

import math
from pathlib import Path

import pyarrow as pa
import pytest

from causal_openlock.analysis.results.references import references_beside
from causal_openlock.analysis.section import Section
from causal_openlock.paper.exploration import TOPIC, schedules
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_courses import around, course, described
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import material_of
from support.topics import section_on

DECAYS = (
    "conditions: [CC4, CE4]\n"
    "learners:\n"
    "  - random\n"
    "  - {learner: ddqn, name: usual}\n"
    "  - {learner: ddqn, name: fast, parameters: {epsilon_decay: 0.743}}\n"
    "  - {learner: ddqn, name: each_trial, parameters: {epsilon_decay: 0.548,"
    " epsilon_decays_with: trial, epsilon_after_trial: null}}\n"
)


def made(record: pa.Table, experiment: StoredExperiment) -> Section | None:
    return section_on(
        TOPIC, material_of(record, experiment, references=references_beside(experiment))
    )


def courses(shares: dict[tuple[str, str], float]) -> pa.Table:
    return pa.concat_tables(
        [
            course(
                around([share] * 5, spread=0.02 if share else 0),
                learner=learner,
                condition=condition,
                schema=condition,
            )
            for (learner, condition), share in shares.items()
        ]
    )


def test_schedules_worked_by_hand(tmp_path: Path) -> None:
    found = schedules(described(tmp_path, DECAYS)).set_index("learner")
    assert found.index.tolist() == ["usual", "fast", "each_trial"]
    assert found["steps"].tolist() == [919, 16, 8]
    assert found["after_trial"].tolist()[:2] == [0.5, 0.5]
    assert math.isnan(found["after_trial"].iloc[2])
    # .743 ** k adds up to 3.86 down to .01, which the rest of 900 actions then keep.
    geometric = sum(0.743**k for k in range(16)) + 884 * 0.01
    assert found.loc["fast", "first_trial"] == pytest.approx(geometric)
    assert found.loc["each_trial", ["first_trial", "later_trial"]].tolist() == pytest.approx(
        [900, 0.548 * 900]
    )


def test_what_the_paper_says_is_recognised(tmp_path: Path) -> None:
    record = courses(
        {
            ("usual", "CC4"): 0.6,
            ("fast", "CC4"): 0.0,
            ("each_trial", "CC4"): 0.5,
            ("usual", "CE4"): 0.6,
            ("fast", "CE4"): 0.1,  # learns, and less than half as well
            ("each_trial", "CE4"): 0.0,
        }
    )
    found = made(record, described(tmp_path, DECAYS))
    assert found is not None
    assert [one.name for one in found.tables] == ["exploration", "people_decay"]
    fast, each_trial = found.text[-2:]
    assert fast.startswith(
        "fast (epsilon shrinks by 0.743 with every action): no meaningful learning, as the paper "
        "says; in CC4 0.0% (0.0% to 0.0%) of its last attempts open the door, with a usual decay "
    )
    assert "each_trial (epsilon shrinks by 0.548 with every trial): not the same in" in each_trial
    assert ": meaningful learning; in CE4 0.0% " in each_trial
    assert each_trial.endswith(": no meaningful learning.")
    for one in found.tables:
        for column, how in one.formats.items():
            assert all(format(value, how) for value in one.frame[column])
    told = found.tables[0].frame
    assert told["learner"].tolist() == ["usual"] * 2 + ["fast"] * 2 + ["each_trial"] * 2
    none = "no meaningful learning"
    assert told["meaning"].tolist() == ["", "", none, none, "meaningful learning", none]
    assert told["verdict"].tolist()[:4] == ["learns", "learns", "does not learn", "learns"]


def test_the_contrary_is_recognised(tmp_path: Path) -> None:
    both = {("usual", "CC4"): 0.6, ("fast", "CC4"): 0.55, ("each_trial", "CC4"): 0.6}
    found = made(courses(both), described(tmp_path, DECAYS))
    assert found is not None
    assert all("meaningful learning, unlike in the paper" in line for line in found.text[-2:])


def test_where_nobody_learns_nothing_can_be_told(tmp_path: Path) -> None:
    both = {("usual", "CC4"): 0.0, ("fast", "CC4"): 0.0, ("each_trial", "CC4"): 0.3}
    found = made(courses(both), described(tmp_path, DECAYS))
    assert found is not None
    for line in found.text[-2:]:
        assert "): undecided; in CC4 " in line
        assert line.endswith("with a usual decay nothing is learned.")


def test_subjects_that_differ_widely_leave_it_undecided(tmp_path: Path) -> None:
    half = around([0.0] * 5, spread=0)
    half[:5] = 0.6
    record = pa.concat_tables([courses({("usual", "CC4"): 0.6}), course(half, learner="fast")])
    found = made(record, described(tmp_path, DECAYS))
    assert found is not None
    assert "every action): undecided; in CC4 30.0% (" in found.text[-1]


def test_people_are_beside_learners_that_did_what_they_did(tmp_path: Path) -> None:
    experiment = described(
        tmp_path, "conditions: [CC4]\nlearners: [{learner: ddqn, protocol: human, name: a}]\n"
    )
    rows = []
    for trial, length in enumerate((16, 8, 4, 4, 4), 1):
        for subject in range(4):
            rows += trial_rows([0] * (length - 3) + [1, 2, 3], trial=trial, subject=subject)
    found = made(table(rows), experiment)
    assert found is not None
    assert [one.name for one in found.tables] == ["people_decay", "learners_decay"]
    mine = found.tables[1].frame.set_index("form")
    assert mine["curve"].tolist() == ["a, CC4"] * 3
    assert mine.loc["with offset", "offset"] < 4.1
    assert "cannot be recovered" in found.text[0]


def test_nothing_is_said_where_exploration_does_not_differ(tmp_path: Path) -> None:
    one = described(tmp_path, "conditions: [CC4]\nlearners: [{learner: ddqn, name: a}, random]\n")
    assert made(course(around([0.5] * 5)), one) is None


def test_nothing_is_said_of_learners_whose_exploration_never_shrinks(tmp_path: Path) -> None:
    experiment = described(
        tmp_path, "conditions: [CC4]\nlearners: [{learner: random, protocol: human, name: a}]\n"
    )
    rows = [row for trial in range(1, 6) for row in trial_rows([0, 1, 2, 3], trial=trial)]
    assert made(table(rows), experiment) is None
