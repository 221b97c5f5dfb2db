"""Intervals of means."""

from __future__ import annotations

import math
import warnings
from typing import Any

import numpy as np
import pandas as pd
import pytest
from scipy import stats

from causal_openlock.analysis.statistics import (
    bootstrap_interval,
    mean_interval,
    mean_intervals,
)


def test_bootstrap_interval_covers_what_it_should() -> None:
    rng = np.random.default_rng(1)
    samples = rng.normal(10, 2, size=(300, 40))
    low, high = mean_interval(samples, np.random.default_rng(2), resamples=500)
    assert 0.89 < ((low < 10) & (high > 10)).mean() < 0.98
    assert np.median(high - low) == pytest.approx(2 * 1.96 * 2 / math.sqrt(40), rel=0.1)


def test_intervals_without_spread_or_company() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        low, high = mean_interval(np.full((2, 7), 0.1), np.random.default_rng(0))
        assert low.tolist() == high.tolist() == [0.1, 0.1]
        low, high = mean_interval(np.zeros((3, 1)), np.random.default_rng(0))
        assert low.shape == high.shape == (3,)
        assert np.isnan([*low, *high]).all()


def test_a_groups_interval_does_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(5)
    frame = pd.DataFrame({"group": np.repeat([*"abcd"], [10, 10, 10, 4]), "x": rng.random(34)})
    together = mean_intervals(frame, ["group"], "x").set_index("group")
    for name in "abcd":
        alone = mean_intervals(frame[frame["group"] == name], ["group"], "x").set_index("group")
        assert alone.loc[name].tolist() == pytest.approx(together.loc[name].tolist(), rel=1e-12)


@pytest.mark.parametrize("level", [0.95, 0.99])
def test_intervals_of_means_are_scipys_to_the_last_digit(level: float) -> None:
    samples = np.random.default_rng(4).integers(3, 31, size=(50, 40)).astype(float)
    theirs = stats.bootstrap(
        (samples,), np.mean, axis=-1, method="percentile", confidence_level=level,
        n_resamples=2000, batch=2500, rng=np.random.default_rng(2018),
    ).confidence_interval  # fmt: skip
    low, high = mean_interval(samples, np.random.default_rng(2018), level=level)
    assert low == pytest.approx(theirs.low, rel=1e-14)
    assert high == pytest.approx(theirs.high, rel=1e-14)


def _difference(one: Any, other: Any) -> Any:
    return one.mean(axis=-1) - other.mean(axis=-1)


def test_bootstrap_interval_is_scipys_of_two_samples() -> None:
    rng = np.random.default_rng(1)
    groups = rng.normal(5, 2, 30), rng.normal(3, 1, 50)
    ours = bootstrap_interval(_difference, groups, np.random.default_rng(2), resamples=5000)
    theirs = stats.bootstrap(
        groups, lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        method="percentile", n_resamples=5000, rng=np.random.default_rng(3),
    ).confidence_interval  # fmt: skip
    assert ours == pytest.approx(tuple(theirs), abs=0.06)


def test_strata_are_resampled_among_themselves() -> None:
    """Within constant groups nothing varies, however far apart the groups are."""
    far = [np.full(9, 1.0), np.append(np.full(9, 50.0), 50.5)]
    low, high = bootstrap_interval(
        lambda *drawn: np.concatenate(drawn, axis=-1).mean(axis=-1), far, np.random.default_rng(0)
    )
    middle = (9 + 500.5) / 19
    assert middle - 0.1 < low < high < middle + 0.1


def test_bootstrap_interval_in_small_batches_without_spread_and_company() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        constant = [np.full(4, 0.1), np.full(3, 0.3)]
        low, high = bootstrap_interval(_difference, constant, np.random.default_rng(0))
        assert low == high == pytest.approx(-0.2)
        few = [np.ones(1), np.ones(9)]
        assert np.isnan(bootstrap_interval(_difference, few, np.random.default_rng(0))).all()


def test_batches_make_no_difference_to_what_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    groups = [np.arange(6.0), np.arange(8.0) ** 2]
    sizes = []

    def counted(one: Any, other: Any) -> Any:
        sizes.append(len(one))
        return _difference(one, other)

    monkeypatch.setattr("causal_openlock.analysis.statistics._BATCH", 14 * 300)
    low, high = bootstrap_interval(counted, groups, np.random.default_rng(0), resamples=1000)
    assert sizes[1:] == [300, 300, 300, 100]  # after the subjects themselves
    assert low < 2.5 - 17.5 < high


def test_counts_of_equal_values_are_resampled_as_the_values_are() -> None:
    values = np.array([1.0, 2.0, 2.0, 9.0, 9.0, 9.0])
    distinct, counts = np.unique(values, return_counts=True)
    by_counts = bootstrap_interval(
        lambda drawn: drawn @ distinct / 6, [counts], np.random.default_rng(1), counted=True
    )
    low, high = mean_interval(values[None], np.random.default_rng(2))
    assert by_counts == pytest.approx((low[0], high[0]), abs=0.35)


def test_a_generator_of_its_own_makes_a_group_independent_of_the_others() -> None:
    def ends(second: Any) -> Any:
        generators = [np.random.default_rng(1), np.random.default_rng(2)]
        return bootstrap_interval(
            lambda one, other: one.mean(axis=-1), [np.arange(7.0), second], generators
        )

    assert ends(np.arange(9.0)) == ends(np.arange(3.0))
