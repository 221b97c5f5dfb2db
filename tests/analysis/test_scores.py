"""What a condition comes to for each subject, what training was worth, and its section."""

from __future__ import annotations

import warnings
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.summary import headline_table, judged
from causal_openlock.analysis.section import Section
from causal_openlock.analysis.topic import sections_of
from causal_openlock.analysis.topics.leaderboard import normalised_score
from causal_openlock.analysis.topics.transfer import (
    congruency,
    reference_scores,
    savings,
    scores_by_condition,
    transfer_scores,
)
from causal_openlock.paper.references import people
from causal_openlock.wording import file_names
from support.fabricated_records import table, trial_rows
from support.paper_play import material, play, same, scattered
from support.topics import topics_called


def written(held: Material) -> Section | None:
    return next(iter(sections_of(held, topics_called("transfer"))), None)


@pytest.fixture(scope="module")
def played() -> Material:
    rows = [*play("good", scattered(1)), *play("never", same(30)), *play("always", same(3))]
    return material(rows, ("good", "never", "always"))


def test_normalised_score_is_1_for_ideal_and_0_for_random() -> None:
    assert normalised_score(np.array([3.0, 30, 16.5, 2]), 30, 3).tolist() == pytest.approx(
        [1, 0, 0.5, 28 / 27]
    )
    assert np.isnan(normalised_score(np.array([3.0]), 3, 3)).all()


def test_congruency_and_savings_worked_by_hand() -> None:
    assert congruency(np.array([3.0, 5]), np.array([6.0, 8, 10])) == -4
    assert savings(np.array([10.0, 30]), np.array([5.0])) == 0.75
    assert savings(np.ones((4, 2)), np.full((4, 3), 2.0)).tolist() == [-1.0] * 4


def test_transfer_scores_by_pandas(played: Material) -> None:
    frame = played.record.to_pandas()
    solved = frame[frame["new_solution"] & (frame["solutions_found"] == 3)]
    key = ["learner", "condition", "phase", "trial", "subject"]
    needed = solved.groupby(key, observed=True)["attempt"].first()
    scores = transfer_scores(played.trials).set_index(["learner", "score", "condition"])
    assert len(scores) == 3 * 6
    good = needed["good"]
    tests = {c: good[c, "test", 1] for c in ("CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4")}
    row = scores.loc[("good", "congruency", "CE3-CE4")]
    assert row["value"] == pytest.approx(tests["CE3-CE4"].mean() - tests["CC3-CE4"].mean())
    assert (row["subjects"], row["attempts"]) == (12, tests["CE3-CE4"].mean())
    row = scores.loc[("good", "savings", "CC3-CE4")]
    untrained = good["CE4", "train", 1]
    assert row["value"] == pytest.approx(1 - tests["CC3-CE4"].mean() / untrained.mean())
    assert row["against"] == untrained.mean()


def test_intervals_of_scores_are_scipys_and_hold_the_score(played: Material) -> None:
    held = scores_by_condition(played.trials)["good", "human"]
    row = transfer_scores(played.trials).set_index(["learner", "score", "condition"])
    row = row.loc[("good", "congruency", "CC3-CC4")]
    groups = (held["CC3-CC4"], held["CE3-CC4"])
    theirs = stats.bootstrap(
        groups, lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        method="percentile", n_resamples=4000, rng=np.random.default_rng(9),
    ).confidence_interval  # fmt: skip
    assert (row["ci_low"], row["ci_high"]) == pytest.approx(tuple(theirs), abs=0.25)
    assert row["ci_low"] < row["value"] < row["ci_high"]


def test_a_condition_is_judged_as_in_the_headline(played: Material) -> None:
    held = scores_by_condition(played.trials)
    headline = headline_table(played.record)
    assert len(headline) == 18
    for row in headline.to_dict("records"):
        attempts = held[row["learner"], row["protocol"]][row["condition"]]
        assert (len(attempts), attempts.mean()) == (row["subjects"], pytest.approx(row["attempts"]))


