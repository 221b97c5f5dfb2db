"""The processes that play: what a learner starts ends with it, and who may start none says so."""

import multiprocessing
import os
import subprocess
import sys
import time
import warnings

import pytest

import causal_openlock as ol
from causal_openlock.errors import CellsFailed
from causal_openlock.running.runner import run
from support.command import modules_of
from support.processes import start_prepared

pytestmark = pytest.mark.slow

LEAKS = """\
import os, subprocess, time
from causal_openlock import OneSubjectLearner

class Leaks(OneSubjectLearner):
    def begin(self):
        subprocess.Popen(["sleep", "SECONDS"])

    def act(self, observation):
        return 0

class Hangs(Leaks):
    def act(self, observation):
        time.sleep(1000)

class Dies(Leaks):
    def act(self, observation):
        os._exit(9)

class Closes(Leaks):
    def act(self, observation):
        os.closerange(3, 256)
        time.sleep(1000)
"""
PROGRAM = """\
import causal_openlock as ol
ol.compare("CC3", ["random"], subjects=1, out="out", workers=1)
"""


@pytest.fixture
def sleepers(tmp_path, monkeypatch):
    """A folder with learners that start ``sleep``; how many of these run."""
    seconds = f"777.{os.getpid()}{time.monotonic_ns()}"
    (tmp_path / "leaks.py").write_text(LEAKS.replace("SECONDS", seconds))
    monkeypatch.chdir(tmp_path)

    def number():
        found = subprocess.run(["pgrep", "-fc", f"^sleep {seconds}"], stdout=subprocess.PIPE)
        return int(found.stdout)

    with modules_of(tmp_path):
        yield number


@pytest.mark.parametrize(
    ("learner", "end"),
    [
        ("Leaks", None),
        ("Hangs", "was ended after 1 s"),
        ("Dies", "ended its process"),
        ("Closes", "ended its process"),
    ],
)
def test_what_a_learner_starts_ends_with_its_cell(learner, end, sleepers, monkeypatch):
    start_prepared(monkeypatch)
    options = {"subjects": 1, "protocol": {"baseline_trials": 1, "attempt_limit": 2}}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if end is None:
            ol.compare("CC3", f"leaks:{learner}", workers=1, **options)
        else:
            limit = 1 if learner == "Hangs" else None
            with pytest.raises(CellsFailed, match=end):
                ol.compare("CC3", f"leaks:{learner}", workers=1, time_limit=limit, **options)
    assert sleepers() == 0


def test_what_a_learner_starts_ends_with_a_run_that_is_stopped(sleepers, monkeypatch, tmp_path):
    start_prepared(monkeypatch)

    def stop(_):
        if sleepers():
            raise KeyboardInterrupt

    experiment = ol.make_experiment(["CC3"], ["leaks:Hangs"], subjects=1)
    with pytest.raises(KeyboardInterrupt) as traceback:  # a notebook keeps it, too
        run(experiment, tmp_path / "out", workers=1, progress=stop)
    assert traceback
    assert sleepers() == 0


def test_what_a_learner_starts_ends_with_a_run_that_is_killed(sleepers):
    words = ["compare", "-c", "CC3", "-l", "leaks:Hangs", "--workers", "1", "--out", "out"]
    command = subprocess.Popen([sys.executable, "-m", "causal_openlock", *words])
    while not sleepers():
        time.sleep(0.1)
    command.kill()
    command.wait()
    last = time.monotonic() + 60
    while sleepers() and time.monotonic() < last:
        time.sleep(0.1)
    assert sleepers() == 0


def compares(pipe):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        results = ol.compare("CC3", "random", subjects=1, workers=1)
    pipe.send((len(results.trials), [str(warning.message) for warning in said]))


def test_a_process_that_may_start_none_plays_itself_and_says_so():
    here, there = multiprocessing.Pipe()
    daemon = multiprocessing.get_context("fork").Process(
        target=compares, args=(there,), daemon=True
    )
    daemon.start()
    trials, said = here.recv()
    daemon.join()
    assert trials == 5
    assert any("this process is itself a worker" in sentence for sentence in said)


@pytest.mark.parametrize(
    ("words", "named"), [(["program.py"], "each worker first runs"), (["-"], "no file (<stdin>)")]
)
def test_a_program_that_workers_cannot_run_is_told_why(words, named, tmp_path):
    (tmp_path / "program.py").write_text(PROGRAM)
    done = subprocess.run(
        [sys.executable, *words], input=PROGRAM, cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1
    assert named in done.stderr
    assert 'if __name__ == "__main__":' in done.stderr
    assert "memory" not in done.stderr
