"""That verdicts follow from the stated rules, against independent implementations."""

from itertools import permutations
from typing import get_args

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.weightstats import ttost_ind, ttost_paired

from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.study import Contrast, Selection, Study, StudyFile
from causal_openlock.evidence.study_files import RUN
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


def of(values, trials=10**12, least=-1e3, most=1e3):
    """Units with these values; by default of a number of trials that misses nothing."""
    found = np.asarray(values, float)
    return Selected(found, np.arange(len(found)), trials, least, most)


@pytest.mark.parametrize("seed", range(5))
def test_intervals_are_students_and_welchs(seed):
    rng = np.random.default_rng(seed)
    one, two = rng.normal(3, 1, 12), rng.normal(2, 3, 7)
    expected = stats.ttest_1samp(one, 0).confidence_interval()
    assert mean_of(of(one)).interval == pytest.approx((expected.low, expected.high))
    welch = stats.ttest_ind(one, two, equal_var=False).confidence_interval()
    assert difference(of(one), of(two)).interval == pytest.approx((welch.low, welch.high))


@pytest.mark.parametrize("seed", range(20))
def test_same_is_the_two_one_sided_tests_of_equivalence(seed):
    rng = np.random.default_rng(seed)
    one = rng.normal(0, 1, 15)
    two = one + rng.normal(0.1, 0.6, 15)
    p = ttost_paired(two, one, -0.5, 0.5)[0]
    assert (verdict(mean_of(of(two - one)), "same", 0.5) == "holds") == (p <= 0.05)
    other = rng.normal(0.1, 0.6, 30)
    p = ttost_ind(other, one, -0.7, 0.7, usevar="unequal")[0]
    assert (verdict(difference(of(other), of(one)), "same", 0.7) == "holds") == (p <= 0.05)


def at(low, high):
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
        (1.0, 2.0, "more", "holds"),  # at the margin, or at 0
        (0.1, 1.0, "more", "in part"),
        (0.0, 2.0, "more", "undecided"),
        (1.0, 3.0, "same", "undecided"),
    ],
)
def test_the_table_of_verdicts(low, high, expected, wanted):
    assert verdict(at(low, high), expected, 1.0) == wanted
    within = Estimate(0.0, {LEVEL: (-2.0, 2.0), EQUIVALENCE: (-1.0, 1.0)}, (1000,))
    assert verdict(within, "same", 1.0) == "holds"


def test_one_unit_and_two_decide_nothing():
    assert verdict(mean_of(of([9.0])), "more", 1.0) == "undecided"
    assert verdict(difference(of([9.0]), of([1.0, 2])), "more", 1.0) == "undecided"
    two = mean_of(of([4.0, 4.1]))
    assert np.isnan(two.interval[0])
    assert verdict(two, "more", smallest=1) == "undecided"
    assert verdict(mean_of(of([4.0, 4.1, 4.2])), "more", smallest=1) == "holds"


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


@pytest.mark.parametrize("expected", ["more", "same"])
def test_a_contrast_at_its_margin_is_decided_by_chance_as_seldom_as_promised(expected):
    rng = np.random.default_rng(3)
    samples = rng.normal(1.0, 0.5, (4000, 10))  # exactly the smallest difference that matters
    said = [verdict(mean_of(of(row)), expected, 1.0) for row in samples]
    chance = {"more": 0.025, "same": 0.05}[expected]
    assert said.count("holds") / len(said) == pytest.approx(chance, abs=0.01)
    assert said.count("does not hold") / len(said) <= chance + 0.01


def test_people_count_with_their_standard_error_and_published_shares_without():
    own = of([3.0, 4, 5, 4])
    found = from_known(mean_of(own), 6.45, 0.998, 40)
    assert found.value == pytest.approx(4 - 6.45)
    theirs, mine = stats.t.ppf(0.975, 39) * 0.998, stats.t.ppf(0.975, 3) * stats.sem(own.values)
    assert found.interval[1] - found.value == pytest.approx(np.hypot(theirs, mine))
    mean = mean_of(of([0.4, 0.5, 0.45, 0.5]))
    found = from_known(mean, 0.28, 0.0, 1)
    assert found.interval == pytest.approx((mean.interval[0] - 0.28, mean.interval[1] - 0.28))


def units():
    rows = [
        (learner, condition, unit, base + unit)
        for learner, base in (("a", 0.0), ("b", 2.0))
        for condition in ("CC4", "CE4")
        for unit in range(3)
    ]
    table = pd.DataFrame(rows, columns=["learner", "condition", "unit", "attempts"])
    return table.assign(protocol="human", phase="train", trial=5, judged=True, trials=1)


def test_subjects_are_paired_where_they_meet_the_same_rooms():
    b, a, other = (
        Selection(learner=one, condition=where)
        for one, where in (("b", "CC4"), ("a", "CC4"), ("a", "CE4"))
    )
    table = units()
    table.loc[(table["learner"] == "b") & (table["unit"] == 2), "attempts"] += 0.5
    same, apart = (
        compared(
            table,
            Contrast(measure="attempts", of=b, minus=minus, expected="more", smallest=1.0),
            "subject",
        )
        for minus in (a, other)
    )
    assert (same.units, apart.units) == ((3,), (3, 3))
    assert same.value == pytest.approx(2.0 + 0.5 / 3)
    assert np.diff(apart.interval) > np.diff(same.interval)
    one, two = (Selection(learner=name, condition="CC4") for name in "ab")
    assert not paired(one, two, "network", {})  # networks, with themselves alone
    assert paired(one, two, "network", {"b": "a"})
    assert paired(one, Selection(learner="a", condition="CE4"), "network", {})


def test_a_unit_counts_if_it_has_all_conditions():
    table = units()
    table = table[~((table["condition"] == "CE4") & (table["unit"] == 2))]
    found = selected(table, Selection(learner="a", condition=["CC4", "CE4"]), "attempts")
    assert found.units.tolist() == [0, 1]


X = {"learner": "x", "condition": "CC3"}
LESS = {"measure": "solved", "of": X, "minus": 0.5, "expected": "less"}
SAME = {**LESS, "expected": "same", "smallest": 0.1}
CLAIMS = {
    "every": {"text": "a", "contrasts": dict.fromkeys("ABCD", LESS)},
    "same": {"text": "b", "contrasts": {"A": SAME, "B": SAME}},
    "late": {"text": "c", "contrasts": {"A": LESS}},
}


@pytest.fixture
def made_up(tmp_path):
    """A study of three claims: one contrast of the first does not hold."""
    said = {
        "every": ["holds", "holds", "holds", "does not hold"],
        "same": ["holds", "holds"],
        "late": ["undecided"],
    }
    estimate = Estimate(0.1, {LEVEL: (0.0, 0.2), EQUIVALENCE: (0.0, 0.2)}, (9,))
    file = {"title": "Made up", "experiment": "experiment.yaml", "hours": 1, "claims": CLAIMS}
    found = Evidence(Study(tmp_path, StudyFile.model_validate(file)))
    (tmp_path / RUN).touch()
    claims = {name: found.study.margin(name) for name in said if name != "late"}
    found.__dict__["run"] = {"complete": True, "claims": claims}
    found.__dict__["estimates"] = {
        (name, part): (estimate, verdict)
        for name, verdicts in said.items()
        for part, verdict in zip("ABCD", verdicts, strict=False)
    }
    return found


def test_a_mixed_claim_says_how_many_contrasts_do_not_hold(made_up):
    text = made_up.block("verdicts")
    assert "| **does not hold** (1 of 4 do not hold) |" in text
    assert "| **holds** |" in text
    assert "| **undecided**; stated after the run |" in text