def test_a_baseline_is_judged_by_the_last_trial_of_its_last_loop() -> None:
    rows: list[dict[str, Any]] = []
    for loop in (1, 2):
        for trial in (1, 2):
            rows += trial_rows([0] * (loop + trial) + [1, 2, 3], loop=loop, trial=trial)
    trials = judged(attempts_to_solve(table(rows)))
    assert trials[["loop", "trial", "attempts"]].to_numpy().tolist() == [[2, 2, 7]]


def test_scores_of_people_follow_from_published_means() -> None:
    scores = reference_scores(people(), "human").set_index(["score", "condition"])
    row = scores.loc[("congruency", "CE3-CE4")]
    assert row["value"] == pytest.approx(7.725 - 13.75)
    error = np.hypot(0.769, 1.162) * np.sqrt(40 / 39)
    assert row["ci_high"] - row["ci_low"] == pytest.approx(2 * 1.959964 * error)
    assert scores.loc[("savings", "CC3-CC4"), "value"] == pytest.approx(1 - 5.525 / 19.375)


def test_the_error_of_savings_is_that_of_a_simulation() -> None:
    rng = np.random.default_rng(1)
    one = rng.normal(5.525, 0.49 * np.sqrt(40 / 39), 200_000)
    two = rng.normal(19.375, 1.509 * np.sqrt(40 / 39), 200_000)
    scores = reference_scores(people(), "human").set_index(["score", "condition"])
    row = scores.loc[("savings", "CC3-CC4")]
    wide = row["ci_high"] - row["ci_low"]
    assert wide == pytest.approx(2 * 1.96 * np.std(1 - one / two), rel=0.05)


# -- the section ----------------------------------------------------------------------------------


def test_the_section_shows_people_first_and_says_who_is_helped(played: Material) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        section = written(played)
    assert section is not None
    names = ["transfer_congruency_human", "transfer_savings_human"]
    assert [one.name for one in section.tables] == [*names, "transfer_scores_human"]
    assert [one.name for one in section.plots] == names
    for shown in section.tables[:2]:
        assert shown.frame["learner"].tolist() == [
            "People", "Published model", "good", "never", "always",
        ]  # fmt: skip
        assert set(shown.formats) < set(shown.frame.columns)
    assert "2.65 for CC4 and 6.03 for CE4" in section.text[0]
    assert "helps good" in section.text[0]
    assert "never 0%" in section.text[1]


def test_published_scores_stand_beside_nobody_who_did_something_else(played: Material) -> None:
    section = written(
        Material(
            played.record,
            played.experiment,
            played.trials,
            played.learners,
            frozenset(),
            {},
        )
    )
    assert section is not None
    assert section.tables[0].frame["learner"].tolist() == ["good", "never", "always"]


def test_without_a_counterpart_there_is_no_section() -> None:
    rows = play("good", scattered(1), 2, ("CC4", "CE3-CE4"))
    assert written(material(rows, ("good",))) is None
    section = written(material(play("good", scattered(1), 2, ("CC4", "CC3-CC4")), ("good",)))
    assert section is not None
    assert [one.name for one in section.tables] == [
        "transfer_savings_human", "transfer_scores_human",
    ]  # fmt: skip
    frame: pd.DataFrame = section.tables[0].frame
    assert frame.loc[2, ["CE4 untrained", "CE3-CC4"]].isna().all()


def test_protocols_have_their_own_tables_and_drawings() -> None:
    rows = [*play("a", scattered(1), 2), *play("b", scattered(2), 2, protocol="My one")]
    section = written(material(rows, ("a", "b")))
    assert section is not None
    assert [one.name for one in section.tables] == [
        f"transfer_{score}_{part}" for part in ("human", "my_one")
        for score in ("congruency", "savings", "scores")
    ]  # fmt: skip
    assert section.tables[0].frame["learner"].tolist() == ["People", "Published model", "a"]
    assert section.tables[3].frame["learner"].tolist() == ["b"]
    assert section.tables[3].title.endswith(", protocol My one")
    assert file_names(["a+b", "a-b", "A b"]) == {"a+b": "a_b", "a-b": "a_b_2", "A b": "a_b_2_2"}
