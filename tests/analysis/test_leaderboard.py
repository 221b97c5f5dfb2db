"""Where every learner stands, and learners in pairs: numbers by hand, and what is said of them."""

import itertools
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import causal_openlock as ol
from causal_openlock.analysis.plots.style import WIDTH
from causal_openlock.analysis.table import markdown
from causal_openlock.analysis.topic import sections_of
from causal_openlock.analysis.topics.leaderboard import answers, leaderboard, leaderboard_tables
from causal_openlock.analysis.topics.pairwise import outcomes, pairs, pairwise_table, plot_pairs
from causal_openlock.experiment.origin import Origin
from causal_openlock.paper.published import people
from support.fabricated_records import table
from support.made_up_experiments import NO_ONE_BESIDE, experiment_of, spec
from support.paper_play import material, play, same, scattered
from support.topics import topics_called

pytestmark = pytest.mark.slow

LEARNERS = ("able", "half", "never", "told")
TOLD = spec("told", recorded=Origin("made_up:Told", "made-up 1.0", informed=True))
TRAINED = spec("a", recorded=Origin("made_up:A", "made-up 1.0", prior_attempts=12_000))
FOUR = ("CC4", "CE4", "CC3-CC4", "CE3-CC4")
ABSENT = (TOLD, spec("never_played"))
LACKING = {
    "told": (same(3), 20), "whole": (same(6), 20, FOUR), "even": (same(6), 20, FOUR),
    "easy": (same(4), 20, FOUR[:1]),
}  # fmt: skip


def sometimes(number):
    """A learner that solves every second subject's trials, in that number of attempts."""
    return lambda condition, phase, trial, subject: number if subject % 2 else 30


def held(*specs, **ways):
    """Results of learners, each given as ``(attempts, subjects, conditions)`` or fewer of these."""
    rows = [row for name, way in ways.items() for row in play(name, *way)]
    known = {one.name: one for one in specs}
    specs = [known.pop(name, None) or spec(name) for name in ways] + [*known.values()]
    names = tuple(one.name for one in specs)
    return material(rows, names, experiment=experiment_of(table(rows), learners=tuple(specs)))


@pytest.fixture(scope="module")
def played():
    ways = (same(5), sometimes(9), same(30), same(3))
    return held(TOLD, **{name: (way, 4) for name, way in zip(LEARNERS, ways, strict=True)})


@pytest.fixture(scope="module")
def found(played):
    return leaderboard(played).set_index("learner")


def test_people_are_those_of_the_paper(found):
    means = people()
    last = means[(means["phase"] == "test") | (means["trial"] == 5)]
    assert len(last) == 6
    mean = last["mean"].mean()
    assert found.loc["people", "attempts"] == pytest.approx(mean)
    able = found.loc["able"]
    assert able["to_people"] == pytest.approx(5 - mean)
    assert found.loc["people", "to_best"] == -able["to_people"]
    half = (able["to_people_high"] - able["to_people_low"]) / 2
    errors = last["se"] * np.sqrt(40 / 39)
    assert half == pytest.approx(2 * np.sqrt((errors**2).sum()) / 6, rel=0.02)


def test_a_difference_is_over_the_conditions_of_its_row_or_there_is_none():
    results = held(*ABSENT, **LACKING, other=(same(4), 20, (*FOUR[:3], "CE3-CE4")))
    ranked = leaderboard(results).set_index("learner")
    assert ranked.loc["whole", "best"] == "whole"
    assert ranked.loc["easy", "to_best"] == -2  # in the condition that it played
    assert np.isnan(ranked.loc["other", "to_best"])
    assert ranked.loc["never_played", "conditions"] == 0
    mean = ranked.loc["people", "attempts"]
    assert np.isclose(ranked.loc["told", "to_people"], 3 - mean)  # the only one with all six
    own = leaderboard(held(a=(same(5), 20, ("CC4", "mine")))).set_index("learner").loc["a"]
    assert own["conditions"] == 2
    assert np.isnan(own["to_people"])


