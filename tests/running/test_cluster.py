"""Cells played by a cluster's workers or in shards: the same bytes, and nothing lost on the way."""

import hashlib
import os
import signal
import socket
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest

from causal_openlock.analysis.results.summary import summary_table
from causal_openlock.analysis.table import write_table
from causal_openlock.errors import CellsFailed, LearnerError, OpenLockError, StoreError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running import cluster as cluster_module
from causal_openlock.running import runner, worker
from causal_openlock.running.carried_code import carry, use
from causal_openlock.running.status import status_of
from causal_openlock.running.worker import NotAwaitedError, Watching, play_cell
from causal_openlock.storage import folder_lock
from causal_openlock.storage.running_files import checkpointed
from causal_openlock.storage.shard import Shard
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.processes import prepared, start_prepared

pytestmark = pytest.mark.cluster

# Its workers begin with everything imported, as those of other tests do.
os.environ["DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD"] = "forkserver"
pytest.importorskip("distributed")

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

class LosesItsWorkerOnce(Fine):
    def act(self, observation):
        mark = Path(self.parameters.marks) / "killed"
        late = self.acts == 4 and self.brief.attempt_limit == 3
        if late and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)

class Dies(Fine):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)

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
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(runner, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def declared(folder, *learners, subjects=4):
    path = folder / "experiment.yaml"
    own = "{{learner: 'mine:{}', parameters: {{marks: {}}}}}"
    entries = [own.format(name, folder) if name[0].isupper() else name for name in learners]
    path.write_text(
        f"name: e\nsubjects: {subjects}\ncell_size: 2\nconditions: [CC3]\n"
        f"protocols: {{short: {{attempt_limit: 3, baseline_trials: 1}}}}\nprotocol: short\n"
        f"learners: [{', '.join(entries)}]\n",
        encoding="utf-8",
    )
    return read_experiment(path)


@pytest.fixture(scope="module")
def address():
    """A cluster of two workers, as ``local:2`` starts it."""
    prepared()
    with cluster_module._started(2) as cluster:
        yield cluster.scheduler_address


def summary(folder):
    """The hash of what a results folder says."""
    record, experiment = Store(folder).record()
    assert not experiment.missing
    write_table(summary_table(record), folder / "summary.csv")
    return hashlib.sha256((folder / "summary.csv").read_bytes()).hexdigest()


def play_shard(experiment, out, shard):
    """Play a shard slowly, in a process that is to be killed."""
    slowly = lambda _: time.sleep(0.01)  # noqa: E731
    runner.run(experiment, out, workers=0, shard=shard, watching=Watching(0), progress=slowly)


def test_everywhere_the_same_bytes(folder, address):
    """Also where workers and shards are killed; what a checkpoint holds is not played again."""
    experiment = declared(folder, "LosesItsWorkerOnce", "random")
    mark, acts = folder / "killed", folder / "acts"

    def play(name, *, killed=True, **options):
        if killed:
            mark.unlink(missing_ok=True)
        acts.write_text("")
        told = []
        runner.run(experiment, folder / name, watching=Watching(0), warn=told.append, **options)
        assert mark.exists()
        assert sum("; it is tried again" in one for one in told) == killed, told
        return summary(folder / name)

    mark.touch()
    expected = play("one", killed=False, workers=1)
    everything = len(acts.read_text())
    for name, options in {"two": {"workers": 2}, "dask": {"cluster": address}}.items():
        assert play(name, **options) == expected, name
        assert len(acts.read_text()) == everything, name
        assert not list((folder / name).glob("errors/*"))
    assert play("dask", killed=False, cluster=address) == expected
    assert not acts.read_text(), "nothing was left to play"

    mark.unlink()
    shards = {
        number: prepared().Process(  # the one that has the learner's first cell is killed
            target=play_shard, args=(experiment, folder / "shards", Shard(number, 3))
        )
        for number in (1, 2, 3)
    }
    for shard in shards.values():
        shard.start()
    for shard in shards.values():
        shard.join(600)
    (died,) = [number for number, shard in shards.items() if shard.exitcode == -signal.SIGKILL]
    assert sum(shard.exitcode == 0 for shard in shards.values()) == 2
    missing = Store(folder / "shards").files()[1]
    assert any(path.with_suffix(".checkpoint").exists() for path in missing)
    runner.run(experiment, folder / "shards", workers=0, shard=Shard(died, 3))
    assert summary(folder / "shards") == expected


def test_a_cell_that_loses_three_workers_is_left_out(folder, address):
    experiment, told = declared(folder, "Dies", "random", subjects=2), []
    with pytest.raises(CellsFailed) as caught:
        runner.run(experiment, folder / "out", cluster=address, warn=told.append)
    (reason,) = caught.value.reasons
    assert "the learner Dies in CC3, subjects 0-1, ended its process (the worker tcp://" in reason
    assert sum(one.endswith("; it is tried again") for one in told) == 2
    store = Store(folder / "out")
    assert store.failures.of(experiment.cells()[0].file_name)[0] == 3
    assert len(store.files()[0]) == 1
    with pytest.raises(CellsFailed, match="--retry-failed"):
        runner.run(experiment, folder / "out", workers=1)


def test_workers_play_the_code_of_the_comparison(folder, address):
    """And not what they have imported for another one."""
    for first in (7, 3):
        (folder / "my_helper.py").write_text(f"FIRST = {first}\n", encoding="utf-8")
        with modules_of(folder):
            experiment = declared(folder, "Fine")
            store = runner.run(experiment, folder / f"out{first}", cluster=address)
        actions = store.record(["subject", "actions"])[0].to_pandas().groupby("subject").first()
        assert [int(each[0]) for each in actions["actions"]] == [first] * 4
    carried = carry(experiment, folder / "out")
    assert {*carried.files} == {"mine.py", "my_helper.py"}
    (Path(carried.folder) / "my_helper.py").write_text("FIRST = 8\n", encoding="utf-8")
    with pytest.raises(OpenLockError, match=r"my_helper\.py is missing or is not what it was"):
        use(carried)
    (folder / "mine.py").write_text(MINE + "\n", encoding="utf-8")
    with pytest.raises(LearnerError, match="the file of mine:Fine has changed"):
        carry(experiment, folder / "out")


def test_a_lost_scheduler_is_named_and_the_same_command_continues(folder, address):
    experiment = declared(folder, "Slow", "random")
    with cluster_module._started(1) as other:

        def stop(_):
            if (folder / "acts").exists():  # in the midst of a cell
                other.close()

        with pytest.raises(OpenLockError, match=r"the scheduler tcp://.* was lost; start it, and"):
            runner.run(experiment, folder / "out", cluster=other.scheduler_address, progress=stop)
    assert not list((folder / "out").glob(".awaited-*"))
    runner.run(experiment, folder / "out", cluster=address)
    assert not Store(folder / "out").files()[1]


def test_what_is_wrong_with_a_worker_or_a_scheduler_is_named(folder, monkeypatch):
    import distributed

    experiment = declared(folder, "random")
    store = Store(folder / "out")
    store.open(experiment)
    here = SimpleNamespace(address="tcp://w:1", state=SimpleNamespace(nthreads=2))
    monkeypatch.setattr(distributed, "get_worker", lambda: here)
    carried, versions = carry(experiment, store.folder), dict(cluster_module.versions())

    def refuses(sentence, expected, out):
        with pytest.raises(OpenLockError, match=sentence):
            cluster_module.play_there(carried, expected, list, experiment.cells()[0], str(out))

    refuses("has 2 threads.* --nthreads 1", versions, store.folder)
    here.state.nthreads = 1
    refuses("has numpy .*, and here it is 0.1; install", {**versions, "numpy": "0.1"}, store.folder)
    refuses("does not see .*elsewhere; give --out a folder", versions, folder / "elsewhere")
    store.close()
    monkeypatch.setattr(cluster_module, "PATIENCE", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as dumb:  # it takes connections, and says nothing
        silent = f"tcp://127.0.0.1:{dumb.getsockname()[1]}"
        for address in (silent, "tcp://127.0.0.1:9", "http://127.0.0.1:9", "tls://x:1", "nonsense"):
            with pytest.raises(OpenLockError, match="there is no Dask scheduler at"):
                runner.run(experiment, folder / "out", cluster=address)


def test_a_worker_that_nobody_waits_for_takes_a_checkpoint_and_ends(folder, monkeypatch):
    experiment = declared(folder, "Fine")
    monkeypatch.setattr(worker, "REPORT_EVERY", 0.0)
    store, cell = Store(folder / "out"), experiment.cells()[0]
    store.open(experiment)
    with pytest.raises(NotAwaitedError):
        play_cell(cell, str(store.folder), Watching(awaited=str(folder / "gone")))
    assert checkpointed(store.path(cell))
    assert not store.failures.of(cell.file_name)[0]
    assert store.check(cell) == "missing"


def test_shards_share_a_folder_and_nobody_else_gets_in(folder, monkeypatch):
    monkeypatch.setattr(folder_lock, "PATIENCE", 0.2)
    experiment, out = declared(folder, "random", "oracle", subjects=6), folder / "out"
    first, second, other = Store(out), Store(out), Store(out)
    first.open(experiment, shard=Shard(1, 2))
    half = out / "cells" / ".half.partial"
    half.write_bytes(b"being written by the first")
    second.open(experiment, shard=Shard(2, 2))
    assert half.exists(), "only who is alone tidies up"
    with pytest.raises(StoreError, match=r"the shard 2/2 is being played in .* already"):
        other.open(experiment, shard=Shard(2, 2))
    with pytest.raises(StoreError, match="in use by another comparison"):
        other.open(experiment)
    with pytest.raises(StoreError, match="in use by shards of another form"):
        other.open(declared(folder, "random"), shard=Shard(3, 4))
    first.close()
    second.close()
    other.open(experiment)
    assert not half.exists()
    with pytest.raises(StoreError, match="in use by another comparison"):
        first.open(experiment, shard=Shard(1, 2))
    other.close()
    cells = experiment.cells()
    shares = [Shard(number, 4).of(cells) for number in range(1, 5)]
    assert sorted(sum(shares, ()), key=cells.index) == [*cells]


def test_status_says_what_is_done_running_silent_and_failed(folder):
    experiment = declared(folder, "random", "oracle", subjects=8)
    runner.run(experiment, folder / "out", workers=0, shard=Shard(1, 2))
    store = Store(folder / "out")
    cells = [cell for cell in experiment.cells() if store.check(cell)]
    for cell, age in zip(cells[:2], (0, 1000), strict=True):
        path = store.path(cell).with_suffix(".progress")
        path.write_text("0.2500 10.0", encoding="utf-8")
        os.utime(path, (time.time() - age,) * 2)
    store.failures.record(cells[2], "failed: of itself", "")
    found = status_of(store)
    assert (found.progress.done, found.progress.failed, found.progress.cells) == (4, 1, 8)
    (one,) = found.progress.playing
    assert (one.cell.in_words, one.share) == (cells[0].in_words, 0.25)
    assert 9 < one.seconds < 12
    # Ten seconds for two cells and a quarter; as much is left as one and three quarters take.
    assert 7 < (found.progress.left or 0) < 11
    said = at_once("status", "out").stdout.splitlines()
    assert said[0].startswith("e: 4 of 8 cells done, 1 running, 1 failed, 2 waiting; ")
    assert said[1:3] == ["running:", f"  {cells[0].in_words}: 25%, for 10 s"]
    assert f"  {cells[1].in_words}: no report for 17 min" in said
    assert f"  the learner {cells[2].in_words}, failed: of itself" in said
    assert said[-1].startswith("over in about ")
