"""Tests of one question are corrected together, and decided once."""

from __future__ import annotations

import numpy as np
import pytest

from causal_openlock.analysis.decisions import Decisions
from causal_openlock.analysis.topics import congruency


def test_a_question_is_corrected_by_itself() -> None:
    decisions = Decisions()
    decisions.register("one", {"a": 0.02, "b": float("nan")})
    tests = {("x", 1): 0.001, ("x", 2): 0.04, ("y", 1): 0.6, ("y", 2): 0.02}
    decisions.register("other", tests, family=lambda key: key[0])
    assert decisions.total == 5
    assert decisions.p("one", "a") == 0.02
    assert np.isnan(decisions.p("one", "b"))
    assert decisions.p("other", ("x", 1)) == pytest.approx(2 * 0.001)
    assert decisions.p("other", ("x", 2)) == 0.04
    assert decisions.p("other", ("y", 2)) == pytest.approx(2 * 0.02)
    assert decisions.size("other", ("y", 2)) == 2
    found = [decisions.found(*key) for key in (("one", "a"), ("one", "b"), ("other", ("y", 1)))]
    assert found == [True, False, False]


def test_one_learner_more_changes_nobody_elses_answer() -> None:
    few, many = Decisions(), Decisions()
    tests = {("human", "a", "CC4"): 0.03, ("human", "a", "CE4"): 0.02}
    more = {("human", f"r{n}", c): 0.5 for n in range(9) for c in ("CC4", "CE4")}
    few.register("congruency", tests, family=congruency.family)
    many.register("congruency", tests | more, family=congruency.family)
    assert [few.p("congruency", key) for key in tests] == [
        many.p("congruency", key) for key in tests
    ]


def test_nothing_is_added_once_something_is_decided() -> None:
    decisions = Decisions()
    decisions.register("one", {"a": 0.02})
    assert decisions.found("one", "a")
    with pytest.raises(ValueError, match="the tests of late come after"):
        decisions.register("late", {"a": 0.03})


def test_a_report_without_tests_has_none() -> None:
    assert Decisions().total == 0
