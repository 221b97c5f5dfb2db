"""How learners are found by name, and how their parameters are read."""

import sys
from dataclasses import dataclass, field, make_dataclass
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import pytest
from pydantic import Field

from causal_openlock.contract.one_subject import OneSubjectLearner, PerSubjectAdapter
from causal_openlock.contract.registry import (
    changed_parameters,
    create,
    file_that_runs,
    is_ours,
    learner_class,
    name_of,
    origin,
    parameter_table,
    parse_parameters,
    registry,
)
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.files.plugins import LEARNERS
from openlock_learners.random import RandomLearner
from support.command import at_once
from support.packages import register


def test_our_learners_are_registered():
    assert [*registry()] == sorted(registry())
    assert learner_class("random") is RandomLearner
    assert is_ours("random")
    assert not is_ours("openlock_learners.random:RandomLearner")
    assert origin("random").startswith("causal-openlock ")


def test_learners_of_another_package_are_listed_and_loaded_when_they_are_created(
    tmp_path, monkeypatch
):
    register(tmp_path, "gentle-learners", LEARNERS, sweeper=f"{__name__}:Sweeper")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    assert origin("sweeper") == "gentle-learners 1.0"
    (row,) = [line for line in at_once("learners").stdout.splitlines() if "sweeper" in line]
    assert "Always does the same" in row
    assert "gentle-learners" in row
    assert isinstance(create("sweeper"), PerSubjectAdapter)
    register(tmp_path / "broken", "broken", LEARNERS, breaks="no_such_module_here:Learner")
    monkeypatch.syspath_prepend(tmp_path / "broken")
    assert registry()["breaks"].dist.name == "broken"
    with pytest.raises(OpenLockError, match=r"breaks.*no_such_module_here:Learner.*ModuleNotFound"):
        create("breaks")


class Sweeper(OneSubjectLearner):
    """Always does the same."""

    def act(self, observation):
        return 0


def test_a_class_of_a_module_is_found_by_its_name():
    assert name_of(RandomLearner) == "random"
    assert name_of(Sweeper) == f"{__name__}:Sweeper"
    assert isinstance(create(f"{__name__}:Sweeper"), PerSubjectAdapter)
    with pytest.raises(LearnerError, match="cannot be found by its name"):
        name_of(type("Sweeper", (Sweeper,), {"__module__": __name__}))


def test_a_module_of_the_working_directory_is_found(tmp_path, monkeypatch):
    text = "from openlock_learners.random import RandomLearner\n"
    text += "class Mine(RandomLearner):\n    '''Mine.'''\n"
    (tmp_path / "beside_the_notebook.py").write_text(text)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    assert "beside_the_notebook.py" in file_that_runs("beside_the_notebook:Mine", tmp_path)
    assert isinstance(create("beside_the_notebook:Mine"), RandomLearner)
    before = origin("beside_the_notebook:Mine")
    (tmp_path / "beside_the_notebook.py").write_text(f"{text}    changed = True\n")
    after = origin("beside_the_notebook:Mine")
    assert before.split()[0] == after.split()[0] == "beside_the_notebook.py"
    assert before != after
    for name in ("random", "openlock_learners.random:RandomLearner", "no_such_module:Learner"):
        assert file_that_runs(name, tmp_path) is None


@dataclass(frozen=True)
class Settings:
    rate: Annotated[float, Field(gt=0, le=1), "how fast"] = 0.5
    steps: Annotated[int | None, Field(ge=1, description="how often")] = None
    layers: Annotated[tuple[int, ...], "how wide", "and how many"] = (8, 8)
    rule: Annotated[Literal["win-stay", "lose-shift"], "what it goes by"] = "win-stay"
    greedy: bool = False

    def __post_init__(self):
        if self.greedy and self.rate < 0.1:
            raise ValueError("greedy asks for a rate of .1 or more")


class Tuned(RandomLearner):
    """Has parameters."""

    Parameters = Settings


TUNED = f"{__name__}:Tuned"


def test_parameters_come_from_plain_data():
    assert parse_parameters(TUNED, {}) == Settings()
    given = {"rate": 1, "steps": 3, "layers": [4, 5], "rule": "lose-shift", "greedy": True}
    assert parse_parameters(TUNED, given) == Settings(1.0, 3, (4, 5), "lose-shift", True)
    assert parse_parameters(TUNED, {"layers": (4, 5)}).layers == (4, 5)
    assert create(TUNED, {"rate": 0.1}).parameters == Settings(rate=0.1)
    of_numpy = {"steps": np.int64(3), "rate": np.float32(0.5), "greedy": np.bool_(True)}
    assert parse_parameters(TUNED, of_numpy) == Settings(0.5, 3, greedy=True)


@pytest.mark.parametrize(
    ("given", "names"),
    [
        ({"rate": float("nan")}, "rate.*nan"),
        ({"rate": [0.1, 0.5]}, "rate.*sweep"),
        ({"layers": [8, "8"]}, "^((?!sweep).)*layers((?!sweep).)*'8'((?!sweep).)*$"),
        ({"greedy": 1}, "greedy.*1"),
        ({"rate": object()}, "plain data.*rate"),
        ({"rate": 0.05, "greedy": True}, "greedy asks for a rate of .1"),
        ({"rate": "fast", "rat": 1}, "(?s)'fast'.*'rat'"),
    ],
)
def test_a_parameter_that_does_not_fit_is_named(given, names):
    with pytest.raises(LearnerError, match=names):
        create(TUNED, given)


Rule = Enum("Rule", {"WIN": "win"})


@pytest.mark.parametrize(
    ("kind", "default", "names"),
    [
        *((Any, value, r"plain data.*odd") for value in (np.int64(3), Path("a"), Rule.WIN, b"a")),
        (np.ndarray, None, r"Tuned.*ndarray"),
    ],
)
def test_parameters_that_no_file_can_have_are_refused(monkeypatch, kind, default, names):
    made = make_dataclass("Odd", [("odd", kind, field(default=default))], frozen=True)
    monkeypatch.setattr(Tuned, "Parameters", made)
    with pytest.raises(LearnerError, match=names):
        create(TUNED)


def test_the_table_of_parameters_tells_defaults_and_meanings():
    assert [tuple(row) for row in parameter_table(TUNED)] == [
        ("rate", 0.5, "how fast"),
        ("steps", None, "how often"),
        ("layers", (8, 8), "how wide and how many"),
        ("rule", "win-stay", "what it goes by"),
        ("greedy", False, ""),
    ]
    assert parameter_table("random") == []
    assert ("settings", {}) in [(row.name, row.default) for row in parameter_table("llm")]


def test_changed_parameters_are_compared_as_a_file_has_them():
    given = {"rate": 0.5, "steps": None, "layers": [8, 8], "greedy": np.bool_(False)}
    assert changed_parameters(TUNED, given) == {}
    assert changed_parameters(TUNED, {**given, "layers": (8,)}) == {"layers": [8]}
