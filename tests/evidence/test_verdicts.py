"""That verdicts follow from the stated rules, against independent implementations."""

from itertools import permutations
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from causal_openlock.analysis.effects import Group
from causal_openlock.errors import EvidenceError
from evidence.study import Contrast, Networks
from evidence.units import selected, with_differences
from evidence.verdicts import (
    EQUIVALENCE,
    LEVEL,
    Estimate,
    Verdict,
    compared,
    estimate,
    mean_of,
    mean_selected,
    together,
    verdict,
)


def difference(of, minus):
    return estimate(Group.of(of), Group.of(minus, -1.0))


@pytest.mark.parametrize("seed", range(20))
def test_same_is_the_two_one_sided_tests_of_equivalence(seed):
    rng = np.random.default_rng(seed)
    one = rng.normal(0, 1, 15)
    two = one + rng.normal(0.1, 0.6, 15)
    p = ttost_paired(two, one, -0.5, 0.5)[0]
    assert (verdict(mean_of(two - one), "same", 0.5) == "holds") == (p <= 0.05)
    other = rng.normal(0.1, 0.6, 30)
    p = ttost_ind(other, one, -0.7, 0.7, usevar="unequal")[0]
    assert (verdict(difference(other, one), "same", 0.7) == "holds") == (p <= 0.05)


def at(low, high):
    """An estimate with this 95% interval, from many units."""
    middle, half = (low + high) / 2, (high - low) / 2
    half *= float(stats.norm.ppf(0.95) / stats.norm.ppf(0.975))
    ends = {LEVEL: (low, high), EQUIVALENCE: (middle - half, middle + half)}
    return Estimate(middle, ends.__getitem__, (1000,))


@pytest.mark.parametrize(
    ("low", "high", "expected", "wanted"),
    [
        (1.1, 2.0, "more", "holds"),
        (0.1, 2.0, "more", "in part"),
        (0.1, 0.9, "more", "does not hold"),
        (-2.0, -0.5, "more", "does not hold"),
        (-0.5, 2.0, "more", "undecided"),
        (-2.0, -1.1, "less", "holds"),
        (-2.0, -0.1, "less", "in part"),
        (-0.5, 3.0, "less", "does not hold"),
        (-0.9, 0.9, "same", "holds"),
        (1.1, 2.0, "same", "does not hold"),
        (-3.0, -1.1, "same", "does not hold"),
        (0.5, 2.0, "same", "undecided"),
        (1.0, 2.0, "more", "holds"),  # a difference of exactly the margin matters
        (0.1, 1.0, "more", "in part"),
        (0.0, 2.0, "more", "undecided"),
        (1.0, 3.0, "same", "does not hold"),
    ],
)
def test_the_table_of_verdicts(low, high, expected, wanted):
    assert verdict(at(low, high), expected, 1.0) == wanted
    ends = {LEVEL: (-2.0, 2.0), EQUIVALENCE: (-0.9, 0.9)}
    within = Estimate(0.0, ends.__getitem__, (1000,))
    assert verdict(within, "same", 1.0) == "holds"


def test_four_units_decide_nothing():
    four, five = np.array([4.0, 4.1, 4.2, 4.3]), np.array([4.0, 4.1, 4.2, 4.3, 4.4])
    assert verdict(mean_of(four), "more", smallest=1) == "undecided"
    assert verdict(difference(five, four), "more", smallest=1) == "undecided"
    assert verdict(mean_of(five), "more", smallest=1) == "holds"


def test_where_nearly_all_are_alike_an_exact_test_decides():
    """Thirty-eight of forty pairs differ by 2; two groups are as many at 30 and at 4."""
    pairs = mean_of(np.r_[np.full(38, 2.0), 0.0, 1.0])
    assert np.isnan(pairs.interval[0])
    assert pairs.alike == "38 of 40 at 2 (83% to 99%)"
    asked = [("more", 1.0), ("more", 2.0), ("more", 3.0), ("less", 1.0), ("same", 3.0), ("same", 1)]
    said = [verdict(pairs, expected, margin) for expected, margin in asked]
    assert said == [HOLDS, HOLDS, FAILS, FAILS, HOLDS, FAILS]
    groups = difference(np.r_[np.full(9, 30.0), 12.0], np.r_[np.full(9, 4.0), 5.0])
    assert [verdict(groups, "more", margin) for margin in (10.0, 40.0)] == [HOLDS, FAILS]
    assert verdict(mean_of(np.full(5, 2.0)), "more", 1.0) == OPEN  # five signs: p = .06
    share = mean_of(np.r_[np.ones(39), 0.0], 0.8)  # of units that did it: Wilson's
    assert share.interval == pytest.approx((0.0712, 0.1956), abs=1e-4)


