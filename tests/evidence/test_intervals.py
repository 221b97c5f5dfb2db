"""That intervals of small discrete samples cover what they promise, and change with the data."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.power import as_stated, decides_at, planned
from causal_openlock.evidence.study import (
    CORRELATION,
    PUBLISHED,
    Contrast,
    Selection,
)
from causal_openlock.evidence.units import Selected, selected
from causal_openlock.evidence.verdicts import (
    EQUIVALENCE,
    LEVEL,
    Verdict,
    difference,
    from_known,
    gaps,
    mean_of,
    paired,
    verdict,
)
from support.shipped_studies import NAMES, shipped

SHARES = np.r_[np.linspace(0.001, 0.05, 20), np.linspace(0.06, 0.5, 23)]


def attempts(values: object) -> Selected:
    return Selected(np.asarray(values, float), least=1.0, most=30.0)


@pytest.mark.parametrize("n", [3, 5, 10, 20, 40, 200])
@pytest.mark.parametrize("level", [LEVEL, EQUIVALENCE])
def test_of_two_values_each_end_is_wrong_as_seldom_as_promised(n: int, level: float) -> None:
    # Exact, by all samples that there are: shares, and 4 or 30 attempts.
    ones = np.arange(n + 1)
    samples = (np.arange(n) < ones[:, None]).astype(float)
    for low, high, make in ((0.0, 1.0, Selected), (4.0, 30.0, attempts)):
        ends = np.array([mean_of(make(low + (high - low) * row)).intervals[level]
                         for row in samples])  # fmt: skip
        for share in SHARES:
            true = low + (high - low) * share
            chance = stats.binom.pmf(ones, n, share)
            above, below = (ends[:, 0] > true + 1e-9), (ends[:, 1] < true - 1e-9)
            assert max(chance @ above, chance @ below) <= (1 - level) / 2 + 1e-3


@pytest.mark.parametrize("n", [5, 10, 20, 40, 200])
def test_of_what_learners_do_intervals_cover_the_mean(n: int) -> None:
    rng = np.random.default_rng(n)
    units = Evidence(shipped("human_protocol")).own_units
    for learner, trial in (("random", 1), ("ddqn", 5), ("bayes", 1), ("win_stay", 1)):
        chosen = Selection(learner=learner, condition="CE4", trial=trial)
        whole = selected(units, chosen, "attempts")
        samples = rng.choice(whole.values, (400, n))
        ends = [mean_of(replace(whole, values=row, trials=n)).interval for row in samples]
        true = whole.values.mean()
        assert np.mean([low <= true <= high for low, high in ends]) >= 0.95 - 0.02  # of 400


@pytest.mark.parametrize("n", [5, 10, 20, 40, 200])
@pytest.mark.parametrize("pairs", [False, True])
def test_differences_of_shares_cover_the_true_one(n: int, pairs: bool) -> None:
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


def test_equal_units_leave_room_for_what_was_missed() -> None:
    low = mean_of(Selected(np.ones(10))).interval[0]
    # A trial that differs with this probability is missed by ten in one of forty studies.
    assert low**10 == pytest.approx(0.025)
    assert mean_of(attempts([30.0] * 40)).interval == pytest.approx((27.445, 30), abs=1e-3)
    # Five networks that solve all of two hundred rooms each have been seen a thousand times.
    low, high = mean_of(Selected(np.full(5, 0.5), trials=1000)).interval
    assert (low, high) == pytest.approx((0.4982, 0.5018), abs=1e-4)


def test_intervals_stay_within_what_can_be() -> None:
    assert mean_of(attempts([30.0, 30, 30, 1])).interval[1] == 30
    assert mean_of(Selected(np.array([0.0, 0, 0.5]))).interval[0] == 0
    found = difference(Selected(np.array([1.0, 1, 0.5])), Selected(np.zeros(3)))
    assert found.interval[1] == 1


def test_one_unit_that_differs_changes_an_interval_by_little() -> None:
    equal, other = attempts([4.0] * 200), attempts([4.0] * 199 + [3.0])
    for one, two in zip(mean_of(equal).interval, mean_of(other).interval, strict=True):
        assert one == pytest.approx(two, abs=0.02)


def jumps(of: Verdict, to: Verdict, expected: str, smallest: float) -> bool:
    """Whether another verdict lies between two: intervals of both do not touch."""
    apart = [{"holds", "does not hold"}]
    if expected != "same" and smallest:
        apart.append({"holds", "undecided"})
    return {of, to} in apart


@pytest.mark.parametrize("name", NAMES)
def test_no_verdict_jumps_where_one_unit_changes_by_one_attempt_or_trial(name: str) -> None:
    study = shipped(name)
    found = Evidence(study)
    same = found._same_networks
    for (claim, part), before in found.estimates.items():
        contrast = study.file.claims[claim].contrasts[part]
        if isinstance(before, str) or contrast.measure == CORRELATION:
            continue
        of, known = selected(found.units, contrast.of, contrast.measure), contrast.minus
        step = len(of.values) / max(of.trials, len(of.values))
        for place in (of.values.argmin(), of.values.argmax()):
            for by in (-step, step):
                values = of.values.copy()
                values[place] = np.clip(values[place] + by, of.least, of.most)
                moved = replace(of, values=values)
                if not isinstance(known, Selection):
                    one = from_known(mean_of(moved), known)
                elif known.learner in PUBLISHED:
                    continue
                elif paired(contrast.of, known, study.unit, same):
                    minus = selected(found.units, known, contrast.measure)
                    both = np.intersect1d(of.units, minus.units)
                    one = mean_of(gaps(moved.only(both), minus.only(both)))
                else:
                    one = difference(moved, selected(found.units, known, contrast.measure))
                after = verdict(one, contrast.expected, contrast.smallest)
                assert not jumps(before[1], after, contrast.expected, contrast.smallest)


def asked(smallest: float = 0.1, **more: object) -> Contrast:
    of = Selection(learner="bayes", condition="CC4")
    return Contrast(measure="solved", of=of, minus=0.9, expected="more", smallest=smallest, **more)  # type: ignore[arg-type]


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9])
def test_the_number_that_decides_is_the_least_whose_interval_is_within_the_margin(
    share: float,
) -> None:
    pilot = Selected((np.arange(20) < 20 * share).astype(float))
    needed = decides_at(lambda times: mean_of(pilot, times), asked())
    assert needed

    def reach(n: int) -> float:
        found = mean_of(pilot, n / 20)
        return max(found.value - found.interval[0], found.interval[1] - found.value)

    assert reach(needed) <= 0.1 < reach(needed - 1)


def test_without_a_spread_no_number_decides() -> None:
    assert decides_at(lambda times: mean_of(Selected(np.ones(2)), times), asked()) is None
    loud = Selected(1e6 * np.array([0.0, 1, 2]), least=0, most=2e6)
    assert decides_at(lambda times: mean_of(loud, times), asked()) is None


def test_before_a_run_the_number_follows_from_a_stated_spread() -> None:
    study = shipped("bayes")
    assert as_stated(asked(), study) is None
    found = as_stated(asked(spread=0.4), study)
    assert found
    needed = decides_at(found, asked(spread=0.4))
    assert needed
    assert 62 < needed < 130  # (1.96 x 0.4 / 0.1)², and what that number can miss
    assert planned(study, asked()) == 1500
