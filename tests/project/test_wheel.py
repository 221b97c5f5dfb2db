"""The wheel carries everything: schemas, experiments, reference data and learners."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from support.places import ROOT

PROBE = """
import causal_openlock, learners, sys
from causal_openlock.formats.schema_file import bundled, bundled_schemas
home = sys.argv[1]
assert causal_openlock.__file__.startswith(home), causal_openlock.__file__
assert learners.__file__.startswith(home), learners.__file__
assert str(bundled("schemas")).startswith(home)
assert {"CC3", "CE3", "CC4", "CE4"} < set(bundled_schemas())
assert (bundled("notebooks") / "template.ipynb").is_file()
"""


def test_the_wheel_compares_the_bundled_experiment_from_an_empty_folder(tmp_path: Path) -> None:
    """Over ten seconds: it is built, installed, and plays in processes of its own."""
    pytest.importorskip("hatchling")
    home, empty = tmp_path / "site", tmp_path / "empty"
    empty.mkdir()
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index", "--no-build-isolation"]

    def run(*words: object, **options: object) -> str:
        done = subprocess.run(
            [*map(str, words)],
            capture_output=True,
            text=True,
            check=False,
            timeout=180,
            **options,  # type: ignore[call-overload]
        )
        assert done.returncode == 0, done.stdout + done.stderr
        return str(done.stdout)

    run(*pip, "wheel", *offline, "--wheel-dir", tmp_path, ROOT)
    (wheel,) = tmp_path.glob("causal_openlock-*.whl")
    run(*pip, "install", *offline, "--no-compile", "--target", home, wheel)
    there = {"cwd": empty, "env": {**os.environ, "PYTHONPATH": str(home)}}
    run(sys.executable, "-c", PROBE, home, **there)
    # Few figures are drawn of one condition and one learner.
    words = ("default", "--condition", "CC4", "--learner", "oracle", "--subjects", 2)
    said = run(sys.executable, "-m", "causal_openlock", "compare", *words, **there)
    (results,) = (empty / "results").iterdir()
    assert f"report: results/{results.name}/report.html" in said
    # The reference data travel too: people's first CC4 trial is in the summary.
    assert "19.375" in (results / "summary.csv").read_text(encoding="utf-8")
