"""Sweeps: a learner once for each value of a parameter, in files and in Python."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.contract.registry import create
from causal_openlock.errors import FileError, LearnerError, OpenLockError
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment

GRID = "sweep: {lapse: [0.0, 0.1], policy: [thompson, solve_and_learn]}"
NINE = [0.5] * 9
LABELS = [
    "bayes-lapse-0-policy-thompson",
    "bayes-lapse-0-policy-solve_and_learn",
    "bayes-lapse-0.1-policy-thompson",
    "bayes-lapse-0.1-policy-solve_and_learn",
]


def read(folder: Path, learners: str, changes: Changes | None = None) -> Experiment:
    path = folder / "e.yaml"
    path.write_text(f"name: e\nconditions: [CC3]\nlearners:\n  - random\n  - {learners}\n")
    return read_experiment(path, changes)


def test_a_file_and_a_program_declare_the_same_grid(tmp_path: Path) -> None:
    entry = f"{{learner: bayes, parameters: {{noise: 0.2}}, subjects: 3, {GRID}}}"
    in_file = read(tmp_path, entry).learners
    swept = ol.sweep(
        "bayes", lapse=[0.0, 0.1], policy=("thompson", "solve_and_learn"), noise=0.2, subjects=3
    )
    assert [one.name for one in swept] == LABELS
    for given in (["random", *swept], ["random", swept]):
        assert ol.make_experiment(["CC3"], given).learners == in_file
    assert [one.name for one in in_file] == ["random", *LABELS]
    assert [(one.parameters["lapse"], one.parameters["policy"]) for one in in_file[1:]] == [
        (0.0, "thompson"), (0.0, "solve_and_learn"), (0.1, "thompson"), (0.1, "solve_and_learn"),
    ]  # fmt: skip
    assert {one.parameters["noise"] for one in in_file[1:]} == {0.2}
    assert {one.subjects for one in in_file[1:]} == {3}


def test_labels_are_legal_and_show_values_as_they_are_written() -> None:
    swept = ol.sweep("bayes", label="mine", lapse=np.linspace(0, 0.3, 4), strength_alpha=[1e-9])
    assert [one.name for one in swept][1::2] == [
        "mine-lapse-0.1-strength_alpha-1e-09",
        "mine-lapse-0.3-strength_alpha-1e-09",
    ]
    assert ol.sweep("win_stay", grey_only=[True])[0].name == "win_stay-grey_only-True"
    instance = create("bayes", {"noise": 0.2})
    (own,) = ol.sweep(instance, lapse=[0.1])
    assert own.parameters == {"noise": 0.2, "lapse": 0.1}


def test_a_sweep_or_one_of_its_learners_can_be_chosen_by_name(tmp_path: Path) -> None:
    entry = f"{{learner: bayes, name: b, {GRID}}}"
    every = [label.replace("bayes", "b") for label in LABELS]
    chosen = read(tmp_path, entry, Changes(learners=["b"]))
    assert [one.name for one in chosen.learners] == every
    one = read(tmp_path, entry, Changes(learners=[every[2]]))
    assert [spec.name for spec in one.learners] == [every[2]]
    assert one.command.endswith(f"e.yaml --learner {every[2]}")


def test_two_sweeps_of_one_learner_are_both_chosen_by_its_name(tmp_path: Path) -> None:
    two = "{learner: bayes, sweep: {lapse: [0.1]}}\n  - {learner: bayes, sweep: {noise: [0.2]}}"
    chosen = read(tmp_path, two, Changes(learners=["bayes"]))
    assert [one.name for one in chosen.learners] == ["bayes-lapse-0.1", "bayes-noise-0.2"]


@pytest.mark.parametrize(
    ("sweep", "line", "column", "said"),
    [
        ("{lapse: 0.1}", 5, 30, "sweep.lapse must be a list, written [one, another]"),
        ("{lapse: []}", 5, 30, "needs at least 1; add one"),
        ("{lapsing: [0.1, 0.2]}", 5, 30, "did you mean lapse?"),
        ("{lapse: [0.1, 1.1]}", 5, 43, "less than or equal to 1"),
        ("{lapse: [0.1,\n    high]}", 6, 5, "a valid number"),
        ("{lapse: [[0.1]]}", 5, 38, "a valid number"),
        ("{lapse: [0.1, 0.1]}", 5, 22, "two learners with the label bayes-lapse-0.1; take one"),
        ("{noise: [0.1]}, parameters: {noise: 0.2}", 5, 30, "noise is in parameters and in sweep"),
        ("{forgets: [" + "x" * 70 + "]}", 5, 22, "give the learner a shorter name"),
        (f"{{lapse: {NINE}, noise: {NINE}, free_form: {NINE}}}", 5, 22, "729 learners; sweep"),
    ],
)  # fmt: skip
def test_a_fault_of_a_sweep_has_its_place(
    tmp_path: Path, sweep: str, line: int, column: int, said: str
) -> None:
    with pytest.raises(OpenLockError) as caught:
        read(tmp_path, f"{{learner: bayes, sweep: {sweep}}}")
    assert str(caught.value).splitlines()[0].startswith(f"{tmp_path / 'e.yaml'}:{line}:{column}: ")
    assert said in str(caught.value)


@pytest.mark.parametrize(
    ("parameters", "said"),
    [
        ({}, "a sweep needs a list of values"),
        ({"lapse": 0.1}, "a sweep needs a list of values"),
        ({"lapse": []}, "a sweep needs a list of values"),
        ({"lapse": [0.1, 3]}, "less than or equal to 1, and this is 3"),
        ({"lapsing": [0.1]}, "did you mean lapse?"),
        ({"lapse": np.array(0.3)}, "a sweep needs a list of values"),
        ({"lapse": [0.1, 0.1]}, "two learners with the label bayes-lapse-0.1; take one"),
    ],
)
def test_a_faulty_sweep_of_a_program_is_refused(parameters: dict[str, object], said: str) -> None:
    with pytest.raises(LearnerError) as caught:
        ol.sweep("bayes", **parameters)  # type: ignore[arg-type]
    assert said in str(caught.value)


def test_a_program_is_told_every_fault_of_a_learner_at_once() -> None:
    parameters: dict[str, object] = {"lapse": [0.1, 3], "noise": ["x"], "polcy": 1}
    with pytest.raises(OpenLockError) as caught:
        ol.sweep("bayes", label="a b", subjects=0, **parameters)  # type: ignore[arg-type]
    said = [
        "'a b' is not a label",
        "the learner bayes has no parameter 'polcy'",
        "the parameter lapse of bayes should be less than or equal to 1, and this is 3",
        "the parameter noise of bayes should be a valid number, and this is 'x'",
        "subjects should be greater than or equal to 1, and this is 0",
    ]
    lines = str(caught.value).splitlines()
    assert len(lines) == len(said)
    for line, start in zip(lines, said, strict=True):
        assert line.startswith(start)


def test_a_file_is_told_every_fault_of_a_learner_at_once(tmp_path: Path) -> None:
    with pytest.raises(FileError) as caught:
        read(
            tmp_path,
            "learner: bayes\n    sweep: {lapse: [3]}\n    parameters: {noise: x}\n"
            "    protocol: hum\n    reward: nono\n  - {learner: unknown, protocol: hum}",
        )
    assert [(fault.line, fault.message.partition(";")[0]) for fault in caught.value.faults] == [
        (6, "the parameter lapse of bayes should be less than or equal to 1, and this is 3"),
        (7, "the parameter noise of bayes should be a valid number, and this is 'x'"),
        (8, "there is no protocol 'hum'"),
        (9, "there is no reward 'nono'"),
        (10, "there is no learner 'unknown'"),
        (10, "there is no protocol 'hum'"),
    ]


def test_a_wrong_label_in_a_file_is_told_its_form(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="the form: letters, digits, underscores, dots and dashes"):
        read(tmp_path, "{learner: bayes, name: a b}")
