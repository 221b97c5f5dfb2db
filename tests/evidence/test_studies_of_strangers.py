"""A study may come from anybody: to check it runs no code, and what runs is named first."""

import sys

import pytest

from causal_openlock.evidence.checking import check
from causal_openlock.evidence.keeping import Watched
from causal_openlock.evidence.running import run_study
from causal_openlock.evidence.study import read_study
from support.command import at_once

STUDY = "title: A stranger's\nexperiment: experiment.yaml\nhours: 0.01\n"
SPY = """
from pathlib import Path

Path({place!r}).touch()

import numpy as np
from openlock_learners.random import RandomLearner


class Spy(RandomLearner):
    pass


def pays(events):
    return np.where(events.opens, 1.0, 0.0)
"""


@pytest.fixture(params=["learner", "reward", "own reward", "network"])
def folder(request, tmp_path, monkeypatch):
    """A study that names a module, which leaves a file when it is imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("sys.path", [*sys.path])
    name = f"spy_{request.param.replace(' ', '_')}"
    folder = tmp_path / "evidence" / "strange"
    folder.mkdir(parents=True)
    (folder / f"{name}.py").write_text(SPY.format(place=str(tmp_path / "seen")))
    named = {
        "learner": f"learners: ['{name}:Spy']\n",
        "reward": f"learners: [random]\nreward: {name}:pays\n",
        "own reward": f"learners: [{{learner: random, reward: '{name}:pays'}}]\n",
        "network": "learners: [random]\n",
    }
    experiment = "name: strange\nsubjects: 1\nconditions: [CC3]\n" + named[request.param]
    study = STUDY
    if request.param == "network":
        study += (
            "networks:\n  command: touch {out} {file}\n  files: {one: one.yaml}\n"
            f"  seeds: [1]\n  learner: {name}:Spy\n"
        )
        (folder / "one.yaml").write_text("rooms: {}\n")
    (folder / "study.yaml").write_text(study)
    (folder / "experiment.yaml").write_text(experiment)
    return folder


def test_checking_and_listing_run_nothing(folder, tmp_path):
    fault = check(folder.parent)[0]
    assert "--trust strange" in fault
    assert "spy_" in fault
    for words in (["--check"], ["--write"], []):
        assert "Traceback" not in at_once("evidence", *words).stderr
    assert not (tmp_path / "seen").exists()


def test_what_runs_is_named_before_it_runs(folder, tmp_path):
    said = []

    def tell(sentence):
        assert not (tmp_path / "seen").exists()
        said.append(sentence)

    study = read_study(folder, tell)
    if study.file.networks:
        study.file.networks.seeds.clear()  # nothing is trained here
    run_study(study, tmp_path / "results", Watched(workers=0))
    assert any("spy_" in sentence and "will run as" in sentence for sentence in said)
    if study.file.networks:
        assert "touch {out} {file} will run to train networks" in said
        return
    assert (tmp_path / "seen").exists()
    assert not [one for one in check(folder.parent, ["strange"]) if "names code" in one]
