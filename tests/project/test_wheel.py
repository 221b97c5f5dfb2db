"""The wheel carries everything: schemas, experiments, reference data and learners.

What it says and writes is looked at here, too, since this is the one comparison among the tests
that is played by a process of its own and has all its figures drawn.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

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
lessons = [path.read_text() for path in bundled("notebooks").glob("0*.ipynb")]
assert len(lessons) == 9 and not any("image/png" in text for text in lessons)
"""


def run(*words: object, **options: Any) -> str:
    done = subprocess.run(
        [*map(str, words)], capture_output=True, text=True, check=False, timeout=180, **options
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return str(done.stdout)


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> tuple[str, Path]:
    """What a comparison in an empty folder said, and the folder; it takes over ten seconds."""
    pytest.importorskip("hatchling")
    folder = tmp_path_factory.mktemp("wheel")
    home, empty = folder / "site", folder / "empty"
    empty.mkdir()
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-index", "--no-build-isolation"]
    run(*pip, "wheel", *offline, "--wheel-dir", folder, ROOT)
    (wheel,) = folder.glob("causal_openlock-*.whl")
    run(*pip, "install", *offline, "--no-compile", "--target", home, wheel)
    there = {"cwd": empty, "env": {**os.environ, "PYTHONPATH": str(home)}}
    run(sys.executable, "-c", PROBE, home, **there)
    words = ("default", "--learner", "oracle", "--learner", "random", "--subjects", 3)
    words += ("--workers", 1)  # each would compile the same, here where nothing is compiled yet
    conditions = ("--condition", "CC4", "--condition", "CC3-CC4")
    return run(
        sys.executable, "-m", "causal_openlock", "compare", *words, *conditions, **there
    ), empty


def test_the_wheel_compares_the_bundled_experiment_from_an_empty_folder(
    compared: tuple[str, Path],
) -> None:
    said, empty = compared
    (results,) = (empty / "results").iterdir()
    assert f"report: results/{results.name}/report.html" in said
    for name in ("report.html", "summary.csv", "experiment.json"):
        assert (results / name).is_file()
    assert "<svg" in (results / "report.html").read_text(encoding="utf-8")
    # The reference data travel too: people's first CC4 trial is in the summary.
    assert "19.375" in (results / "summary.csv").read_text(encoding="utf-8")


def test_compare_prints_the_table(compared: tuple[str, Path]) -> None:
    rows = {line.split()[0]: line.split() for line in compared[0].splitlines() if line.split()}
    assert rows["people"][1:2] == ["5.99"]  # the mean of 6.45 and 5.53
    assert rows["oracle"][1:2] == ["3.00"]
    assert rows["random"][1:3] == [">", "30"]
