"""Cells that fail, however they do: they are named, all others are played, and nothing goes on."""

import csv
import multiprocessing
import os
import subprocess
import sys
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.errors import CellsFailed, OpenLockError
from causal_openlock.running import runner, workers
from causal_openlock.running.worker import Watching
from causal_openlock.storage.beside_cell import failures_of
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.processes import prepared, start_prepared
from support.waiting import until

pytestmark = pytest.mark.slow

LETHAL = """\
import asyncio, os, signal, subprocess, sys, time
from causal_openlock import OneSubjectLearner

def fail():
    raise ZeroDivisionError("the learner [/broke]")

class Silent(Exception):
    def __str__(self):
        raise ValueError

class Fine(OneSubjectLearner):
    acts = 0

    def act(self, observation):
        self.acts += 1
        return self.answer()

    def answer(self):
        return int(self.generator.integers(15))

class Ends(Fine):
    def answer(self):
        os._exit(9)

class Leaks(Fine):
    def begin(self):
        subprocess.Popen(["sleep", "SECONDS"])
"""
LEARNER = """
class {name}({base}):
    def answer(self):
        {answers}
"""
# What a learner does in place of an answer, and what is said of it.
BY_ITSELF = {
    "Raises": (
        "return 0 if self.acts < 3 else fail()",
        "failed: ZeroDivisionError: the learner [/broke] (lethal.py:5)",
    ),
    "Mute": ("raise Silent", "failed: Silent (lethal.py:35)"),
    "Talks": (
        "raise ValueError('x' * 10_000_000)",
        f"failed: ValueError: {199 * 'x'} … (lethal.py",
    ),
    "Stray": ("return 99", "failed: a learner answers with 2 integers from 0 to 14"),
    "Nonsense": (
        "return float('nan')",
        "failed: Nonsense has to answer with an integer, the index",
    ),
    "Exits": ("sys.exit(0)", "failed: SystemExit: 0 (lethal.py"),
    "Stops": ("raise KeyboardInterrupt", "failed: KeyboardInterrupt"),
    "Cancels": ("raise asyncio.CancelledError", "failed: CancelledError (lethal.py"),
}
KILLED = "ended its process (killed by SIGKILL, perhaps for lack of memory)"
WITH_ITS_PROCESS = {
    "Dies": ("os._exit(9)", "ended its process (exit status 9)"),
    "Killed": ("os.kill(os.getpid(), signal.SIGKILL)", KILLED),
    "Closes": ("os.closerange(3, 256); time.sleep(1000)", "closed the connection to its worker"),
    "Hangs": ("time.sleep(1000)", "was ended after 5 s"),
}
PROGRAM = """\
import causal_openlock as ol
ol.compare("CC3", ["random"], subjects=1, out="out", workers=1)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with these learners, some of which start a ``sleep`` of its own length."""
    seconds = f"777.{os.getpid()}{time.monotonic_ns()}"
    code = LETHAL.replace("SECONDS", seconds)
    for base, learners in {"Fine": BY_ITSELF, "Leaks": WITH_ITS_PROCESS}.items():
        for name, (answers, _) in learners.items():
            code += LEARNER.format(name=name, base=base, answers=answers)
    (tmp_path / "lethal.py").write_text(code, encoding="utf-8")
    (tmp_path / "seconds").write_text(seconds)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(workers, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def some_sleep(folder):
    seconds = (folder / "seconds").read_text()
    return subprocess.run(["pgrep", "-f", f"^sleep {seconds}"], capture_output=True).returncode == 0


def declared(*learners, subjects=4):
    entries = [f"lethal:{name}" for name in learners]
    protocol = {"attempt_limit": 3, "baseline_trials": 1}
    return ol.make_experiment(["CC3"], entries, subjects=subjects, cell_size=2, protocol=protocol)


def fails(experiment, folder, **options):
    with pytest.raises(CellsFailed) as caught:
        runner.run(experiment, folder, **options)
    return caught.value


@pytest.mark.parametrize(("kind", "cells"), [("threads", ["0-1", "2-3"]), ("processes", ["0-1"])])
def test_cells_that_fail_are_named_and_the_others_are_played(folder, kind, cells):
    experiment = declared(*BY_ITSELF, "Fine", subjects=2 * len(cells))
    told = []
    with ThreadPoolExecutor(2) as executor:
        how = {"executor": executor} if kind == "threads" else {"workers": 2}
        error = fails(experiment, folder / "out", warn=told.append, watching=Watching(0), **how)
    assert error.status == 1
    assert sorted(error.reasons) == sorted(told)
    expected = [
        f"the learner {name} in CC3, subjects {numbers}, {why}"
        for name, (_, why) in BY_ITSELF.items()
        for numbers in cells
    ]
    for reason, begins in zip(error.reasons, expected, strict=True):
        assert reason.startswith(begins)
        sentence, _, path = reason.partition("; see ")
        said, trace = Path(path).read_text(encoding="utf-8").split("\n\n", 1)
        assert len(trace) < 30_000
        assert said == sentence
        assert "Traceback" in trace or "Silent" in trace
    store = Store(folder / "out")
    assert {path.name[:5] for path in store.files()[0]} == {"Fine_"}
    assert not [path for path in store.cells.iterdir() if path.suffix != ".parquet"]


def test_what_ends_or_blocks_its_process_is_named_and_all_it_started_is_ended(folder):
    experiment = declared(*WITH_ITS_PROCESS, "Leaks", "Raises", subjects=2)
    seen, told = [], []
    options = {"time_limit": np.int64(5), "progress": seen.append, "warn": told.append}
    error = fails(experiment, folder / "out", workers=2, **options)
    assert sum("it is tried again" in sentence for sentence in told) == 3
    reasons = [reason.split("; see ") for reason in error.reasons[:-1]]
    assert [why for why, _ in reasons] == [
        f"the learner {name} in CC3, subjects 0-1, {why}"
        for name, (_, why) in WITH_ITS_PROCESS.items()
    ]
    assert all(Path(path).exists() for _, path in reasons)
    assert {path.name[:6] for path in Store(folder / "out").files()[0]} == {"Leaks_"}
    last = seen[-1]
    assert (last.cells, last.done, last.failed, last.playing, last.share) == (6, 1, 5, (), 1)
    assert seen[0].done == seen[0].failed == 0
    assert max(cell.still for progress in seen for cell in progress.playing) > 0.5
    until(lambda: not some_sleep(folder))


def test_an_executor_is_not_ended_and_its_lost_workers_are_named(folder):
    fine, told = declared("Fine"), []
    with ThreadPoolExecutor(1) as executor:
        for where in ({"workers": 0}, {"executor": executor}):
            runner.run(fine, folder / "fine", time_limit=1, warn=told.append, **where)
    assert sum("is ignored" in sentence for sentence in told) == 2
    with (
        ProcessPoolExecutor(1, mp_context=prepared()) as executor,
        pytest.raises(OpenLockError, match="a worker of the executor ended without a message"),
    ):
        runner.run(declared("Ends"), folder / "given", executor=executor)


def test_what_a_learner_starts_ends_with_a_run_that_is_stopped(folder):
    def stop(_):
        if some_sleep(folder):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as traceback:  # a notebook keeps it, too
        runner.run(declared("Hangs"), folder / "out", workers=1, progress=stop)
    assert traceback
    until(lambda: not some_sleep(folder))


def test_what_a_learner_starts_ends_with_a_run_that_is_killed(folder):
    words = ["compare", "-c", "CC3", "-l", "lethal:Hangs", "--workers", "1", "--out", "out"]
    command = subprocess.Popen([sys.executable, "-m", "causal_openlock", *words])
    until(lambda: some_sleep(folder))
    command.kill()
    command.wait()
    until(lambda: not some_sleep(folder))


def test_compare_says_what_is_missing_and_exits_with_1(folder, monkeypatch):
    monkeypatch.setenv("COLUMNS", "80")
    words = ["compare", "-c", "CC3", "--subjects", 4, "-l", "lethal:Raises"]
    done = at_once(*words, "-l", "lethal:Fine", "--out", "out")
    assert done.status == 1, done.stdout + done.stderr
    assert done.stderr.startswith("error: 1 of 2 cells failed, ")
    report = at_once("report", "out")
    assert report.status == 0
    line = f"the learner Raises in CC3, subjects 0-3, {BY_ITSELF['Raises'][1]}"
    assert all(line in said for said in (done.stdout, report.stdout))
    assert "1 of its cells is missing" in (folder / "out" / "report.html").read_text("utf-8")
    with (folder / "out" / "summary.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["learner"]: (row["subjects"], row["missing"]) for row in csv.DictReader(file)}
    assert rows == {"Fine": ("4", "0"), "Raises": ("0", "4")}
    nothing = at_once(*words, "--out", "other")
    assert nothing.status == 1
    assert "Traceback" not in nothing.stderr
    assert (nothing.stdout + nothing.stderr).count("ZeroDivisionError") == 1
    assert not (folder / "other" / "report.html").exists()
    shard = at_once(*words, "--shard", "1/1", "--out", "shard")
    assert (shard.status, "is done" in shard.stdout) == (1, False)
    said = at_once("status", "out").stdout
    assert all(word in said for word in ("1 failed", "ZeroDivisionError", "--retry-failed"))


def test_a_cell_that_failed_three_times_is_left_out_until_it_is_asked_for_or_repaired(folder):
    experiment, out, standings = declared("Fine", "Stray"), folder / "out", []
    done, *_, failed = [Store(out).path(cell) for cell in experiment.cells()]
    for number in range(3):
        reasons = fails(experiment, out, workers=0).reasons
        assert all("[99 99]" in reason for reason in reasons)
        assert failures_of(failed)[0] == number + 1
    left_out = fails(experiment, out, workers=0, progress=standings.append)
    assert "--retry-failed" in left_out.reasons[0]
    assert (standings[-1].failed, standings[-1].over) == (2, True)
    assert "left out" not in fails(experiment, out, workers=0, retry_failed=True).reasons[0]
    assert failures_of(failed)[0] == 1
    fine, stray = experiment.learners
    repaired = replace(experiment, learners=(fine, replace(stray, learner="lethal:Fine")))
    before, standings = Store(out).read(done), []
    runner.run(repaired, out, workers=0, progress=standings.append)
    assert (standings[0].done, standings[-1].done) == (2, 4)
    assert Store(out).read(done).equals(before)
    assert not list((out / "errors").iterdir())


def compares():
    with pytest.warns(UserWarning, match="this process is itself a worker"):
        results = ol.compare("CC3", "random", subjects=1, workers=1)
    assert len(results.trials) == 5


def test_a_process_that_may_start_none_plays_itself_and_says_so():
    daemon = multiprocessing.get_context("fork").Process(target=compares, daemon=True)
    daemon.start()
    daemon.join()
    assert daemon.exitcode == 0


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
