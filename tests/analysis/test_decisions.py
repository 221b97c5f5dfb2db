"""All tests of a report are corrected together, and decided once."""

from __future__ import annotations

import numpy as np
import pytest

from causal_openlock.analysis.decisions import Decisions


def test_sections_share_one_correction() -> None:
    decisions = Decisions()
    decisions.register("one", {"a": 0.02, "b": float("nan")})
    decisions.register("other", {"a": 0.001, "c": 0.04, "d": 0.6})
    assert decisions.total == 4
    assert decisions.p("other", "a") == pytest.approx(4 * 0.001)
    assert decisions.p("one", "a") == pytest.approx(3 * 0.02)
    assert np.isnan(decisions.p("one", "b"))
    found = [decisions.found(*key) for key in (("one", "a"), ("one", "b"), ("other", "a"))]
    assert found == [False, False, True]


def test_nothing_is_added_once_something_is_decided() -> None:
    decisions = Decisions()
    decisions.register("one", {"a": 0.02})
    assert decisions.found("one", "a")
    with pytest.raises(ValueError, match="the tests of late come after"):
        decisions.register("late", {"a": 0.03})


def test_a_report_without_tests_has_none() -> None:
    assert Decisions().total == 0
