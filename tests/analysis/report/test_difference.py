"""Two results side by side: what changed, and whether the results differ."""

import re
from dataclasses import replace

import numpy as np
import pytest

from causal_openlock.analysis.report.difference_page import (
    DIFFERENT,
    SAME,
    UNDECIDED,
    UNKNOWN,
    changes,
    differences,
    write_difference,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.making import Changes, find_experiment, read_experiment
from causal_openlock.schemas.schema import schema_from_dict
from support.fabricated_records import table, trial_rows
from support.html_page import Page
from support.made_up_experiments import experiment_of, stored
from support.whole_report import lines_of

pytestmark = pytest.mark.slow


def described(learners=("bayes", "random"), conditions=("CC4",), seed=1, **changed):
    made = Changes([*conditions], [*learners], None, 4, seed)
    experiment = read_experiment(find_experiment("default"), made)
    return stored(experiment, **{"versions": {"numpy": "2.0"}, **changed})


def lengths(**groups):
    """A record in which each subject of each learner solves one trial after so many attempts."""
    rows = []
    for learner, many in groups.items():
        for subject, length in enumerate(many):
            found = [0] * (length - 3) + [1, 2, 3]
            rows += trial_rows(found, learner=learner, subject=subject)
    return table(rows)


def verdicts(first, second):
    both = (Material.of(record, experiment_of(record)) for record in (first, second))
    return differences(*both).set_index("learner")


def test_what_changed_is_told_field_by_field():
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
    found = changes(described(), second)
    assert {row.what: (row.first, row.second) for row in found.itertuples()} == {
        "seed": ("1", "2"),
        "versions, numpy": ("2.0", "2.0, 2.1"),
        "learner bayes, parameters, lapse": ("0.0", "0.5"),
        "learner random, protocol, attempt_limit": ("30", "60"),
        "condition CC4, train, 1, schema, edges, L0": ("L1, L2, L3", "L1, L2"),
    }
    only_once = changes(described(), described(["bayes"], ["CC4", "CE3-CC4"]))
    assert only_once.to_numpy().tolist() == [
        ["name", "bayes_random_in_CC4", "bayes_in_CC4_CE3-CC4"],
        ["learner random", "there", "–"],
        ["condition CE3-CC4", "–", "there"],
    ]
    assert changes(described(), described(title="another", command="x")).empty


def test_verdicts_tell_noise_from_more():
    rng = np.random.default_rng(0)
    near, far = rng.integers(5, 15, 40).tolist(), rng.integers(20, 29, 40).tolist()
    other = rng.integers(5, 15, 40).tolist()
    first = lengths(equal=near, noisy=near, moved=near, alone=[4], gone=near)
    second = lengths(equal=near, noisy=other, moved=far, alone=[9], new=near)
    told = verdicts(first, second)
    assert list(told["verdict"].items()) == [
        ("alone", UNKNOWN), ("equal", SAME), ("moved", DIFFERENT), ("noisy", UNDECIDED),
    ]  # fmt: skip
    moved = told.loc["moved"]
    assert moved["difference"] == pytest.approx(np.mean(far) - np.mean(near))
    assert moved["ci_low"] < moved["difference"] < moved["ci_high"]


def test_differences_are_corrected_over_those_that_changed():
    rng = np.random.default_rng(4)
    groups = [{f"l{i}": rng.integers(4, 20, 20).tolist() for i in range(40)} for _ in range(2)]
    told = verdicts(*(lengths(**group) for group in groups))
    assert (told["p"] < 0.05).any()  # of forty equals two are expected
    assert not (told["verdict"] == DIFFERENT).any()
    still = {f"l{i}": rng.integers(5, 15, 5).tolist() for i in range(60)}
    before, after = [5, 8, 9, 11, 14], [12, 14, 17, 22, 17]
    told = verdicts(*(lengths(moved=one, **still) for one in (before, after)))
    assert 0.05 / 61 < told.loc["moved", "p"] < 0.05
    assert told.loc["moved", "p_holm"] == told.loc["moved", "p"]
    assert told["verdict"].value_counts().to_dict() == {SAME: 60, DIFFERENT: 1}
    assert told.loc[told["verdict"] == SAME, "p_holm"].isna().all()


def test_the_page_stands_alone_and_has_its_tables_as_files(tmp_path, golden):
    results = [
        Material.of(lengths(bayes=[4, 5, 6, 7, 8], gone=[5, 6]), described()),
        Material.of(
            lengths(bayes=[14, 15, 17, 17, 19], new=[5, 7]), described(seed=9, missing=("x",))
        ),
    ]
    path = tmp_path / "difference_b.html"
    write_difference(*results, path, ("a <1>", "b"), figures=True)
    html = path.read_text("utf-8")
    assert Page(html).open == []
    assert "http" not in re.sub(r'xmlns(:\w+)?="[^"]*"', "", html)
    golden("difference.txt", lines_of(html))
    assert {one.name for one in (tmp_path / "tables").iterdir()} == {
        f"difference_b_{what}.{kind}" for what in ("changes", "means") for kind in ("csv", "tex")
    }


def test_long_tables_are_closed_on_the_page(tmp_path):
    for learners, closed in ((24, False), (25, True)):
        record = lengths(**{f"l{i:02}": [4, 5] for i in range(learners)})
        one = Material.of(record, described(learners=["oracle"]))
        write_difference(one, one, tmp_path / "page.html", ("a", "b"))
        assert ("<details" in (tmp_path / "page.html").read_text("utf-8")) == closed
