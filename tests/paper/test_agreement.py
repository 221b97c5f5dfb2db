"""Ours against the paper's counts: every verdict on records whose truth is known."""

import numpy as np
import pyarrow as pa
import pytest

from causal_openlock.analysis.measures import TRANSFERS, attempts_to_solve
from causal_openlock.analysis.topics.learning import FINDS_ALL, OPENS, shares
from causal_openlock.evidence.study import read_study
from causal_openlock.paper.agreement import (
    AGREES,
    DISAGREES,
    MARGIN,
    TOPIC,
    UNDECIDED,
    baseline_course,
    baseline_points,
    grows,
    kendall,
    margin_of,
    published_shares,
    same,
    transfer_order,
    transfer_points,
)
from causal_openlock.world import facts
from support.fabricated_courses import around, course, described
from support.made_up_experiments import material_of
from support.places import ROOT
from support.topics import section_on

PAPER = {"CC3-CC4": 0.284, "CE3-CC4": 0.301, "CC3-CE4": 0.166, "CE3-CE4": 0.430}
ALL_SIX = "conditions: [CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4]\n"
BOTH = "learners: [random, {learner: ddqn, name: a}]\n"
COUNTS = facts.results()["cogsci2018"]["ddqn"]


def played(means, subjects=10, **names):
    """A test phase of five visits in each transfer case, subjects around these means."""
    own = {"phase": "test", "attempts": 100, **names}
    return pa.concat_tables(
        course(around([mean] * 5, subjects, seed=k), condition=case, schema=case[-3:], **own)
        for k, (case, mean) in enumerate(means.items())
    )


def whole(means, **names):
    return shares(attempts_to_solve(played(means, **names)), parts=1)


def test_the_papers_shares_are_those_of_its_counts():
    for case, share in PAPER.items():
        own = published_shares(COUNTS["transfer_counts"][case])
        assert own[OPENS] == pytest.approx(share, abs=5e-4)
    assert own[FINDS_ALL] == pytest.approx(32 / 60)
    assert own["else"] == pytest.approx(6883 / 18000)
    first, *_, last = map(published_shares, COUNTS["baseline_counts"]["CE4"].values())
    assert (first["else"], last["else"]) == pytest.approx((0.187, 0.971), abs=1e-3)
    assert first[FINDS_ALL] == pytest.approx(0.72, abs=1e-3)


def test_the_margin_lies_between_shares_that_the_paper_calls_the_same_and_different():
    gaps = np.diff(sorted(PAPER.values()))
    assert gaps.min() < MARGIN < sorted(gaps)[1] / 2
    assert margin_of(OPENS, 0.3, 60) == MARGIN
    assert margin_of(FINDS_ALL, 0.3, 60) == pytest.approx(1.96 * (0.21 / 60) ** 0.5)
    assert margin_of(FINDS_ALL, 0.0, 100) == MARGIN
    claims = read_study(ROOT / "evidence" / "figure7").file.claims
    levels = [claim for name, claim in claims.items() if name.startswith("levels")]
    assert len(levels) == 3
    for claim in levels:
        assert [one.smallest for one in claim.contrasts.values()] == [MARGIN] * 4


# -- single points --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mean", "spread", "verdict"),
    [
        (0.30, 0.01, AGREES),
        (0.33, 0.01, AGREES),
        (0.35, 0.03, UNDECIDED),  # its interval reaches over the margin
        (0.30, 0.20, UNDECIDED),  # right on average, and far too uncertain
        (0.40, 0.01, DISAGREES),
        (0.10, 0.03, DISAGREES),
    ],
)
def test_a_share_against_the_papers(mean, spread, verdict):
    values = mean + spread * np.array([-1.5, -1, -0.5, -0.2, 0, 0, 0.2, 0.5, 1, 1.5])
    ours, low, high, found = same(values, 0.3, 0.05)
    assert found == verdict
    assert (low + high) / 2 == pytest.approx(ours, abs=spread / 5)


def test_few_subjects_and_few_visits_decide_nothing():
    assert same(np.full(4, 0.3), 0.3, 0.05)[3] == UNDECIDED
    assert same(np.full(5, 0.3), 0.3, 0.05)[3] == AGREES
    # None of 8 visits: the share may well be .3. None of 500: surely not.
    few = same(np.zeros(5), 0.3, 0.05, visits=8)
    assert few[1:3] == pytest.approx((0.0, 0.324), abs=1e-3)
    assert few[3] == UNDECIDED
    assert same(np.zeros(5), 0.3, 0.05, visits=500)[3] == DISAGREES


@pytest.mark.parametrize(
    ("gain", "verdict"),
    [
        ([0.3, 0.2, 0.4, 0.3, 0.3], AGREES),
        ([0.06, 0.05, 0.07, 0.08, 0.06], AGREES),
        ([0.01, 0.02, 0.01, 0.02, 0.01], DISAGREES),  # sure, and next to nothing
        ([-0.3, -0.2, -0.4, -0.1, -0.3], DISAGREES),
        ([0.5, -0.2, 0.3, -0.1, 0.1], UNDECIDED),
        ([0.3, 0.2, 0.4, 0.3], UNDECIDED),  # four subjects
    ],
)
def test_growth(gain, verdict):
    assert grows(np.array(gain)) == verdict


# -- Figure 7 -------------------------------------------------------------------------------------


