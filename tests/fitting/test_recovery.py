"""Who made simulated subjects is found again, where it can be."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from causal_openlock.cli import app
from causal_openlock.contract.registry import create
from causal_openlock.experiment.building import learner, make_experiment
from causal_openlock.fitting.actions import Fitted
from causal_openlock.fitting.recovering import searched
from causal_openlock.fitting.recovery import drawn_sets, made_with, recovered, recovery, space_of
from causal_openlock.fitting.search import Range, bundled_search
from support.command import at_once

pytestmark = pytest.mark.slow

EXPERIMENT = """
name: three
seed: 4
subjects: 5
protocol: brief
conditions: [CC3]
protocols: {brief: {attempt_limit: 8, stop_when_solved: true, baseline_trials: 2}}
learners: [random, win_stay, associative]
"""


def scores(chances: dict[str, list[float]]) -> pd.DataFrame:
    """Subjects of one condition, by label of who made them: log-likelihoods of `a` and `b`."""
    rows = [
        {"scored": scored, "learner": maker, "condition": "CC3", "protocol": "human",
         "experiment": "e", "seed": 1, "subject": subject, "trial": trial, "log_probability": value}
        for maker, differences in chances.items()
        for subject, difference in enumerate(differences)
        for trial, share in ((1, -1.0), (2, 2.0))
        for scored, value in (("a", -9.0 + share * difference), ("b", -9.0))
    ]  # fmt: skip
    return pd.DataFrame(rows)


def test_the_confusion_of_a_hand_made_record() -> None:
    # Of the subjects of a, one in four looks like b; b's are clear. Each first trial misleads.
    found = recovery(scores({"a": [3, 3, 3, -1], "b": [-2, -2, -2, -2]}))
    assert found.single.to_numpy().tolist() == [[0.75, 0.25], [0.0, 1.0]]
    assert found.subjects == 4
    assert found.groups.loc["a", "a"] > 0.95
    assert found.groups.loc["b", "b"] == 1.0
    first = found.by_size[found.by_size["trials"] == 1]
    assert first[first["subjects"] == 1]["right"].tolist() == [0.25, 0.0]
    assert found.bits.loc["b", "b"] == pytest.approx(9 / np.log(2))
    assert found.confused(found.single) == [("a", "b", 0.25)]


def test_equal_learners_are_attributed_to_neither() -> None:
    found = recovery(scores({"a": [0, 0], "b": [0, 0]}))
    assert (found.single == 0.5).all().all()


def test_drawn_parameters_lie_in_their_ranges_and_can_be_played() -> None:
    space = bundled_search("bayes")
    sets = drawn_sets(space, 30, 1)
    for name, one in space.ranges.items():
        values = np.array([chosen[name] for chosen in sets])
        assert one.low <= values.min() < values.max() <= one.high
    assert drawn_sets(space, 3, 1) == sets[:3]
    made = make_experiment(["CC3"], made_with(space, sets[:2], 3)).learners
    assert [one.name for one in made] == ["set_000", "set_001"]
    assert made[1].parameters["forgetting"] == sets[1]["forgetting"]
    plain, thompson = make_experiment(
        ["CC3"], ["bayes", learner("bayes", label="t", policy="thompson", forgets="failures")]
    ).learners
    assert space_of(plain) is None
    assert space_of(thompson) == space
    assert create("bayes", made[0].parameters)


def test_correlations_are_on_the_scale_that_is_searched() -> None:
    space = bundled_search("theory_based")
    truth = drawn_sets(space, 12, 3)
    assert space.ranges["local_gain"] == Range(0.05, 1.0, log=True)
    fits = [
        Fitted("s", -1, {**one, "local_gain": one["local_gain"] ** 2, "edit_weight": 1.0},
               1.0, 1, 0.0, 0, 0.0, 1, 2.0)
        for one in truth
    ]  # fmt: skip
    pairs, found = recovered(truth, fits, space)
    r = found.set_index("parameter")["r"]
    assert r["local_gain"] == pytest.approx(1.0)
    assert r["schema_gain"] == pytest.approx(1.0)
    assert np.isnan(r["edit_weight"])
    assert len(pairs) == 12 * 4


def test_on_the_command_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "three.yaml").write_text(EXPERIMENT)
    words = [
        "recover",
        str(tmp_path / "three.yaml"),
        "--workers",
        "1",
        "--out",
        str(tmp_path / "r"),
    ]
    result = CliRunner().invoke(app, words)
    assert result.exit_code == 0, (result.output, result.exception)
    assert "With 5 subjects in a condition, 100% of groups" in " ".join(result.output.split())
    single = pd.read_csv(tmp_path / "r" / "single.csv", index_col=0)
    assert np.diag(single).mean() > 0.6
    assert (tmp_path / "r" / "recovery.svg").exists()
    # What is done is not done again.
    monkeypatch.setattr("causal_openlock.scoring.teacher_forcing.score_part", None)
    again = CliRunner().invoke(app, words)
    assert again.exit_code == 0, again.exception


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--parameters", "random"], "random has no search space .* --search name=low:high"),
        (["--parameters", "random", "-s", "x=0:1"], "the learner random has no parameter 'x'"),
        (["--parameters", "associative", "-s", "temperature=0"], "is not a range; write"),
        (["-s", "temperature=0:1"], "--search is for one learner; name it with --parameters"),
    ],
)
def test_what_cannot_be_recovered_is_told_before_anything_is_simulated(
    tmp_path: Path, words: list[str], said: str
) -> None:
    (tmp_path / "three.yaml").write_text(EXPERIMENT)
    wrong = CliRunner().invoke(
        app, ["recover", str(tmp_path / "three.yaml"), "-o", str(tmp_path / "r"), *words]
    )
    assert re.search(said, str(wrong.exception))
    assert not (tmp_path / "r").exists()


def test_a_learner_that_predicts_nobody_is_refused_before_anything_is_simulated(
    tmp_path: Path,
) -> None:
    (tmp_path / "three.yaml").write_text(EXPERIMENT.replace("associative]", "sb3]"))
    done = at_once("recover", tmp_path / "three.yaml", "-o", tmp_path / "r")
    assert "sb3 learns from its own actions alone" in done.stderr
    assert not (tmp_path / "r").exists()


def test_parameters_of_any_learner_are_recovered_in_given_ranges(tmp_path: Path) -> None:
    pytest.importorskip("optuna")
    (spec,) = make_experiment(
        ["CC3"], [learner("associative", lever=0.2, temperature=0.5)]
    ).learners
    space = searched(spec, ["temperature=0.02:2:log"])
    assert (space.fixed, [*space.ranges]) == ({"lever": 0.2}, ["temperature"])
    (tmp_path / "one.yaml").write_text(
        EXPERIMENT.replace("[random, win_stay, associative]", "[random, associative]")
        .replace("subjects: 5", "subjects: 1")
        .replace("baseline_trials: 2", "baseline_trials: 1")
    )
    result = at_once(
        *("recover", tmp_path / "one.yaml", "-o", tmp_path / "r", "--parameters", "associative"),
        *("-s", "temperature=0.02:2:log", "--sets", "3", "--candidates", "2", "--workers", "1"),
    )
    assert result.status == 0, result.stderr
    pairs = pd.read_csv(tmp_path / "r" / "parameters_associative.csv")
    assert pairs["true"].between(0.02, 2).all()
    assert pairs["at_bound"].isin([True, False]).all()
