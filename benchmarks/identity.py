"""The same bytes anywhere: ``python benchmarks/identity.py --json FILE``.

One small experiment is played with 1, 2, 4 and 8 processes of this machine, by a Dask cluster of
which a worker is killed (SIGKILL) in the midst of a cell, and as sixteen shards of which two are
killed in the midst of a cell and begun again. Prints what each run came to and the SHA-256 of its
``summary.csv``, and ends with status 1 if they are not all the same. Checkpoints are taken after
every step, so that what was killed goes on inside its cell.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from run import ONE_THREAD, machine

EXPERIMENT = """\
name: identity
title: The same bytes anywhere
seed: 2018
subjects: 12
cell_size: 2
protocol: short
protocols: {short: {attempt_limit: 12, baseline_trials: 2, training_trials: 2}}
conditions: [CC4, noisy_CC3-CE4]
learners:
  - random
  - tabular_q
  - {learner: bayes, parameters: {particles: 200, planned: 200}}
  - ddqn
"""
SHARDS, KILLED = 16, (3, 11)
DASK_WORKERS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--json", metavar="FILE", type=Path, help="write what was found here")
    chosen = parser.parse_args()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
    from causal_openlock.experiment.file import read_experiment

    rows = []
    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "identity.yaml")
        file.write_text(EXPERIMENT, encoding="utf-8")
        experiment = read_experiment(file)
        for name, played in _ways():
            began = time.perf_counter()
            folder = Path(place, name.replace(" ", "_"))
            killed = played(experiment, folder)
            seconds = time.perf_counter() - began
            rows.append(
                {"way": name, "killed": killed, **summary(folder), "seconds": round(seconds)}
            )
            print("  ".join(f"{key} {value}" for key, value in rows[-1].items()), flush=True)
    if chosen.json:
        said = {"machine": machine(), "experiment": EXPERIMENT, "rows": rows}
        chosen.json.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    sys.exit(len({row["sha256"] for row in rows}) != 1)


def _ways() -> list[tuple[str, Callable[[Any, Path], int]]]:
    local = [(f"{many} local", _local(many)) for many in (1, 2, 4, 8)]
    return [*local, ("Dask", _dask), (f"{SHARDS} shards", _shards)]


def _local(workers: int) -> Callable[[Any, Path], int]:
    def played(experiment: Any, folder: Path) -> int:
        _run(experiment, folder, workers=workers)
        return 0

    return played


def _run(experiment: Any, folder: Path, **options: Any) -> None:
    from causal_openlock.running.runner import run
    from causal_openlock.running.worker import Watching

    run(experiment, folder, watching=Watching(checkpoint_every=0), **options)


def _dask(experiment: Any, folder: Path) -> int:
    """Play on a cluster that loses a worker; returns how many cells were played elsewhere."""
    losses: list[str] = []
    killed: list[int] = []

    def look(_: object) -> None:
        if not killed and in_a_cell(folder):
            busy = max(_workers(), key=lambda one: sum(one.cpu_times()[:2]))
            busy.kill()
            killed.append(busy.pid)

    _run(
        experiment,
        folder,
        cluster=f"local:{DASK_WORKERS}",
        progress=look,
        warn=lambda sentence: losses.append(sentence) if "tried again" in sentence else None,
    )
    assert len(killed) == 1
    return len(losses)


def _workers() -> list[Any]:
    import psutil

    named = [one for one in multiprocessing.active_children() if "Dask Worker" in one.name]
    return [psutil.Process(one.pid) for one in named]


def _shards(experiment: Any, folder: Path) -> int:
    """Play shards, each in a process of its own; returns how many were killed and begun again."""
    from causal_openlock.storage.shard import Shard

    def begin(number: int) -> int:
        return begin_shard(experiment, folder, Shard(number, SHARDS))

    cells = {number: Shard(number, SHARDS).of(experiment.cells()) for number in KILLED}
    # First those that are to be killed, so that it is seen when they are in the midst of a cell.
    playing = {number: begin(number) for number in KILLED}
    for number, child in playing.items():
        own = {Path(cell.file_name).stem for cell in cells[number]}
        while not in_a_cell(folder, own):
            time.sleep(0.01)
        os.kill(child, signal.SIGKILL)
        assert os.WIFSIGNALED(os.waitpid(child, 0)[1]), f"shard {number} was over too early"
    others = [begin(number) for number in range(1, SHARDS + 1) if number not in KILLED]
    again = [begin(number) for number in KILLED]
    for child in (*others, *again):
        assert os.waitpid(child, 0)[1] == 0
    return len(KILLED)


def begin_shard(experiment: Any, folder: Path, shard: Any, every: float = 0.0) -> int:
    """Play a shard in a process of its own, forked from this one; returns its number.

    Checkpoints are taken ``every`` so many seconds.
    """
    from causal_openlock.running.runner import run
    from causal_openlock.running.worker import Watching

    child = os.fork()
    if not child:
        status = 1
        try:
            run(experiment, folder, workers=0, shard=shard, watching=Watching(every))
            status = 0
        finally:
            os._exit(status)
    return child


def in_a_cell(folder: Path, own: set[str] | None = None) -> bool:
    """Whether a cell has been played for some attempts and is not done."""
    for path in folder.glob("cells/*.attempts"):
        with_record = path.with_suffix(".parquet").exists()
        if not with_record and (own is None or path.stem in own) and path.stat().st_size:
            return True
    return False


def summary(folder: Path) -> dict[str, Any]:
    """How much was played, and the SHA-256 of its summary."""
    from causal_openlock.analysis.results.summary import summary_table
    from causal_openlock.analysis.table import write_table
    from causal_openlock.storage.store import Store

    record, experiment = Store(folder).record()
    assert not experiment.missing
    write_table(summary_table(record), folder / "summary.csv")
    digest = hashlib.sha256((folder / "summary.csv").read_bytes()).hexdigest()
    return {"cells": len(experiment.files), "attempts": record.num_rows, "sha256": digest}


if __name__ == "__main__":
    main()
