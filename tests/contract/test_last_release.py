"""Results and bundles of the last release open, are reported and played on."""

import json
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from causal_openlock import open_results
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store

pytestmark = pytest.mark.slow

LAST = Path(__file__).parents[1] / "data" / "last_release"
"""An experiment, a folder of its results without one cell, and a bundle of it, made with 0.2.0."""
BY_CLASS = "bayes"
"""It is named by its class, so its identity holds a hash of the file that has changed since."""


def test_a_folder_of_the_last_release_is_reported_and_resumed(tmp_path):
    folder = tmp_path / "results"
    shutil.copytree(LAST / "results", folder)
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
    stored = Store(folder).experiment()
    asked = read_experiment(LAST / "last_release.yaml")
    before = {path.name: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    run(asked, folder, workers=1)
    after = {path.name: path.stat().st_mtime_ns for path in (folder / "cells").iterdir()}
    names = [cell.file_name for cell in asked.cells() if cell.spec.name != BY_CLASS]
    assert set(names) <= set(stored.files)
    assert {name: after[name] for name in before} == before
    assert {name.split("_")[0] for name in after.keys() - before.keys()} == {"random", BY_CLASS}


def test_a_bundle_of_the_last_release_runs(tmp_path, monkeypatch):
    with zipfile.ZipFile(LAST / "last_release.zip") as archive:
        archive.extractall(tmp_path)
    monkeypatch.chdir(tmp_path / "last_release")
    held = json.loads(Path("results", "experiment.json").read_text())
    run(read_experiment(Path("experiment.yaml")), Path("results"), workers=1)
    now = {path.name for path in Path("results", "cells").glob("*.parquet")}
    assert set(held["cells"]) == now


def test_packages_of_common_names_beside_a_script_do_no_harm(tmp_path):
    for name in ("learners", "schemas", "tests"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('not this one')\n")
    (tmp_path / "script.py").write_text(
        "import causal_openlock as ol\n"
        "if __name__ == '__main__':\n"
        "    found = ol.compare(['CC3', 'CC3-CC4'], ['bayes', 'rl2'], subjects=1, workers=1)\n"
        "    print(sorted(found.learners))\n"
    )
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "['bayes', 'rl2']"