def test_learners_without_a_condition_in_common_are_not_compared():
    one = ol.compare("CC3", ["oracle", "bayes"], subjects=2, workers=0)
    other = ol.compare("CE3", ["random"], subjects=2, workers=0)
    ranked = (one + other).leaderboard.set_index("learner")
    assert np.isnan(ranked.loc["random", "to_best"])
    assert (one + other).pairs["learner"].tolist() == ["oracle"]
    rows = leaderboard_tables((one + other).leaderboard)["human"].frame.set_index("Learner")
    assert rows["Conditions"].to_dict() == {"oracle": "CC3", "bayes": "CC3", "random": "CE3"}


def test_a_score_leaves_out_conditions_whose_ideal_observer_is_not_known(played):
    some = replace(played, bounds={k: one for k, one in played.bounds.items() if k[0] != "CC4"})
    (shown,) = leaderboard_tables(leaderboard(some)).values()
    assert "where both are known: not CC3-CE4, CC4, CE3-CE4 and CE4." in shown.caption
    (costs,) = topics_called("learning_cost")[0].section(some).tables
    assert "all conditions but CC3-CE4, CC4, CE3-CE4 and CE4, where" in costs.caption


def told(title, results, alike=None, ranked=None):
    """All that is shown of a leaderboard: its answer and its table."""
    ranked = leaderboard(results) if ranked is None else ranked
    lines = [f"== {title}"]
    for protocol, sentences in answers(ranked, pairs(results) if alike is None else alike).items():
        lines += [f"{protocol}: {sentence}" for sentence in sentences]
    for shown in leaderboard_tables(ranked).values():
        lines += [shown.title, markdown(shown.heads, shown.rows), shown.caption]
        lines += [f"rows above the line: {len(shown.looks)}"]
    return lines


def test_answers_tables_and_legends_of_leaderboards(played, golden):
    """Where the limit cuts values off, few subjects, training before, other conditions, no best."""
    alike = [("half", "able", 0.003), ("able", "told", 0.06), ("able", "never", 0.06)]
    alike = pd.DataFrame(alike, columns=["learner", "other", "p_corrected"]).assign(
        protocol="human"
    )
    enough = (
        leaderboard(played).assign(subjects=40, to_people_p=0.5).replace({"score": {1.0: 1.01}})
    )
    alone = replace(held(a=(same(5), 2), b=(same(5), 2)), references=NO_ONE_BESIDE)
    unsolved = held(a=(same(30), 2), b=(same(30), 2))
    lines = [
        *told("cut off by the limit, four subjects", played),
        *told("not told apart", played, alike, enough),
        *told("trained before", held(TRAINED, a=(same(4), 20), b=(same(6), 20))),
        *told("other conditions", held(*ABSENT, **LACKING)),
        *told("a condition of one's own", held(a=(same(5), 20, ("CC4", "mine")))),
        *told("both cut off", held(a=(sometimes(9), 4), b=(same(30), 4))),
        *told("nothing solved", unsolved),
        *told("nothing solved, no people", replace(unsolved, references=NO_ONE_BESIDE)),
        *told("no people, no marks", alone),
    ]
    golden("leaderboards.txt", "\n".join(lines))


QUICK, SLOW = scattered(1), scattered(2, 9.0)
FOUR_WAYS = {"random": same(30), "quick": QUICK, "slow": SLOW, "perfect": same(3)}


@pytest.fixture(scope="module")
def rivals():
    return held(**{name: (way,) for name, way in FOUR_WAYS.items()})


def pairs_of(results):
    return pairwise_table(outcomes(results.trials, "human"))


