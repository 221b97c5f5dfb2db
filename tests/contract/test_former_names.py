"""Names of the release before, in which the package of the learners was called ``learners``."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from causal_openlock import compare, open_results
from causal_openlock.contract.former_names import present_name
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store

pytestmark = pytest.mark.slow

LAST = Path(__file__).parents[1] / "data" / "last_release"
"""An experiment, a folder of its results without one cell, and a bundle of it, made with 0.2.0."""
BY_CLASS = "bayes"
"""It is named by its class, so its identity holds a hash of the file that has changed since."""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(LAST / "results", tmp_path / "results")
    return tmp_path / "results"


def test_a_folder_of_the_last_release_opens_and_is_reported(folder: Path) -> None:
    results = open_results(folder)
    kinds = {spec.name: spec.origin.class_name for spec in results.experiment.learners}
    assert kinds == {
        "random": "openlock_learners.random:RandomLearner",
        "bayes": "learners.bayes:Bayes",  # of a file, as it was
        "ddqn": "openlock_learners.ddqn:DDQN",
        "rl2": "openlock_learners.rl2:RL2",
    }
    assert results.experiment.random_learners == {"random"}
    assert "random_CC3-CE4" in " ".join(results.experiment.missing)
    results.report()
    assert (folder / "report.html").is_file()


def test_a_folder_of_the_last_release_is_resumed(folder: Path) -> None:
    stored = Store(folder).experiment()
    asked = read_experiment(LAST / "last_release.yaml")
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    run(asked, folder, workers=1)
    after = {path.name: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    names = [cell.file_name for cell in asked.cells() if cell.spec.name != BY_CLASS]
    assert set(names) <= set(stored.files)
    assert {name: after[name] for name in before} == before
    assert {name.split("_")[0] for name in after.keys() - before.keys()} == {"random", BY_CLASS}


def test_a_bundle_of_the_last_release_runs(tmp_path: Path) -> None:
    with zipfile.ZipFile(LAST / "last_release.zip") as archive:
        archive.extractall(tmp_path)
    unpacked = tmp_path / "last_release"
    held = json.loads((unpacked / "results" / "experiment.json").read_text())
    code = (
        "from pathlib import Path\n"
        "from causal_openlock.experiment.file import read_experiment\n"
        "from causal_openlock.running.runner import run\n"
        "made = read_experiment(Path('experiment.yaml'))\n"
        "run(made, Path('results'), workers=1)\n"
        "print({spec.name: spec.origin.class_name for spec in made.learners})\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=unpacked, check=True, timeout=300)
    now = {path.name for path in (unpacked / "results" / "cells").glob("*.parquet")}
    assert set(held["cells"]) == now


def test_former_names_in_files_and_in_python_are_the_bundled_learners() -> None:
    made = make_experiment(["CC3"], ["learners.ddqn:DDQN", "learners.random:RandomLearner"])
    assert [spec.learner for spec in made.learners] == [
        "openlock_learners.ddqn:DDQN",
        "openlock_learners.random:RandomLearner",
    ]
    assert compare("CC3", "learners.oracle:Oracle", subjects=1, workers=1).trials["solved"].all()


def test_ones_own_package_of_that_name_is_ones_own(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    own = tmp_path / "learners"
    own.mkdir()
    (own / "__init__.py").touch()
    (own / "random.py").write_text("class RandomLearner: pass\n")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "learners", raising=False)  # a folder of these tests
    assert present_name("learners.random:RandomLearner") == "learners.random:RandomLearner"
    assert present_name("learners.oracle:Oracle") == "openlock_learners.oracle:Oracle"


def test_who_imports_the_former_package_is_told(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "from_before.py").write_text("from learners.oracle import Oracle\n")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(LearnerError, match="the bundled learners are in the package openlock_lear"):
        make_experiment(["CC3"], ["from_before:Oracle"])


def test_packages_of_common_names_beside_a_script_do_no_harm(tmp_path: Path) -> None:
    for name in ("learners", "schemas", "tests"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('not this one')\n")
    (tmp_path / "script.py").write_text(
        "import causal_openlock as ol\n"
        "if __name__ == '__main__':\n"
        "    learners = ['bayes', 'ddqn', 'rl2']\n"
        "    found = ol.compare(['CC3', 'CC3-CC4'], learners, subjects=1, workers=1)\n"
        "    print(sorted(found.learners))\n"
    )
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "['bayes', 'ddqn', 'rl2']"
