"""Bundles: what is in them, and that their one command runs the experiment again."""

from __future__ import annotations

import re
import shlex
import shutil
import sys
import zipfile
from collections.abc import Iterator
from dataclasses import replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from causal_openlock.cli import app
from causal_openlock.contract.registry import _learner_class
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.experiment import Origin
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.export.bundle import _files, write_bundle
from causal_openlock.export.experiment_file import experiment_file
from causal_openlock.storage.store import Store
from causal_openlock.world.rewards import PRESETS, find_reward
from support.command import play_here, report_shortly
from support.made_up_experiments import NOBODY, condition_called, edit_stored, spec, stored
from support.processes import start_prepared

pytestmark = pytest.mark.slow

LEARNER = """
from dataclasses import dataclass

from causal_openlock.contract.one_subject import OneSubjectLearner


@dataclass(frozen=True)
class Parameters:
    stays: float = 0.5


class Mine(OneSubjectLearner):
    Parameters = Parameters

    def act(self, observation):
        stays = self.generator.random() < self.parameters.stays
        return 14 if stays else int(self.generator.integers(15))
"""
SCHEMA = """
name: two_ways
title: 'Two ways: "either" will do'
levers: [L0, L1, L2]
edges:
  L0: [L1]
  L1: [door]
  L2: {door: {strength: 0.8}}
"""
EXPERIMENT = """
name: own_everything
title: "Own: schema, learner & protocol"
seed: 5
subjects: 3
cell_size: 2
reward: [basic, state_change]
conditions:
  - two_ways
  - CC3-CE4
  - name: spelled.out
    train:
      - {schema: CC3, layouts: random, trials: 2}
      - {schema: two_ways, layouts: [{L0: LEFT, L1: UPPER, L2: LOWER}, trial1], shuffle: false}
    test: [{schema: CE4, layouts: [trial7]}]
  - {name: watched, train: {shown: CC3}, test: [{schema: CE4}]}
learners:
  - oracle
  - {learner: "a_bundled_learner:Mine", name: mine, parameters: {stays: 0.25}, protocol: quick}
  - {learner: random, reward: authors_2018, subjects: 2}
protocols:
  quick: {based_on: rl, attempt_limit: 9, baseline_loops: 1, train_loops: 1, test_loops: 1,
    layouts: random}
"""


def forget_the_learner() -> None:
    """Let the module of the learner be imported anew, from wherever it is found then."""
    for name in (
        "a_bundled_learner",
        "helping",
        *filter(re.compile("parts_of_it").match, [*sys.modules]),
    ):
        sys.modules.pop(name, None)
    _learner_class.cache_clear()