def test_differences_and_probabilities_of_pairs_by_hand(rivals):
    frame = rivals.record.to_pandas()
    key = ["learner", "condition", "phase", "trial", "subject"]
    needed = frame.groupby(key, observed=True)["attempt"].max()  # all stop when they are done
    conditions = (*FOUR, "CC3-CE4", "CE3-CE4")
    scores = {
        learner: [
            needed[learner, name, *(("test", 1) if "-" in name else ("train", 5))].to_numpy()
            for name in conditions
        ]
        for learner in FOUR_WAYS
    }
    pairs = pairs_of(rivals).set_index(["learner", "other"])
    assert len(pairs) == 4 * 3 / 2  # each pair once
    for one, other in itertools.combinations(FOUR_WAYS, 2):
        gaps = [a - b for a, b in zip(scores[one], scores[other], strict=True)]
        row = pairs.loc[(one, other)]
        assert row["difference"] == pytest.approx(np.mean(gaps))
        wins = np.mean([(gap < 0) + (gap == 0) / 2 for gap in gaps])
        assert row["probability"] == pytest.approx(wins)
        assert (row["conditions"], row["pairs"]) == (6, 6 * 12)
        if np.ptp(gaps) == 0:
            assert np.isnan(row[["ci_low", "ci_high"]].to_numpy(float)).all()
        else:
            assert row["ci_low"] < row["difference"] < row["ci_high"]


def test_rooms_that_are_hard_for_both_do_not_count_against_either():
    level = np.random.default_rng(0).integers(0, 9, 40)
    one = play("a", lambda *at: 4 + int(level[at[3]]), 12, ("CC4",))
    other = play("b", lambda *at: 5 + int(level[at[3]]) + (at[3] < 2), 12, ("CC4",))
    (row,) = pairs_of(material([*one, *other], ("a", "b"))).to_dict("records")
    assert row["difference"] == pytest.approx(-14 / 12)
    assert row["ci_high"] - row["ci_low"] < 0.5
    assert (row["pairs"], row["probability"]) == (12, 1.0)
    elsewhere = [{**line, "seed": 2} for line in other]  # other seeds, other rooms
    (row,) = pairs_of(material([*one, *elsewhere], ("a", "b"))).to_dict("records")
    assert (row["difference"], row["pairs"]) == (pytest.approx(-14 / 12), 0)
    assert row["ci_high"] - row["ci_low"] > 3
    gaps = np.subtract.outer(4 + level[:12], 5 + level[:12] + (np.arange(12) < 2))
    assert row["probability"] == pytest.approx(np.mean((gaps < 0) + (gaps == 0) / 2))


def test_pairs_of_protocols_that_do_not_meet_are_not_made():
    rows = [*play("a", scattered(1), 3), *play("b", scattered(2), 3)]
    alone = play("c", scattered(3), 3, protocol="mine")
    (section,) = sections_of(material(rows + alone, ("a", "b", "c")), topics_called("pairwise"))
    assert [one.name for one in section.tables] == ["pairwise_human"]
    assert section.plots == ()  # a single pair is told in a sentence
    assert section.tables[0].frame[["learner", "other"]].to_numpy().tolist() == [["a", "b"]]
    apart = [*play("a", same(4), 2, ("CC4",)), *play("b", same(5), 2, ("CE4",))]
    for few in (material(alone, ("c",)), material(apart, ("a", "b"))):
        assert sections_of(few, topics_called("pairwise")) == []


def test_the_matrix_shows_every_pair_once_best_first_and_fits_the_page(rivals):
    axes = plot_pairs(rivals, ax=Figure())
    order = [label.get_text() for label in axes.get_yticklabels()]
    assert order == ["perfect", "quick", "slow", "random"]
    shown = {
        (order[round(text.get_position()[1])], order[round(text.get_position()[0])]): text
        for text in axes.texts
    }
    pairs = pairs_of(rivals)
    assert len(shown) == len(pairs) == 6
    for one, other, chance in pairs[["learner", "other", "probability"]].to_numpy():
        if order.index(one) > order.index(other):
            one, other, chance = other, one, 1 - chance
        assert shown[one, other].get_text() == f"{chance:.2f}"
    names = [f"a learner whose name is long {i}" for i in range(12)]
    figure = Figure()
    plot_pairs(held(**{name: (same(3), 1, ("CC4",)) for name in names}), ax=figure)
    assert figure.get_figwidth() <= WIDTH + 1e-9
