"""A bad night: ``python benchmarks/soak.py --minutes 30 --json FILE``.

A comparison is played by the command that users give, and every 20 seconds something of it is
killed (SIGKILL) in turns: one of its workers, the command alone, the command with all its workers.
A command that was killed is given again. When a comparison is over, its summary has to be that of a
quiet run, byte for byte, and the next one begins in an empty folder. When the minutes are over,
the last one is played to its end. Prints what was killed and what came of it, and ends with status
1 if a summary differs or a cell is missing.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from itertools import cycle
from pathlib import Path
from typing import Any

import psutil
from run import ONE_THREAD, machine

EXPERIMENT = """\
name: soak
seed: 2018
subjects: {subjects}
cell_size: 4
protocol: long
protocols: {{long: {{based_on: rl, baseline_loops: 2, train_loops: 1, test_loops: 1}}}}
conditions: [CC4, CC3-CE4]
learners: [{learners}]
"""
KINDS = ("worker", "command", "all")
WORKERS = 2
# Attempts are counted by their checkpoints: a killed cell loses a second.
OPTIONS = ("--checkpoint-every", "1", "--workers", str(WORKERS), "--shard", "1/1")
"""A shard writes no report, which would take most of the time of a small comparison."""


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--every", type=float, default=20.0, help="seconds between kills")
    parser.add_argument("--subjects", type=int, default=24)
    parser.add_argument(
        "--learner", nargs="+", default=["random", "tabular_q", "associative", "win_stay"]
    )
    parser.add_argument("--json", metavar="FILE", type=Path, help="write what was found here")
    chosen = parser.parse_args()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))
    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "soak.yaml")
        learners = ", ".join(chosen.learner)
        text = EXPERIMENT.format(subjects=chosen.subjects, learners=learners)
        file.write_text(text, encoding="utf-8")
        quiet = Path(place, "quiet")
        assert _begun(file, quiet).wait() == 0
        expected = _summary(quiet)
        found = _night(file, Path(place), chosen, expected)
    print("  ".join(f"{key} {value}" for key, value in found.items()))
    if chosen.json:
        said = {"machine": machine(), "experiment": text, **found}
        chosen.json.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    sys.exit(bool(found["summaries that differ"] or found["cells missing"]))


def _night(file: Path, place: Path, chosen: Any, expected: tuple[str, int]) -> dict[str, Any]:
    """Kill for so many minutes; returns what was counted."""
    killed: Counter[str] = Counter()
    kinds = cycle(KINDS)
    over = wrong = missing = commands = inside = 0
    end = time.monotonic() + 60 * chosen.minutes
    due = time.monotonic() + chosen.every
    while time.monotonic() < end:
        folder = place / f"round{over}"
        command = _begun(file, folder)
        commands += 1
        while command.poll() is None:
            time.sleep(0.1)
            if due <= time.monotonic() < end:
                inside += any(folder.glob("cells/*.progress"))
                killed[_kill(command, next(kinds))] += 1
                due = time.monotonic() + chosen.every
        if command.returncode == -signal.SIGKILL and time.monotonic() < end:
            continue
        while command.returncode:  # killed at the last moment, or a cell lost three workers
            command = _begun(file, folder, "--retry-failed")
            commands += 1
            assert command.wait() in (0, 1)
        digest, cells = _summary(folder)
        over, wrong = over + 1, wrong + (digest != expected[0])
        missing += expected[1] - cells
    return {
        "minutes": chosen.minutes,
        **{f"kills of {kind}": killed[kind] for kind in KINDS},
        "in the midst of a cell": inside,
        "commands": commands,
        "comparisons": over,
        "cells each": expected[1],
        "summaries that differ": wrong,
        "cells missing": missing,
        "sha256": expected[0],
    }


def _begun(file: Path, folder: Path, *more: str) -> subprocess.Popen[bytes]:
    words = [sys.executable, "-m", "causal_openlock", "compare", str(file), "--out", str(folder)]
    with (folder.parent / f"{folder.name}.log").open("ab") as log:
        return subprocess.Popen(
            [*words, *OPTIONS, *more], stdout=log, stderr=log, start_new_session=True
        )


def _kill(command: subprocess.Popen[bytes], kind: str) -> str:
    """Kill one of its workers, itself, or all; returns what was killed."""
    try:
        workers = [
            child
            for child in psutil.Process(command.pid).children()
            if any("spawn_main" in word for word in child.cmdline())
        ]
    except psutil.NoSuchProcess:
        workers = []
    if kind == "worker" and workers:
        max(workers, key=lambda one: one.cpu_times().user).kill()
        return kind
    if kind == "command":
        command.kill()
        command.wait()
        return kind
    os.killpg(command.pid, signal.SIGKILL)
    command.wait()
    return "all"


def _summary(folder: Path) -> tuple[str, int]:
    """The SHA-256 of the summary, and how many cells there are."""
    from causal_openlock.analysis.results.summary import summary_table, write_table
    from causal_openlock.experiment.store import Store

    record, experiment = Store(folder).record()
    write_table(summary_table(record), folder / "summary.csv")
    digest = hashlib.sha256((folder / "summary.csv").read_bytes()).hexdigest()
    return digest, len(experiment.files) - len(experiment.missing)


if __name__ == "__main__":
    main()
