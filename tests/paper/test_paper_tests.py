"""The paper's tests on a record: every number by other means, and what the section says."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from causal_openlock.analysis.effects import power_of_t, subjects_needed
from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.references import Beside
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import sections_of
from causal_openlock.paper.paper_tests import (
    TEST_COLUMNS,
    TESTS,
    outcome_text,
    paper_tests,
    power_table,
    printed_tests,
)
from causal_openlock.paper.references import people
from support.fabricated_records import trial_rows
from support.paper_play import material, play, same, scattered
from support.topics import topics_called

LEARNERS = ("good", "never", "always")


@pytest.fixture(autouse=True)
def _no_warnings() -> Iterator[None]:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        yield


def learner_tests(trials: pd.DataFrame, learner: str) -> pd.DataFrame:
    found = paper_tests(trials, (learner,))
    return found[found["learner"] == learner]


@pytest.fixture(scope="module")
def played() -> Material:
    rows = [*play("good", scattered(1)), *play("never", same(30)), *play("always", same(3))]
    return material(rows, LEARNERS)


@pytest.fixture(scope="module")
def wide(played: Material) -> pd.DataFrame:
    """Attempts of ``good`` by pandas alone: a row for each subject, a column for each trial."""
    frame = played.record.to_pandas()
    frame = frame[(frame["learner"] == "good") & (frame["solutions_found"] == 3)]
    key = ["condition", "subject", "phase", "trial"]
    return frame.groupby(key, observed=True)["attempt"].min().unstack(["phase", "trial"])


@pytest.fixture(scope="module")
def tests(played: Material) -> pd.DataFrame:
    return learner_tests(played.trials, "good").set_index(["family", "test"])


def test_people_are_as_printed_and_in_the_papers_order() -> None:
    people = printed_tests()
    assert people["paper"].tolist() == [
        "F(4,75)=40.16,p<.001", "F(1,78)=3.63,p=.06", "t(78)=2.00,p<.05",
        "F(5,152)=56.02,p<.001", "F(1,158)=0.11", "t(78)=0.87", "t(78)=0.48",
        "F(1,156)=24.94,p<.001", "t(78)=2.62,p=.01", "t(78)=4.27,p<.001", "F(1,158)=17.14,p<.001",
    ]  # fmt: skip
    for row in people.to_dict("records"):
        statistic = f"{row['statistic']}({row['df'].replace(' ', '')})={row['value']:.2f}"
        assert row["paper"].startswith(statistic)
        told = re.search(r"p([<=])(\.\d+)", row["paper"])
        if told and told[1] == "<":
            assert row["p"] < float(told[2])
        elif told:
            assert round(row["p"], 2) == float(told[2])
    assert people["difference"].tolist()[7:] == pytest.approx([4.3375, 2.65, 6.025, 3.8875])
    assert people["difference"][0] == pytest.approx((19.375 + 21.95 - 6.45 - 9.425) / 2)
    assert people["difference"][3:7].isna().all()  # no training trial is published


def test_degrees_of_freedom_with_forty_subjects_are_the_papers() -> None:
    rows = play("good", scattered(4), 40)
    own = paper_tests(material(rows, ("good",)).trials, ("good",))
    people, good = (own[own["learner"] == name] for name in ("People", "good"))
    assert good["df"].tolist() == people["df"].tolist()
    assert good["subjects"].tolist() == people["subjects"].tolist()
    assert good["statistic"].tolist() == people["statistic"].tolist()


def test_comparisons_of_groups_are_scipys(tests: pd.DataFrame, wide: pd.DataFrame) -> None:
    train, test = wide["train"], wide["test", 1]
    last = stats.ttest_ind(train[5]["CE4"], train[5]["CC4"])
    row = tests.loc[("baseline", "CE4 − CC4, last")]
    assert (row["value"], row["p"]) == pytest.approx((last.statistic, last.pvalue))
    assert row["difference"] == train[5]["CE4"].mean() - train[5]["CC4"].mean()
    baseline = train[[1, 2, 3, 4, 5]].mean(axis=1)
    whole = stats.f_oneway(baseline["CE4"], baseline["CC4"])
    row = tests.loc[("baseline", "CE4 − CC4")]
    assert (row["value"], row["p"]) == pytest.approx((whole.statistic, whole.pvalue))
    training = train.mean(axis=1)
    three = stats.f_oneway(
        pd.concat([training["CE3-CC4"], training["CE3-CE4"]]),
        pd.concat([training["CC3-CC4"], training["CC3-CE4"]]),
    )
    assert tests.loc[("training", "CE3 − CC3"), "value"] == pytest.approx(three.statistic)
    end = stats.ttest_ind(train[6]["CC3-CC4"], train[6]["CC3-CE4"])
    row = tests.loc[("training", "CC3, last: CC4 − CE4")]
    assert row["value"] == pytest.approx(end.statistic)
    simple = stats.ttest_ind(test["CC3-CE4"], test["CE3-CE4"])
    row = tests.loc[("transfer", "CE4: CC3 − CE3")]
    assert (row["value"], row["p"]) == pytest.approx((simple.statistic, simple.pvalue))
    assert row["effect_size"] == pytest.approx(simple.statistic * np.sqrt(2 / 12))
    tested = stats.f_oneway(
        pd.concat([test["CC3-CE4"], test["CE3-CE4"]]), pd.concat([test["CC3-CC4"], test["CE3-CC4"]])
    )
    row = tests.loc[("transfer", "CE4 − CC4")]
    assert (row["value"], row["df"]) == (pytest.approx(tested.statistic), "1, 46")


def test_the_trial_effect_of_one_group_by_hotelling(wide: pd.DataFrame) -> None:
    """Of a single group the multivariate test is Hotelling's T² of its differences."""
    from causal_openlock.paper.significance import trial_test

    values = wide.loc["CC4", "train"][[1, 2, 3, 4, 5]].to_numpy()
    steps = values[:, 1:] - values[:, :1]  # against the first trial: another base, the same test
    mean = steps.mean(axis=0)
    squared = 12 * mean @ np.linalg.inv(np.cov(steps.T)) @ mean
    assert trial_test([values]).value == pytest.approx(squared * 8 / (11 * 4))


