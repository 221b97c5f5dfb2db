"""``causal-openlock check``: what is equal, what is in its interval, and what is not."""

import pytest

import causal_openlock as ol
from causal_openlock.comparison import checking
from causal_openlock.comparison.checking import compared, expected_of
from support.command import at_once


def played(seed, learners=("random", "tabular_q")):
    return ol.compare(["CC3", "CE3"], learners, subjects=5, seed=seed, workers=0)


def test_actions_of_exact_learners_and_means_of_others_are_compared():
    results = played(3)
    expected = {name: expected_of(results, name) for name in results.learners}
    mean, low, high = expected["tabular_q"]["moved"]
    moved = results.actions.query("learner == 'tabular_q'")["moved"]
    assert low < mean < high
    assert mean == pytest.approx(moved.mean(), abs=0.01)  # over subjects and conditions
    assert [check.ok for check in compared(results, expected)] == [True, True]
    assert [check.ok for check in compared(played(4), expected)] == [False, True]
    expected["tabular_q"]["moved"] = [mean + 2, low + 2, high + 2]
    assert [check.ok for check in compared(results, expected)] == [True, False]
    only = compared(played(3, ["oracle"]), expected)
    assert [(check.found, check.ok) for check in only] == [("nothing", False)] * 2


@pytest.mark.parametrize("text", ["", "{", "[]", '{"experiment": "a", "learners": {"a": 3}}'])
def test_damaged_file_of_expected_results_is_named(text, tmp_path, monkeypatch):
    monkeypatch.setattr(checking, "STORED", tmp_path / "expected.json")
    (tmp_path / "expected.json").write_text(text)
    done = at_once("check")
    assert done.status == 2
    assert "expected.json" in done.stderr.replace("\n", "")


@pytest.mark.slow
def test_this_installation_is_right():
    done = at_once("check")
    assert done.status == 0, done.stdout + done.stderr
    assert done.stdout.rstrip().endswith("This installation is right.")
