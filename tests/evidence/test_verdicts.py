"""That verdicts follow from the stated rules, against independent implementations."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from causal_openlock.evidence.study import Contrast, Selection
from causal_openlock.evidence.verdicts import (
    Estimate,
    difference,
    estimate,
    from_known,
    mean_of,
    paired,
    together,
    verdict,
)


@pytest.mark.parametrize("seed", range(5))
def test_intervals_are_students_and_welchs(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one, two = rng.normal(3, 1, 12), rng.normal(2, 3, 7)
    expected = stats.ttest_1samp(one, 0).confidence_interval()
    assert mean_of(one).interval() == pytest.approx((expected.low, expected.high))
    welch = stats.ttest_ind(one, two, equal_var=False).confidence_interval()
    assert difference(one, two).interval() == pytest.approx((welch.low, welch.high))


@pytest.mark.parametrize("seed", range(20))
def test_same_is_the_two_one_sided_tests_of_equivalence(seed: int) -> None:
    rng = np.random.default_rng(seed)
    one = rng.normal(0, 1, 15)
    two = one + rng.normal(0.1, 0.6, 15)
    p = ttost_paired(two, one, -0.5, 0.5)[0]
    assert (verdict(mean_of(two - one), "same", 0.5) == "holds") == (p <= 0.05)
    other = rng.normal(0.1, 0.6, 30)
    p = ttost_ind(other, one, -0.7, 0.7, usevar="unequal")[0]
    assert (verdict(difference(other, one), "same", 0.7) == "holds") == (p <= 0.05)


def at(low: float, high: float) -> Estimate:
    """An estimate with this 95% interval, from many units."""
    error = (high - low) / 2 / stats.t.ppf(0.975, 1e6)
    return Estimate((low + high) / 2, float(error), 1e6, (1000,))


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
    assert verdict(mean_of(np.array([9.0])), "more", 1.0) == "undecided"
    assert verdict(difference(np.array([9.0]), np.array([1.0, 2])), "more", 1.0) == "undecided"


def test_a_claim_holds_if_all_contrasts_do() -> None:
    assert together(["holds", "holds"]) == "holds"
    assert together(["does not hold", "does not hold"]) == "does not hold"
    assert together(["holds", "in part"]) == "in part"
    assert together(["does not hold", "undecided"]) == "undecided"


@pytest.mark.parametrize(("expected", "wrongly"), [("more", 0.025), ("same", 0.05)])
def test_a_claim_that_just_fails_is_believed_as_seldom_as_promised(
    expected: str, wrongly: float
) -> None:
    rng = np.random.default_rng(3)
    samples = rng.normal(1.0, 0.5, (4000, 10))  # exactly the smallest difference that matters
    held = [verdict(mean_of(row), expected, 1.0) == "holds" for row in samples]  # type: ignore[arg-type]
    assert np.mean(held) == pytest.approx(wrongly, abs=0.01)


def test_shares_that_are_all_equal_leave_room_for_what_was_missed() -> None:
    found = mean_of(np.ones(10), share=True)
    # A unit that differs with this probability is missed by ten draws in one of forty studies.
    missed = 1 - found.interval()[0]
    assert (1 - missed) ** 10 == pytest.approx(0.025)
    assert mean_of(np.full(10, 30.0)).interval() == (30.0, 30.0)


def test_people_count_with_their_standard_error() -> None:
    own = np.array([3.0, 4, 5, 4])
    found = from_known(mean_of(own), 6.45, 0.998)
    assert found.value == pytest.approx(4 - 6.45)
    assert found.error == pytest.approx(np.hypot(stats.sem(own), 0.998))


def units() -> pd.DataFrame:
    rows = [
        (learner, condition, "train", 5, True, unit, base + unit)
        for learner, base in (("a", 0.0), ("b", 2.0))
        for condition in ("CC4", "CE4")
        for unit in range(3)
    ]
    names = ["learner", "condition", "phase", "trial", "judged", "unit", "attempts"]
    return pd.DataFrame(rows, columns=names)


def contrast(of: Selection, minus: Selection) -> Contrast:
    return Contrast(measure="attempts", of=of, minus=minus, expected="more", smallest=1.0)


def test_subjects_are_paired_where_they_meet_the_same_rooms() -> None:
    b, a = (Selection(learner=name, condition="CC4") for name in "ba")
    found = estimate(units(), contrast(b, a), "subject")
    assert (found.value, found.error, found.units) == (2.0, 0.0, (3,))
    other = estimate(units(), contrast(b, Selection(learner="a", condition="CE4")), "subject")
    assert other.error > 0
    assert other.units == (3, 3)


def test_networks_are_paired_with_themselves_alone() -> None:
    a, b = (Selection(learner=name, condition="CC4") for name in "ab")
    assert not paired(a, b, "network")
    assert paired(a, Selection(learner="a", condition="CE4"), "network")
