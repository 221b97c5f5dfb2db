"""That verdicts follow from the stated rules, against independent implementations."""

from __future__ import annotations

from itertools import permutations
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from causal_openlock.evidence.multiplicity import chance
from causal_openlock.evidence.study import Contrast, Selection
from causal_openlock.evidence.units import Selected, selected
from causal_openlock.evidence.verdicts import (
    EQUIVALENCE,
    LEVEL,
    Estimate,
    Verdict,
    compared,
    difference,
    from_known,
    mean_of,
    paired,
    together,
    verdict,
)


def of(values: object, trials: int = 10**12, least: float = -1e3, most: float = 1e3) -> Selected:
    """Units with these values; by default of a number of trials that misses nothing."""
    found = np.asarray(values, float)
    return Selected(found, np.arange(len(found)), trials, least, most)


@pytest.mark.parametrize("seed", range(5))
def test_intervals_are_students_and_welchs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = rng.normal(3, 1, 12), rng.normal(2, 3, 7)
    expected = stats.ttest_1samp(one, 0).confidence_interval()
    assert mean_of(of(one)).interval == pytest.approx((expected.low, expected.high))
    welch = stats.ttest_ind(one, two, equal_var=False).confidence_interval()
    assert difference(of(one), of(two)).interval == pytest.approx((welch.low, welch.high))


@pytest.mark.parametrize("seed", range(20))
def test_same_is_the_two_one_sided_tests_of_equivalence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = rng.normal(0, 1, 15)
    two = one + rng.normal(0.1, 0.6, 15)
    p = ttost_paired(two, one, -0.5, 0.5)[0]
    assert (verdict(mean_of(of(two - one)), "same", 0.5) == "holds") == (p <= 0.05)
    other = rng.normal(0.1, 0.6, 30)
    p = ttost_ind(other, one, -0.7, 0.7, usevar="unequal")[0]
    assert (verdict(difference(of(other), of(one)), "same", 0.7) == "holds") == (p <= 0.05)


def at(low: float, high: float) -> Estimate:
    """An estimate with this 95% interval, from many units."""
    middle, half = (low + high) / 2, (high - low) / 2
    half *= float(stats.norm.ppf(0.95) / stats.norm.ppf(0.975))
    ends = {LEVEL: (low, high), EQUIVALENCE: (middle - half, middle + half)}
    return Estimate(middle, ends, (1000,))


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
    ],
)
def test_the_table_of_verdicts(low: float, high: float, expected: str, wanted: str) -> None:
    assert verdict(at(low, high), expected, 1.0) == wanted  # type: ignore[arg-type]


def test_one_unit_decides_nothing() -> None:
    assert verdict(mean_of(of([9.0])), "more", 1.0) == "undecided"
    assert verdict(difference(of([9.0]), of([1.0, 2])), "more", 1.0) == "undecided"


HOLDS, PART, FAILS, OPEN = get_args(Verdict)


@pytest.mark.parametrize(
    ("contrasts", "every", "whole"),
    [
        ([HOLDS], HOLDS, HOLDS),
        ([HOLDS, HOLDS], HOLDS, HOLDS),
        ([HOLDS, PART], PART, PART),
        ([PART, PART], PART, PART),
        ([HOLDS, OPEN], OPEN, PART),
        ([HOLDS, OPEN, OPEN], OPEN, OPEN),
        ([FAILS, OPEN], FAILS, OPEN),
        ([FAILS, HOLDS], FAILS, PART),
        ([FAILS, PART, OPEN, HOLDS], FAILS, PART),
        ([FAILS, OPEN, OPEN, HOLDS], FAILS, OPEN),
        ([FAILS, FAILS, HOLDS], FAILS, FAILS),
        ([FAILS, FAILS], FAILS, FAILS),
        ([OPEN], OPEN, OPEN),
        ([], OPEN, OPEN),
    ],
)
def test_a_claim_about_every_case_has_no_exception_and_one_about_the_whole_up_to_half(
    contrasts: list[Verdict], every: Verdict, whole: Verdict
) -> None:
    for order in permutations(contrasts):
        assert together(order) == every
        assert together(order, "whole") == whole


