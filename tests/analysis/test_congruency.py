"""Whether congruent training helps, and what training saves."""

import warnings

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy import stats

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.summary import judged
from causal_openlock.analysis.topic import sections_of
from causal_openlock.analysis.topics.congruency import COMPARED, congruency, plot_congruency
from causal_openlock.analysis.topics.savings import savings, share_saved
from causal_openlock.paper.paper_tests import paper_tests
from causal_openlock.wording import file_names
from support.fabricated_records import table, trial_rows
from support.paper_play import material, play, same, scattered
from support.topics import topics_called


def section_of(held, topic="congruency"):
    return next(iter(sections_of(held, topics_called(topic))), None)


@pytest.fixture(scope="module")
def played():
    rows = [*play("good", scattered(1)), *play("never", same(30)), *play("always", same(3))]
    return material(rows, ("good", "never", "always"))


@pytest.fixture(scope="module")
def found(played):
    return congruency(played).set_index(["learner", "test"])


@pytest.fixture(scope="module")
def tests_of_good(played):
    """By condition, the attempts of every subject in its test, from the record by pandas alone."""
    frame = played.record.to_pandas()
    solved = frame[frame["new_solution"] & (frame["solutions_found"] == 3)]
    key = ["learner", "condition", "phase", "trial", "subject"]
    needed = solved.groupby(key, observed=True)["attempt"].first()["good"]
    names = [name for pair in COMPARED.values() for name in pair]
    return {name: needed[name, "test", 1].to_numpy(float) for name in names}


def test_the_effect_is_students_t_of_scipy(found, tests_of_good):
    for test, (congruent, other) in COMPARED.items():
        row = found.loc[("good", test)]
        theirs = stats.ttest_ind(tests_of_good[other], tests_of_good[congruent])
        assert row["saved"] == tests_of_good[other].mean() - tests_of_good[congruent].mean()
        assert row["congruent"] == tests_of_good[congruent].mean()
        assert row["incongruent"] == tests_of_good[other].mean()
        numbers = [*theirs.confidence_interval(), theirs.pvalue]
        assert row[["low", "high", "p"]].tolist() == pytest.approx(numbers)
        assert (row["subjects"], row["solved"]) == (12, 1)


def test_the_papers_tests_answer_the_same_question_alike(played, found):
    tests = paper_tests(played.trials, ["good"]).set_index(["learner", "test"])
    for name, test in (("CC4: CE3 − CC3", "CC4"), ("CE4: CC3 − CE3", "CE4")):
        one, other = tests.loc[("good", name)], found.loc[("good", test)]
        assert (one["difference"], one["p"]) == pytest.approx((other["saved"], other["p"]))
        of_people = found.loc[("people", test)]
        assert tests.loc[("People", name)]["p"] == pytest.approx(of_people["p"], abs=2e-4)


def test_the_effect_beyond_people_is_welchs(found, tests_of_good):
    row = found.loc[("good", "CE4")]
    errors = [tests_of_good[name].std(ddof=1) ** 2 / 12 for name in COMPARED["CE4"]]
    errors += [(se * np.sqrt(40 / 39)) ** 2 for se in (0.769, 1.162)]
    parts = sum(e**2 / 11 for e in errors[:2]) + sum(e**2 / 39 for e in errors[2:])
    half = np.sqrt(sum(errors)) * stats.t.isf(0.025, sum(errors) ** 2 / parts)
    assert row["to_people"] == pytest.approx(row["saved"] - (13.75 - 7.725), abs=1e-3)
    assert row["to_people_high"] - row["to_people_low"] == pytest.approx(2 * half, rel=1e-3)
    assert found.loc["people", "to_people"].isna().all()
    assert found.loc["people", "subjects"].tolist() == [40, 40]


def test_the_limit_says_nothing_of_who_solved_nothing(played, found):
    never = found.loc["never"]
    assert (never["solved"] == 0).all()
    assert never[["saved", "low", "high", "p", "to_people"]].isna().all(axis=None)
    assert (found.loc["always", "saved"] == 0).all()  # and zero it is where trials are solved
    rows = [label.get_text() for label in plot_congruency(played, ax=Figure())[0].get_yticklabels()]
    assert rows == ["people", "published model", "good", "always"]
    (left, _) = plot_congruency(played, learners=["never"], ax=Figure())
    assert [text.get_text() for text in left.texts] == ["solved no trial"]
    assert left.get_title(loc="left") == "Test of CC4"


def test_a_condition_is_judged_by_the_last_trial_of_its_last_loop():
    rows = []
    for loop in (1, 2):
        for trial in (1, 2):
            rows += trial_rows([0] * (loop + trial) + [1, 2, 3], loop=loop, trial=trial)
    trials = judged(attempts_to_solve(table(rows)))
    assert trials[["loop", "trial", "attempts"]].to_numpy().tolist() == [[2, 2, 7]]


