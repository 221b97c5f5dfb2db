"""Intervals, sizes of effects, corrections and power: by hand, by SciPy and by statsmodels."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestIndPower, TTestPower

import causal_openlock as ol
from causal_openlock.analysis.effects import ALPHA, Group, contrast, holm, weighted_difference
from causal_openlock.analysis.statistics import (
    mean_intervals,
    median_interval,
    share_interval,
    student,
)
from causal_openlock.paper.significance import hedges_g, t_test


def seeded(seed):
    return np.random.default_rng(seed)


def units():
    """``[n]`` values of each cell of the stored studies that has thirty units or more."""
    for path in sorted(Path(__file__).parents[2].glob("evidence/*/units.parquet")):
        table = pd.read_parquet(path)
        value = next((name for name in ("value", "attempts", "mean") if name in table), None)
        keys = table.select_dtypes(exclude="number").columns
        keys = [name for name in keys if table[name].nunique() < 200]
        if value is not None:
            for _, own in table.groupby(keys, dropna=False, observed=True):
                values = own[value].dropna().to_numpy(float)
                if len(values) >= 30 and np.ptp(values):
                    yield values


def test_intervals_cover_the_means_of_the_projects_own_units():
    rng, cells = seeded(1), [*units()]
    assert len(cells) > 600
    table = {}
    for size in (6, 10, 20, 40):
        covered = []
        for cell in cells:
            drawn = np.sort(rng.choice(cell, (200, size)), axis=1)
            most = run = np.ones(200, int)
            for place in range(1, size):
                run = np.where(drawn[:, place] == drawn[:, place - 1], run + 1, 1)
                most = np.maximum(most, run)
            low, high = student(size, drawn.mean(axis=1), drawn.var(axis=1, ddof=1), most)
            given = ~np.isnan(low)
            if given.mean() > 0.3:
                held = (low - 1e-12 <= cell.mean()) & (cell.mean() <= high + 1e-12)
                covered.append(held[given].mean())
        table[size] = np.median(covered), np.quantile(covered, 0.05)
    medians, fifths = zip(*table.values(), strict=True)
    assert medians == pytest.approx((0.947, 0.945, 0.948, 0.948), abs=0.01)
    assert fifths == pytest.approx((0.84, 0.87, 0.91, 0.92), abs=0.02)


def test_intervals_are_students_and_there_are_none_of_few_or_equal_subjects():
    values = seeded(4).integers(3, 31, 12).astype(float)
    theirs = stats.ttest_1samp(values, 0.0).confidence_interval()
    frame = pd.DataFrame({"learner": "a", "attempts": values})
    frame = pd.concat([frame, frame.head(4).assign(learner="few")])
    frame = pd.concat([frame, frame.head(10).assign(learner="limit", attempts=[30.0] * 9 + [3])])
    found = mean_intervals(frame, ["learner"], "attempts").set_index("learner")
    assert found.loc["a", ["ci_low", "ci_high"]].tolist() == pytest.approx([*theirs])
    assert found.loc[["few", "limit"], ["ci_low", "ci_high"]].isna().all(axis=None)
    assert found.loc["limit", ["mode", "at_mode"]].tolist() == [30.0, 9]


def test_shares_have_wilsons_interval_and_medians_that_of_the_sign_test():
    for many, size in ((0, 5), (38, 40), (40, 40)):
        theirs = stats.binomtest(many, size).proportion_ci(method="wilson")
        assert share_interval(many / size, size) == pytest.approx(tuple(theirs))
    values = seeded(1).permutation(40).astype(float)
    assert median_interval(values) == (13.0, 26.0)  # 14th lowest and highest: P(X <= 13) = .019
    assert np.isnan(median_interval(np.ones(5))).all()
    assert median_interval(np.array([4.0, *[np.inf] * 5])) == (4, np.inf)
    assert median_interval(np.array([9.0, *[4.0] * 60])) == (4, 4)


def test_one_group_is_students_t_and_two_are_welchs():
    rng = seeded(3)
    one, other = rng.integers(3, 20, 12).astype(float), rng.integers(3, 9, 7).astype(float)
    alone = stats.ttest_1samp(one, 0.0)
    ours = weighted_difference([Group.of(one)])
    assert ours == pytest.approx((one.mean(), *alone.confidence_interval(), alone.pvalue))
    welch = stats.ttest_ind(one, other, equal_var=False)
    ours = weighted_difference([Group.of(one), Group.of(other, -1)])
    ends = welch.confidence_interval()
    assert ours == pytest.approx((one.mean() - other.mean(), *ends, welch.pvalue))


def test_conditions_count_alike_whatever_their_size():
    large, small = np.tile([1.0, 3.0], 40), np.tile([9.0, 11.0], 2)
    found = weighted_difference([Group.of(large, 0.5), Group.of(small, 0.5)])
    assert found.value == pytest.approx(6.0)
    assert found.low < 6.0 < found.high


def test_where_nearly_all_are_alike_there_is_no_interval_and_an_exact_test():
    pairs = np.array([0.0] * 36 + [2, 3, 2, 2])
    found = weighted_difference([Group.of(pairs)])
    assert found[:1] + found[3:] == (pairs.mean(), stats.binomtest(4, 4).pvalue)
    assert np.isnan([found.low, found.high]).all()
    assert weighted_difference([Group.of(np.full(5, 2.0))]).p == 2 / 2**5
    assert weighted_difference([Group.of(np.zeros(5))]).p == 1.0
    one, other = np.array([30.0] * 38 + [4, 5]), np.array([30.0] * 36 + [3, 4, 7, 8])
    found = weighted_difference([Group.of(one), Group.of(other, -1)])
    theirs = stats.permutation_test(
        (one, other), lambda a, b, axis: a.mean(axis) - b.mean(axis), rng=seeded(1)
    )
    assert np.isnan(found.low)
    assert found.p == pytest.approx(theirs.pvalue, abs=0.02)
    apart = weighted_difference([Group.of(np.full(9, 30.0)), Group.of(np.full(8, 4.0), -1)])
    assert (apart.value, apart.p < 0.001) == (26.0, True)


def test_fewer_than_five_subjects_have_neither_interval_nor_p():
    assert np.isnan(weighted_difference([Group.of(np.arange(4.0))])[1:]).all()
    few = [Group.of(np.arange(9.0)), Group.of(np.arange(4.0), -1)]
    assert np.isnan(weighted_difference(few)[1:]).all()
    assert not np.isnan(weighted_difference([Group.of(np.arange(3.0))] * 2)).any()
    assert Group.of(np.ones(1)).variance == Group.published(4.0, 0.5, 1).variance == 0.0


def test_subjects_of_the_same_rooms_are_paired():
    one = pd.Series([3.0, 5, 4, 7, 9, 4], index=[*"abcdef"])
    other = pd.Series([2.0, 9, 6, 6, 4, 6], index=one.index)
    theirs = stats.ttest_rel(one, other)
    assert weighted_difference(contrast(one, other)).p == pytest.approx(theirs.pvalue)
    apart = weighted_difference(contrast(one, other.set_axis([*"ghijkl"])))
    assert apart.p == pytest.approx(stats.ttest_ind(one, other, equal_var=False).pvalue)


def test_equal_groups_have_no_difference_of_the_last_digits():
    for size in range(1, 30):
        groups = [Group.of(np.full(6, 30.1), 1 / size) for _ in range(size)]
        others = [Group.of(np.full(6, 30.1), -1 / size) for _ in range(size)]
        assert weighted_difference([*groups, *others])[::3] == (0.0, 1.0)


def test_hedges_g():
    d = (6 - 2) / np.sqrt((8 + 2) / 3)
    assert t_test(np.array([4.0, 6.0, 8.0]), np.array([1.0, 3.0])).effect == pytest.approx(d)
    assert hedges_g(d, 78) == pytest.approx(d * (1 - 3 / (4 * 78 - 1)), rel=1e-4)
    assert np.isnan([hedges_g(1.0, df) for df in (0, 1)]).all()
    assert hedges_g(1.0, 2) == pytest.approx(1 / np.sqrt(np.pi))
    rng = seeded(0)  # g is without the bias of d
    one, other = rng.normal(0.8, 1, (40_000, 5)), rng.normal(0, 1, (40_000, 5))
    pooled = np.sqrt((one.var(axis=1, ddof=1) + other.var(axis=1, ddof=1)) / 2)
    mean = ((one.mean(axis=1) - other.mean(axis=1)) / pooled).mean()
    assert mean > 0.85
    assert hedges_g(1.0, 8) * mean == pytest.approx(0.8, abs=0.012)


def test_holm_by_hand_and_by_statsmodels():
    nan = pytest.approx(np.nan, nan_ok=True)
    assert holm(np.array([0.04, 0.01, 0.03])).tolist() == pytest.approx([0.06, 0.03, 0.06])
    assert holm(np.array([0.9, np.nan, 0.02])).tolist() == [0.9, nan, 0.04]
    assert holm(np.array([0.6, 0.7])).tolist() == [1.0, 1.0]
    assert len(holm(np.zeros(0))) == 0
    p = seeded(0).random(40) ** 3
    assert np.array_equal(holm(p), multipletests(p, method="holm")[1])


def test_power_is_that_of_statsmodels_and_of_cohens_tables():
    theirs = TTestIndPower().power(0.2, 2, ALPHA)
    assert ol.sample_size(-0.2, sd=1, subjects=2).power == pytest.approx(theirs, abs=1e-12)
    for effect in (2.0, 3.0, 8.0, 1e307):
        assert ol.sample_size(effect, sd=0.5, subjects=40).power == pytest.approx(1.0)
    for d, known in ((0.8, 26), (0.5, 64), (0.2, 394)):
        assert ol.sample_size(d, sd=1).subjects == known


@pytest.mark.parametrize("paired", [False, True])
@pytest.mark.parametrize(("effect", "power", "alpha"), [(1.0, 0.8, 0.05), (3.0, 0.95, 0.01)])
def test_sample_size_is_what_statsmodels_says(effect, power, alpha, paired):
    planned = ol.sample_size(effect, sd=2.5, power=power, alpha=alpha, paired=paired)
    theirs = TTestPower() if paired else TTestIndPower()
    of_group = "nobs" if paired else "nobs1"

    def at(subjects):
        return float(theirs.power(effect / 2.5, **{of_group: subjects}, alpha=alpha))

    assert at(planned.subjects - 1) < power <= at(planned.subjects)
    assert planned.power == pytest.approx(at(planned.subjects), abs=1e-6)


@pytest.mark.parametrize("subjects", [2, 40, 3000])
@pytest.mark.parametrize("paired", [False, True])
def test_the_smallest_difference_has_just_the_power(subjects, paired):
    found = ol.sample_size(sd=5, subjects=subjects, power=0.9, paired=paired)
    assert found.power == pytest.approx(0.9)
    again = ol.sample_size(found.difference, sd=5, subjects=subjects, paired=paired)
    assert again.power == pytest.approx(0.9)
    assert ol.sample_size(found.difference * 1.0001, sd=5, power=0.9, paired=paired)[0] == subjects


def test_sample_size_from_a_pilot_study_and_whatever_the_sign():
    pilot = [3, 4, 9, 12, 5]
    assert ol.sample_size(2, sd=pilot) == ol.sample_size(2, sd=float(np.std(pilot, ddof=1)))
    assert ol.sample_size(-2, sd=5).subjects == ol.sample_size(2, sd=5).subjects
