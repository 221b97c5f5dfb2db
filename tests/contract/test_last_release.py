"""Results and bundles of the last release open, are reported, and stand beside new ones."""

import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from causal_openlock import compare, open_results
from causal_openlock.errors import FileError, StoreError
from causal_openlock.experiment.making import read_experiment

pytestmark = pytest.mark.slow

LAST = Path(__file__).parents[1] / "data" / "last_release"
"""An experiment, a folder of its results without one cell, and a bundle of it, made with 0.2.0."""


def test_a_folder_of_the_last_release_is_reported_beside_new_results_and_not_mixed(tmp_path):
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
    new = compare("CC3-CE4", "oracle", subjects=1, workers=0, out=tmp_path / "new")
    both = open_results(folder, new.folders[0])
    assert {*both.learners} == {*kinds, "oracle"}
    with pytest.raises(StoreError, match=r"made with version 0\.2\.0\+1"):
        compare("CC4", "random", name="last_release", workers=0, out=folder)


def test_a_bundle_of_the_last_release_opens(tmp_path):
    with zipfile.ZipFile(LAST / "last_release.zip") as archive:
        archive.extractall(tmp_path)
    results = open_results(tmp_path / "last_release" / "results")
    results.report()
    assert {*results.learners} >= {"random", "rl2"}
    with pytest.raises(FileError, match="rl2: 'learns' is not a key here"):  # it is gone
        read_experiment(tmp_path / "last_release" / "experiment.yaml")


def test_packages_of_common_names_beside_a_script_do_no_harm(tmp_path):
    for name in ("learners", "schemas", "tests"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "__init__.py").write_text("raise RuntimeError('not this one')\n")
    (tmp_path / "script.py").write_text(
        "import causal_openlock as ol\n"
        "if __name__ == '__main__':\n"
        "    found = ol.compare('CC3-CC4', 'bayes', subjects=1, workers=1)\n"
        "    print(*found.learners)\n"
    )
    done = subprocess.run(
        [sys.executable, "script.py"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "bayes"
