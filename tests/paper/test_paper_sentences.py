"""Sentences of the paper that its own numbers give, or contradict, and the page that lists all."""

import itertools
import math
import re
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from scipy import stats

from causal_openlock.analysis.effects import Group
from causal_openlock.contract.registry import create
from causal_openlock.experiment.declare import PROTOCOLS, find_condition
from causal_openlock.experiment.session import Session
from causal_openlock.paper.significance import contrast_test, t_test
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world import facts
from causal_openlock.world.room import Layout, Room
from support.places import ROOT

HUMAN = facts.results()["cogsci2018"]["human"]
DDQN = facts.results()["cogsci2018"]["ddqn"]
LATER = facts.results()["cogsci2019"]["human"]
FIFTHS = ("0-30k", "30-60k", "60-90k", "90-120k", "120-150k")


def in_test(condition):
    """People in a test, as Figure 4 has them."""
    return Group.published(**HUMAN["transfer"][condition], size=40)


# -- people ---------------------------------------------------------------------------------------


def test_the_effect_of_the_test_structure_has_another_f_in_the_two_way_analysis():
    cells = [in_test(name) for name in ("CE3-CE4", "CC3-CE4", "CE3-CC4", "CC3-CC4")]
    two_way = contrast_test(cells, (0.5, 0.5, -0.5, -0.5))
    assert (two_way.df, round(two_way.value, 2)) == ((1, 156), 20.03)
    # The one-way test counts what training and the interaction explain as error.
    grand = np.mean([cell.mean for cell in cells])
    within = sum(39 * cell.variance for cell in cells)
    between = sum(40 * (cell.mean - grand) ** 2 for cell in cells)
    structure = 40 * two_way.difference**2
    one_way = structure / ((within + between - structure) / 158)
    assert one_way == pytest.approx(17.14, abs=0.01)


def test_after_incongruent_training_cc4_took_more_than_congruent_ce4():
    """So CE did not take more "in all cases", and CE3-CE4 was the third hardest, not the second."""
    means = {name: in_test(name).mean for name in HUMAN["transfer"]}
    assert sorted(means, key=means.__getitem__) == ["CC3-CC4", "CE3-CE4", "CE3-CC4", "CC3-CE4"]
    assert (means["CE3-CC4"], means["CE3-CE4"]) == (8.175, 7.725)
    lowest = min(HUMAN["baseline"]["CC4"]["mean"] + HUMAN["baseline"]["CE4"]["mean"])
    assert min(means.values()) == 5.525 < lowest
    difference = t_test(in_test("CE3-CC4"), in_test("CE3-CE4"))
    assert difference.value == pytest.approx(0.38, abs=0.005)


def test_congruent_training_helped_with_ce4_more_than_with_cc4():
    gains = [
        t_test(in_test(other), in_test(same))
        for other, same in (("CE3-CC4", "CC3-CC4"), ("CC3-CE4", "CE3-CE4"))
    ]
    assert [round(gain.value, 2) for gain in gains] == [2.62, 4.27]
    assert [gain.difference for gain in gains] == pytest.approx([2.65, 6.025])


def test_attempts_fall_in_every_trial_but_the_last_of_ce4():
    steps = {name: np.diff(of["mean"]) for name, of in HUMAN["baseline"].items()}
    assert (steps["CC4"] < 0).all()
    assert (steps["CE4"] < 0).tolist() == [True, True, True, False]
    assert HUMAN["baseline"]["CE4"]["mean"][3:] == [9.35, 9.425]
    cc4, ce4 = (np.array(HUMAN["baseline"][name]["mean"]) for name in ("CC4", "CE4"))
    assert (ce4 > cc4).all()


def test_that_complexity_decides_is_not_shown_by_its_own_interaction():
    """CE minus CC, in the last trial: four levers (Figure 3) against three (the later paper)."""
    baseline = HUMAN["baseline"]
    four = [
        Group.published(baseline[name]["mean"][-1], baseline[name]["se"][-1], 40)
        for name in ("CE4", "CC4")
    ]
    three = [
        (LATER["all"][name]["mean"][-1], LATER["all"][name]["se"][-1]) for name in ("CE3", "CC3")
    ]
    assert [mean for mean, _ in three] == [4.44, 4.11]
    apart = four[0].mean - four[1].mean, three[0][0] - three[1][0]
    assert apart == pytest.approx((2.975, 0.33))
    squares = sum(one.variance / 40 for one in four) + sum(se**2 for _, se in three)
    half = stats.norm.ppf(0.975) * math.sqrt(squares)
    interval = apart[0] - apart[1] - half, apart[0] - apart[1] + half
    assert interval == pytest.approx((-0.6, 5.9), abs=0.05)


def test_people_of_the_later_paper_need_fewer_attempts_after_the_first_solution():
    for name in ("CC3", "CE3"):
        first, second = (np.array(LATER[key][name]["mean"]) for key in ("first", "second"))
        assert (second <= first + 0.55).all()
        assert second[0] < first[0] - 3
    assert (LATER["first"]["CC3"]["mean"][0], LATER["second"]["CC3"]["mean"][0]) == (8.57, 4.9)


# -- the paper's DDQN -----------------------------------------------------------------------------


@pytest.mark.parametrize("counts", [*DDQN["baseline_counts"].values()], ids=["CC4", "CE4"])
def test_in_figure_6_later_solutions_are_rarer_in_every_fifth(counts):
    for of in counts.values():
        assert sum(of.values()) == 30_000
        assert of["open3"] < of["open2"] < of["open1"]


