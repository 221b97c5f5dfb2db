"""That intervals of small discrete samples cover what they promise, and change with the data."""

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.study import CORRELATION, PUBLISHED, Selection
from causal_openlock.evidence.units import Selected, selected
from causal_openlock.evidence.verdicts import (
    EQUIVALENCE,
    LEVEL,
    difference,
    from_known,
    gaps,
    mean_of,
    paired,
    verdict,
)
from support.shipped_studies import NAMES, shipped

SHARES = np.r_[np.linspace(0.001, 0.05, 20), np.linspace(0.06, 0.5, 23)]


def attempts(values):
    return Selected(np.asarray(values, float), least=1.0, most=30.0)


@pytest.mark.parametrize("n", [3, 5, 10, 20, 40, 200])
@pytest.mark.parametrize("level", [LEVEL, EQUIVALENCE])
def test_of_two_values_each_end_is_wrong_as_seldom_as_promised(n, level):
    # Exact, by all samples that there are: shares, and 4 or 30 attempts.
    ones = np.arange(n + 1)
    samples = (np.arange(n) < ones[:, None]).astype(float)
    for low, high, make in ((0.0, 1.0, Selected), (4.0, 30.0, attempts)):
        ends = [mean_of(make(low + (high - low) * row)).intervals[level] for row in samples]
        lows, highs = np.array(ends).T
        for share in SHARES:
            true = low + (high - low) * share
            chance = stats.binom.pmf(ones, n, share)
            wrong = chance @ (lows > true + 1e-9), chance @ (highs < true - 1e-9)
            assert max(wrong) <= (1 - level) / 2 + 1e-3


@pytest.mark.parametrize("n", [5, 20, 200])
def test_intervals_of_attempts_that_learners_needed_cover_the_mean(n):
    rng = np.random.default_rng(n)
    units = Evidence(shipped("human_protocol")).own_units
    for learner, trial in (("random", 1), ("ddqn", 5), ("bayes", 1), ("win_stay", 1)):
        chosen = Selection(learner=learner, condition="CE4", trial=trial)
        whole = selected(units, chosen, "attempts")
        samples = rng.choice(whole.values, (400, n))
        ends = [mean_of(replace(whole, values=row, trials=n)).interval for row in samples]
        true = whole.values.mean()
        assert np.mean([low <= true <= high for low, high in ends]) >= 0.95 - 0.02  # of 400


@pytest.mark.parametrize("n", [5, 20, 200])
@pytest.mark.parametrize("pairs", [False, True])
def test_differences_of_shares_cover_the_true_one(n, pairs):
    rng = np.random.default_rng(n)
    for one, two in ((0.02, 0.02), (0.3, 0.5), (0.98, 0.5), (0.9, 0.98)):
        drawn = rng.random((300, 2, n))
        if pairs:  # in rooms that are as hard for both
            drawn[:, 1] = drawn[:, 0]
        found = [
            mean_of(gaps(Selected(a), Selected(b)))
            if pairs
            else difference(Selected(a), Selected(b))
            for a, b in (drawn < np.array([one, two])[:, None]).astype(float)
        ]
        covered = [low <= one - two <= high for low, high in (each.interval for each in found)]
        assert np.mean(covered) >= 0.95 - 0.025  # of 300


def test_equal_units_leave_room_for_what_was_missed_within_what_can_be():
    low = mean_of(Selected(np.ones(10))).interval[0]
    # A trial that differs with this probability is missed by ten in one of forty studies.
    assert low**10 == pytest.approx(0.025)
    assert mean_of(attempts([30.0] * 40)).interval == pytest.approx((27.445, 30), abs=1e-3)
    # Five networks that solve all of two hundred rooms each have been seen a thousand times.
    low, high = mean_of(Selected(np.full(5, 0.5), trials=1000)).interval
    assert (low, high) == pytest.approx((0.4982, 0.5018), abs=1e-4)
    assert mean_of(attempts([30.0, 30, 30, 1])).interval[1] == 30
    assert mean_of(Selected(np.array([0.0, 0, 0.5]))).interval[0] == 0
    found = difference(Selected(np.array([1.0, 1, 0.5])), Selected(np.zeros(3)))
    assert found.interval[1] == 1
    equal, other = attempts([4.0] * 200), attempts([4.0] * 199 + [3.0])
    assert mean_of(equal).interval == pytest.approx(mean_of(other).interval, abs=0.02)


def moved_estimates(found, contrast):
    """The estimate of a contrast, if one unit at an end had one attempt or trial more or less."""
    units, known = found.units, contrast.minus
    of = selected(units, contrast.of, contrast.measure)
    step = len(of.values) / max(of.trials, len(of.values))
    for place in (of.values.argmin(), of.values.argmax()):
        for by in (-step, step):
            values = of.values.copy()
            values[place] = np.clip(values[place] + by, of.least, of.most)
            moved = replace(of, values=values)
            if not isinstance(known, Selection):
                yield from_known(mean_of(moved), known)
                continue
            minus = selected(units, known, contrast.measure)
            if paired(contrast.of, known, found.study.unit, found._same_networks):
                both = np.intersect1d(of.units, minus.units)
                yield mean_of(gaps(moved.only(both), minus.only(both)))
            else:
                yield difference(moved, minus)


@pytest.mark.parametrize("name", NAMES)
def test_no_verdict_jumps_where_one_unit_changes_by_one_attempt_or_trial(name):
    found = Evidence(shipped(name))
    for (claim, part), before in found.estimates.items():
        contrast = found.study.file.claims[claim].contrasts[part]
        published = isinstance(contrast.minus, Selection) and contrast.minus.learner in PUBLISHED
        if isinstance(before, str) or contrast.measure == CORRELATION or published:
            continue
        apart = [{"holds", "does not hold"}]  # another verdict lies between these
        if contrast.expected != "same" and contrast.smallest:
            apart.append({"holds", "undecided"})
        for estimate in moved_estimates(found, contrast):
            after = verdict(estimate, contrast.expected, contrast.smallest)
            assert {before[1], after} not in apart
