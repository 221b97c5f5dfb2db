"""Intervals of means."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pandas as pd
import pytest

from causal_openlock.analysis.statistics import mean_interval, mean_intervals


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
