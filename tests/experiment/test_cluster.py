"""Cells played by a cluster's workers or in shards: the same bytes, and nothing lost on the way."""

from __future__ import annotations

import hashlib
import os
import signal
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from causal_openlock.analysis.results.reading import read_results
from causal_openlock.analysis.results.summary import summary_table, write_table
from causal_openlock.errors import CellsFailed, LearnerError, OpenLockError, StoreError
from causal_openlock.experiment import cluster as cluster_module
from causal_openlock.experiment import runner
from causal_openlock.experiment.carried_code import carry, use
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.progress import RunProgress
from causal_openlock.experiment.shard import Shard
from causal_openlock.experiment.status import status_of
from causal_openlock.experiment.store import Store
from causal_openlock.experiment.worker import NotAwaitedError, Watching, play_cell
from support.command import at_once, modules_of
from support.processes import prepared, start_prepared

# Its workers begin with everything imported, as those of other tests do.
os.environ["DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD"] = "forkserver"
pytest.importorskip("distributed")

HELPER = "FIRST = 7\n"
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
        with (Path(self.parameters.marks) / "acts").open("a") as file:
            file.write("1")
        return FIRST if self.acts == 1 else int(self.generator.integers(15))

class LosesItsWorkerOnce(Fine):
    def act(self, observation):
        mark = Path(self.parameters.marks) / "killed"
        if self.acts == 4 and not mark.exists():
            mark.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return super().act(observation)

class Dies(Fine):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)

class Slow(Fine):
    def act(self, observation):
        time.sleep(0.05)
        return super().act(observation)
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "mine.py").write_text(MINE, encoding="utf-8")
    (tmp_path / "my_helper.py").write_text(HELPER, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(runner, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def declared(folder: Path, *learners: str, subjects: int = 4) -> Experiment:
    path = folder / "experiment.yaml"
    entries = [
        f"{{learner: 'mine:{name}', parameters: {{marks: {folder}}}}}" if name[0].isupper() else name
        for name in learners
    ]
    path.write_text(
        f"name: e\nsubjects: {subjects}\ncell_size: 2\nconditions: [CC3]\n"
        f"protocols: {{short: {{attempt_limit: 3, baseline_trials: 1}}}}\nprotocol: short\n"
        f"learners: [{', '.join(entries)}]\n",
        encoding="utf-8",
    )
    return read_experiment(path)


@pytest.fixture(scope="module")
def cluster() -> Iterator[Any]:
    """A cluster of two workers, as ``local:2`` starts it."""
    prepared()
    with cluster_module._started(2) as cluster:
        yield cluster


@pytest.fixture
def address(cluster: Any) -> str:
    found: str = cluster.scheduler_address
    return found


def summary(folder: Path) -> str:
    """The hash of what a results folder says."""
    store = Store(folder)
    assert not read_results(store)[1].missing
    write_table(summary_table(store.record()[0]), folder / "summary.csv")
    return hashlib.sha256((folder / "summary.csv").read_bytes()).hexdigest()


def play_shard(experiment: Experiment, out: Path, shard: str) -> None:
    """Play a shard slowly, in a process that is to be killed."""
    runner.run(
        experiment,
        out,
        workers=0,
        shard=Shard.parse(shard),
        watching=Watching(0),
        progress=lambda _: time.sleep(0.01),
    )


def test_everywhere_the_same_bytes(folder: Path, address: str) -> None:
    """Also where workers and shards are killed; what a checkpoint holds is not played again."""
    experiment = declared(folder, "LosesItsWorkerOnce", "random")
    mark, acts = folder / "killed", folder / "acts"

    def play(name: str, *, killed: bool = True, **options: Any) -> str:
        if killed:
            mark.unlink(missing_ok=True)
        acts.write_text("")
        told: list[str] = []
        runner.run(
            experiment, folder / name, watching=Watching(0), warn=told.append, **options
        )
        assert mark.exists()
        assert sum("; it is tried again" in one for one in told) == killed, told
        return summary(folder / name)

    mark.touch()
    expected = play("one", killed=False, workers=1)
    everything = len(acts.read_text())
    for name, options in {"two": {"workers": 2}, "dask": {"cluster": address}}.items():
        assert play(name, **options) == expected, name
        # A process that is new plays some steps to check the learner.
        assert len(acts.read_text()) < everything + 60, name
        assert not list((folder / name).glob("errors/*"))
    assert play("dask", killed=False, cluster=address) == expected
    assert not acts.read_text(), "nothing was left to play"

    mark.unlink()
    shards = {
        number: prepared().Process(  # the one that has the learner's first cell is killed
            target=play_shard, args=(experiment, folder / "shards", f"{number}/3")
        )
        for number in (1, 2, 3)
    }
    for shard in shards.values():
        shard.start()
    for shard in shards.values():
        shard.join(60)
    died = [number for number, shard in shards.items() if shard.exitcode == -signal.SIGKILL]
    assert len(died) == 1
    assert sum(shard.exitcode == 0 for shard in shards.values()) == 2
    missing = Store(folder / "shards").files()[1]
    assert missing
    assert any(path.with_suffix(".checkpoint").exists() for path in missing)
    runner.run(experiment, folder / "shards", workers=0, shard=Shard(died[0], 3))
    assert summary(folder / "shards") == expected
