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
    mean_interval,
    mean_intervals,
    stratified_interval,
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
        assert (low == 0.1).all()
        assert (high == 0.1).all()
        for shape in ((3, 1), (3, 0), (0, 5)):
            low, high = mean_interval(np.zeros(shape), np.random.default_rng(0))
            assert low.shape == high.shape == shape[:1]
            assert np.isnan([*low, *high]).all()


def test_a_groups_interval_does_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(5)
    frame = pd.DataFrame({"group": np.repeat([*"abcd"], [10, 10, 10, 4]), "x": rng.random(34)})
    together = mean_intervals(frame, ["group"], "x").set_index("group")
    for name in "abcd":
        alone = mean_intervals(frame[frame["group"] == name], ["group"], "x").set_index("group")
        assert alone.loc[name].tolist() == pytest.approx(together.loc[name].tolist(), rel=1e-12)


def _difference(groups: Any) -> Any:
    return groups[0].mean(axis=-1) - groups[1].mean(axis=-1)


def test_stratified_interval_is_scipys_of_two_samples() -> None:
    rng = np.random.default_rng(1)
    groups = rng.normal(5, 2, 30), rng.normal(3, 1, 50)
    ours = stratified_interval(groups, _difference, np.random.default_rng(2), resamples=5000)
    theirs = stats.bootstrap(
        groups, lambda a, b, axis: a.mean(axis=axis) - b.mean(axis=axis),
        method="percentile", n_resamples=5000, rng=np.random.default_rng(3),
    ).confidence_interval  # fmt: skip
    assert ours == pytest.approx(tuple(theirs), abs=0.06)


def test_strata_are_resampled_among_themselves() -> None:
    """Within constant groups nothing varies, however far apart the groups are."""
    far = [np.full(9, 1.0), np.append(np.full(9, 50.0), 50.5)]
    low, high = stratified_interval(
        far, lambda drawn: np.concatenate(drawn, axis=-1).mean(axis=-1), np.random.default_rng(0)
    )
    middle = (9 + 500.5) / 19
    assert middle - 0.1 < low < high < middle + 0.1


def test_stratified_interval_in_small_batches_without_spread_and_company() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        constant = [np.full(4, 0.1), np.full(3, 0.3)]
        low, high = stratified_interval(constant, _difference, np.random.default_rng(0))
        assert low == high == pytest.approx(-0.2)
        for few in ([np.ones(1), np.ones(9)], []):
            assert np.isnan(stratified_interval(few, _difference, np.random.default_rng(0))).all()


def test_batches_make_no_difference_to_what_is_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    groups = [np.arange(6.0), np.arange(8.0) ** 2]
    sizes = []

    def counted(drawn: Any) -> Any:
        sizes.append(len(drawn[0]))
        return _difference(drawn)

    monkeypatch.setattr("causal_openlock.analysis.statistics._BATCH", 14 * 300)
    low, high = stratified_interval(groups, counted, np.random.default_rng(0), resamples=1000)
    assert sizes == [300, 300, 300, 100]
    assert low < 2.5 - 17.5 < high
