"""Cells that fail, however they do: they are named, and all others are played."""

import csv
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.errors import CellsFailed, OpenLockError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running import runner, workers
from causal_openlock.storage.beside_cell import failures_of
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.processes import prepared, start_prepared

pytestmark = pytest.mark.slow

LETHAL = """\
import os, signal, sys, time
from causal_openlock import OneSubjectLearner

class Silent(Exception):
    def __str__(self):
        raise ValueError

class Fine(OneSubjectLearner):
    def act(self, observation):
        return int(self.generator.integers(15))

class Raises(Fine):
    def act(self, observation):
        raise ZeroDivisionError("the learner [/broke]")

class Mute(Fine):
    def act(self, observation):
        raise Silent

class Talks(Fine):
    def act(self, observation):
        raise ValueError("x" * 10_000_000)

class Stray(Fine):
    def act(self, observation):
        return 99

class Nonsense(Fine):
    def act(self, observation):
        return float("nan")

class Exits(Fine):
    def act(self, observation):
        sys.exit(0)

class Stops(Fine):
    def act(self, observation):
        raise KeyboardInterrupt

class Dies(Fine):
    def act(self, observation):
        os._exit(9)

class Killed(Fine):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)

class Hangs(Fine):
    def act(self, observation):
        time.sleep(1000)
"""
BY_ITSELF = {
    "Raises": "failed: ZeroDivisionError: the learner [/broke] (lethal.py:14)",
    "Mute": "failed: Silent (lethal.py:18)",
    "Talks": f"failed: ValueError: {199 * 'x'} … (lethal.py:22)",
    "Stray": "failed: a learner answers with 2 integers from 0 to 14",
    "Nonsense": "failed: Nonsense has to answer with an integer, the index of an action",
    "Exits": "failed: SystemExit: 0 (lethal.py:34)",
    "Stops": "failed: KeyboardInterrupt",
}
WITH_ITS_PROCESS = {"Dies": "(exit status 9)", "Killed": "(killed by SIGKILL, "}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "lethal.py").write_text(LETHAL, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(workers, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def declared(folder, *learners):
    path = folder / "experiment.yaml"
    names = ", ".join(f"'lethal:{name}'" for name in learners)
    path.write_text(
        "name: e\nsubjects: 4\ncell_size: 2\nconditions: [CC3]\n"
        "protocols: {short: {attempt_limit: 3, baseline_trials: 1}}\nprotocol: short\n"
        f"learners: [{names}]\n",
        encoding="utf-8",
    )
    return read_experiment(path)


def fails(experiment, folder, **options):
    with pytest.raises(CellsFailed) as caught:
        runner.run(experiment, folder, **options)
    return caught.value


@pytest.mark.parametrize("kind", ["threads", "ours"])
def test_cells_that_fail_are_named_and_the_others_are_played(folder, kind):
    experiment = declared(folder, *BY_ITSELF, "Fine")
    told = []
    with ThreadPoolExecutor(2) as executor:
        how = {"executor": executor} if kind == "threads" else {"workers": 2}
        error = fails(experiment, folder / "out", warn=told.append, **how)
    assert error.status == 1
    assert sorted(error.reasons) == sorted(told)
    expected = [
        f"the learner {name} in CC3, subjects {numbers}, {why}"
        for name, why in BY_ITSELF.items()
        for numbers in ("0-1", "2-3")
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


def test_a_learner_that_kills_its_process_takes_no_other_cell_with_it(folder):
    experiment = declared(folder, *WITH_ITS_PROCESS, "Fine", "Raises")
    seen, told = [], []
    error = fails(experiment, folder / "out", workers=2, progress=seen.append, warn=told.append)
    assert sum("it is tried again" in one for one in told) == 4 * 2
    for name, why in WITH_ITS_PROCESS.items():
        mine = [reason for reason in error.reasons if f"learner {name} in" in reason]
        assert len(mine) == 2
        assert all(f"ended its process {why}" in reason for reason in mine)
        assert all(Path(one.partition("; see ")[2]).exists() for one in mine)
    assert len(Store(folder / "out").files()[0]) == 2
    last = seen[-1]
    assert (last.cells, last.done, last.failed, last.playing, last.share) == (8, 2, 6, (), 1)
    assert seen[0].done == seen[0].failed == 0
    with (
        ProcessPoolExecutor(1, mp_context=prepared()) as executor,
        pytest.raises(OpenLockError, match="a worker of the executor ended without a message"),
    ):
        runner.run(declared(folder, "Dies"), folder / "given", executor=executor)


def test_a_cell_that_hangs_is_named_and_ended_at_its_time_limit(folder):
    experiment = declared(folder, "Hangs", "Fine")
    seen, warnings = [], []
    options = {"time_limit": np.int64(1), "progress": seen.append, "warn": warnings.append}
    error = fails(experiment, folder / "out", workers=2, **options)
    # On a machine that has much else to do, the others may take too long as well.
    assert [one.partition("; see")[0] for one in error.reasons if " Hangs " in one] == [
        f"the learner Hangs in CC3, subjects {numbers}, was ended after 1 s"
        for numbers in ("0-1", "2-3")
    ]
    assert seen[-1].done + seen[-1].failed == 4
    assert max(one.still for progress in seen for one in progress.playing) > 0.5
    fine = declared(folder, "Fine")
    with ThreadPoolExecutor(1) as executor:
        for where in ({"workers": 0}, {"executor": executor}):
            runner.run(fine, folder / "fine", time_limit=1, warn=warnings.append, **where)
    assert sum("is ignored" in one for one in warnings) == 2


def test_a_repaired_learner_alone_is_played_again(folder):
    out, standings = folder / "out", []
    fails(declared(folder, "Fine", "Raises"), out, workers=0)
    first = Store(out).read(Store(out).files()[0][0])
    broken = declared(folder, "Fine", "Raises")
    fine, raises = broken.learners
    repaired = replace(broken, learners=(fine, replace(raises, learner="lethal:Fine")))
    runner.run(repaired, out, workers=0, progress=standings.append)
    assert (standings[0].done, standings[-1].done) == (2, 4)
    assert Store(out).read(Store(out).files()[0][0]).equals(first)
    assert not list((out / "errors").iterdir())


def test_compare_says_what_is_missing_and_exits_with_1(folder, monkeypatch):
    declared(folder, "Fine", "Raises", "Dies")
    monkeypatch.setenv("COLUMNS", "80")
    done = at_once("compare", "experiment.yaml", "--out", "out", "--workers", 2, workers=True)
    assert done.status == 1, done.stdout + done.stderr
    assert done.stderr.startswith("error: 4 of 6 cells failed, ")
    report = at_once("report", "out")
    assert report.status == 0
    for name, why in {"Raises": BY_ITSELF["Raises"], "Dies": "ended its process (exit"}.items():
        line = f"the learner {name} in CC3, subjects 0-1, {why}"
        assert all(line in said for said in (done.stdout, report.stdout))
    assert "4 of its cells are missing" in (folder / "out" / "report.html").read_text("utf-8")
    with (folder / "out" / "summary.csv").open(newline="", encoding="utf-8") as file:
        rows = {row["learner"]: row for row in csv.DictReader(file)}
    missing = {name: (row["subjects"], row["missing"]) for name, row in rows.items()}
    assert missing == {"Fine": ("4", "0"), "Raises": ("0", "4"), "Dies": ("0", "4")}


def test_where_every_cell_fails_there_is_no_report_and_the_reasons_are_told(folder):
    declared(folder, "Raises")
    done = at_once("compare", "experiment.yaml", "--out", "out")
    assert done.status == 1
    assert "Traceback" not in done.stderr
    assert (done.stdout + done.stderr).count("ZeroDivisionError") == 2  # each is named once
    assert not (folder / "out" / "report.html").exists()


def test_a_cell_that_failed_three_times_is_left_out_until_it_is_asked_for(folder):
    experiment, out = declared(folder, "Stray"), folder / "out"
    for number in range(3):
        reasons = fails(experiment, out, workers=0).reasons
        assert all("[99 99]" in reason for reason in reasons)
        assert failures_of(Store(out).path(experiment.cells()[0]))[0] == number + 1
    played = []
    assert "--retry-failed" in fails(experiment, out, workers=0, progress=played.append).reasons[0]
    assert (played[-1].failed, played[-1].over) == (2, True)
    assert "left out" not in fails(experiment, out, workers=0, retry_failed=True).reasons[0]
    assert failures_of(Store(out).path(experiment.cells()[0]))[0] == 1
