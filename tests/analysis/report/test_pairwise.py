"""Learners against learners: the tables by other means, the drawing, and what is said."""

from __future__ import annotations

import itertools
import warnings
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from causal_openlock.analysis.plots.style import WIDTH
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.topic import decisions_of, sections_of
from causal_openlock.analysis.topics import pairwise
from causal_openlock.analysis.topics.leaderboard import leaderboard
from causal_openlock.analysis.topics.pairwise import outcomes, pairwise_table, plot_pairs
from support.paper_play import Attempts, material, play, same, scattered
from support.topics import topics_called

LEARNERS = ("random", "quick", "slow", "perfect")


@pytest.fixture(scope="module")
def played() -> Material:
    rows = [
        *play("random", same(30)),
        *play("quick", scattered(1)),
        *play("slow", scattered(2, 9.0)),
        *play("perfect", same(3)),
    ]
    return material(rows, LEARNERS)


def judged(played: Material) -> dict[str, dict[str, np.ndarray]]:
    """By pandas alone: attempts in the test, or in the fifth trial of a baseline."""
    frame = played.record.to_pandas()
    key = ["learner", "condition", "phase", "trial", "subject"]
    needed = frame.groupby(key, observed=True)["attempt"].max()  # all stop when they are done
    held: dict[str, dict[str, np.ndarray]] = {}
    for learner in LEARNERS:
        for condition in ("CC4", "CE4", "CC3-CC4", "CE3-CC4", "CC3-CE4", "CE3-CE4"):
            place = ("test", 1) if "-" in condition else ("train", 5)
            held.setdefault(learner, {})[condition] = needed[learner, condition, *place].to_numpy()
    return held


def test_the_leaderboard_the_pairs_and_their_section_share_what_is_computed(
    played: Material, monkeypatch: pytest.MonkeyPatch
) -> None:
    fresh, asked = replace(played), []
    for name in ("outcomes", "pairwise_table"):
        function = getattr(pairwise, name)
        monkeypatch.setattr(
            pairwise, name, lambda *given, of=function: asked.append(of) or of(*given)
        )
    leaderboard(fresh)
    (table,) = pairwise.compute(fresh).values()
    assert fresh.once(pairwise.all_pairs)["human"] is table
    assert asked == [outcomes, pairwise_table]


def test_differences_and_probabilities_are_of_pairs_by_hand(played: Material) -> None:
    scores = judged(played)
    table = pairwise_table(outcomes(played.trials, "human")).set_index(["learner", "other"])
    assert len(table) == 4 * 3 / 2  # each pair once
    for one, other in itertools.combinations(LEARNERS, 2):
        gaps = [scores[one][name] - scores[other][name] for name in scores[one]]
        row = table.loc[(one, other)]
        assert row["difference"] == pytest.approx(np.mean(gaps))
        assert row["probability"] == pytest.approx(
            np.mean([(gap < 0) + (gap == 0) / 2 for gap in gaps])
        )
        assert (row["conditions"], row["pairs"]) == (6, 6 * 12)
        if np.ptp(gaps) == 0:
            assert np.isnan(row[["ci_low", "ci_high"]].to_numpy(float)).all()
        else:
            assert row["ci_low"] < row["difference"] < row["ci_high"]


def test_rooms_that_are_hard_for_both_do_not_count_against_either() -> None:
    hard = same_rooms(0)
    one = play("a", lambda *at: 4 + hard(*at), 12, ("CC4",))
    other = play("b", lambda *at: 5 + hard(*at) + (at[3] == 0), 12, ("CC4",))
    (row,) = pairwise_table(outcomes(material([*one, *other], ("a", "b")).trials, "human")).to_dict(
        "records"
    )
    assert row["difference"] == pytest.approx(-13 / 12)
    assert row["ci_high"] - row["ci_low"] < 0.5
    assert row["probability"] == 1.0
    alone = [*one, *(({**line, "seed": 2}) for line in other)]  # other seeds, other rooms
    (row,) = pairwise_table(outcomes(material(alone, ("a", "b")).trials, "human")).to_dict(
        "records"
    )
    assert (row["difference"], row["pairs"]) == (pytest.approx(-13 / 12), 0)
    assert row["ci_high"] - row["ci_low"] > 3


