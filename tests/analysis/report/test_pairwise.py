"""Learners against learners: the tables by other means, the drawing, and what is said."""

from __future__ import annotations

import itertools
import warnings

import numpy as np
import pandas as pd
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from matplotlib.figure import Figure
from scipy import stats

from causal_openlock.analysis.plots.comparisons import plot_pairs
from causal_openlock.analysis.plots.style import WIDTH
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.sections import pairwise
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.pairwise import Scores, pairwise_table, ranking_table
from support.fabricated_records import table
from support.made_up_experiments import experiment_of, spec
from support.paper_play import material, play, same, scattered

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


def test_a_random_learner_is_known_by_its_short_name_too() -> None:
    rows = [*play("chance", same(30)), *play("perfect", same(3))]
    kinds = (spec("chance", learner="random"), spec("perfect", learner="oracle"))
    experiment = experiment_of(table(rows), learners=kinds)
    found = pairwise.section(material(rows, ("chance", "perfect"), experiment=experiment))
    assert found is not None
    ranks = found.tables[0].frame.set_index("learner")
    assert ranks["normalised"].to_dict() == {"perfect": 1.0, "chance": 0.0}


def test_probabilities_are_counted_by_hand(played: Material) -> None:
    scores = judged(played)
    table = pairwise_table(scores).set_index(["learner", "other"])
    assert len(table) == 4 * 3
    for one, other in itertools.permutations(LEARNERS, 2):
        shares = [
            np.mean(
                [(a < b) + (a == b) / 2 for a in scores[one][name] for b in scores[other][name]]
            )
            for name in scores[one]
        ]
        row = table.loc[(one, other)]
        assert row["probability"] == pytest.approx(np.mean(shares))
        assert row["ci_low"] <= row["probability"] <= row["ci_high"]
        assert row["conditions"] == 6


def test_the_ranking_is_by_scipys_trimmed_mean(played: Material) -> None:
    section = pairwise.section(played)
    assert section is not None
    table, every = section.tables
    assert len(every.frame) == 12
    scores = judged(played)
    iqm = {
        name: stats.trim_mean(np.concatenate(list(scores[name].values())), 0.25)
        for name in LEARNERS
    }
    frame = table.frame.set_index("learner")
    assert frame.index.tolist() == sorted(LEARNERS, key=iqm.__getitem__)
    for name in LEARNERS:
        assert frame.loc[name, "IQM"] == pytest.approx(iqm[name])
        assert frame.loc[name, "low"] <= iqm[name] <= frame.loc[name, "high"]
        normalised = (30 - np.concatenate(list(scores[name].values()))) / 27
        assert frame.loc[name, "normalised"] == pytest.approx(stats.trim_mean(normalised, 0.25))
    known = pairwise_table(scores).set_index(["learner", "other"])
    follows = frame.index[1]
    assert frame.iloc[0]["better than next"] == known.loc[(frame.index[0], follows), "probability"]
    assert np.isnan(frame.iloc[-1]["better than next"])


def test_the_middle_half_decides_the_order_and_the_mean_where_it_is_equal() -> None:
    some = {"a": [3.0, 4, 4, 30], "b": [5.0, 5, 5, 5], "c": [3.0, 4, 4, 29], "d": [3.0, 4, 4, 31]}
    ranks, _ = _ranked({name: {"CC4": np.array(of)} for name, of in some.items()})
    assert ranks["learner"].tolist() == ["c", "a", "d", "b"]
    assert ranks["iqm"].tolist() == [4, 4, 4, 5]


@settings(max_examples=10, deadline=None)
@given(st.permutations(LEARNERS))
def test_who_else_is_there_makes_no_difference(order: list[str]) -> None:
    rng = np.random.default_rng(1)
    scores = {
        name: {c: rng.integers(3, 20, 9).astype(float) for c in ("x", "y")} for name in LEARNERS
    }
    whole = pairwise_table(scores).set_index(["learner", "other"])
    one, other = order[:2]
    part = pairwise_table({name: scores[name] for name in LEARNERS if name in (one, other)})
    assert part.set_index(["learner", "other"]).loc[(one, other)].tolist() == (
        whole.loc[(one, other)].tolist()
    )
    mirrored = whole.loc[(other, one)]
    assert whole.loc[(one, other), "ci_low"] == pytest.approx(1 - mirrored["ci_high"])


