"""A learner from another package is listed, compared with ours, and held to the contract."""

import json
import os
import subprocess
import sys

import pytest

from causal_openlock.files.plugins import LEARNERS
from support.packages import register
from support.places import ROOT
from support.waiting import HANGS

pytestmark = pytest.mark.slow

MODULE = '''\
from dataclasses import dataclass
from typing import Annotated

from causal_openlock import OneSubjectLearner


@dataclass(frozen=True)
class Stride:
    stride: Annotated[int, "positions from one action to the next"] = 1


class Sweeper(OneSubjectLearner):
    """Tries the actions one after another."""

    Parameters = Stride
    last = 0

    def act(self, observation):
        self.last = (self.last + self.parameters.stride) % self.brief.actions
        return self.last
'''

CONTRACT = """\
from causal_openlock.testing import LearnerContract


class TestSweeper(LearnerContract):
    learner = "sweeper"
    parameters = {"stride": 4}
"""


def test_it_is_listed_compared_with_ours_and_keeps_the_contract(tmp_path, tmp_path_factory):
    target = tmp_path_factory.mktemp("installed")
    register(target, "gentle-learners", LEARNERS, sweeper="gentle_learners:Sweeper")
    (target / "gentle_learners.py").write_text(MODULE)
    paths = [*filter(None, [str(target), str(ROOT), os.environ.get("PYTHONPATH")])]

    def python(*arguments):
        done = subprocess.run(
            [sys.executable, "-m", *arguments],
            env={**os.environ, "PYTHONPATH": os.pathsep.join(paths), "COLUMNS": "120"},
            cwd=tmp_path,
            capture_output=True,
            text=True,
            timeout=HANGS,
        )
        assert done.returncode == 0, f"{done.stdout}\n{done.stderr}"
        return done.stdout

    listed = python("causal_openlock", "learners")
    row = next(line for line in listed.splitlines() if line.startswith("sweeper"))
    assert "Tries the actions one after another" in row
    assert "gentle-learners" in row
    command = "compare -c CC3 -l sweeper -l random --subjects 3 --workers 1 --out out"
    python("causal_openlock", *command.split())
    described = json.loads((tmp_path / "out" / "experiment.json").read_text())
    entry = next(entry for entry in described["learners"] if entry["name"] == "sweeper")
    assert entry["package"] == "gentle-learners 1.0"
    assert entry["parameters"] == {"stride": 1}
    (tmp_path / "test_sweeper.py").write_text(CONTRACT)
    assert " passed" in python("pytest", "-q", "-p", "no:cacheprovider")