@pytest.mark.parametrize("expected", ["more", "same"])
def test_a_contrast_at_its_margin_is_decided_by_chance_as_seldom_as_promised(
    expected: str,
) -> None:
    rng = np.random.default_rng(3)
    samples = rng.normal(1.0, 0.5, (4000, 10))  # exactly the smallest difference that matters
    said = [verdict(mean_of(of(row)), expected, 1.0) for row in samples]  # type: ignore[arg-type]
    one = Selection(learner="a", condition="CC4")
    asked = Contrast(measure="attempts", of=one, minus=0.0, expected=expected, smallest=1.0)  # type: ignore[arg-type]
    assert said.count("holds") / len(said) == pytest.approx(chance(asked), abs=0.01)
    assert said.count("does not hold") / len(said) <= chance(asked) + 0.01


def test_people_count_with_their_standard_error() -> None:
    own = of([3.0, 4, 5, 4])
    found = from_known(mean_of(own), 6.45, 0.998, 40)
    assert found.value == pytest.approx(4 - 6.45)
    theirs, mine = stats.t.ppf(0.975, 39) * 0.998, stats.t.ppf(0.975, 3) * stats.sem(own.values)
    assert found.interval[1] - found.value == pytest.approx(np.hypot(theirs, mine))


def test_two_units_decide_nothing() -> None:
    found = mean_of(of([4.0, 4.1]))
    assert np.isnan(found.interval[0])
    assert verdict(found, "more", smallest=1) == "undecided"
    assert verdict(mean_of(of([4.0, 4.1, 4.2])), "more", smallest=1) == "holds"


def test_published_shares_are_taken_as_they_are() -> None:
    own = mean_of(of([0.4, 0.5, 0.45, 0.5]))
    found = from_known(own, 0.28, 0.0, 1)
    assert found.interval == pytest.approx((own.interval[0] - 0.28, own.interval[1] - 0.28))


def units() -> pd.DataFrame:
    rows = [
        (learner, condition, "train", 5, True, unit, 1, base + unit)
        for learner, base in (("a", 0.0), ("b", 2.0))
        for condition in ("CC4", "CE4")
        for unit in range(3)
    ]
    names = ["learner", "condition", "phase", "trial", "judged", "unit", "trials", "attempts"]
    return pd.DataFrame(rows, columns=names).assign(protocol="human")


def contrast(of: Selection, minus: Selection) -> Contrast:
    return Contrast(measure="attempts", of=of, minus=minus, expected="more", smallest=1.0)


def test_subjects_are_paired_where_they_meet_the_same_rooms() -> None:
    b, a = (Selection(learner=name, condition="CC4") for name in "ba")
    table = units()
    table.loc[(table["learner"] == "b") & (table["unit"] == 2), "attempts"] += 0.5
    found = compared(table, contrast(b, a), "subject")(1.0)
    assert found.units == (3,)
    assert found.value == pytest.approx(2.0 + 0.5 / 3)
    other = compared(table, contrast(b, Selection(learner="a", condition="CE4")), "subject")(1.0)
    assert other.units == (3, 3)
    assert np.diff(other.interval) > np.diff(found.interval)


def test_networks_are_paired_with_themselves_alone() -> None:
    a, b = (Selection(learner=name, condition="CC4") for name in "ab")
    assert not paired(a, b, "network", {})
    assert paired(a, b, "network", {"b": "a"})
    assert paired(a, Selection(learner="a", condition="CE4"), "network", {})


def test_a_unit_counts_if_it_has_all_conditions() -> None:
    table = units()
    table = table[~((table["condition"] == "CE4") & (table["unit"] == 2))]
    found = selected(table, Selection(learner="a", condition=["CC4", "CE4"]), "attempts")
    assert found.units.tolist() == [0, 1]
