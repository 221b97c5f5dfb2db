"""Who learns and who does not, and which rewards: the rules on courses whose truth is known."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.results.bounds import ideal_bounds
from causal_openlock.analysis.topics import learning, reward_study
from causal_openlock.analysis.topics.learning import (
    FALLS,
    FLAT,
    LEARNS,
    NOT,
    OPENS,
    SOME,
    UNDECIDED,
    going_on,
    judge,
    matrix,
    progress,
    shares,
    starts,
)
from support.fabricated_courses import around, course, described
from support.fabricated_records import table, trial_rows
from support.made_up_experiments import material_of
from support.topics import section_on

RANDOM_AND_A = "conditions: [CC4]\nlearners: [random, {learner: ddqn, name: a}]\n"


def test_visits_worked_by_hand():
    record = table(
        trial_rows([0, 1, 1, 2], trial=1, otherwise="unlock")
        + trial_rows([1, 2, 3, 3], trial=2)
        + trial_rows([0, 0], trial=3, otherwise="open1")
    )
    counted = attempts_to_solve(record)
    assert counted["last_attempt"].tolist() == [4, 4, 2]
    of = counted[["neither", "unlock", "open1", "open2", "open3"]].to_numpy().tolist()
    assert of == [[0, 2, 1, 1, 0], [1, 0, 1, 1, 1], [0, 0, 2, 0, 0]]
    assert counted["solved"].tolist() == [False, True, False]
    whole = shares(counted, parts=1).iloc[0]
    assert (whole["opens"], whole["else"]) == (0.7, 0.1)
    assert whole["finds_all"] == pytest.approx(1 / 3)
    began = starts(counted).iloc[0]  # one in ten of four attempts is the first
    assert (began["opens"], began["finds_all"]) == (0.0, 0.0)


def test_parts_are_of_equally_many_visits_in_the_order_of_time():
    opens = np.arange(10) / 10
    parted = shares(attempts_to_solve(course(np.tile(opens, (2, 1)))), parts=5)
    wide = matrix(parted, OPENS)
    assert wide == pytest.approx(np.tile(opens.reshape(5, 2).mean(axis=1), (2, 1)))
    assert parted["visits"].tolist() == [2] * 10
    fewer = matrix(shares(attempts_to_solve(course([[0.0, 0.5, 1.0]])), parts=5), OPENS)
    assert fewer.tolist() == [[0.0, 0.5, 1.0]]  # a part for each visit


def test_protocols_that_stop_when_solved_are_left_out(tmp_path):
    text = (
        "conditions: [CC4]\n"
        "learners: [random, {learner: random, name: b, protocol: goes_on},"
        " {learner: random, name: c, protocol: stops}]\n"
        "protocols: {goes_on: {stop_when_solved: false}, stops: {attempt_limit: 90}}\n"
    )
    trials = pd.DataFrame({"protocol": ["rl", "goes_on", "stops", "human"]})
    assert going_on(trials, described(tmp_path, text))["protocol"].tolist() == ["rl", "goes_on"]


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
def test_verdict_on_a_course(means, spread, expected):
    assert judge(ZERO, around(means, spread=spread), BAR) == expected


def test_able_from_the_start_is_no_learning():
    start = around([0.6])[:, 0]
    assert judge(start, around([0.62] * 5, seed=1), BAR) == FLAT
    assert judge(start / 4, around([0.62] * 5, seed=1), BAR) == LEARNS


def test_one_subject_in_ten_does_not_make_a_group_learn():
    parts = np.zeros((10, 5))
    parts[0] = 0.9
    assert judge(ZERO, parts, BAR) == UNDECIDED  # a mean of .09 may be more than the margin
    parts[0] = 0.2
    assert judge(ZERO, parts, BAR) == NOT
    assert judge(ZERO, parts, BAR, counted=np.full(10, 60)) == SOME
    parts[:8] = 0.9
    assert judge(ZERO, parts, BAR, counted=np.full(10, 60)) == LEARNS


def test_a_subject_stands_out_only_in_the_last_part_and_beyond_luck():
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


def test_few_subjects_are_undecided():
    parts = np.zeros((10, 5))
    parts[:, 1] = 0.1
    parts[:3, 1] = 0.9
    parts[9, 4] = 0.9  # in the end neither surely above chance nor surely below the best
    assert judge(ZERO, parts, BAR) == UNDECIDED
    assert judge(ZERO[:4], around([0.5] * 5, 4), BAR) == UNDECIDED
    assert judge(ZERO[:5], around([0.5] * 5, 5), BAR) == LEARNS


def test_random_subjects_seldom_seem_to_learn():
    # 60 groups of ten subjects, 600 attempts in each part, at the chance of CC4.
    rng = np.random.default_rng(3)
    chance, counted = 3 / 3375, np.full(10, 600)
    verdicts = [
        judge(ZERO, rng.binomial(600, chance, (10, 5)) / 600, chance, counted) for _ in range(60)
    ]
    assert verdicts.count(NOT) >= 51


def test_a_lucky_random_learner_raises_the_bar(tmp_path):
    experiment = described(tmp_path, RANDOM_AND_A)
    mine = course(around([0.3] * 5))
    lucky = course(around([0.5] * 5, seed=1), learner="random")
    alone = progress(attempts_to_solve(mine), experiment)
    beside = progress(attempts_to_solve(pa.concat_tables([mine, lucky])), experiment)
    verdicts = beside[beside["measure"] == OPENS].set_index("learner")["verdict"]
    assert alone.loc[alone["measure"] == OPENS, "verdict"].tolist() == [LEARNS]
    assert verdicts["a"] == NOT
    assert verdicts["random"] == LEARNS  # itself it is judged against exact chance


def test_verdicts_name_protocols_and_conditions_only_if_there_are_several(tmp_path):
    def first_sentence(*courses, conditions="CC4"):
        text = RANDOM_AND_A.replace("CC4", conditions)
        experiment = described(tmp_path, text)
        _, a = experiment.learners
        long = replace(a, protocol=replace(a.protocol, name="long"))
        experiment = replace(experiment, learners=(*experiment.learners, long))
        held = material_of(pa.concat_tables(courses), experiment, bounds=ideal_bounds(experiment))
        section = section_on(learning.TOPIC, held)
        return section and section.text[0].partition(". ")[2]

    def of(learner, share, condition="CC4", protocol="rl"):
        spread = 0.02 if share else 0
        values = {"condition": condition, "schema": condition, "protocol": protocol}
        return course(around([share] * 5, spread=spread), learner=learner, **values)

    dull, able = of("random", 0.0), of("a", 0.3)
    assert first_sentence(able, dull) == "Learns: a (CC4). Does not learn: random (CC4)."
    assert first_sentence(of("a", 0.3, protocol="human")) is None
    each = [of("a", 0.0, name) for name in ("CC4", "CE4", "CC3")]
    whole = first_sentence(*each, conditions="CC4, CE4, CC3")
    assert whole == "Does not learn: a (CC4, CE4, CC3)."
    mixed = first_sentence(each[0], of("a", 0.5, "CE4"), each[2], conditions="CC4, CE4, CC3")
    assert mixed == "Learns: a (CE4). Does not learn: a (CC4, CC3)."
    both = first_sentence(able, of("a", 0.0, protocol="long"))
    assert both == "Learns: a under rl (CC4). Does not learn: a under long (CC4)."


REWARDS = (
    "conditions: [CC4, CE4]\n"
    "learners:\n"
    "  - random\n"
    "  - {learner: ddqn, name: basic, reward: basic}\n"
    "  - {learner: ddqn, name: unique, reward: unique_solutions}\n"
    "  - {learner: ddqn, name: unique18, reward: authors_2018_change_state_unique_solutions}\n"
    "  - {learner: ddqn, name: best, reward: paper}\n"
)


def study(experiment, finds_all=(), **both):
    """The section on courses with the same share throughout, by learner in CC4 and in CE4."""
    record = pa.concat_tables(
        [
            course(
                around([share] * 5, spread=0.02 if share > 0.2 else 0),
                finds_all=learner in finds_all,
                learner=learner,
                condition=condition,
                schema=condition,
            )
            for learner, shares_ in both.items()
            for condition, share in zip(("CC4", "CE4"), shares_, strict=True)
        ]
    )
    return section_on(reward_study.TOPIC, material_of(record, experiment))


def test_the_contrary_of_what_the_paper_says_is_recognised(tmp_path):
    shares_ = {"basic": (0.5, 0.31), "unique": (0.8, 0.8), "unique18": (0.5, 0.5)}
    experiment = described(tmp_path, REWARDS)
    found = study(experiment, ("unique", "unique18"), best=(0.3, 0.3), **shares_)
    for sentence in found.text[:2]:
        assert ": otherwise, in every condition something is learned. " in sentence
    best = found.text[2]
    assert best.count("Surely more often finds every solution unique (100.0%), unique18 (") == 2
    assert "basic" not in best  # it opens the door more often, which is not asked for
    assert found.tables[0].frame.loc[0, "learner"] == "unique"
    # Three in twenty attempts: what an agent optimal for unique solutions alone would do.
    one = described(tmp_path, REWARDS.replace("  - {learner: ddqn, name: unique18", "  #"))
    found = study(one, ("unique",), unique=(0.15, 0.15), best=(0.6, 0.6))
    assert ": otherwise, in every condition something is learned. " in found.text[0]
    assert "Surely more often finds every solution unique (100.0%)." in found.text[2]


def test_rewards_that_learn_in_part_and_too_few_rewards(tmp_path):
    found = study(described(tmp_path, REWARDS), unique=(0.5, 0.0), unique18=(0.0, 0.0))
    assert ": the same, in every condition. " in found.text[0]
    assert ": otherwise in part. Learns: unique (CC4). Does not learn: " in found.text[1]
    assert len(found.text) == 3  # nobody got the paper's best
    two = REWARDS.replace("  - {learner: ddqn, name: unique", "  #")
    assert study(described(tmp_path, two), basic=(0.5, 0.5), best=(0.5, 0.5)) is None
