"""Cells played by a cluster's workers or in shards: the same bytes, and nothing lost on the way."""

import asyncio
import os
import socket
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import chdir, contextmanager

import pytest

import causal_openlock as ol
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.running import runner, workers
from causal_openlock.running.worker import Watching
from causal_openlock.storage.beside_cell import keep_failure
from causal_openlock.storage.folder_lock import Shard
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.processes import prepared, start_prepared

pytestmark = pytest.mark.cluster

# Its workers begin with everything imported, as those of other tests do.
os.environ["DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD"] = "forkserver"
distributed = pytest.importorskip("distributed")
import dask  # noqa: E402 - it comes with distributed

MINE = """\
import os, signal, time
from dataclasses import dataclass
from pathlib import Path
from causal_openlock import OneSubjectLearner
from my_helper import FIRST

@dataclass(frozen=True)
class Settings:
    marks: str = ""

class Fine(OneSubjectLearner):
    Parameters = Settings

    def begin(self):
        self.acts = 0

    def act(self, observation):
        self.acts += 1
        if self.brief.attempt_limit == 3:  # and not in the check before the cell
            with (Path(self.parameters.marks) / "acts").open("a") as file:
                file.write("1")
        return FIRST if self.acts == 1 else int(self.generator.integers(15))

def pay(events):
    return 1.0 * events.opens

class LosesItsWorkerOnce(Fine):
    def act(self, observation):
        mark = Path(self.parameters.marks) / "killed"
        late = self.acts == 4 and self.brief.attempt_limit == 3
        if late and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)

class Slow(Fine):
    def act(self, observation):
        time.sleep(0.1)
        return super().act(observation)
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    (tmp_path / "my_helper.py").write_text("FIRST = 7\n", encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(workers, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def declared(folder, *learners, subjects=4):
    own = {"reward": "mine:pay", "marks": str(folder)}
    entries = [
        ol.learner(f"mine:{name}", **own) if name[0].isupper() else name for name in learners
    ]
    protocol = {"attempt_limit": 3, "baseline_trials": 1}
    options = {"name": "e", "subjects": subjects, "cell_size": 2, "protocol": protocol}
    return ol.make_experiment(["CC3"], entries, **options)


@contextmanager
def cluster_of(workers, threads=1, processes=True):
    """A cluster as the scripts of ``examples/clusters`` start it."""
    options = {"n_workers": workers, "threads_per_worker": threads, "processes": processes}
    quiet = {"dashboard_address": ":0", "silence_logs": 50}
    with (
        dask.config.set({"distributed.scheduler.allowed-failures": 0}),
        distributed.LocalCluster(**options, **quiet) as cluster,
    ):
        yield cluster


@pytest.fixture(scope="module")
def address(tmp_path_factory):
    """A cluster of two workers, in another directory."""
    prepared()
    with chdir(tmp_path_factory.mktemp("workers")), cluster_of(2) as cluster:
        yield cluster.scheduler_address


def contents(folder):
    record, experiment = Store(folder).record()
    assert not experiment.missing
    return record.drop_columns(["wall_time"])


def test_everywhere_the_same_bytes(folder, address):
    """Also where workers are killed; what a checkpoint holds is not played again."""
    experiment = declared(folder, "LosesItsWorkerOnce", "random")
    mark, acts = folder / "killed", folder / "acts"

    def play(name, **options):
        told = []
        runner.run(experiment, folder / name, watching=Watching(0), warn=told.append, **options)
        return told

    mark.touch()  # no worker is killed
    assert not play("one", workers=1)
    everything = acts.read_text()
    for name, options in {"two": {"workers": 2}, "dask": {"cluster": address}}.items():
        mark.unlink()
        acts.write_text("")
        (told,) = play(name, **options)
        assert "; it is tried again" in told
        assert mark.exists()
        assert contents(folder / name).equals(contents(folder / "one")), name
        assert acts.read_text() == everything, name
        assert not list((folder / name).glob("errors/*"))
    assert not play("dask", cluster=address)
    assert acts.read_text() == everything, "nothing was left to play"


def test_workers_play_the_code_of_the_comparison_also_where_an_event_loop_runs(folder, address):
    """And not what they have imported for another one. A loop runs in every notebook."""

    async def cell():
        return runner.run(declared(folder, "Fine"), f"out{first}", cluster=address)

    for first in (7, 3):
        (folder / "my_helper.py").write_text(f"FIRST = {first}\n", encoding="utf-8")
        with modules_of(folder):
            store = asyncio.run(cell())
        actions = store.record(["subject", "actions"])[0].to_pandas().groupby("subject").first()
        assert [int(done[0]) for done in actions["actions"]] == [first] * 4


def test_cells_wait_for_a_worker_and_continue_after_a_lost_scheduler(folder, address):
    experiment, told = declared(folder, "Slow", "random"), []
    with cluster_of(0) as other:

        def look(_):
            if (folder / "acts").exists():  # in the midst of a cell
                other.close()
            elif told:
                other.scale(1)

        options = {"cluster": other.scheduler_address, "warn": told.append, "progress": look}
        with pytest.raises(OpenLockError, match=r"the scheduler tcp://.* was lost; start it, and"):
            runner.run(experiment, folder / "out", **options)
    assert told == ["there is no worker at the moment; the cells wait for one"]
    assert not list((folder / "out").glob(".awaited-*"))
    runner.run(experiment, folder / "out", cluster=address)
    assert not Store(folder / "out").files()[1]


def test_what_is_wrong_with_a_worker_or_a_scheduler_is_named(folder, monkeypatch):
    experiment = declared(folder, "random")
    with (
        cluster_of(1, threads=2, processes=False) as other,
        pytest.raises(OpenLockError, match=r"has 2 threads.* --nthreads 1"),
    ):
        runner.run(experiment, folder / "out", cluster=other.scheduler_address)
    monkeypatch.setattr("causal_openlock.running.cluster.PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as dumb:  # it takes connections, and says nothing
        silent = f"tcp://127.0.0.1:{dumb.getsockname()[1]}"
        for address in (silent, "tcp://127.0.0.1:9", "http://127.0.0.1:9", "tls://x:1", "nonsense"):
            with pytest.raises(OpenLockError, match="there is no Dask scheduler at"):
                runner.run(experiment, folder / "out", cluster=address)


def test_a_worker_that_nobody_waits_for_takes_a_checkpoint_and_ends(folder):
    experiment = declared(folder, "Slow", subjects=2)

    def stop(_):
        if (folder / "acts").exists():
            raise KeyboardInterrupt

    with ThreadPoolExecutor(1) as executor, pytest.raises(KeyboardInterrupt):
        runner.run(experiment, folder / "out", executor=executor, progress=stop)
    assert list((folder / "out" / "cells").glob("*.checkpoint"))
    assert not list((folder / "out" / "cells").glob("*.parquet"))
    assert not list((folder / "out").glob("errors/*"))


def test_shards_share_a_folder_and_nobody_else_gets_in(folder):
    experiment, out = declared(folder, "random", "oracle", subjects=6), folder / "out"
    first, second, other = Store(out), Store(out), Store(out)
    first.open(experiment, shard=Shard(1, 2))
    second.open(experiment, shard=Shard(2, 2))
    for shard in (None, Shard(1, 2)):
        with pytest.raises(StoreError, match="in use by another comparison"):
            other.open(experiment, shard=shard)
    for store in (first, second):
        store.close()
    other.open(experiment)
    other.close()


def test_status_says_what_is_done_running_silent_and_failed(folder):
    experiment = declared(folder, "random", "oracle", subjects=8)
    runner.run(experiment, folder / "out", workers=0, shard=Shard(1, 2))
    store = Store(folder / "out")
    cells = [cell for cell in experiment.cells() if store.check(cell)]
    for cell, age in zip(cells[:2], (0, 1000), strict=True):
        path = store.path(cell).with_suffix(".progress")
        path.write_text("0.2500 600.0", encoding="utf-8")
        os.utime(path, (time.time() - age,) * 2)
    keep_failure(store.path(cells[2]), cells[2], "failed: of itself", "")
    said = at_once("status", "out").stdout.splitlines()
    assert said[0].startswith("e: 4 of 8 cells done, 1 running, 1 failed, 2 waiting; ")
    assert said[1:3] == ["running:", f"  {cells[0].in_words}: 25%, for 10 min"]
    assert f"  {cells[1].in_words}: no report for 17 min" in said
    assert f"  the learner {cells[2].in_words}, failed: of itself" in said
    # Forty minutes for each of the cells, two and three quarters of which are left to one worker.
    assert said[-1].startswith("over in about 1 h 50 min, at")
