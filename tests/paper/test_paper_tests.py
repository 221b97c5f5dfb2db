"""The paper's tests on a record: every number by other means, and the tables of the section."""

import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.paper.paper_tests import TESTS, TOPIC, paper_tests, printed_tests
from causal_openlock.paper.references import people
from causal_openlock.world import facts
from support.fabricated_records import trial_rows
from support.paper_play import material, play, same, scattered
from support.topics import section_on

LEARNERS = ("good", "never", "always")


@pytest.fixture(autouse=True)
def _no_warnings():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def learner_tests(trials, learner):
    found = paper_tests(trials, (learner,))
    return found[found["learner"] == learner]


@pytest.fixture(scope="module")
def played():
    rows = [*play("good", scattered(1)), *play("never", same(30)), *play("always", same(3))]
    return material(rows, LEARNERS)


@pytest.fixture(scope="module")
def wide(played):
    """Attempts of ``good`` by pandas alone: a row for each subject, a column for each trial."""
    frame = played.record.to_pandas()
    frame = frame[(frame["learner"] == "good") & (frame["solutions_found"] == 3)]
    key = ["condition", "subject", "phase", "trial"]
    return frame.groupby(key, observed=True)["attempt"].min().unstack(["phase", "trial"])


@pytest.fixture(scope="module")
def tests(played):
    return learner_tests(played.trials, "good").set_index(["family", "test"])


def test_people_are_as_printed_and_in_the_papers_order():
    people = printed_tests()
    shown = people.to_dict("records")
    assert [f"{row['statistic']}({row['df']}) = {row['value']:.2f}" for row in shown] == [
        *("F(4, 75) = 40.16", "F(1, 78) = 3.63", "t(78) = 2.00"),
        *("F(5, 152) = 56.02", "F(1, 158) = 0.11", "t(78) = 0.87", "t(78) = 0.48"),
        *("F(1, 156) = 24.94", "t(78) = 2.62", "t(78) = 4.27", "F(1, 158) = 17.14"),
    ]
    assert people["effect_size"][0] == pytest.approx(0.68, abs=0.005)
    printed = facts.results()["cogsci2018"]["human"]["statistics"]
    for test, p in zip(TESTS, people["p"], strict=True):
        told = printed[test.key].get("p", "<1")
        assert p < float(told[1:]) if told[0] == "<" else round(p, 2) == float(told[1:])
    assert people["difference"].tolist()[7:] == pytest.approx([4.3375, 2.65, 6.025, 3.8875])
    assert people["difference"][0] == pytest.approx((19.375 + 21.95 - 6.45 - 9.425) / 2)
    assert people["difference"][3:7].isna().all()  # no training trial is published


def test_degrees_of_freedom_with_forty_subjects_are_the_papers():
    own = paper_tests(material(play("good", scattered(4), 40), ("good",)).trials, ("good",))
    people, good = (own[own["learner"] == name] for name in ("People", "good"))
    for column in ("df", "subjects", "statistic"):
        assert good[column].tolist() == people[column].tolist()


def test_comparisons_of_groups_are_scipys(tests, wide):
    train, test = wide["train"], wide["test", 1]
    baseline, training = train[[1, 2, 3, 4, 5]].mean(axis=1), train.mean(axis=1)

    def both(of, *conditions):
        return pd.concat([of[name] for name in conditions])

    for name, expected, difference in (
        (("baseline", "CE4 − CC4, last"), stats.ttest_ind, (train[5]["CE4"], train[5]["CC4"])),
        (("baseline", "CE4 − CC4"), stats.f_oneway, (baseline["CE4"], baseline["CC4"])),
        (
            ("training", "CE3 − CC3"),
            stats.f_oneway,
            (both(training, "CE3-CC4", "CE3-CE4"), both(training, "CC3-CC4", "CC3-CE4")),
        ),
        (
            ("training", "CC3, last: CC4 − CE4"),
            stats.ttest_ind,
            (train[6]["CC3-CC4"], train[6]["CC3-CE4"]),
        ),
        (("transfer", "CE4: CC3 − CE3"), stats.ttest_ind, (test["CC3-CE4"], test["CE3-CE4"])),
        (
            ("transfer", "CE4 − CC4"),
            stats.f_oneway,
            (both(test, "CC3-CE4", "CE3-CE4"), both(test, "CC3-CC4", "CE3-CC4")),
        ),
    ):
        found, row = expected(*difference), tests.loc[name]
        assert (row["value"], row["p"]) == pytest.approx((found.statistic, found.pvalue))
        assert row["difference"] == pytest.approx(difference[0].mean() - difference[1].mean())
    row = tests.loc[("transfer", "CE4: CC3 − CE3")]
    assert row["effect_size"] == pytest.approx(row["value"] * np.sqrt(2 / 12))
    assert tests.loc[("transfer", "CE4 − CC4"), "df"] == "1, 46"
    for name in (("baseline", "trials"), ("transfer", "interaction")):
        assert tests.loc[name, "p"] < 0.005
        assert tests.loc[name, "difference"] > 0


def test_without_variance_or_solutions_no_number_is_given(played):
    for name in ("always", "never"):
        tests = learner_tests(played.trials, name)
        assert len(tests) == len(TESTS)
        assert tests[["value", "p", "effect_size", "hedges_g"]].isna().all(axis=None)


def test_conditions_and_subjects_that_are_not_whole_are_left_out():
    rows = play("good", scattered(3), 4, ("CE4", "CC3-CC4", "CE3-CC4"))
    tests = learner_tests(material(rows, ("good",)).trials, "good")
    assert tests["test"].tolist() == ["CC4: CE3 − CC3"]
    assert tests.columns.tolist() == printed_tests().columns.tolist()
    assert learner_tests(material(rows, ("good",)).trials, "who").empty
    rows = play("good", scattered(3), 6, ("CC4", "CE4"))
    whole = learner_tests(material(rows, ("good",)).trials, "good")
    rows += trial_rows([0, 0, 1, 2, 3], learner="good", subject=77)
    tests = learner_tests(attempts_to_solve(material(rows, ("good",)).record), "good")
    pd.testing.assert_frame_equal(tests, whole)


def tables(held):
    """The tables of the section by name; none if there is no section."""
    section = section_on(TOPIC, held)
    return {
        one.name.removeprefix("paper_tests_"): one.frame
        for one in (section.tables if section else ())
    }


def test_an_effect_in_the_other_direction_stands_in_its_own_column():
    def backwards(condition, phase, trial, subject):
        slow = phase == "test" and condition in ("CC3-CC4", "CE3-CE4")
        return 4 + trial + subject % 3 + 8 * slow

    found = tables(material(play("back", backwards), ("back",)))["found"].set_index("people")
    gain = found[found.index.str.startswith("Transfer test: they gain more from training with")]
    assert gain["opposite significant in"].tolist() == ["back"]
    harder = found[found["printed"] == "F(1, 78) = 3.63, p > 0.05"]
    assert harder["not significant in"].tolist() == ["back"]


def test_learners_that_did_something_else_are_not_tested(played):
    assert tables(replace(played, references=())) == {}
    cells = {("good", "CC4", "human"), ("good", "CE4", "human")}
    beside = (replace(people(), cells=cells),)
    found = tables(replace(played, references=beside))
    assert found["all"]["learner"].tolist() == ["People", "good"] * 3
    assert set(found["all"]["family"]) == {"baseline"}
