"""Whether an installation is right: what is equal, what is in its interval, and what is not."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import causal_openlock as ol
from causal_openlock.comparison import checking
from causal_openlock.comparison.checking import (
    LEVEL,
    STORED,
    Check,
    check_experiment,
    compared,
    expected_of,
    of_subjects,
)
from causal_openlock.errors import OpenLockError
from support.command import at_once

LEARNERS = ["random", "tabular_q"]


def played(seed: int, subjects: int) -> ol.Results:
    return ol.compare(["CC3", "CE3"], LEARNERS, subjects=subjects, seed=seed, workers=0)


@pytest.fixture(scope="module")
def expected() -> dict[str, Any]:
    results = played(3, 5)
    return {name: expected_of(results, name) for name in LEARNERS}


def test_the_same_seed_is_right(expected: dict[str, Any]) -> None:
    checks = compared(played(3, 5), expected)
    assert [(one.learner, one.measure, one.ok) for one in checks] == [
        ("random", "every action", True),
        ("tabular_q", "share of actions that move something", True),
    ]  # hardly anybody solves a room, so that attempts are not compared


def test_other_actions_are_wrong_and_other_means_of_the_same_kind_are_right(
    expected: dict[str, Any],
) -> None:
    exact, mean = compared(played(4, 5), expected)
    assert not exact.ok
    assert exact.found != exact.expected
    assert mean.ok


def test_a_mean_outside_its_interval_is_wrong(expected: dict[str, Any]) -> None:
    results = played(3, 5)
    mean, low, high = expected["tabular_q"]["moved"]
    moved = {"tabular_q": {"moved": [mean + 2, low + 2, high + 2]}}
    (found,) = compared(results, moved)
    assert not found.ok
    assert found.expected == f"{mean + 2:.3f} ({low + 2:.3f} to {high + 2:.3f})"


def test_a_learner_that_could_not_play_is_wrong(expected: dict[str, Any]) -> None:
    only = ol.compare(["CC3", "CE3"], ["oracle"], subjects=1, workers=0)
    assert [(one.found, one.ok) for one in compared(only, expected)] == [("nothing", False)] * 2


def test_intervals_are_those_of_the_mean_of_new_subjects(expected: dict[str, Any]) -> None:
    values = of_subjects(played(3, 5), "tabular_q")["moved"]
    assert len(values) == 5
    half = stats.t(4).ppf((1 + LEVEL) / 2) * np.std(values, ddof=1) * np.sqrt(1 / 5 + 1 / 5)
    assert expected["tabular_q"]["moved"] == pytest.approx(
        [values.mean(), values.mean() - half, values.mean() + half], abs=1e-5
    )


def test_a_subject_counts_once_with_the_mean_of_its_conditions() -> None:
    results = played(3, 2)
    moved: dict[tuple[str, int], list[bool]] = {}
    for row in results.actions.query("learner == 'random'").itertuples():
        moved.setdefault((row.condition, row.subject), []).append(row.moved)
    by_hand = [np.mean([np.mean(moved[name, one]) for name in ("CC3", "CE3")]) for one in (0, 1)]
    assert of_subjects(results, "random")["moved"].tolist() == pytest.approx(by_hand)


# -- the command ----------------------------------------------------------------------------------


def test_what_is_stored_is_of_the_experiment_and_compares_all_its_learners() -> None:
    stored = json.loads(STORED.read_text(encoding="utf-8"))
    experiment = check_experiment()
    assert stored["experiment"] == experiment.declaration
    assert list(stored["learners"]) == [spec.name for spec in experiment.learners]
    assert all(stored["learners"].values())


@pytest.mark.parametrize(
    "text", ["", "{", "[]", "{}", '{"experiment": "a", "learners": {"a": 3}, "versions": {}}', None]
)
def test_a_spoiled_file_of_what_is_expected_is_one_sentence(
    text: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(checking, "STORED", tmp_path / "expected.json")
    if text is not None:
        (tmp_path / "expected.json").write_text(text)
    done = at_once("check")
    assert done.status == 2
    assert "expected.json is damaged" in done.stderr.replace("\n", "")
    assert "install the package again" in " ".join(done.stderr.split())


def test_another_experiment_than_the_stored_one_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    changed = replace(check_experiment(), seed=1)
    monkeypatch.setattr(checking, "check_experiment", lambda: changed)
    done = at_once("check")
    assert done.status == 2
    assert "expected.json is from another experiment than" in done.stderr
    assert "python -m causal_openlock.comparison.checking" in done.stderr


@pytest.mark.parametrize(
    ("others", "remedy"),
    [
        ("numpy 1.0 (here it is 2.0)", "from numpy 1.0 (here it is 2.0); install those versions"),
        ("", "versions are the same; please report this table"),
    ],
)
def test_what_is_wrong_is_shown_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch, others: str, remedy: str
) -> None:
    rows = [Check("oracle", "every action", "0a", "0a", True),
            Check("ddqn", "attempts in a trial", "3 (2 to 4)", "9", False)]  # fmt: skip
    monkeypatch.setattr(checking, "check_installation", lambda **_: (rows, others))
    done = at_once("check")
    assert done.status == 1
    lines = [line.split() for line in done.stdout.splitlines()]
    assert lines[0] == ["learner", "compared", "expected", "found", "ok"]
    assert [line[-1] for line in lines[1:]] == ["yes", "no"]
    assert "1 of 2 are not as expected" in done.stderr
    assert remedy in done.stderr


def test_the_experiments_errors_are_errors_of_the_command(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(**_: Any) -> Any:
        raise OpenLockError("nothing could be played")

    monkeypatch.setattr(checking, "check_installation", fails)
    assert (at_once("check").status, at_once("check").stderr) == (
        2,
        "error: nothing could be played\n",
    )


@pytest.mark.slow
def test_this_installation_is_right() -> None:
    done = at_once("check")
    assert done.status == 0, done.stdout + done.stderr
    assert "no" not in {line.split()[-1] for line in done.stdout.splitlines() if line.split()}
    assert done.stdout.rstrip().endswith("This installation is right.")
