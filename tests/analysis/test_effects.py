"""Sizes of effects, Holm's correction, comparisons of learners and power."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from causal_openlock.analysis.effects import (
    ALPHA,
    Group,
    contrast_subjects_needed,
    hedges_g,
    holm,
    partial_eta_squared,
    power_of_contrast,
    power_of_t,
    subjects_needed,
    weighted_difference,
)
from causal_openlock.paper.significance import INTERACTION, contrast_test, t_test


def test_d_and_hedges_g_worked_by_hand() -> None:
    one, other = np.array([4.0, 6.0, 8.0]), np.array([1.0, 3.0])
    d = (6 - 2) / np.sqrt((8 + 2) / 3)
    assert t_test(one, other).effect == pytest.approx(d)
    assert hedges_g(d, 78) == pytest.approx(d * (1 - 3 / (4 * 78 - 1)), rel=1e-4)


def test_hedges_g_needs_two_degrees_of_freedom() -> None:
    assert np.isnan([hedges_g(1.0, df) for df in (0, 1)]).all()
    assert hedges_g(1.0, 2) == pytest.approx(1 / np.sqrt(np.pi))


def test_hedges_g_is_without_the_bias_of_d() -> None:
    rng = np.random.default_rng(0)
    one, other = rng.normal(0.8, 1, (40_000, 5)), rng.normal(0, 1, (40_000, 5))
    pooled = np.sqrt((one.var(axis=1, ddof=1) + other.var(axis=1, ddof=1)) / 2)
    d = (one.mean(axis=1) - other.mean(axis=1)) / pooled
    assert d.mean() > 0.85
    assert hedges_g(1.0, 8) * d.mean() == pytest.approx(0.8, abs=0.012)


def test_partial_eta_squared_of_the_papers_interaction() -> None:
    assert partial_eta_squared(24.94, 1, 156) == pytest.approx(24.94 / (24.94 + 156))


# -- Holm -----------------------------------------------------------------------------------------


def test_holm_worked_by_hand() -> None:
    assert holm(np.array([0.04, 0.01, 0.03])).tolist() == pytest.approx([0.06, 0.03, 0.06])
    assert holm(np.array([0.9, np.nan, 0.02])).tolist() == pytest.approx(
        [0.9, np.nan, 0.04], nan_ok=True
    )
    assert holm(np.array([0.6, 0.7])).tolist() == [1.0, 1.0]
    assert len(holm(np.zeros(0))) == 0


# -- comparisons ----------------------------------------------------------------------------------


def test_one_group_is_students_t_and_two_are_welchs() -> None:
    rng = np.random.default_rng(3)
    one, other = rng.integers(3, 20, 12).astype(float), rng.integers(3, 9, 7).astype(float)
    alone = stats.ttest_1samp(one, 0.0)
    ours = weighted_difference([Group.of(one)])
    assert ours == pytest.approx((one.mean(), *alone.confidence_interval(), alone.pvalue))
    welch = stats.ttest_ind(one, other, equal_var=False)
    ours = weighted_difference([Group.of(one), Group.of(other, -1)])
    ends = welch.confidence_interval()
    assert ours == pytest.approx((one.mean() - other.mean(), *ends, welch.pvalue))


def test_conditions_count_alike_whatever_their_size() -> None:
    large, small = np.tile([1.0, 3.0], 40), np.tile([9.0, 11.0], 2)
    found = weighted_difference([Group.of(large, 0.5), Group.of(small, 0.5)])
    assert found.value == pytest.approx(6.0)
    assert found.low < 6.0 < found.high


def test_where_nobody_differs_there_is_no_interval_and_p_is_that_of_equal_signs() -> None:
    found = weighted_difference([Group.of(np.full(5, 2.0))])
    assert (found.value, found.p) == (2.0, 2 / 2**5)
    assert np.isnan([found.low, found.high]).all()
    assert weighted_difference([Group.of(np.zeros(5))]).p == 1.0
    unpaired = weighted_difference([Group.of(np.full(5, 30.0)), Group.of(np.full(3, 4.0), -1)])
    assert (unpaired.value, unpaired.p) == (26.0, 2 / 2**3)
    assert np.isnan(weighted_difference([Group.of(np.ones(1))])[1:]).all()


def test_a_single_subject_has_no_variance_whatever_its_error_bar() -> None:
    assert Group.of(np.ones(1)).variance == Group.published(4.0, 0.5, 1).variance == 0.0


# -- power ----------------------------------------------------------------------------------------


def test_equal_groups_have_no_difference_of_the_last_digits() -> None:
    for size in range(1, 30):
        groups = [Group.of(np.full(3, 30.1), 1 / size) for _ in range(size)]
        others = [Group.of(np.full(3, 30.1), -1 / size) for _ in range(size)]
        assert weighted_difference([*groups, *others])[::3] == (0.0, 1.0)


def test_power_of_t_is_how_often_it_finds_the_effect() -> None:
    rng = np.random.default_rng(2)
    one, other = rng.normal(0.6, 1, (6000, 20)), rng.normal(0, 1, (6000, 20))
    found = (stats.ttest_ind(one, other, axis=1).pvalue < 0.05).mean()
    assert power_of_t(0.6, 20) == pytest.approx(found, abs=0.02)
    assert power_of_t(-0.6, 20) == pytest.approx(power_of_t(0.6, 20))
    assert power_of_t(0.0, 20) == pytest.approx(0.05)


def test_power_of_a_contrast_is_how_often_it_finds_the_interaction() -> None:
    rng = np.random.default_rng(2)
    means = np.array([[0.7, 0.0], [0.0, 0.7]])
    found = 0
    for _ in range(1500):
        cells = rng.normal(means[..., None], 1, (2, 2, 15))
        found += contrast_test([*cells.reshape(4, -1)], INTERACTION).p < 0.05  # type: ignore[operator]
    difference = 0.7  # halves of the diagonals; F / n is its square over the sum of weights squared
    assert power_of_contrast(difference**2, 15, 4) == pytest.approx(found / 1500, abs=0.04)


def test_two_groups_have_the_same_power_as_a_contrast() -> None:
    assert power_of_contrast(0.5**2 / 2, 30, 2) == pytest.approx(power_of_t(0.5, 30))


@pytest.mark.parametrize(("d", "known"), [(0.8, 26), (0.5, 64), (0.2, 394)])  # Cohen's tables
def test_subjects_needed_are_those_of_cohens_tables(d: float, known: int) -> None:
    assert subjects_needed(d) == known
    assert power_of_t(d, known) >= 0.8 > power_of_t(d, known - 1)


def test_no_effect_needs_more_subjects_than_there_are() -> None:
    assert subjects_needed(0.0) is None
    assert contrast_subjects_needed(0.0, 4) is None
    assert subjects_needed(float("nan")) is None
    assert contrast_subjects_needed(float("nan"), 4) is None
    assert contrast_subjects_needed(24.94 / 40, 4) == 14
    assert power_of_contrast(24.94 / 40, 14, 4) >= 0.8 > power_of_contrast(24.94 / 40, 13, 4)


def test_correction_and_power_are_those_of_statsmodels() -> None:
    from statsmodels.stats.multitest import multipletests
    from statsmodels.stats.power import TTestIndPower, ftest_power_f2

    p = np.random.default_rng(0).random(40) ** 3
    assert np.array_equal(holm(p), multipletests(p, method="holm")[1])
    for n in (2, 5, 40):
        for effect in (0.0, 0.2, 0.5):
            expected = TTestIndPower().power(effect, n, ALPHA)
            assert power_of_t(-effect, n) == pytest.approx(expected, abs=1e-12)
            error = 4 * (n - 1)
            f2 = effect * n / (error + 2)
            expected = ftest_power_f2(f2, 1, error, ALPHA, ncc=1)
            assert power_of_contrast(effect, n, 4) == pytest.approx(expected, abs=1e-12)


def test_power_of_a_large_effect_is_one_and_no_gap() -> None:
    assert [power_of_t(d, 40) for d in (2.0, 3.0, 8.0)] == pytest.approx([1.0, 1.0, 1.0])
    assert np.isnan(power_of_t(float("nan"), 40))