def test_every_effect_of_the_made_up_learner_is_found(tests: pd.DataFrame) -> None:
    for name in (("baseline", "trials"), ("transfer", "interaction")):
        assert tests.loc[name, "p"] < 0.005
        assert tests.loc[name, "difference"] > 0


def test_without_variance_or_solutions_no_number_is_given(played: Material) -> None:
    for name, reason in (
        ("always", "not defined: every subject needed 3 attempts"),
        ("never", "not defined: no subject solved a trial within 30 attempts"),
    ):
        tests = learner_tests(played.trials, name)
        assert len(tests) == len(TESTS)
        assert tests["note"].str.startswith(reason).all()
        assert tests[["value", "p", "effect_size", "hedges_g"]].isna().all(axis=None)
        assert [outcome_text(row) for row in tests.to_dict("records")] == tests["note"].tolist()


def test_only_tests_of_conditions_that_were_played() -> None:
    rows = play("good", scattered(3), 4, ("CE4", "CC3-CC4", "CE3-CC4"))
    tests = learner_tests(material(rows, ("good",)).trials, "good")
    assert tests["test"].tolist() == ["CC4: CE3 − CC3"]
    assert tests.columns.tolist() == list(TEST_COLUMNS)
    assert learner_tests(material(rows, ("good",)).trials, "who").empty


def test_a_subject_that_misses_a_trial_is_left_out() -> None:
    rows = play("good", scattered(3), 6, ("CC4", "CE4"))
    whole = learner_tests(material(rows, ("good",)).trials, "good")
    rows += trial_rows([0, 0, 1, 2, 3], learner="good", subject=77)
    tests = learner_tests(attempts_to_solve(material(rows, ("good",)).record), "good")
    pd.testing.assert_frame_equal(tests, whole)


def test_an_outcome_is_printed_as_in_a_paper(tests: pd.DataFrame) -> None:
    people = [outcome_text(row) for row in printed_tests().to_dict("records")]
    spaced = [text.replace("\u00a0", " ") for text in people]  # lines break at commas alone
    assert spaced[0] == "F(4, 75) = 40.16, p < .001, ηp² = 0.68"
    assert spaced[2] == "t(78) = 2.00, p = .049, d = 0.45"


def written(held: Material) -> Section | None:
    return next(iter(sections_of(held, topics_called("paper_tests"))), None)


# -- the section ----------------------------------------------------------------------------------


