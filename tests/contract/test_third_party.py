"""A learner from another package is listed, compared with ours, and held to the contract."""

import json

import pytest

from causal_openlock.files.plugins import LEARNERS
from causal_openlock.testing import LearnerContract
from support.command import at_once, modules_of
from support.packages import register

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


@pytest.mark.slow
def test_it_is_listed_compared_with_ours_and_keeps_the_contract(tmp_path, monkeypatch):
    register(tmp_path, "gentle-learners", LEARNERS, sweeper="gentle_learners:Sweeper")
    (tmp_path / "gentle_learners.py").write_text(MODULE)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "120")
    with modules_of(tmp_path):
        listed = at_once("learners").stdout.splitlines()
        (row,) = [line for line in listed if line.startswith("sweeper")]
        assert "Tries the actions one after another" in row
        assert "gentle-learners" in row
        command = "compare -c CC3 -l sweeper -l random --subjects 3 --workers 1 --out out"
        assert at_once(*command.split(), workers=True).status == 0
        described = json.loads((tmp_path / "out" / "experiment.json").read_text())
        (entry,) = [entry for entry in described["learners"] if entry["name"] == "sweeper"]
        assert entry["package"] == "gentle-learners 1.0"
        assert entry["parameters"] == {"stride": 1}
        contract = type("Contract", (LearnerContract,), {"learner": "sweeper"})()
        contract.test_it_goes_on_from_a_checkpoint()
        contract.test_a_subject_does_not_depend_on_its_batch()
