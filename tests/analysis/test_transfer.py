"""What training saves, with the structure of the test and with any."""

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from scipy import stats

from causal_openlock.analysis.topics.transfer import OTHER, TOPIC, plot_savings, transfer
from support.paper_play import material, play, same, scattered
from support.topics import section_on


@pytest.fixture(scope="module")
def played():
    rows = [*play("good", scattered(1)), *play("never", same(30)), *play("always", same(3))]
    return material(rows, ("good", "never", "always"))


@pytest.fixture(scope="module")
def found(played):
    return transfer(played).set_index(["learner", "condition"])


@pytest.fixture(scope="module")
def needed_by_good(played):
    """By condition, phase and trial, attempts of every subject, from the record by pandas alone."""
    frame = played.record.to_pandas()
    solved = frame[frame["new_solution"] & (frame["solutions_found"] == 3)]
    key = ["learner", "condition", "phase", "trial", "subject"]
    needed = solved.groupby(key, observed=True)["attempt"].first()["good"]
    return lambda condition, phase: needed[condition, phase, 1].to_numpy(float)


def test_attempts_saved_are_students_t_of_scipy(found, needed_by_good):
    for condition, other in OTHER.items():
        row = found.loc[("good", condition)]
        own, others = (needed_by_good(name, "test") for name in (condition, other))
        theirs = stats.ttest_ind(others, own)
        assert row["saved"] == others.mean() - own.mean()
        assert (row["attempts"], row["other_training"]) == (own.mean(), others.mean())
        numbers = [*theirs.confidence_interval(), theirs.pvalue]
        assert row[["low", "high", "p"]].tolist() == pytest.approx(numbers)
        assert (row["subjects"], row["solved"]) == (12, 1)


def test_the_share_is_of_first_trials_with_the_error_of_a_ratio(found, needed_by_good):
    row = found.loc[("good", "CC3-CE4")]
    untrained, trained = needed_by_good("CE4", "train"), needed_by_good("CC3-CE4", "test")
    assert (row["first"], row["untrained"]) == (trained.mean(), untrained.mean())
    assert row["share"] == pytest.approx(1 - trained.mean() / untrained.mean())
    error = np.hypot(
        stats.sem(trained) / untrained.mean(),
        trained.mean() * stats.sem(untrained) / untrained.mean() ** 2,
    )
    assert row["share_high"] - row["share_low"] == pytest.approx(2 * 2.09 * error, rel=0.05)
    of_people = found.loc[("people", "CC3-CC4")]
    assert of_people["share"] == pytest.approx(1 - 5.525 / 19.375)
    rng = np.random.default_rng(1)
    one = rng.normal(5.525, 0.49 * np.sqrt(40 / 39), 200_000)
    two = rng.normal(19.375, 1.509 * np.sqrt(40 / 39), 200_000)
    wide = of_people["share_high"] - of_people["share_low"]
    assert wide == pytest.approx(2 * 1.99 * np.std(1 - one / two), rel=0.05)


def test_the_effect_beyond_people_is_welchs(found, needed_by_good):
    row = found.loc[("good", "CE3-CE4")]
    both = [needed_by_good(name, "test") for name in ("CE3-CE4", "CC3-CE4")]
    errors = [attempts.std(ddof=1) ** 2 / 12 for attempts in both]
    errors += [(se * np.sqrt(40 / 39)) ** 2 for se in (0.769, 1.162)]
    parts = sum(e**2 / 11 for e in errors[:2]) + sum(e**2 / 39 for e in errors[2:])
    half = np.sqrt(sum(errors)) * stats.t.isf(0.025, sum(errors) ** 2 / parts)
    assert row["to_people"] == pytest.approx(row["saved"] - (13.75 - 7.725), abs=1e-3)
    assert row["to_people_high"] - row["to_people_low"] == pytest.approx(2 * half, rel=1e-3)
    assert found.loc["people", "to_people"].isna().all()
    assert found.loc["people", "subjects"].tolist() == [40] * 4


def test_the_limit_says_nothing_of_who_solved_nothing(played, found):
    never = found.loc["never"]
    assert (never["solved"] == 0).all()
    assert never[["saved", "low", "high", "p", "share", "to_people"]].isna().all(axis=None)
    assert (found.loc["always", "saved"] == 0).all()  # and zero it is where trials are solved

    def rows(**options):
        axes = plot_savings(played, ax=Figure(), **options)
        return [label.get_text() for label in axes[0].get_yticklabels()]

    assert rows() == ["people", "published model", "good", "always"]
    assert rows(learners=["never"])[-1] == "never"


def test_other_learners_change_neither_the_estimate_nor_what_is_significant(played):
    alone = material(play("good", scattered(1)), ("good",))
    one, many = (
        transfer(held).set_index("learner").loc["good"].reset_index(drop=True)
        for held in (alone, played)
    )
    pd.testing.assert_frame_equal(one, many)
    assert section_on(TOPIC, alone).answer == section_on(TOPIC, played).answer


def test_the_section_shows_no_people_beside_those_who_did_something_else(played):
    section = section_on(TOPIC, replace(played, references=()))
    assert section.tables[0].frame["learner"].unique().tolist() == ["good", "never", "always"]
    assert "people" not in section.answer
    assert "the other structure, significant for learners" in section.answer
    more = ("CE3-CC4", "CC3-CE4")
    rows = play("one", lambda condition, phase, *_: 4 + (phase == "test" and condition in more))
    section = section_on(TOPIC, material(rows, ("one",)))
    assert "one +1.00 in CC4 and +1.00 in CE4." in section.answer


def test_without_a_counterpart_there_is_no_section():
    held = material(play("good", scattered(1), 2, ("CC4", "CC3-CC4")), ("good",))
    section = section_on(TOPIC, held)
    assert section.answer == ""
    row = section.tables[0].frame.set_index(["learner", "test"]).loc[("good", "CC4")]
    assert row["attempts saved"] == "–"
    assert row["saved by CC3"].endswith("%")
    other = material(play("good", scattered(1), 2, ("CC4", "CE3-CE4")), ("good",))
    assert section_on(TOPIC, other) is None


def test_protocols_have_their_own_tables_and_drawings():
    rows = [*play("a", scattered(1), 2), *play("b", scattered(2), 2, protocol="My one")]
    section = section_on(TOPIC, material(rows, ("a", "b")))
    assert [one.name for one in section.tables] == ["transfer_human", "transfer_my_one"]
    assert [one.name for one in section.plots] == ["savings_human", "savings_my_one"]
    assert [plot.folded for plot in section.plots] == [False, True]
    assert [table.frame["learner"].unique().tolist() for table in section.tables] == [
        ["people", "published model", "a"],
        ["b"],
    ]
