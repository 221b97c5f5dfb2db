"""Intervals, sizes of effects, corrections and power: by hand, by SciPy and by statsmodels."""

import math
import warnings

import numpy as np
import pandas as pd
import pytest
from scipy import stats
from statsmodels.stats.multitest import multipletests
from statsmodels.stats.power import TTestIndPower, TTestPower

import causal_openlock as ol
from causal_openlock.analysis.effects import (
    ALPHA,
    Group,
    difference,
    hedges_g,
    holm,
    partial_eta_squared,
    weighted_difference,
)
from causal_openlock.analysis.sample_size import power_of_t
from causal_openlock.analysis.statistics import bootstrap_interval, mean_interval, mean_intervals
from causal_openlock.paper.significance import t_test


def seeded(seed):
    return np.random.default_rng(seed)


# -- intervals ------------------------------------------------------------------------------------


def test_bootstrap_interval_covers_what_it_should():
    samples = seeded(1).normal(10, 2, size=(300, 40))
    low, high = mean_interval(samples, seeded(2), resamples=500)
    assert 0.89 < ((low < 10) & (high > 10)).mean() < 0.98
    assert np.median(high - low) == pytest.approx(2 * 1.96 * 2 / math.sqrt(40), rel=0.1)


@pytest.mark.parametrize("level", [0.95, 0.99])
def test_intervals_of_means_are_scipys_to_the_last_digit(level):
    samples = seeded(4).integers(3, 31, size=(50, 40)).astype(float)
    theirs = stats.bootstrap(
        (samples,), np.mean, axis=-1, method="percentile", confidence_level=level,
        n_resamples=2000, batch=2500, rng=seeded(2018),
    ).confidence_interval  # fmt: skip
    low, high = mean_interval(samples, seeded(2018), level=level)
    assert low == pytest.approx(theirs.low, rel=1e-14)
    assert high == pytest.approx(theirs.high, rel=1e-14)


def gap(one, other):
    return one.mean(axis=-1) - other.mean(axis=-1)


def scipys(groups, resamples, seed):
    return stats.bootstrap(
        groups,
        lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        method="percentile",
        n_resamples=resamples,
        rng=seed,
    ).confidence_interval


def test_intervals_of_two_samples_are_scipys():
    rng = seeded(1)
    groups = rng.normal(5, 2, 30), rng.normal(3, 1, 50)
    ours = bootstrap_interval(gap, groups, seeded(2), resamples=5000)
    assert ours == pytest.approx(tuple(scipys(groups, 5000, 3)), abs=0.06)


def test_intervals_without_spread_or_company():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        low, high = mean_interval(np.full((2, 7), 0.1), seeded(0))
        assert low.tolist() == high.tolist() == [0.1, 0.1]
        low, high = mean_interval(np.zeros((3, 1)), seeded(0))
        assert low.shape == high.shape == (3,)
        assert np.isnan([*low, *high]).all()
        low, high = bootstrap_interval(gap, [np.full(4, 0.1), np.full(3, 0.3)], seeded(0))
        assert low == high == pytest.approx(-0.2)
        assert np.isnan(bootstrap_interval(gap, [np.ones(1), np.ones(9)], seeded(0))).all()


def test_a_groups_interval_does_not_depend_on_the_others():
    groups = np.repeat([*"abcd"], [10, 10, 10, 4])
    frame = pd.DataFrame({"group": groups, "x": seeded(5).random(34)})
    together = mean_intervals(frame, ["group"], "x").set_index("group")
    for name in "abcd":
        alone = mean_intervals(frame[frame["group"] == name], ["group"], "x").set_index("group")
        assert alone.loc[name].tolist() == pytest.approx(together.loc[name].tolist(), rel=1e-12)

    def ends(second):
        generators = [seeded(1), seeded(2)]
        groups = [np.arange(7.0), second]
        return bootstrap_interval(lambda one, other: one.mean(axis=-1), groups, generators)

    assert ends(np.arange(9.0)) == ends(np.arange(3.0))


def test_strata_are_resampled_among_themselves():
    """Within constant groups nothing varies, however far apart the groups are."""
    far = [np.full(9, 1.0), np.append(np.full(9, 50.0), 50.5)]
    low, high = bootstrap_interval(
        lambda *drawn: np.concatenate(drawn, axis=-1).mean(axis=-1), far, seeded(0)
    )
    middle = (9 + 500.5) / 19
    assert middle - 0.1 < low < high < middle + 0.1


