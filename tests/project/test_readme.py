"""The README's examples, run as they stand."""

from __future__ import annotations

import hashlib
import re
import shlex
import sys
from pathlib import Path
from typing import Any

import gymnasium
import pytest

from causal_openlock.schemas.schema_file import parse_schema
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.documents import DOCS, ROOT, broken_links, code, unknown_options, words_of
from support.processes import start_prepared

sys.path.append(str(DOCS / "figures"))
import first_page

pytestmark = pytest.mark.slow

README = (ROOT / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a reader saves who follows the README, and what the commands shown leave there."""
    folder = tmp_path_factory.mktemp("readme")
    for name, text in zip(("vault.yaml", "first_look.yaml"), code(README, "yaml"), strict=True):
        (folder / name).write_text(text, encoding="utf-8")
    (folder / "my_learners.py").write_text(code(README, "python")[0], encoding="utf-8")
    return folder


def test_the_vault_has_the_solution_that_the_text_tells_of(folder: Path) -> None:
    schema = parse_schema((folder / "vault.yaml").read_text(encoding="utf-8"))
    assert [set(solution) for solution in schema.solutions] == [{"dial", "key", "second_key"}]
    shown = at_once("schema", "show", "vault.yaml", cwd=folder).stdout
    assert "1 solution:" in shown


def test_the_learner_and_the_experiment_of_ones_own_run(folder: Path) -> None:
    assert len([line for line in code(README, "python")[0].splitlines() if line.strip()]) <= 20
    compared = [words for words in words_of(README) if words[0] == "compare"]
    (line,) = (words for words in compared if "first" in words[1])
    with modules_of(folder):
        done = at_once(*line, "--subjects", 2, "--out", "results/first_look", cwd=folder)
    assert done.status == 0, done.stdout + done.stderr
    record = Store(folder / "results" / "first_look").record()[0].to_pandas()
    assert set(record["learner"]) == {"oracle", "bayes", "Persistent"}
    assert set(record["condition"]) == {"CC4", "CC3-CE4", "vault"}


def test_the_trial_can_be_traced_as_shown(folder: Path) -> None:
    (line,) = (words for words in words_of(README) if words[:1] == ["trace"])
    assert "bits learned" in at_once(*line, cwd=folder).stdout


def test_the_python_runs(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    start_prepared(monkeypatch)
    block = code(README, "python")[1]
    assert len(block.strip().splitlines()) <= 12
    assert "subjects=20" in block
    names: dict[str, Any] = {}
    exec(block.replace("subjects=20", "subjects=1"), names)
    results = names["results"]
    assert results.learners == ("bayes", "rl2")
    assert len(results.trials) == 2 * (5 + 7 + 5)
    (table,) = results.by_condition
    assert [name for name, _ in table.columns] == ["CC4", "CC3-CC4", "vault"]
    assert table.beside["people"][:2] == (6.45, 5.525)
    for named in re.findall(r"(?<= )\.(\w+)\(", block):  # in the comment
        assert hasattr(results.plot, named), named


def test_the_environment_is_made_as_shown() -> None:
    (line,) = (line for line in README.split("`") if line.startswith("gymnasium.make"))
    env = eval(line, {"gymnasium": gymnasium})
    assert env.reset(seed=0)[0].shape == (16,)


def test_every_file_that_the_readme_points_to_exists() -> None:
    assert README.count("](") > 15
    pictures = re.findall(r'(?:href|src)="([^"]+)"', README)
    assert len(pictures) == 4
    assert [path for path in pictures if not (ROOT / path).is_file()] == []
    assert broken_links(ROOT / "README.md") == []
    assert broken_links(ROOT / "CONTRIBUTING.md") == []


@pytest.mark.parametrize(("figure", "source"), first_page.SOURCES.items())
def test_figures_are_made_from_what_is_stored_now(figure: str, source: str) -> None:
    """Otherwise: ``python docs/figures/first_page.py``."""
    svg = (DOCS / "figures" / figure).read_text(encoding="utf-8")
    stored = (first_page.STUDY / source).read_bytes()
    assert first_page.made_from(svg) == hashlib.sha256(stored).hexdigest()


def test_figures_can_be_drawn_from_what_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_page, "HERE", tmp_path)
    first_page.main()
    for figure in first_page.SOURCES:
        drawn = (tmp_path / figure).read_text(encoding="utf-8")
        assert first_page.made_from(drawn) in (DOCS / "figures" / figure).read_text("utf-8")


def test_every_option_that_the_readme_names_exists() -> None:
    for words in words_of(README):
        assert unknown_options(words) == [], shlex.join(words)


def test_the_readme_is_short() -> None:
    assert len(README.splitlines()) <= 90
    (table,) = re.findall(r"<!-- evidence:.*?<!-- end of evidence -->", README, flags=re.DOTALL)
    assert len(re.findall(r"^\|", table, flags=re.MULTILINE)) <= 2 + 7