def test_a_learner_with_the_papers_shares_agrees_everywhere():
    points = transfer_points(whole(PAPER)).set_index(["condition", "point"])
    for case, share in PAPER.items():
        assert points.loc[(case, OPENS), "verdict"] == AGREES
        assert points.loc[(case, OPENS), "ours"] == pytest.approx(share, abs=0.03)
    order = transfer_order(whole(PAPER)).set_index("pair")
    assert order.loc["tau", "paper"] == 1.0
    assert len(order) == 7
    # Those that the paper has nearly the same are so here, the others in the paper's order.
    assert set(order.drop("tau")["verdict"]) == {AGREES}


def test_the_opposite_order_disagrees_and_no_difference_is_undecided():
    opposite = whole({case: 0.6 - share for case, share in PAPER.items()})
    order = transfer_order(opposite).set_index("pair")
    assert order.loc["tau", "ours"] <= -2 / 3
    assert order.loc["tau", "verdict"] == DISAGREES
    assert order.loc["CC3-CE4 − CE3-CE4", "verdict"] == DISAGREES
    assert order.loc["CC3-CC4 − CE3-CC4", "verdict"] == AGREES  # still nearly the same
    assert (transfer_points(opposite)["verdict"] == AGREES).sum() <= 2
    order = transfer_order(whole(dict.fromkeys(TRANSFERS, 0.3))).set_index("pair")
    assert order.loc["tau", "verdict"] == UNDECIDED
    assert order.loc["CC3-CC4 − CE3-CC4", "verdict"] == AGREES
    assert set(transfer_order(whole(PAPER, subjects=3))["verdict"]) == {UNDECIDED}


@pytest.mark.parametrize(
    ("values", "tau"),
    [
        ([0.284, 0.301, 0.166, 0.430], 1),  # the paper's order
        ([0.301, 0.284, 0.166, 0.430], 4 / 6),  # one pair of six the other way: (5 - 1) / 6
        ([0.430, 0.166, 0.301, 0.284], -2 / 6),  # two pairs right, four wrong
        ([0.3, 0.3, 0.166, 0.430], 5 / 6),  # a tie counts nothing
    ],
)
def test_kendalls_tau_worked_by_hand(values, tau):
    paper = np.array([0.284, 0.301, 0.166, 0.430])
    assert kendall(np.array([values]).T, paper) == pytest.approx([tau])


# -- Figure 6 -------------------------------------------------------------------------------------


def baseline(condition, other, loops=1, **names):
    """Ten subjects in five visits a loop, ``else`` as told in each fifth, half of the rest open."""
    rest = around(np.repeat(1 - np.array(other), loops), spread=0.01)
    opens = np.rint(rest * 50) / 100
    own = {"condition": condition, "schema": condition, "attempts": 100, **names}
    return course(opens, other=np.clip((1 - rest) / (1 - opens), 0, 1), **own)


@pytest.mark.parametrize("loops", [1, 3])
def test_the_decline_of_figure_6_is_recognised_whatever_the_length(loops):
    improves = shares(attempts_to_solve(baseline("CC4", [0.77, 0.7, 0.6, 0.5, 0.43])))
    points = baseline_points(improves).set_index("point")
    assert points.loc["else grows", "verdict"] == DISAGREES
    paper = COUNTS["baseline_counts"]["CE4"]
    other = [published_shares(block)["else"] for block in paper.values()]
    parts = shares(attempts_to_solve(baseline("CE4", other, loops)))
    points = baseline_points(parts).set_index("point")
    for point in ("else grows", "else, block 1", "else, block 5"):
        assert points.loc[point, "verdict"] == AGREES
    assert points.loc["else grows", "ours"] == pytest.approx(other[-1] - other[0], abs=0.03)
    assert points.loc["opens, block 1", "verdict"] == DISAGREES  # .41 and not .65
    told = baseline_course(parts).set_index(["learner", "condition", "measure"])
    mine = told.loc[("a", "CE4", "else")]
    assert mine[[f"block{k}" for k in range(1, 6)]].tolist() == pytest.approx(other, abs=0.02)
    assert mine["attempts"] == 500 * loops
    assert told.loc[("paper", "CE4", "else"), "attempts"] == 150_000
    assert told.loc[("paper", "CC4", OPENS), "block1"] == pytest.approx(0.367, abs=1e-3)


# -- the section ----------------------------------------------------------------------------------


def test_the_section_counts_the_verdicts(tmp_path):
    record = pa.concat_tables(
        [
            played(PAPER | {"CE3-CE4": 0.55}),
            baseline("CE4", [0.2, 0.4, 0.9, 0.97, 0.97]),
            baseline("CC4", [0.5, 0.5, 0.5, 0.5, 0.5]),
            played(PAPER, learner="random"),
        ]
    )
    made = section_on(TOPIC, material_of(record, described(tmp_path, ALL_SIX + BOTH)))
    tables = {one.name: one.frame for one in made.tables}
    assert list(tables) == [
        *("figure6_course", "figure6_agreement", "figure7_agreement", "figure7_order")
    ]
    grows = tables["figure6_agreement"].set_index(["point", "condition"])["verdict"]["else grows"]
    assert grows.to_dict() == {"CC4": "disagrees", "CE4": "agrees"}
    verdicts = [*tables["figure7_agreement"]["verdict"], *grows]
    numbers = [len(verdicts), *map(verdicts.count, ("agrees", "disagrees", "undecided"))]
    assert len(made.text) == 1  # nothing is said of random
    assert [int(word) for word in made.text[0].split() if word.isdecimal()][:4] == numbers
    human = baseline("CC4", [0.43, 0.4, 0.6, 0.7, 0.77], protocol="human")
    assert section_on(TOPIC, material_of(human, described(tmp_path, ALL_SIX + BOTH))) is None
