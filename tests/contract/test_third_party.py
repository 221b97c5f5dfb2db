"""A learner from somebody else's package plays as ours do."""

import importlib.util
import json
import os
import subprocess
import sys
from itertools import pairwise

import pyarrow.parquet as pq
import pytest

from support.places import ROOT
from support.waiting import HANGS

pytestmark = pytest.mark.slow

PROJECT = """\
[build-system]
requires = ["hatchling"]
build-backend = "hatchling.build"

[project]
name = "gentle-learners"
version = "0.3"
dependencies = ["causal-openlock"]

[project.entry-points."causal_openlock.learners"]
sweeper = "gentle_learners:Sweeper"
"""

MODULE = '''\
"""A learner that knows nothing of causes."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import Field

from causal_openlock import OneSubjectLearner


@dataclass(frozen=True)
class Stride:
    """How it sweeps."""

    stride: Annotated[int, Field(ge=1), "positions from one action to the next"] = 1


class Sweeper(OneSubjectLearner):
    """Tries the actions one after another, from one drawn at random."""

    Parameters = Stride

    def begin(self):
        self.last = int(self.generator.integers(self.brief.actions))

    def act(self, observation):
        return (self.last + self.parameters.stride) % self.brief.actions

    def learn(self, moment):
        self.last = moment.action
'''

CONTRACT = """\
from causal_openlock.testing import LearnerContract


class TestSweeper(LearnerContract):
    learner = "sweeper"
    parameters = {"stride": 4}
"""


@pytest.fixture(scope="module")
def installed(tmp_path_factory):
    """The environment of a process in which the package is installed."""
    for needed in ("pip", "hatchling"):
        if importlib.util.find_spec(needed) is None:
            pytest.skip(f"{needed} is missing, which installs the package of this test")
    package = tmp_path_factory.mktemp("package")
    target = tmp_path_factory.mktemp("installed")
    (package / "pyproject.toml").write_text(PROJECT)
    (package / "gentle_learners.py").write_text(MODULE)
    pip = [sys.executable, "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    offline = ["--no-deps", "--no-build-isolation", "--no-index"]
    done = subprocess.run(
        [*pip, *offline, "--target", str(target), str(package)], capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    paths = filter(None, [str(target), str(ROOT), os.environ.get("PYTHONPATH")])
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "120"}


def python(installed, cwd, *arguments):
    done = subprocess.run(
        [sys.executable, *arguments],
        env=installed,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=HANGS,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
    return done.stdout


def test_it_is_listed_compared_with_ours_and_keeps_the_contract(installed, tmp_path):
    listed = python(installed, tmp_path, "-m", "causal_openlock", "learners")
    row = next(line for line in listed.splitlines() if line.startswith("sweeper"))
    assert "Tries the actions one after another" in row
    assert "gentle-learners" in row
    command = "compare -c CC3 -l sweeper -l random --subjects 3 --workers 1 --out out"
    python(installed, tmp_path, "-m", "causal_openlock", *command.split())
    folder = tmp_path / "out"
    assert (folder / "report.html").is_file()
    described = json.loads((folder / "experiment.json").read_text())
    entry = next(entry for entry in described["learners"] if entry["name"] == "sweeper")
    assert entry["package"] == "gentle-learners 0.3"
    assert entry["parameters"] == {"stride": 1}
    (cell,) = (folder / "cells").glob("sweeper_*.parquet")
    record = pq.read_table(cell).to_pandas()
    assert set(record["subject"]) == {0, 1, 2}
    for _, rows in record.groupby("subject"):
        actions = [int(action) for attempt in rows["actions"] for action in attempt]
        assert {(after - before) % 15 for before, after in pairwise(actions)} == {1}
    (tmp_path / "test_sweeper.py").write_text(CONTRACT)
    said = python(installed, tmp_path, "-m", "pytest", "-q", "-p", "no:cacheprovider")
    assert "13 passed" in said
