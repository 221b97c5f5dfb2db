"""How learners stand: the first table by hand, and what it says of values that were cut off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.decisions import Decisions
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import all_topics, decisions_of
from causal_openlock.analysis.topics.leaderboard import (
    answers,
    leaderboard,
    leaderboard_tables,
    legend,
)
from causal_openlock.experiment.experiment import Origin
from causal_openlock.paper.published import people
from support.fabricated_records import table
from support.made_up_experiments import NO_ONE_BESIDE, experiment_of, spec
from support.paper_play import Attempts, material, play, same

pytestmark = pytest.mark.slow

LEARNERS = ("able", "half", "never", "told")


def sometimes(number: int) -> Attempts:
    """A learner that solves every second subject's trials, in so many attempts."""
    return lambda condition, phase, trial, subject: number if subject % 2 else 30


@pytest.fixture(scope="module")
def played() -> Material:
    ways = (same(5), sometimes(9), same(30), same(3))
    rows = [row for name, way in zip(LEARNERS, ways, strict=True) for row in play(name, way, 4)]
    told = spec("told", recorded=Origin("made_up:Told", "made-up 1.0", informed=True))
    others = tuple(spec(name) for name in LEARNERS[:3])
    return material(rows, LEARNERS, experiment=experiment_of(table(rows), learners=(*others, told)))


@pytest.fixture(scope="module")
def found(played: Material) -> pd.DataFrame:
    return leaderboard(played).set_index("learner")


def test_shares_medians_and_means_by_hand(found: pd.DataFrame) -> None:
    assert found["solved"].dropna().to_dict() == {"able": 1, "half": 0.5, "never": 0, "told": 1}
    assert found["median"].dropna().to_dict() == {"able": 5, "half": 9, "told": 3}
    assert found.loc["half", "attempts"] == (9 + 30) / 2
    assert (found.loc["half", "found"], found.loc["half", "solutions"]) == (1.5, 3)
    assert set(found["conditions"]) == {6}
    assert found["subjects"].to_dict() == {"people": 40, **dict.fromkeys(LEARNERS, 4)}


def test_the_best_learner_has_to_find_out_how_the_room_works(found: pd.DataFrame) -> None:
    assert set(found["best"]) == {"able"}
    assert np.isnan(found.loc["able", "to_best"])
    assert found.loc["told", "to_best"] == -2
    assert np.isnan(found.loc["told", "to_best_low"])  # nobody differs, so there is no interval
    half = found.loc["half"]
    assert half["to_best"] == (4 + 25) / 2
    assert half["to_best_low"] < half["to_best"] < half["to_best_high"]


def test_the_score_is_0_at_random_and_1_for_the_ideal_observer(found: pd.DataFrame) -> None:
    assert found.loc["told", "score"] == pytest.approx(1.0)  # the made-up bound is 3
    assert found.loc["never", "score"] == pytest.approx(0.0, abs=1e-4)
    assert found.loc["able", "score"] == pytest.approx(25 / 27, abs=1e-4)


def test_people_are_those_of_the_paper(found: pd.DataFrame) -> None:
    means = people()
    last = means[(means["phase"] == "test") | (means["trial"] == 5)]["mean"]
    assert len(last) == 6
    assert found.loc["people", "attempts"] == pytest.approx(last.mean())
    assert found.loc["able", "to_people"] == pytest.approx(5 - last.mean())
    assert found.loc["people", "to_best"] == -found.loc["able", "to_people"]
    errors = means[(means["phase"] == "test") | (means["trial"] == 5)]["se"] * np.sqrt(40 / 39)
    half = (found.loc["able", "to_people_high"] - found.loc["able", "to_people_low"]) / 2
    assert half == pytest.approx(2 * np.sqrt((errors**2).sum()) / 6, rel=0.02)


def test_values_that_the_limit_cuts_off_are_marked(played: Material) -> None:
    (shown,) = leaderboard_tables(leaderboard(played))
    heads = list(shown.heads[1:])
    best = heads.index("Attempts more than able")
    assert list(shown.rows) == ["people", "told", "able", "half", "never"]
    assert shown.references == ("people", "told")
    assert shown.rows["never"][best] == ("≥ +25.00", "the same in every subject of a condition")
    assert shown.rows["half"][best][0] == "≥ +14.50"
    assert shown.rows["told"][best][0] == "−2.00"
    assert shown.rows["able"][best] == ("best", "")
    assert [shown.rows[name][0][0] for name in LEARNERS] == [
        "5.00", "≥ 19.50", "> 30", "3.00"
    ]  # fmt: skip
    assert shown.short_rows["never"][0] == "> 30"
    assert shown.short_rows["never"][2] == "≥ 25.0 [all]"
    assert shown.few == (
        "Only 4 subjects in a condition: with fewer than 20 the intervals are unreliable."
    )


def test_only_marks_that_occur_are_explained(played: Material) -> None:
    every = legend([*leaderboard_tables(leaderboard(played))], narrow=True)
    assert "given the schema or the room" in every
    assert "[all]" in every
    assert "≥ marks" in every
    assert "*" not in every
    assert "1 ideal; solved" in every
    lucky = leaderboard(played).replace({"score": {1.0: 1.01}})
    assert "1 ideal (above 1: by luck, or who knows the room);" in legend(
        [*leaderboard_tables(lucky)], True
    )
    rows = [row for name in "ab" for row in play(name, same(5), 2)]
    held = replace(material(rows, ("a", "b")), references=NO_ONE_BESIDE)
    plain = legend([*leaderboard_tables(leaderboard(held))], narrow=True)
    assert not any(mark in plain for mark in ("≥", "*", "schema"))


