"""Two results side by side: what changed, and whether the results differ."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from typer.testing import CliRunner

from causal_openlock.analysis.measures import count
from causal_openlock.analysis.report.difference_page import (
    DIFFERENT,
    SAME,
    UNDECIDED,
    UNKNOWN,
    changes,
    compared,
    sentence_on_changes,
    sentence_on_differences,
    write_difference,
)
from causal_openlock.cli import app
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.schemas.schema_file import schema_from_dict
from causal_openlock.storage.stored import StoredExperiment
from support.fabricated_records import table, trial_rows
from support.html_page import Page
from support.made_up_experiments import stored

pytestmark = pytest.mark.slow


def described(**changed: Any) -> StoredExperiment:
    learners = changed.pop("learners", ["bayes", "random"])
    conditions = changed.pop("conditions", ["CC4"])
    experiment = read_experiment(
        find_experiment("default"), Changes(conditions, learners, None, 4, changed.pop("seed", 1))
    )
    return stored(experiment, **{"versions": {"numpy": "2.0"}, **changed})


def lengths(**groups: list[int]) -> pa.Table:
    """A record in which each subject of each learner solves one trial after so many attempts."""
    rows = []
    for learner, many in groups.items():
        for subject, length in enumerate(many):
            found = [0] * (length - 3) + [1, 2, 3]
            rows += trial_rows(found, learner=learner, subject=subject)
    return table(rows)


def test_what_changed_is_told_field_by_field() -> None:
    first = described()
    second = described(seed=2, versions={"numpy": ["2.0", "2.1"]})
    bayes, random = second.learners
    (cc4,) = second.conditions
    schema = cc4.train[0].schema.as_dict()
    schema["edges"]["L0"] = ["L1", "L2"]
    trials = replace(cc4.train[0], schema=schema_from_dict(schema))
    second = replace(
        second,
        learners=(
            replace(bayes, parameters={**bayes.parameters, "lapse": 0.5}),
            replace(random, protocol=replace(random.protocol, attempt_limit=60)),
        ),
        conditions=(replace(cc4, train=(trials,)),),
    )
    told = {row.what: (row.first, row.second) for row in changes(first, second).itertuples()}
    assert told == {
        "seed": ("1", "2"),
        "versions, numpy": ("2.0", "2.0, 2.1"),
        "learner bayes, parameters, lapse": ("0.0", "0.5"),
        "learner random, protocol, attempt limit": ("30", "60"),
        "condition CC4, train, 1, schema": (
            "CC4: L0 → L1, L2, L3; L1, L2, L3 → door",
            "CC4: L0 → L1, L2; L1, L2, L3 → door",
        ),
    }


def test_what_is_there_only_once_is_one_line() -> None:
    told = changes(described(), described(learners=["bayes"], conditions=["CC4", "CE3-CC4"]))
    assert told.to_numpy().tolist() == [
        ["name", "bayes_random_in_CC4", "bayes_in_CC4_CE3-CC4"],
        ["learner random", "there", "–"],
        ["condition CE3-CC4", "–", "there"],
    ]
    assert sentence_on_changes(told).startswith("3 things differ in what was run: name")


def test_equal_experiments_differ_in_nothing() -> None:
    assert changes(described(), described(title="another", command="x")).empty


def test_verdicts_tell_noise_from_more() -> None:
    rng = np.random.default_rng(0)
    near, far = rng.integers(5, 15, 40).tolist(), rng.integers(20, 29, 40).tolist()
    other = rng.integers(5, 15, 40).tolist()
    first = lengths(equal=near, noisy=near, moved=near, alone=[4], gone=near)
    second = lengths(equal=near, noisy=other, moved=far, alone=[9], new=near)
    trials = [count(record).trials for record in (first, second)]
    told = compared(trials[0], trials[1], ["noisy", "moved", "equal"])
    assert dict(zip(told["learner"], told["verdict"], strict=True)) == {
        "noisy": UNDECIDED,
        "moved": DIFFERENT,
        "equal": SAME,
        "alone": UNKNOWN,
    }
    moved = told.set_index("learner").loc["moved"]
    assert moved["difference"] == pytest.approx(np.mean(far) - np.mean(near))
    assert moved["ci_low"] < moved["difference"] < moved["ci_high"]
    said = sentence_on_differences(told)
    assert said.startswith("1 of 4 means differ by more than chance explains (moved in CC4)")


def test_a_difference_seen_by_chance_is_corrected_away() -> None:
    """Forty comparisons of equals: without the correction two of them are expected to be told."""
    rng = np.random.default_rng(4)
    groups = [{f"l{i}": rng.integers(4, 20, 20).tolist() for i in range(40)} for _ in range(2)]
    trials = [count(lengths(**group)).trials for group in groups]
    told = compared(trials[0], trials[1], [])
    assert (told["p"] < 0.05).any()
    assert not (told["verdict"] == DIFFERENT).any()


def test_learners_that_did_not_change_do_not_hide_one_that_did() -> None:
    rng = np.random.default_rng(2)
    still = {f"l{i}": rng.integers(5, 15, 5).tolist() for i in range(60)}
    before, after = [5, 8, 9, 11, 14], [12, 15, 16, 18, 21]
    trials = [count(lengths(moved=one, **still)).trials for one in (before, after)]
    told = compared(trials[0], trials[1], []).set_index("learner")
    assert 0.05 / 61 < told.loc["moved", "p"] < 0.05
    assert told.loc["moved", "p_holm"] == told.loc["moved", "p"]
    assert told["verdict"].value_counts().to_dict() == {SAME: 60, DIFFERENT: 1}
    assert told.loc[told["verdict"] == SAME, "p_holm"].isna().all()


def test_the_page_stands_alone_and_has_its_tables_as_files(tmp_path: Path) -> None:
    results = [
        (lengths(bayes=[4, 5, 6, 7]), described()),
        (lengths(bayes=[14, 15, 16, 17]), described(seed=9, missing=("x",))),
    ]
    path = tmp_path / "difference_b.html"
    write_difference(results[0], results[1], path, ("a <1>", "b"), figures=True)
    text = path.read_text("utf-8")
    page = Page(text)
    assert page.open == []
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", text)
    assert "a <1> and b" in page.text
    assert "1 of 1 means differ by more than chance explains (bayes in CC4)." in page.text
    assert "seed 9, 1 cell missing" in page.text
    assert ["seed", "1", "9"] in page.tables[0]
    assert "+10.00" in page.tables[1][1]
    names = {path.name for path in (tmp_path / "tables").iterdir()}
    assert names == {
        f"difference_b_{what}.{kind}" for what in ("changes", "means") for kind in ("csv", "tex")
    }


def test_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    call = CliRunner().invoke
    base = ["compare", "-c", "CC4", "-l", "oracle", "--subjects", "3", "--workers", "1"]
    for name, seed in (("a", "1"), ("b", "2")):
        assert call(app, [*base, "--seed", seed, "-o", name]).exit_code == 0
    done = call(app, ["report", "a", "b"])
    assert done.exit_code == 0, done.output
    assert re.search(r"seed +1 +2", done.output)
    assert "the same" in done.output
    assert (tmp_path / "a" / "difference_b.html").exists()
    assert (tmp_path / "a" / "report.html").exists()
    assert call(app, ["report", "a", "b", "--out", "c"]).exit_code == 0
    assert (tmp_path / "c" / "difference_b.html").exists()
    for wrong, said in (
        (["report", "a", "b", "--beside", "b"], "--beside"),
        (["report", "a", "--out", "c"], "--out"),
        (["report", "a", "nowhere"], "nowhere holds no results"),
    ):
        failed = call(app, wrong)
        assert said in str(failed.exception)