def test_counts_of_equal_values_are_resampled_as_the_values_are():
    values = np.array([1.0, 2.0, 2.0, 9.0, 9.0, 9.0])
    distinct, counts = np.unique(values, return_counts=True)
    by_counts = bootstrap_interval(
        lambda drawn: drawn @ distinct / 6, [counts], seeded(1), counted=True
    )
    low, high = mean_interval(values[None], seeded(2))
    assert by_counts == pytest.approx((low[0], high[0]), abs=0.35)


# -- differences ----------------------------------------------------------------------------------


def test_differences_are_welchs_test_and_a_bootstrap():
    rng = seeded(5)
    first, second = rng.integers(3, 12, 30).astype(float), rng.integers(4, 25, 18).astype(float)
    found = difference(first, second, ("a", "b"))
    assert found.value == first.mean() - second.mean()
    assert found.p == stats.ttest_ind(first, second, equal_var=False).pvalue
    booted = scipys((first, second), 9000, 2)
    assert (found.low, found.high) == pytest.approx((booted.low, booted.high), abs=0.15)


def test_differences_of_groups_that_do_not_vary_are_counted_exactly():
    three, four = np.full(3, 30.0), np.full(4, 12.0)
    # Of the 35 ways to choose 3 of 7, two part the groups as sharply: one either way.
    found = difference(three, four, ("a", "b"))
    assert found == (18.0, 18.0, 18.0, pytest.approx(2 / 35))
    assert difference(three, np.full(5, 30.0), ("a", "b")).p == 1.0
    alone = difference(np.array([3.0]), four, ("a", "b"))
    assert alone.value == -9.0
    assert all(math.isnan(value) for value in alone[1:])


def test_resamples_depend_on_the_group_and_on_nothing_else():
    values, constant = np.array([1.0, 2.1, 2.3, 9.7, 4.4, 5.2]), np.full(4, 3.0)
    found = difference(values, constant, ("key", "b"))
    assert found[:3] == pytest.approx(difference(values[::-1], constant, ("key", "c"))[:3])
    assert found[1:3] != difference(values, constant, ("other", "b"))[1:3]


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


def test_where_nobody_differs_there_is_no_interval_and_p_is_that_of_equal_signs():
    found = weighted_difference([Group.of(np.full(5, 2.0))])
    assert (found.value, found.p) == (2.0, 2 / 2**5)
    assert np.isnan([found.low, found.high]).all()
    assert weighted_difference([Group.of(np.zeros(5))]).p == 1.0
    unpaired = weighted_difference([Group.of(np.full(5, 30.0)), Group.of(np.full(3, 4.0), -1)])
    assert (unpaired.value, unpaired.p) == (26.0, 2 / 2**3)
    assert np.isnan(weighted_difference([Group.of(np.ones(1))])[1:]).all()
    assert Group.of(np.ones(1)).variance == Group.published(4.0, 0.5, 1).variance == 0.0


def test_equal_groups_have_no_difference_of_the_last_digits():
    for size in range(1, 30):
        groups = [Group.of(np.full(3, 30.1), 1 / size) for _ in range(size)]
        others = [Group.of(np.full(3, 30.1), -1 / size) for _ in range(size)]
        assert weighted_difference([*groups, *others])[::3] == (0.0, 1.0)


# -- sizes of effects -----------------------------------------------------------------------------


def test_hedges_g_and_eta_squared():
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
    assert partial_eta_squared(24.94, 1, 156) == pytest.approx(24.94 / (24.94 + 156))


# -- corrections ----------------------------------------------------------------------------------


def test_holm_by_hand_and_by_statsmodels():
    nan = pytest.approx(np.nan, nan_ok=True)
    assert holm(np.array([0.04, 0.01, 0.03])).tolist() == pytest.approx([0.06, 0.03, 0.06])
    assert holm(np.array([0.9, np.nan, 0.02])).tolist() == [0.9, nan, 0.04]
    assert holm(np.array([0.6, 0.7])).tolist() == [1.0, 1.0]
    assert len(holm(np.zeros(0))) == 0
    p = seeded(0).random(40) ** 3
    assert np.array_equal(holm(p), multipletests(p, method="holm")[1])


# -- power ----------------------------------------------------------------------------------------


def test_power_is_that_of_statsmodels_and_of_cohens_tables():
    for n in (2, 5, 40):
        for effect in (0.0, 0.2, 0.5):
            expected = TTestIndPower().power(effect, n, ALPHA)
            assert power_of_t(-effect, n) == pytest.approx(expected, abs=1e-12)
    assert [power_of_t(d, 40) for d in (2.0, 3.0, 8.0)] == pytest.approx([1.0, 1.0, 1.0])
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