def same_rooms(seed: int) -> Attempts:
    """How much harder a room is, for whoever is in it."""
    level = np.random.default_rng(seed).integers(0, 9, 40)
    return lambda condition, phase, trial, subject: int(level[subject])


def test_the_section_names_the_pairs_of_which_no_difference_is_found() -> None:
    rows = [*play("a", same(4)), *play("b", same(5)), *play("c", same(5))]
    held = material(rows, ("a", "b", "c"))
    told, table = said(held)
    assert "Protocol human: of 3 pairs of learners 2 differ" in told
    assert told.endswith("they are equal: b and c (0.00).")
    assert table["p corrected"].tolist() == pytest.approx([3 * 2 / 2**72, 3 * 2 / 2**72, 1.0])
    told, _ = said(material([*play("a", scattered(1), 4), *play("b", scattered(9), 4)], ("a", "b")))
    assert "Protocol human: of 1 pair of learners 0 differ in" in told
    whole = pairwise.section(held, decisions_of(held, topics_called("pairwise")).of("pairwise"))
    assert whole is not None
    assert (
        "An interval is for its comparison alone; what is significant is decided after"
        in whole.text[1]
    )


def said(held: Material) -> tuple[str, pd.DataFrame]:
    section = pairwise.section(held, decisions_of(held, topics_called("pairwise")).of("pairwise"))
    assert section is not None
    (table,) = section.tables
    return section.text[0], table.frame


def test_protocols_are_kept_apart_and_a_single_learner_has_nobody_to_compare_with() -> None:
    rows = [*play("a", scattered(1), 3), *play("b", scattered(2), 3)]
    alone = play("c", scattered(3), 3, protocol="mine")
    (section,) = sections_of(material(rows + alone, ("a", "b", "c")), topics_called("pairwise"))
    assert [one.name for one in section.tables] == ["pairwise_human"]
    assert section.plots == ()  # a single pair is told in a sentence
    assert section.tables[0].frame[["learner", "other"]].to_numpy().tolist() == [["a", "b"]]
    assert sections_of(material(alone, ("c",)), topics_called("pairwise")) == []
    apart = [*play("a", same(4), 2, ("CC4",)), *play("b", same(5), 2, ("CE4",))]
    assert sections_of(material(apart, ("a", "b")), topics_called("pairwise")) == []


def test_a_single_subject_of_each_decides_nothing() -> None:
    rows = [*play("a", same(4), 1), *play("b", same(5), 1)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        told, table = said(material(rows, ("a", "b")))
    assert "of 1 pair of learners 0 differ" in told
    assert table[["low", "high", "p"]].isna().all(axis=None)


def test_the_matrix_shows_every_pair_once_and_fits_the_page(played: Material) -> None:
    pairs = pairwise_table(outcomes(played.trials, "human"))
    axes = plot_pairs(played, ax=Figure())
    order = [label.get_text() for label in axes.get_yticklabels()]
    assert order == ["perfect", "quick", "slow", "random"]
    shown = {
        (order[round(text.get_position()[1])], order[round(text.get_position()[0])]): text
        for text in axes.texts
    }
    assert len(shown) == len(pairs) == 6
    for row in pairs.to_dict("records"):
        one, other, chance = row["learner"], row["other"], row["probability"]
        if order.index(one) > order.index(other):
            one, other, chance = other, one, 1 - chance
        assert shown[one, other].get_text() == f"{chance:.2f}"
    names = tuple(f"a learner whose name is long {i}" for i in range(12))
    rows = [row for i, name in enumerate(names) for row in play(name, same(3 + i), 1, ("CC4",))]
    figure = Figure()
    plot_pairs(material(rows, names), ax=figure)
    assert figure.get_figwidth() <= WIDTH + 1e-9