def test_other_learners_change_neither_the_estimate_nor_what_is_significant(played):
    alone = material(play("good", scattered(1)), ("good",))
    one, many = (
        congruency(held).set_index("learner").loc["good"].reset_index(drop=True)
        for held in (alone, played)
    )
    pd.testing.assert_frame_equal(one, many)
    assert section_of(alone).answer == section_of(played).answer


def test_the_section_shows_people_first_and_names_who_is_helped(played):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        section = section_of(played)
    shown = section.tables[0].frame.set_index("learner")
    assert list(shown.index) == ["people", "published model", "good", "never", "always"]
    saved = shown["CE4: attempts saved"]
    assert saved[["people", "never"]].tolist() == ["+6.03 [3.22, 8.83]", "solved no trial"]
    assert shown.loc["people", "CC4: more than people"] == "–"
    for name, named in (("good", True), ("never", False), ("always", False)):
        assert (f"{name} (" in section.answer) == named
    assert "unsolved" not in section.answer  # who solved nothing is no matter of the limit
    more = ("CE3-CC4", "CC3-CE4")
    rows = play("one", lambda condition, phase, *_: 4 + (phase == "test" and condition in more))
    assert "one (1.00 in CC4 and 1.00 in CE4)" in section_of(material(rows, ("one",))).answer
    # Published people stand beside nobody who did something else.
    parts = played.record, played.experiment, played.trials, played.learners
    section = section_of(Material(*parts, frozenset(), {}))
    assert section.tables[0].frame["learner"].tolist() == ["good", "never", "always"]
    assert "people" not in section.answer


def test_without_a_counterpart_there_is_no_section():
    held = material(play("good", scattered(1), 2, ("CC4", "CC3-CC4")), ("good",))
    assert section_of(held) is None
    frame = section_of(held, "savings").tables[0].frame
    assert frame.loc[2, ["CE4 untrained", "CE3-CC4"]].isna().all()
    other = material(play("good", scattered(1), 2, ("CC4", "CE3-CE4")), ("good",))
    assert section_of(other, "savings") is None


@pytest.mark.parametrize("topic", ["congruency", "savings"])
def test_protocols_have_their_own_tables_and_drawings(topic):
    rows = [*play("a", scattered(1), 2), *play("b", scattered(2), 2, protocol="My one")]
    section = section_of(material(rows, ("a", "b")), topic)
    parts = ["human", "my_one", "all"]
    assert [one.name for one in section.tables] == [f"{topic}_{part}" for part in parts]
    assert [one.name for one in section.plots] == [f"{topic}_{part}" for part in parts[:2]]
    assert [plot.folded for plot in section.plots] == [False, topic == "congruency"]
    assert section.tables[0].frame["learner"].tolist() == ["people", "published model", "a"]
    assert section.tables[1].frame["learner"].tolist() == ["b"]
    assert file_names(["a+b", "a-b", "A b"]) == {"a+b": "a_b", "a-b": "a_b_2", "A b": "a_b_2_2"}


# -- savings --------------------------------------------------------------------------------------


def test_savings_compare_first_trials_and_hold_scipys_interval(played):
    assert share_saved(np.array([10.0, 30]), np.array([5.0])) == 0.75
    assert share_saved(np.ones((4, 2)), np.full((4, 3), 2.0)).tolist() == [-1.0] * 4
    trials = played.trials[played.trials["learner"] == "good"]
    first = trials[trials["trial"] == 1].set_index(["condition", "phase"])["attempts"]
    untrained = first["CE4", "train"].to_numpy(float)
    trained = first["CC3-CE4", "test"].to_numpy(float)
    saved = savings(played).set_index(["learner", "condition"])
    row = saved.loc[("good", "CC3-CE4")]
    assert (row["attempts"], row["untrained"]) == (trained.mean(), untrained.mean())
    assert row["saved"] == pytest.approx(1 - trained.mean() / untrained.mean())
    theirs = stats.bootstrap(
        (untrained, trained),
        lambda a, b, axis: 1 - b.mean(axis=axis) / a.mean(axis=axis),
        method="percentile",
        n_resamples=4000,
        rng=np.random.default_rng(9),
    ).confidence_interval
    assert (row["low"], row["high"]) == pytest.approx(tuple(theirs), abs=0.03)
    assert saved.loc["never", "saved"].isna().all()


def test_the_error_of_peoples_savings_is_that_of_a_simulation(played):
    row = savings(played).set_index(["learner", "condition"]).loc[("people", "CC3-CC4")]
    assert row["saved"] == pytest.approx(1 - 5.525 / 19.375)
    rng = np.random.default_rng(1)
    one = rng.normal(5.525, 0.49 * np.sqrt(40 / 39), 200_000)
    two = rng.normal(19.375, 1.509 * np.sqrt(40 / 39), 200_000)
    wide = row["high"] - row["low"]
    assert wide == pytest.approx(2 * 1.96 * np.std(1 - one / two), rel=0.05)