HOLDS, PART, FAILS, OPEN = get_args(Verdict)


@pytest.mark.parametrize(
    ("contrasts", "claim"),
    [
        ([HOLDS, HOLDS], HOLDS),
        ([HOLDS, PART], PART),
        ([PART, PART], PART),
        ([HOLDS, OPEN], OPEN),
        ([HOLDS, OPEN, OPEN], OPEN),
        ([FAILS, OPEN], FAILS),
        ([FAILS, HOLDS], FAILS),
        ([FAILS, PART, OPEN, HOLDS], FAILS),
        ([FAILS, OPEN, OPEN, HOLDS], FAILS),
        ([FAILS, FAILS, HOLDS], FAILS),
        ([], OPEN),
    ],
)
def test_any_contrast_that_does_not_hold_refutes_a_claim(contrasts, claim):
    assert all(together(order) == claim for order in permutations(contrasts))


def contrast(of, minus, expected="more"):
    return Contrast(measure="attempts", of=of, minus=minus, expected=expected, smallest=1.0)


def units():
    rows = [
        (learner, condition, unit, base + unit)
        for learner, base in (("a", 0.0), ("b", 2.0))
        for condition in ("CC4", "CE4")
        for unit in range(5)
    ]
    table = pd.DataFrame(rows, columns=["learner", "condition", "unit", "attempts"])
    return table.assign(protocol="human", phase="train", trial=5, judged=True, trials=1)


def test_subjects_are_paired_where_they_meet_the_same_rooms():
    table = units()
    table.loc[(table["learner"] == "b") & (table["unit"] == 2), "attempts"] += 0.5
    same, apart = (compared(table, contrast("b CC4", minus), None) for minus in ("a CC4", "a CE4"))
    assert (same.units, apart.units) == ((5,), (5, 5))
    assert same.value == pytest.approx(2.0 + 0.5 / 5)
    assert np.diff(apart.interval) > np.diff(same.interval)


def test_networks_are_paired_with_themselves_alone():
    def sides(of, minus, **files):
        networks = Networks(files={"a": "a.yaml", **files}, seeds=[1])
        return len(compared(units(), contrast(of, minus), networks).units)

    assert sides("b CC4", "a CC4", b="b.yaml") == 2
    assert sides("b CC4", "a CC4") == 1  # a variant has the networks of the first file
    assert sides("a CC4", "a CE4") == 1


def test_a_unit_counts_if_it_has_all_conditions():
    table = units()
    table = table[~((table["condition"] == "CE4") & (table["unit"] > 1))]
    assert selected(table, "a CC4+CE4", "attempts").index.tolist() == [0, 1]


def test_parameters_are_recovered_if_the_true_ones_come_out_again():
    about = {"learner": "a", "condition": "", "phase": "test", "judged": True, "protocol": ""}
    table = pd.DataFrame({"unit": range(5), "parameter": "gain", "true": [0.1, 0.2, 0.3, 0.5, 0.9]})
    table = with_differences(table.assign(fitted=[0.3, 0.1, 0.5, 0.4, 0.8], **about))
    found = mean_selected(table, "a parameter gain", "r", 0.2)
    r = np.corrcoef(table["true"], table["fitted"])[0, 1]
    z = np.arctanh(r) + np.array([-1, 1]) * 1.959964 / np.sqrt(5 - 3)
    assert found.value == pytest.approx(r - 0.2)
    assert found.interval == pytest.approx(np.tanh(z) - 0.2, abs=1e-6)
    assert found.n == "5"
    with pytest.raises(EvidenceError, match="too few"):
        mean_selected(table[:3], "a parameter gain", "r")
