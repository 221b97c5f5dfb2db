"""Who learns and who does not: the rule on courses whose truth is known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.prose import Prose
from causal_openlock.analysis.results.bounds import ideal_bounds
from causal_openlock.analysis.results.chance import chance_of_finding_all, chance_of_opening
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.visits import (
    FINDS_ALL,
    OPENS,
    each_group,
    many_attempts,
    matrix,
    shares,
    starts,
)
from causal_openlock.analysis.topics.learning import (
    FALLS,
    FLAT,
    LEARNS,
    NOT,
    SOME,
    TOPIC,
    UNDECIDED,
    by_verdict,
    judge,
    progress,
)
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_courses import around, course, described
from support.fabricated_records import random_cells, table, trial_rows
from support.made_up_experiments import material_of
from support.topics import section_on

RANDOM_AND_A = "conditions: [CC4]\nlearners: [random, {learner: ddqn, name: a}]\n"


def material(record: pa.Table, experiment: StoredExperiment) -> Material:
    return material_of(record, experiment, bounds=ideal_bounds(experiment))


# -- visits and parts -----------------------------------------------------------------------------


def test_visits_worked_by_hand() -> None:
    record = table(
        trial_rows([0, 1, 1, 2], trial=1, otherwise="unlock")
        + trial_rows([1, 2, 3, 3], trial=2)
        + trial_rows([0, 0], trial=3, otherwise="open1")
    )
    counted = attempts_to_solve(record)
    assert counted["last_attempt"].tolist() == [4, 4, 2]
    of = counted[["else", "unlock", "open1", "open2", "open3"]].to_numpy().tolist()
    assert of == [[0, 2, 1, 1, 0], [1, 0, 1, 1, 1], [0, 0, 2, 0, 0]]
    assert counted["solved"].tolist() == [False, True, False]
    whole = shares(counted, parts=1).iloc[0]
    assert (whole["opens"], whole["else"]) == (0.7, 0.1)
    assert whole["finds_all"] == pytest.approx(1 / 3)
    began = starts(counted).iloc[0]  # one in ten of four attempts is the first
    assert (began["opens"], began["finds_all"]) == (0.0, 0.0)


def test_categories_of_all_attempts_are_counted_on_random_records_in_any_order() -> None:
    cells = random_cells(5)
    counted = attempts_to_solve(pa.concat_tables(cells[::-1]))
    pd.testing.assert_frame_equal(counted, attempts_to_solve(pa.concat_tables(cells)))
    key = ["learner", "condition", "protocol", "subject", "phase", "loop", "trial"]
    rows = pa.concat_tables(cells).to_pandas().astype({"category": str})
    each = rows.groupby([*key, "category"], observed=True).size().unstack(fill_value=0)
    indexed = counted.astype(dict.fromkeys([*key[:3], "phase"], str)).set_index(key)
    for category in ("else", "unlock", "open1", "open2", "open3"):
        assert indexed[category].to_dict() == each[category].to_dict()


def test_parts_are_of_equally_many_visits_in_the_order_of_time() -> None:
    opens = np.arange(10) / 10
    parted = shares(attempts_to_solve(course(np.tile(opens, (2, 1)))), parts=5)
    wide = matrix(parted, OPENS)
    assert wide == pytest.approx(np.tile(opens.reshape(5, 2).mean(axis=1), (2, 1)))
    assert parted["visits"].tolist() == [2] * 10


def test_a_phase_of_fewer_visits_than_parts_has_a_part_for_each() -> None:
    wide = matrix(shares(attempts_to_solve(course([[0.0, 0.5, 1.0]])), parts=5), OPENS)
    assert wide.tolist() == [[0.0, 0.5, 1.0]]


def test_groups_come_in_the_order_that_is_asked_for() -> None:
    counted = attempts_to_solve(pa.concat_tables(random_cells(3)))
    counted["learner"] = counted["learner"].cat.reorder_categories(["b", "a"])
    groups = [group for group, _ in each_group(counted)]
    assert [group.learner for group in groups] == ["b"] * 6 + ["a"] * 6
    assert [group.protocol for group in groups[:6]] == ["human"] * 3 + ["loops"] * 3
    assert [group.condition for group in groups[:3]] == ["CE4", "CC3-CC4", "own"]


def test_protocols_that_stop_when_solved_are_left_out(tmp_path: Path) -> None:
    text = (
        "conditions: [CC4]\n"
        "learners: [random, {learner: random, name: b, protocol: goes_on},"
        " {learner: random, name: c, protocol: stops}]\n"
        "protocols: {goes_on: {stop_when_solved: false}, stops: {attempt_limit: 90}}\n"
    )
    assert many_attempts(described(tmp_path, text)) == {"rl", "goes_on"}


# -- the rule -------------------------------------------------------------------------------------

BAR = 0.001
ZERO = np.zeros(10)


@pytest.mark.parametrize(
    ("means", "spread", "expected"),
    [
        ([0.1, 0.3, 0.5, 0.5, 0.5], 0.02, LEARNS),
        ([0.5, 0.5, 0.5, 0.5, 0.5], 0.02, LEARNS),  # by the end of the first part already
        ([0.5, 0.5, 0.5, 0.4, 0.3], 0.02, LEARNS),  # a decline by less than half
        ([0.5, 0.5, 0.5, 0.4, 0.2], 0.02, FALLS),
        ([0.65, 0.47, 0.055, 0.011, 0.012], 0.005, FALLS),  # the paper's Figure 6, CE4
        ([0.0, 0.0, 0.0, 0.0, 0.0], 0.0, NOT),
        ([0.001, 0.001, 0.001, 0.001, 0.001], 0.0, NOT),  # chance itself
    ],
)
def test_verdict_on_a_course(means: list[float], spread: float, expected: str) -> None:
    assert judge(ZERO, around(means, spread=spread), BAR) == expected


def test_able_from_the_start_is_no_learning() -> None:
    start = around([0.6])[:, 0]
    assert judge(start, around([0.62] * 5, seed=1), BAR) == FLAT
    assert judge(start / 4, around([0.62] * 5, seed=1), BAR) == LEARNS


def test_one_subject_in_ten_does_not_make_a_group_learn() -> None:
    parts = np.zeros((10, 5))
    parts[0] = 0.9
    assert judge(ZERO, parts, BAR) == UNDECIDED  # a mean of .09 may be more than the margin
    parts[0] = 0.2
    assert judge(ZERO, parts, BAR) == NOT
    assert judge(ZERO, parts, BAR, counted=np.full(10, 60)) == SOME
    parts[:8] = 0.9
    assert judge(ZERO, parts, BAR, counted=np.full(10, 60)) == LEARNS


def test_a_subject_stands_out_only_in_the_last_part_and_beyond_luck() -> None:
    counted = np.full(10, 60)
    early = np.zeros((10, 5))
    early[0, :4] = 0.9
    assert judge(ZERO, early, BAR, counted) == NOT
    # Luck at .001: one of 60 in .058 of cases, two in .0017, three in .00003.
    for opened, verdict in ((1, NOT), (2, NOT), (3, SOME)):
        late = np.zeros((10, 5))
        late[0, 4] = opened / 60
        assert judge(ZERO, late, BAR, counted) == verdict
    assert judge(ZERO, late, 0.0, counted) == NOT  # chance is not known


def test_a_fall_of_few_subjects_is_undecided() -> None:
    parts = np.zeros((10, 5))
    parts[:, 1] = 0.1
    parts[:3, 1] = 0.9
    parts[9, 4] = 0.9  # in the end neither surely above chance nor surely below the best
    assert judge(ZERO, parts, BAR) == UNDECIDED


def test_few_subjects_are_undecided() -> None:
    assert judge(ZERO[:3], around([0.5] * 5, 3), BAR) == UNDECIDED
    assert judge(ZERO[:4], around([0.5] * 5, 4), BAR) == LEARNS


def test_random_subjects_seldom_seem_to_learn() -> None:
    # 60 groups of ten subjects, 600 attempts in each part, at the chance of CC4.
    rng = np.random.default_rng(3)
    chance, counted = 3 / 3375, np.full(10, 600)
    verdicts = [
        judge(ZERO, rng.binomial(600, chance, (10, 5)) / 600, chance, counted) for _ in range(60)
    ]
    assert verdicts.count(NOT) >= 51


# -- on a record ----------------------------------------------------------------------------------


def test_progress_on_a_record_whose_truth_is_known(tmp_path: Path) -> None:
    experiment = described(
        tmp_path,
        "conditions: [CC4]\nlearners: [random, {learner: ddqn, name: able},"
        " {learner: ddqn, name: falls}, {learner: ddqn, name: dull}]\n",
    )
    up, down = around([0.2, 0.4, 0.5, 0.6, 0.6]), around([0.2, 0.6, 0.5, 0.3, 0.1])
    record = pa.concat_tables(
        [
            course(up, learner="able", finds_all=up * 0 == 0),
            course(down, learner="falls"),
            course(around([0.0] * 5, spread=0), learner="dull"),
            course(around([0.0] * 5, spread=0), learner="random"),
            course(up, learner="able", protocol="human"),
            course(up, learner="able", phase="test"),
        ]
    )
    found = progress(attempts_to_solve(record), experiment).set_index(["learner", "measure"])
    assert found["verdict"].to_dict() == {
        ("able", OPENS): LEARNS,
        ("able", FINDS_ALL): FLAT,  # in the first visit already
        ("dull", OPENS): NOT,
        ("dull", FINDS_ALL): NOT,
        ("falls", OPENS): FALLS,
        ("falls", FINDS_ALL): NOT,
        ("random", OPENS): NOT,
        ("random", FINDS_ALL): NOT,
    }
    able = found.loc[("able", OPENS)]
    assert (able["subjects"], able["visits"], able["start"]) == (10, 5, 0.0)
    rounded = np.rint(up * 20) / 20
    assert able["first"] == pytest.approx(rounded[:, 0].mean())
    assert able["peak"] == pytest.approx(rounded.mean(axis=0).max())
    assert able["ci_low"] < able["last"] < able["ci_high"]
    assert able["random"] == 0.0
    cc4 = find_schema("CC4")
    assert able["chance"] == pytest.approx(chance_of_opening(cc4, 3, 7))
    all_found = chance_of_finding_all(cc4, 3, 7, 20)
    assert found.loc[("able", FINDS_ALL), "chance"] == pytest.approx(all_found)


def test_a_lucky_random_learner_raises_the_bar(tmp_path: Path) -> None:
    experiment = described(tmp_path, RANDOM_AND_A)
    mine = course(around([0.3] * 5))
    lucky = course(around([0.5] * 5, seed=1), learner="random")
    alone = progress(attempts_to_solve(mine), experiment)
    beside = progress(attempts_to_solve(pa.concat_tables([mine, lucky])), experiment)
    verdicts = beside[beside["measure"] == OPENS].set_index("learner")["verdict"]
    assert alone.loc[alone["measure"] == OPENS, "verdict"].tolist() == [LEARNS]
    assert verdicts["a"] == NOT
    assert verdicts["random"] == LEARNS  # itself it is judged against exact chance


def test_section_has_both_tables_and_says_the_verdicts(tmp_path: Path) -> None:
    experiment = described(tmp_path, RANDOM_AND_A)
    record = pa.concat_tables(
        [course(around([0.3] * 5)), course(around([0.0] * 5, spread=0), learner="random")]
    )
    made = section_on(TOPIC, material(record, experiment))
    assert made is not None
    assert [one.name for one in made.tables] == ["learning_door", "learning_all"]
    assert made.text[0] == "Opening the door. Learns: a (CC4). Does not learn: random (CC4)."
    for one in made.tables:
        assert one.frame["learner"].tolist() == ["random", "a"]
        assert set(one.formats) <= set(one.frame.columns)
        for column, how in one.formats.items():
            assert all(format(value, how) for value in one.frame[column])
    human = course(around([0.3] * 5), protocol="human")
    assert section_on(TOPIC, material(human, experiment)) is None


def said(rows: pd.DataFrame) -> str:
    return Prose("causal_openlock.analysis.topics.learning").sentence(
        "verdicts", found=by_verdict(rows)
    )


def test_verdicts_in_sentences_name_protocols_only_if_there_are_several() -> None:
    rows = pd.DataFrame(
        [("b", "CC4", "rl", LEARNS), ("a", "CC4", "rl", NOT), ("b", "CE4", "rl", LEARNS)],
        columns=["learner", "condition", "protocol", "verdict"],
    )
    assert said(rows) == "Learns: b (CC4, CE4). Does not learn: a (CC4)."
    rows.loc[2, "protocol"] = "long"
    expected = "Learns: b under rl (CC4); b under long (CE4). Does not learn: a (CC4)."
    assert said(rows) == expected


def test_verdicts_that_hold_in_every_condition_are_said_once() -> None:
    rows = pd.DataFrame(
        {"learner": "a", "condition": ["CC4", "CE4", "own"], "protocol": "rl", "verdict": NOT}
    )
    assert said(rows) == "Does not learn: a (every condition)."
    rows.loc[1, "verdict"] = FALLS
    assert said(rows) == "Rises, then falls: a (CE4). Does not learn: a (CC4, own)."