@pytest.fixture(scope="module")
def played(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an experiment of everything one's own, its results, and their bundle."""
    folder = tmp_path_factory.mktemp("played")
    (folder / "a_bundled_learner.py").write_text(LEARNER)
    (folder / "two_ways.yaml").write_text(SCHEMA)
    (folder / "mine.yaml").write_text(EXPERIMENT)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.setattr(sys, "path", [*sys.path])
        play_here(patch)
        call = CliRunner().invoke
        done = call(app, ["compare", "mine.yaml", "-o", "out"])
        assert done.exit_code == 0, done.output
        done = call(app, ["bundle", "out", "-o", "own.zip"])
        assert done.exit_code == 0, done.output
        assert "warning" not in done.output
    forget_the_learner()
    return folder


@pytest.fixture
def made(played: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A copy of it, to be in and to change."""
    folder = shutil.copytree(played, tmp_path / "made")
    monkeypatch.chdir(folder)
    monkeypatch.setattr(sys, "path", [*sys.path])
    yield folder
    forget_the_learner()


def test_the_one_command_of_a_bundle_gives_the_same_summary(
    made: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    zipfile.ZipFile("own.zip").extractall("elsewhere")
    unpacked = made / "elsewhere" / "own_everything"
    for name in ("a_bundled_learner.py", "two_ways.yaml"):
        (made / name).unlink()  # what is not in the bundle is not there
    monkeypatch.chdir(unpacked)
    play_here(monkeypatch)
    report_shortly(monkeypatch)
    told = re.findall(r"^    (causal-openlock .+)$", Path("README.md").read_text("utf-8"), re.M)
    assert len(told) == 1
    done = CliRunner().invoke(app, shlex.split(told[0])[1:])
    assert done.exit_code == 0, done.output
    assert Path("again/summary.csv").read_bytes() == Path("results/summary.csv").read_bytes()
    again, first = (Store(Path(name)).experiment() for name in ("again", "results"))
    assert again.identity == first.identity
    assert again.files == first.files
    done = CliRunner().invoke(app, ["report", "results", "again"])
    assert "12 are the same, subject by subject" in " ".join(done.output.split())


def test_a_bundle_holds_everything_and_is_the_same_every_time(made: Path) -> None:
    with zipfile.ZipFile("own.zip") as bundle:
        names = {name.removeprefix("own_everything/") for name in bundle.namelist()}
        read = bundle.read("own_everything/requirements.txt").decode()
    results = {name.removeprefix("results/") for name in names if name.startswith("results/")}
    assert names - {f"results/{name}" for name in results} == {
        "README.md",
        "DATA_CARD.md",
        "croissant.json",
        "experiment.yaml",
        "requirements.txt",
        "a_bundled_learner.py",
        *(f"schemas/{name}.yaml" for name in ("two_ways", "CC3", "CE4")),
    }
    assert {"experiment.json", "report.html", "summary.csv"} <= results
    assert sum(name.startswith("cells/") for name in results) == 20
    assert not any(name.startswith(("figures/", "tables/")) for name in results)
    assert re.search(r"^# Python \d", read, re.M)
    assert re.search(r"^numpy==[\d.]+$", read, re.M)
    (made / "out" / "notes.txt").write_text("nobody else's business")
    write_bundle(Store(made / "out"), made / "second.zip")
    assert (made / "second.zip").read_bytes() == (made / "own.zip").read_bytes()
    done = CliRunner().invoke(app, ["report", "out", "--figures"])
    assert done.exit_code == 0, done.output
    write_bundle(Store(made / "out"), made / "third.zip")
    with zipfile.ZipFile("third.zip") as bundle:
        assert "own_everything/results/tables/learner_mine.csv" in bundle.namelist()
        assert "own_everything/results/figures/learner_mine.pdf" in bundle.namelist()


def test_a_learner_that_has_changed_since_is_not_bundled(made: Path) -> None:
    (made / "a_bundled_learner.py").write_text(LEARNER + "\n# changed\n")
    with pytest.raises(OpenLockError, match=r"a_bundled_learner:Mine is not what the results were"):
        write_bundle(Store(made / "out"), made / "other.zip")
    assert not (made / "other.zip").exists()


def test_modules_that_a_learner_imports_are_bundled_and_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Beside the experiment file, in a folder with a dot in its name; run from elsewhere."""
    beside, away = tmp_path / "lab-0.5", tmp_path / "away"
    (beside / "parts_of_it").mkdir(parents=True)
    away.mkdir()
    lazy = "    def act(self, observation):\n        from helping import constant\n"
    text = (
        LEARNER.replace("    def act(self, observation):\n", lazy) + "\nimport networkx, pytest\n"
    )
    (beside / "a_bundled_learner.py").write_text(text)
    (beside / "helping.py").write_text("from parts_of_it import deep\nconstant = deep.constant\n")
    (beside / "parts_of_it" / "__init__.py").write_text("")
    (beside / "parts_of_it" / "deep.py").write_text("from . import deeper\nconstant = 1\n")
    (beside / "parts_of_it" / "deeper.py").write_text("import json\n")
    (beside / "mine.yaml").write_text(
        "name: helped\nsubjects: 2\ncell_size: 1\nconditions: [CC3]\n"
        "learners: ['a_bundled_learner:Mine']\n"
    )
    monkeypatch.chdir(away)
    monkeypatch.setattr(sys, "path", [*sys.path])
    start_prepared(monkeypatch)
    report_shortly(monkeypatch)
    call = CliRunner().invoke
    done = call(app, ["compare", str(beside / "mine.yaml"), "-o", "run-0.5", "--workers", "2"])
    assert done.exit_code == 0, done.output
    forget_the_learner()
    sys.path.remove(str(beside))
    done = call(app, ["bundle", "run-0.5"])
    assert done.exit_code == 0, done.output
    said = " ".join(done.output.split())
    assert "bundled as now" not in said
    assert "imports pytest, which neither the bundle nor its requirements.txt holds" in said
    with zipfile.ZipFile(away / "run-0.5.zip") as bundle:
        names = {name.removeprefix("helped/") for name in bundle.namelist()}
        assert "holds" in bundle.read("helped/README.md").decode()
    helpers = {f"parts_of_it/{name}.py" for name in ("__init__", "deep", "deeper")}
    assert {name for name in names if name.endswith(".py")} == {
        "a_bundled_learner.py",
        "helping.py",
        *helpers,
    }
    zipfile.ZipFile(away / "run-0.5.zip").extractall(tmp_path / "unpacked")
    (beside / "helping.py").write_text("constant = 2\n")
    with pytest.raises(OpenLockError, match="a_bundled_learner:Mine is not what the results were"):
        write_bundle(Store("run-0.5"), "other.zip")
    # Earlier versions recorded the hash of the learner's own file.
    package = f"a_bundled_learner.py {sha256(text.encode()).hexdigest()[:16]}"
    edit_stored(Path("run-0.5"), lambda held: held["learners"][0].update(package=package))
    said = " ".join(write_bundle(Store("run-0.5"), "other.zip"))
    assert "imports helping.py, bundled as now; whether that has changed" in said
    shutil.rmtree(beside)
    assert str(beside) not in sys.path
    forget_the_learner()
    monkeypatch.chdir(tmp_path / "unpacked" / "helped")
    done = call(app, ["compare", "experiment.yaml", "-o", "again", "--workers", "2"])
    assert done.exit_code == 0, done.output
    assert Path("again/summary.csv").read_bytes() == Path("results/summary.csv").read_bytes()
    forget_the_learner()


def test_files_of_one_name_that_two_parameters_name_are_kept_apart(tmp_path: Path) -> None:
    paths = [tmp_path / part / "weights.npz" for part in ("first", "second")]
    for path in paths:
        path.parent.mkdir()
        path.write_text(path.parent.name)
    known = " ".join(sha256(path.read_bytes()).hexdigest()[:16] for path in paths)
    learner = spec(
        "me",
        parameters=dict(zip("ab", map(str, paths), strict=True)),
        recorded=Origin("mine:Learner", "mine 1.0", known),
    )
    assert _files(learner) == {
        "a": ("files/me/a/weights.npz", b"first"),
        "b": ("files/me/b/weights.npz", b"second"),
    }


def test_what_is_unfinished_or_has_no_report_is_not_bundled(made: Path) -> None:
    copy = Store(shutil.copytree(made / "out", made / "copy"))
    (copy.folder / "report.html").unlink()
    with pytest.raises(StoreError, match="has no report; write it first"):
        write_bundle(copy, made / "other.zip")
    next(copy.cells.glob("*.parquet")).unlink()
    with pytest.raises(StoreError, match="unfinished, 1 of its cells are missing"):
        write_bundle(copy, made / "other.zip")


def test_results_of_another_version_are_bundled_with_a_warning(made: Path) -> None:
    copy = Store(shutil.copytree(made / "out", made / "copy"))
    edit_stored(copy.folder, lambda held: held.update(version="9.0", identity="another"))
    (caution,) = write_bundle(copy, made / "other.zip")
    assert caution.startswith(
        "It could not be checked that this runs again: the results were made with"
    )
    with zipfile.ZipFile(made / "other.zip") as bundle:
        assert caution in bundle.read("own_everything/README.md").decode()


def test_a_learner_that_is_another_now_is_named(made: Path) -> None:
    copy = Store(shutil.copytree(made / "out", made / "copy"))

    def change(held: dict[str, Any]) -> None:
        held["learners"][0]["class"] = "openlock_learners.oracle:AnotherOracle"
        held["identity"] = "another"

    edit_stored(copy.folder, change)
    (caution,) = write_bundle(copy, made / "other.zip")
    assert caution.startswith("It may not run as it did")
    assert caution.endswith("(oracle).")


@pytest.mark.parametrize("name", ["default", "bayes", "own_schemas"])
def test_bundled_experiments_survive_being_described(name: str, tmp_path: Path) -> None:
    from causal_openlock.files.yaml_file import dump_yaml

    known = ["oracle", "random", "bayes", "ddqn"]
    experiment = read_experiment(find_experiment(name), Changes(learners=known))
    kept = stored(experiment)
    assert kept.conditions == experiment.conditions
    (tmp_path / "schemas").mkdir()
    for condition in experiment.conditions:
        for schema in condition.schemas:
            (tmp_path / "schemas" / f"{schema.name}.yaml").write_text(schema.to_yaml())
    (tmp_path / "again.yaml").write_text(dump_yaml(experiment_file(kept)))
    assert read_experiment(tmp_path / "again.yaml").identity == experiment.identity


def test_rewards_survive_being_described() -> None:
    for reward in (*PRESETS.values(), find_reward(["basic", "negative_repeat"])):
        one = replace(
            NOBODY, conditions=(condition_called("CC4"),), learners=(spec("a", reward=reward),)
        )
        assert stored(one).learners[0].reward == reward
