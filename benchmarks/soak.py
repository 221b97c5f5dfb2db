"""A bad night: ``python benchmarks/soak.py --minutes 30 --json FILE``.

A comparison is played in a few shards, each in a process of its own, and every 20 seconds one of
these processes is killed (SIGKILL), every third time all of them; what was killed is begun again.
When a comparison is over, its summary has to be that of a quiet run, byte for byte, and the next
one begins in an empty folder. When the minutes are over, the last one is played to its end.
Processes are forked from one that has loaded everything, so that they are killed while they play
and not while they import. Prints what was killed and what came of it, and ends with status 1 if a
summary differs or a cell is missing.
"""

from __future__ import annotations

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from identity import begin_shard, in_a_cell, summary
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
LEARNERS = ("random", "tabular_q", "associative", "win_stay")


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--every", type=float, default=20.0, help="seconds between kills")
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--subjects", type=int, default=24)
    parser.add_argument("--learner", nargs="+", default=LEARNERS)
    parser.add_argument("--json", metavar="FILE", type=Path, help="write what was found here")
    chosen = parser.parse_args()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
    from causal_openlock.experiment.file import read_experiment
    from causal_openlock.running.runner import run

    with tempfile.TemporaryDirectory() as place:
        file = Path(place, "soak.yaml")
        learners = ", ".join(chosen.learner)
        text = EXPERIMENT.format(subjects=chosen.subjects, learners=learners)
        file.write_text(text, encoding="utf-8")
        experiment = read_experiment(file)
        quiet = Path(place, "quiet")
        run(experiment, quiet, workers=0)
        found = _night(experiment, Path(place), chosen, summary(quiet))
    print("  ".join(f"{key} {value}" for key, value in found.items()))
    if chosen.json:
        said = {"machine": machine(), "experiment": text, **found}
        chosen.json.write_text(json.dumps(said, indent=1) + "\n", encoding="utf-8")
    sys.exit(bool(found["summaries that differ"]))


def _night(experiment: Any, place: Path, chosen: Any, expected: dict[str, Any]) -> dict[str, Any]:
    """Kill for so many minutes; returns what was counted."""
    from causal_openlock.storage.shard import Shard

    def begin(folder: Path, number: int) -> int:
        return begin_shard(experiment, folder, Shard(number, chosen.processes), every=1.0)

    luck = random.Random(2018)
    kills = inside = together = over = wrong = 0
    end = time.monotonic() + 60 * chosen.minutes
    due = time.monotonic() + chosen.every
    while time.monotonic() < end:
        folder = place / f"round{over}"
        playing = {number: begin(folder, number) for number in range(1, chosen.processes + 1)}
        while playing:
            time.sleep(0.02)
            for number, child in list(playing.items()):
                ended, status = os.waitpid(child, os.WNOHANG)
                if ended:
                    assert status == 0, f"shard {number} failed"
                    del playing[number]
            if playing and due <= time.monotonic() < end:
                kills += 1
                victims = list(playing) if kills % 3 == 0 else [luck.choice(list(playing))]
                together += len(victims) > 1
                inside += in_a_cell(folder)
                for number in victims:
                    os.kill(playing[number], signal.SIGKILL)
                    os.waitpid(playing[number], 0)
                for number in victims:
                    playing[number] = begin(folder, number)
                due = time.monotonic() + chosen.every
        over, wrong = over + 1, wrong + (summary(folder) != expected)
    return {
        "minutes": chosen.minutes,
        "kills": kills,
        "of all processes": together,
        "in the midst of a cell": inside,
        "comparisons": over,
        **expected,
        "summaries that differ": wrong,
    }


if __name__ == "__main__":
    main()
