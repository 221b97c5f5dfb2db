"""The wheel carries everything: schemas, experiments, lessons, reference data and learners."""

import os
import subprocess
import sys
import zipfile

import pytest

from support.places import ROOT

pytestmark = pytest.mark.slow

PROBE = """
import causal_openlock, openlock_learners, sys
from causal_openlock.schemas.finding import bundled, bundled_schemas
home = sys.argv[1]
assert causal_openlock.__file__.startswith(home), causal_openlock.__file__
assert openlock_learners.__file__.startswith(home), openlock_learners.__file__
assert str(bundled("schemas")).startswith(home)
assert {"CC3", "CE3", "CC4", "CE4"} < set(bundled_schemas())
assert (bundled("notebooks") / "template.ipynb").is_file()
assert len(list(bundled("notebooks").glob("0*.ipynb"))) == 9
"""


def run(*words, **options):
    done = subprocess.run(
        [*map(str, words)], capture_output=True, text=True, check=False, timeout=180, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def test_the_wheel_compares_the_bundled_experiment_from_an_empty_folder(tmp_path):
    """People's first trial of CC4 is in the summary, as reference data travel too."""
    home, empty = tmp_path / "site", tmp_path / "empty"
    empty.mkdir()
    run(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path, cwd=ROOT)
    (wheel,) = tmp_path.glob("causal_openlock-*.whl")
    zipfile.ZipFile(wheel).extractall(home)
    there = {"cwd": empty, "env": {**os.environ, "PYTHONPATH": str(home)}}
    run(sys.executable, "-c", PROBE, home, **there)
    words = ["default", "--learner", "oracle", "--learner", "random", "--subjects", 3]
    words += ["--workers", 1, "--condition", "CC4", "--condition", "CC3-CC4", "--out", "out"]
    said = run(sys.executable, "-m", "causal_openlock", "compare", *words, **there)
    assert "report: out/report.html" in said
    rows = {line.split()[0]: line.split() for line in said.splitlines() if line.split()}
    assert rows["people"][1:3] == ["≥", "5.99"]  # the mean of 6.45 and 5.53
    assert rows["oracle"][1] == "3.00"
    assert rows["random"][1:3] == [">", "30"]
    assert (empty / "out" / "experiment.json").is_file()
    assert "<svg" in (empty / "out" / "report.html").read_text(encoding="utf-8")
    assert "19.375" in (empty / "out" / "summary.csv").read_text(encoding="utf-8")