def test_the_answer_in_sentences(played: Material) -> None:
    table = leaderboard(played)
    first, second = answers(table, decisions_of(played, all_topics()))["human"]
    able = table.set_index("learner").loc["able"]
    assert first.startswith(
        "Of the learners that are given neither the schema nor the room, able needs the fewest "
        "attempts, 5.00 on average; 4 subjects in a condition are too few to rank learners. It "
        f"needs {-able['to_people']:.2f} fewer than people ("
    )
    assert first.endswith(
        "a significant difference after correction for the learners that are compared."
    )
    # 24 pairs that all differ tell the others apart.
    assert second == "Solved no trial that counts: never."


def test_the_answer_counts_training_and_ranks_where_there_are_enough() -> None:
    rows = [*play("a", same(4), 20), *play("b", same(6), 20)]
    trained = Origin("made_up:A", "made-up 1.0", prior_attempts=12_000)
    learners = (spec("a", recorded=trained), spec("b"))
    held = material(rows, ("a", "b"), experiment=experiment_of(table(rows), learners=learners))
    standing = leaderboard(held)
    before = standing.set_index("learner")["before"].dropna().to_dict()
    assert before == {"a": 12_000, "b": 0}
    (first, *_) = answers(standing, decisions_of(held, all_topics()))["human"]
    assert "4.00 on average, after 12,000 attempts of training before the experiment. " in first


def test_learners_are_not_told_apart_by_what_the_report_finds(played: Material) -> None:
    decisions = Decisions()
    decisions.register("leaderboard", {("human", "able", "to_people"): 0.5})
    pairs = {("half", "able"): 0.001, ("able", "told"): 0.03, ("able", "never"): 0.04}
    decisions.register("pairwise", {("human", *pair): p for pair, p in pairs.items()})
    first, second = answers(leaderboard(played), decisions)["human"]
    assert "not a significant difference after" in first
    assert second == "Solved no trial that counts: never."  # four subjects tell nothing of pairs
    enough = leaderboard(played).assign(subjects=40)
    (first, _) = answers(enough, decisions)["human"]
    assert first.startswith(
        "Of the learners that are given neither the schema nor the room, able (5.00) and never "
        "(at least 30.00) need the fewest attempts on average, and do not differ significantly."
    )


def test_the_answer_where_nothing_is_solved(played: Material) -> None:
    held = material([*play("a", same(30), 2), *play("b", same(30), 2)], ("a", "b"))
    assert answers(leaderboard(held), decisions_of(held, all_topics())) == {
        "human": ("No learner solved a trial that counts.",)
    }


def test_a_difference_of_two_values_that_are_cut_off_may_be_off_either_way() -> None:
    rows = [*play("a", sometimes(9), 4), *play("b", same(30), 4)]
    (shown,) = leaderboard_tables(leaderboard(material(rows, ("a", "b"))))
    best = list(shown.heads[1:]).index("Attempts more than a")
    assert shown.rows["b"][best][0] == "+10.50*"


def test_nobody_is_the_best_where_nothing_is_solved(played: Material) -> None:
    rows = [*play("a", same(30), 2), *play("b", same(30), 2)]
    held = material(rows, ("a", "b"))
    table = leaderboard(replace(held, references=NO_ONE_BESIDE))
    assert table["best"].isna().all()
    assert table["learner"].tolist() == ["a", "b"]
    (shown,) = leaderboard_tables(table)
    assert not any("more than" in head for head in shown.heads)


def test_the_answer_is_over_the_same_conditions_and_names_who_lacks_some() -> None:
    told = spec("told", recorded=Origin("made_up:Told", "made-up 1.0", informed=True))
    four = ("CC4", "CE4", "CC3-CC4", "CE3-CC4")
    rows = [
        *play("told", same(3), 20),
        *play("whole", same(6), 20, four),
        *play("even", same(6), 20, four),
        *play("easy", same(4), 20, ("CC4",)),
        *play("other", same(4), 20, (*four[:3], "CE3-CE4")),
    ]
    learners = (told, *map(spec, ("whole", "even", "easy", "other", "never_played")))
    names = tuple(one.name for one in learners)
    held = material(rows, names, experiment=experiment_of(table(rows), learners=learners))
    ranked = leaderboard(held)
    (first, *_) = answers(ranked, decisions_of(held, all_topics()))["human"]
    assert first.startswith(
        "Of the learners that are given neither the schema nor the room, whole (6.00) and even "
        "(6.00) need the fewest attempts on average over 4 conditions (not ranked, as they did not "
        "play the same ones: easy, other and never_played), and do not differ significantly. whole "
        "needs "
    )
    shown = ranked.set_index("learner")
    assert shown.loc["whole", "best"] == "whole"
    assert shown.loc["easy", "to_best"] == -2  # in the condition that it played
    assert np.isnan(shown.loc["other", "to_best"])
    assert shown.loc["never_played", "conditions"] == 0
    people = shown.loc["people", "attempts"]
    assert np.isclose(shown.loc["told", "to_people"], 3 - people)  # the only one with all six


def test_a_difference_is_over_the_conditions_of_its_row_or_there_is_none() -> None:
    rows = play("a", same(5), 20, ("CC4", "mine"))
    held = material(rows, ("a",))
    ranked = leaderboard(held)
    row = ranked.set_index("learner").loc["a"]
    assert row["conditions"] == 2
    assert np.isnan(row["to_people"])
    (first,) = answers(ranked, decisions_of(held, all_topics()))["human"]
    assert first == (
        "a is the only learner that is given neither the schema nor the room and solves a trial; "
        "it needs 5.00 attempts on average. Not compared with people: not all of these conditions "
        "are known there."
    )