def test_else_does_not_grow_monotonically_in_figure_6():
    course = {
        name: [counts[fifth]["else"] for fifth in FIFTHS]
        for name, counts in DDQN["baseline_counts"].items()
    }
    assert (np.diff(course["CC4"]) > 0).tolist() == [False, True, True, True]
    assert (np.diff(course["CE4"]) > 0).tolist() == [True, True, True, False]
    assert course["CC4"][:2] == [12_962, 11_658]
    assert course["CE4"][3:] == [29_185, 29_140]


def test_in_figure_6_most_visits_to_ce4_find_every_solution_at_first():
    """A visit has 300 attempts, and one new second and third solution at most."""
    counts = DDQN["baseline_counts"]["CE4"]
    visits = 30_000 / 300
    shares = [
        [counts[fifth][name] / visits for name in ("open2", "open3")]
        for fifth in (FIFTHS[0], FIFTHS[-1])
    ]
    assert shares == [[0.93, 0.72], [0.27, 0.04]]


def opened_in_figure_7():
    """Share of attempts that open the door in each case."""
    shares = {}
    for case, counts in DDQN["transfer_counts"].items():
        assert sum(counts.values()) == 18_000 == 60 * 300
        shares[case] = sum(counts[f"open{k}"] for k in (1, 2, 3)) / 18_000
    return shares


def test_figure_7_has_the_shares_that_the_text_gives_but_for_a_point():
    shares = opened_in_figure_7()
    assert {case: round(share, 3) for case, share in shares.items()} == {
        "CC3-CC4": 0.284,
        "CE3-CC4": 0.301,
        "CC3-CE4": 0.166,
        "CE3-CE4": 0.430,
    }


def test_the_asymmetry_is_less_pronounced_in_the_model_in_cc4_alone():
    shares = opened_in_figure_7()
    people = {name: in_test(name).mean for name in shares}
    attempts = [people["CE3-CC4"] / people["CC3-CC4"], people["CC3-CE4"] / people["CE3-CE4"]]
    opened = [shares["CC3-CC4"] / shares["CE3-CC4"], shares["CE3-CE4"] / shares["CC3-CE4"]]
    assert attempts == pytest.approx([1.48, 1.78], abs=0.005)
    assert opened == pytest.approx([0.94, 2.59], abs=0.005)
    # The same by differences, of people's in the thirty attempts that there are.
    saved = [(people["CE3-CC4"] - people["CC3-CC4"]) / 30]
    saved += [(people["CC3-CE4"] - people["CE3-CE4"]) / 30]
    gained = [shares["CC3-CC4"] - shares["CE3-CC4"], shares["CE3-CE4"] - shares["CC3-CE4"]]
    assert saved == pytest.approx([0.09, 0.20], abs=0.005)
    assert gained == pytest.approx([-0.02, 0.26], abs=0.005)


def test_no_learner_can_have_more_later_solutions_than_earlier_ones():
    """A visit has one new second solution at most, and a first one before it."""
    protocol = replace(PROTOCOLS["rl"], baseline_loops=1, attempt_limit=60)
    session = Session(find_condition("CE4"), protocol, 4, seed=3)
    record = session.play(create("win_stay")).to_pandas()
    counts = record.groupby("subject")["category"].value_counts().unstack(fill_value=0)
    assert (counts["open3"] <= counts["open2"]).all()
    assert (counts["open2"] <= counts["open1"]).all()
    assert counts["open3"].sum() > 0


# -- the room -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "moves", "unlocks"),
    [
        ("CC4", Fraction(1, 4), Fraction(1)),
        ("CE4", Fraction(3, 4), Fraction(1, 3)),
        ("CC3", Fraction(1, 3), Fraction(1)),
        ("CE3", Fraction(2, 3), Fraction(1, 2)),
    ],
)
def test_both_structures_are_as_likely_to_be_unlocked_by_two_random_pushes(name, moves, unlocks):
    """Of two active levers one after the other: the first moves, then the second unlocks."""
    schema = find_schema(name)
    levers = range(len(schema.levers))
    room = Room.of(schema, Layout(tuple(levers)))
    first = [room.next_state[0, lever] for lever in levers]
    moving = [lever for lever in levers if first[lever] != 0]
    assert Fraction(len(moving), len(levers)) == moves
    after = [
        bool(room.fsm.unlocked[room.next_state[first[one], other]])
        for one, other in itertools.permutations(levers, 2)
        if one in moving
    ]
    assert Fraction(sum(after), len(after)) == unlocks
    assert moves * unlocks == Fraction(1, len(levers))


# -- the page -------------------------------------------------------------------------------------


def test_every_sentence_has_a_row_with_a_verdict():
    text = (ROOT / "docs" / "reproduction.md").read_text(encoding="utf-8")
    tables = re.findall(r"^\| the paper says .*\n\|[-| ]+\n((?:\|.*\n)+)", text, re.MULTILINE)
    rows = [re.split(r"(?<!\\)\|", line)[1:-1] for table in tables for line in table.splitlines()]
    assert len(rows) > 80
    verdict = re.compile(r"\*\*\w|verdict\"\)|\]\(#")  # of its own, of a claim, of another row
    for row in rows:
        assert len(row) == 3, row
        assert verdict.search(row[1]), row
        assert row[2].strip(), row
