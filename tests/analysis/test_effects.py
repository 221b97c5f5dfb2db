"""Sizes of effects, Holm's correction, comparisons of learners and power."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from causal_openlock.analysis.effects import (
    contrast_subjects_needed,
    hedges_g,
    holm,
    improvement_interval,
    interquartile_interval,
    interquartile_mean,
    partial_eta_squared,
    power_of_contrast,
    power_of_t,
    probability_of_improvement,
    subjects_needed,
)
from causal_openlock.analysis.results.people.hypotheses import INTERACTION, contrast_test, t_test
from causal_openlock.analysis.statistics import bootstrap_interval

SCORES = st.lists(st.integers(0, 6), min_size=1, max_size=8)


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


def test_the_interquartile_mean_leaves_out_a_quarter_at_either_end() -> None:
    assert interquartile_mean(np.array([100.0, 1, 2, 3, 4, 5, 9, -90])) == 3.5
    assert interquartile_mean(np.array([[1.0, 2, 9], [3, 3, 3]])).tolist() == [4.0, 3.0]


def test_its_interval_is_that_of_resampled_subjects() -> None:
    rng = np.random.default_rng(3)
    strata = [rng.integers(3, 20, 30).astype(float), rng.integers(8, 31, 13).astype(float)]
    ours = interquartile_interval(strata, np.random.default_rng(1), resamples=6000)
    theirs = bootstrap_interval(
        lambda *drawn: interquartile_mean(np.concatenate(drawn, axis=-1)),
        strata,
        np.random.default_rng(2),
        resamples=6000,
    )
    assert ours == pytest.approx(theirs, abs=0.12)
    assert ours[0] < interquartile_mean(np.concatenate(strata)) < ours[1]
    equal = [np.full(7, 4.0), np.full(2, 4.0)]
    assert interquartile_interval(equal, rng) == (4.0, 4.0)
    assert np.isnan(interquartile_interval([np.ones(1), np.ones(9)], rng)).all()


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(SCORES, SCORES), min_size=1, max_size=4))
def test_probability_of_improvement_is_counted_pair_by_pair(
    scores: list[tuple[list[int], list[int]]],
) -> None:
    first = [np.array(one, float) for one, _ in scores]
    second = [np.array(other, float) for _, other in scores]
    by_pairs = [
        np.mean([(x > y) + (x == y) / 2 for x, y in itertools.product(one, other)])
        for one, other in scores
    ]
    found = probability_of_improvement(first, second)
    assert found == pytest.approx(np.mean(by_pairs))
    assert probability_of_improvement(second, first) == pytest.approx(1 - found)
    # rliable: the Mann-Whitney U of each condition, over n m, averaged.
    u = [
        stats.mannwhitneyu(x, y).statistic / x.size / y.size
        for x, y in zip(first, second, strict=True)
    ]
    assert found == pytest.approx(np.mean(u))
    # It asks for order alone.
    assert probability_of_improvement(
        [one**3 for one in first], [one**3 for one in second]
    ) == pytest.approx(found)


def test_the_interval_of_improvement_is_that_of_resampled_subjects() -> None:
    rng = np.random.default_rng(3)
    first = [rng.integers(0, 9, 20).astype(float), rng.integers(2, 9, 30).astype(float)]
    second = [rng.integers(0, 9, 25).astype(float), rng.integers(0, 9, 30).astype(float)]
    low, high = improvement_interval(first, second, np.random.default_rng(1), resamples=4000)
    drawn = [
        probability_of_improvement(
            *([rng.choice(one, len(one)) for one in of] for of in (first, second))
        )
        for _ in range(1500)
    ]
    assert (low, high) == pytest.approx(tuple(np.quantile(drawn, [0.025, 0.975])), abs=0.012)
    assert low < probability_of_improvement(first, second) < high


def test_intervals_of_improvement_cover_what_they_should() -> None:
    rng = np.random.default_rng(5)
    covered = 0
    for _ in range(200):  # equals, many of them tied
        pairs = [[rng.integers(3, 8, 25).astype(float) for _ in range(2)] for _ in range(2)]
        low, high = improvement_interval(*pairs, np.random.default_rng(0), resamples=400)
        covered += low <= 0.5 <= high
    assert 0.88 < covered / 200 < 0.99


def test_improvement_without_spread_or_company() -> None:
    better, worse = [np.full(5, 9.0)], [np.full(5, 1.0)]
    rng = np.random.default_rng(0)
    assert improvement_interval(better, worse, rng) == (1.0, 1.0)
    assert improvement_interval(better, better, rng) == (0.5, 0.5)
    assert np.isnan(improvement_interval(better, [np.ones(1)], rng)).all()


# -- power ----------------------------------------------------------------------------------------


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