def test_the_section_says_what_departs_from_the_order() -> None:
    plain = [*play("a", same(4)), *play("b", same(5)), *play("c", same(6))]
    section = pairwise.section(material(plain, ("a", "b", "c")))
    assert section is not None
    assert "a needs the fewest attempts, 4.00, and c the most, 6.00." in section.text[0]
    assert "Every learner is better than all those after it in the table." in section.text[0]
    assert "normalised" not in section.tables[0].frame  # nobody plays at random
    # The middle half of x is better, and yet a subject of y more often is.
    scores = {"x": [3.0] * 160 + [9.0] * 240, "y": [8.0] * 400, "z": [3.0] * 140 + [9.0] * 260}
    ranks, pairs = _ranked({name: {"CC4": np.array(of)} for name, of in scores.items()})
    told = said(ranks, pairs)
    assert "x needs the fewest attempts, 7.20, and y the most, 8.00." in told
    assert "In 0 of 3 comparisons the learner that stands first" in told
    assert "Against the order of the table y is better than x and y is better than z." in told
    assert told.endswith("Not decided: x and z.")
    ranks, pairs = _ranked({name: {"CC4": np.array(scores[name])} for name in "xz"})
    assert said(ranks, pairs).endswith("No comparison is decided.")
    tied = pairwise.section(material([*play("a", same(30)), *play("b", same(30))], ("a", "b")))
    assert tied is not None
    assert "all learners need the same number of attempts, 30.00." in tied.text[0]


def said(ranks: pd.DataFrame, pairs: pd.DataFrame) -> str:
    found = pairwise.compared(ranks, pairs)
    return Prose("pairwise").sentence("compared", protocol="human", **found)


def _ranked(scores: Scores) -> tuple[pd.DataFrame, pd.DataFrame]:
    pairs = pairwise_table(scores)
    return ranking_table(scores, pairs), pairs


def test_protocols_are_kept_apart_and_a_single_learner_has_nobody_to_compare_with() -> None:
    rows = [*play("a", scattered(1), 3), *play("b", scattered(2), 3)]
    alone = play("c", scattered(3), 3, protocol="mine")
    section = pairwise.section(material(rows + alone, ("a", "b", "c")))
    assert section is not None
    assert [one.name for one in section.plots] == ["pairwise_human"]
    assert set(section.tables[0].frame["learner"]) == {"a", "b"}
    assert pairwise.section(material(alone, ("c",))) is None
    apart = [*play("a", same(4), 2, ("CC4",)), *play("b", same(5), 2, ("CE4",))]
    assert pairwise.section(material(apart, ("a", "b"))) is None


def test_a_single_subject_of_each_decides_nothing() -> None:
    rows = [*play("a", same(4), 1), *play("b", same(5), 1)]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        section = pairwise.section(material(rows, ("a", "b")))
    assert section is not None
    assert "A single subject of each decides nothing." in section.text[0]
    assert section.tables[0].frame["low"].isna().all()


def test_the_matrix_shows_every_probability_and_fits_the_page(played: Material) -> None:
    scores = judged(played)
    pairs = pairwise_table(scores)
    axes = plot_pairs(played, ax=Figure())
    order = [label.get_text() for label in axes.get_yticklabels()]
    assert order == ["perfect", "quick", "slow", "random"]
    shown = {
        (round(text.get_position()[1]), round(text.get_position()[0])): text for text in axes.texts
    }
    assert len(shown) == 16
    for row in pairs.to_dict("records"):
        text = shown[order.index(row["learner"]), order.index(row["other"])]
        assert text.get_text() == f"{row['probability']:.2f}"
        sure = row["ci_low"] > 0.5 or row["ci_high"] < 0.5
        assert (text.get_fontweight() == "bold") == sure
    names = tuple(f"a learner whose name is long {i}" for i in range(12))
    rows = [row for i, name in enumerate(names) for row in play(name, same(3 + i), 1, ("CC4",))]
    figure = Figure()
    plot_pairs(material(rows, names), ax=figure)
    assert figure.get_figwidth() <= WIDTH + 1e-9