def test_the_section_has_a_table_for_each_family_with_people_first(played: Material) -> None:
    section = written(played)
    assert section is not None
    assert [one.name for one in section.tables] == [
        "paper_tests_found", "paper_tests_baseline", "paper_tests_training", "paper_tests_transfer",
        "paper_tests_power", "paper_tests_all",
    ]  # fmt: skip
    for shown in section.tables[1:4]:
        assert shown.frame["learner"].tolist() == ["People (printed)", *LEARNERS]
        assert shown.frame["n"].tolist() == ["40", "12", "12", "12"]
    transfer = section.tables[3].frame.set_index("learner")["interaction"]
    assert transfer["People (printed)"].replace("\u00a0", " ").startswith("F(1, 156) = 24.94, p <")
    assert transfer["good"].replace("\u00a0", " ").startswith("F(1, 44) = ")
    assert transfer["always"] == "not defined: every subject needed 3 attempts"


def findings(held: Material) -> pd.DataFrame:
    section = written(held)
    assert section is not None
    found = section.tables[0].frame
    assert len(section.text) == 1
    return found.set_index("people")


def test_the_section_says_what_was_found(played: Material) -> None:
    found = findings(played)
    row = found.loc["Baseline trials: they need fewer attempts in later baseline trials"]
    assert row["printed"] == "F(4,75) = 40.16, p < 0.05"
    assert row["significant in"] == "good"
    assert row["not defined for"] == "never, always"
    assert row["opposite significant in"] == row["not significant in"] == "–"
    assert len(found) == len(TESTS)


def test_who_has_no_test_is_named_in_the_rows_that_lack_it() -> None:
    def half(condition: str, phase: str, trial: int, subject: int) -> int:
        return 30 if phase == "test" else 5 + (trial * subject + len(condition)) % (3 + trial)

    rows = [*play("good", scattered(1)), *play("half", half)]
    none = findings(material(rows, ("good", "half")))["not defined for"] == "half"
    transfer = none.index.str.startswith("Transfer")
    assert none[transfer].all()
    assert not none[~transfer].any()


def test_an_effect_the_other_way_round_is_called_so() -> None:
    def backwards(condition: str, phase: str, trial: int, subject: int) -> int:
        slow = phase == "test" and condition in ("CC3-CC4", "CE3-CE4")
        return 4 + trial + subject % 3 + 8 * slow

    found = findings(material(play("back", backwards), ("back",)))
    gain = "Transfer test: they gain more from training with the structure of the test than with "
    assert found.loc[f"{gain}the other", "opposite significant in"] == "back"
    harder = found.loc["Baseline trials: they find CE4 harder than CC4 over all baseline trials"]
    assert (harder["printed"], harder["not significant in"]) == ("F(1,78) = 3.63, p > 0.05", "back")


def test_people_and_learners_are_judged_alike_and_no_learner_by_the_others() -> None:
    """A learner that does as people in one test is told of it, whoever else is in the report."""
    rows = play("alike", scattered(3), subjects=40)
    few = written(material(rows, ("alike",)))
    others = [row for n in range(5) for row in play(f"r{n}", scattered(9 + n), subjects=40)]
    many = written(material(rows + others, ("alike", *(f"r{n}" for n in range(5)))))
    assert few is not None
    assert many is not None
    for one, other in zip(few.tables, many.tables, strict=True):
        if one.name.startswith("paper_tests_") and "learner" in one.frame:
            own, same = (t.frame.set_index("learner").loc["alike"] for t in (one, other))
            if one.name != "paper_tests_all":
                pd.testing.assert_series_equal(own, same)


def test_power_is_that_of_the_size_in_people() -> None:
    power = power_table(20).set_index("test")
    row = power.loc["Transfer test: CC4: CE3 − CC3"]
    d = 2.62 * np.sqrt(2 / 40)
    assert row["effect_size"] == pytest.approx(d)
    assert row["power_here"] == pytest.approx(power_of_t(d, 20))
    assert row["power_of_paper"] == pytest.approx(power_of_t(d, 40))
    assert row["subjects_needed"] == subjects_needed(d) == 47
    both = power.loc["Transfer test: CE4 − CC4"]  # two conditions on either side
    assert both["power_here"] == pytest.approx(power_of_t(np.sqrt(17.14 * 2 / 80), 40))


def test_who_did_something_else_is_not_tested(played: Material) -> None:
    other = Material(played.record, {}, played.trials, LEARNERS, (), {})
    assert written(other) is None
    cells = {("good", "CC4", "human"), ("good", "CE4", "human")}
    some = Material(played.record, {}, played.trials, LEARNERS, (Beside(people(), cells),), {})
    section = written(some)
    assert section is not None
    assert [one.name for one in section.tables] == [
        "paper_tests_found", "paper_tests_baseline", "paper_tests_power", "paper_tests_all",
    ]  # fmt: skip
    assert section.tables[1].frame["learner"].tolist() == ["People (printed)", "good"]
