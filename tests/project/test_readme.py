"""The README's examples, run as they stand."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import gymnasium
import pytest

from causal_openlock.experiment.store import Store
from causal_openlock.formats.schema_file import parse_schema
from support.documents import ROOT, broken_links, code, in_a_process, unknown_options, words_of

README = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return code(README, language)


def run(folder: Path, *words: str) -> str:
    return in_a_process(folder, *words).stdout


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    vault, experiment = blocks("yaml")
    (tmp_path / "vault.yaml").write_text(vault, encoding="utf-8")
    (tmp_path / "first_look.yaml").write_text(experiment, encoding="utf-8")
    (tmp_path / "my_learners.py").write_text(blocks("python")[0], encoding="utf-8")
    return tmp_path


def test_the_schema_of_ones_own_is_what_the_text_says(folder: Path) -> None:
    assert run(folder, "schema", "check", "vault.yaml").strip() in README
    schema = parse_schema((folder / "vault.yaml").read_text(encoding="utf-8"))
    assert sorted(map(sorted, schema.solutions)) == [["dial", "key", "second_key"]]


def test_the_fault_shown_is_the_fault_reported(folder: Path) -> None:
    path = folder / "vault.yaml"
    path.write_text(
        path.read_text(encoding="utf-8").replace("[door]", "[dor]", 1), encoding="utf-8"
    )
    done = in_a_process(folder, "schema", "check", "vault.yaml", status=2)
    (shown,) = re.findall(r"`(vault\.yaml:\d+:\d+: [^`]*)`", README)
    assert shown in done.stderr


def test_the_comparisons_of_the_schema_of_ones_own_run_as_shown(folder: Path) -> None:
    shown = re.findall(r"\$ causal-openlock (compare --condition [^#\n]*)", README)
    assert len(shown) == 2
    for line in shown:
        run(folder, *shlex.split(line), "--subjects", "1", "--workers", "1")


def test_hyper_parameters_are_declared_as_shown(folder: Path) -> None:
    (block,) = (block for block in blocks("python") if "class Settings" in block)
    head = "from dataclasses import dataclass\nfrom typing import Annotated\n"
    head += "from causal_openlock import OneSubjectLearner\n"
    body = "\n    def act(self, observation):\n        return int(self.parameters.persistence)\n"
    (folder / "declared.py").write_text(head + block + body, encoding="utf-8")
    said = run(folder, "learners", "declared:Persistent")
    assert "persistence" in said
    assert "share of actions that are repeated" in said


def test_the_learner_of_ones_own_plays(folder: Path) -> None:
    code = [line for line in blocks("python")[0].splitlines() if line.strip()]
    assert len(code) <= 20
    run(
        folder,
        *("compare", "--learner", "my_learners:Persistent", "--learner", "random"),
        *("--out", "results/mine", "--subjects", "2", "--condition", "CC3"),
    )
    record = Store(folder / "results" / "mine").record()[0].to_pandas()
    assert set(record["learner"]) == {"Persistent", "random"}


def test_the_experiment_of_ones_own_runs(folder: Path) -> None:
    path = folder / "first_look.yaml"
    text = path.read_text(encoding="utf-8").replace("attempt_limit: 100", "attempt_limit: 5")
    path.write_text(text.replace("train_loops: 5", "train_loops: 1"), encoding="utf-8")
    words = ("compare", "first_look.yaml", "--out", "results/first_look", "--subjects", "2")
    run(folder, *words)
    record = Store(folder / "results" / "first_look").record()[0].to_pandas()
    assert set(record["condition"]) == {"CC4", "CC3-CE4", "vault"}
    assert set(record["protocol"]) == {"human", "long"}


def test_the_environments_are_made_as_shown() -> None:
    names: dict[str, object] = {}
    (block,) = (block for block in blocks("python") if "gymnasium.make" in block)
    exec(block, names)
    env, rooms = names["env"], names["rooms"]
    assert isinstance(env, gymnasium.Env)
    assert env.reset(seed=0)[0].shape == (16,)
    assert rooms.reset(seed=0)[0].shape == (16_384, 16)  # type: ignore[attr-defined]


def test_every_file_that_the_readme_points_to_exists() -> None:
    assert README.count("](") > 20
    assert broken_links(ROOT / "README.md") == []


def test_every_option_that_the_readme_names_exists() -> None:
    for words in words_of(README):
        assert unknown_options(words) == [], words


def test_the_trial_that_is_told_is_the_one_that_is_played(folder: Path) -> None:
    told = run(folder, "trace", "CC4", "--learner", "bayes")
    shown = README.split("```\nAttempt 3\n")[1].split("```")[0]
    assert f"Attempt 3\n{shown}" in told
