"""Memory of a session: it should grow with the record and with nothing else.

A fresh process plays a session and tells the most memory it held above what it held before. Four
times as many attempts in each trial make a record four times as long, so that the peak for each
attempt must not rise. Run as a script, this file is that process.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from measure import Row, Target, in_turns

SUBJECTS = 1024
SHORT, LONG = 30, 120
# Columns grow by half when they are full, so that a peak can be half a column off.
TARGET = Target("at most", 1.25)


def memory(repeats: int) -> Iterator[Row]:
    """The peak for each attempt of long trials, against that of short ones."""
    told: dict[str, Any] = {}

    def measure(attempt_limit: int) -> float:
        command = [sys.executable, __file__, str(attempt_limit)]
        told.update(json.loads(subprocess.check_output(command)))
        return float(told["peak"] / told["attempts"])

    mine, others = in_turns(lambda: measure(LONG), lambda: measure(SHORT), repeats, warm_up=False)
    yield Row(
        "memory",
        f"peak, {LONG} attempts a trial, {SUBJECTS:,} subjects",
        "bytes/attempt",
        mine,
        f"{SHORT} attempts a trial",
        others,
        TARGET,
        note=f"the Arrow table itself has {told['record'] / told['attempts']:.0f} bytes/attempt",
    )


def _play(attempt_limit: int) -> dict[str, int]:
    from dataclasses import replace

    import pyarrow  # noqa: F401 - loaded before the peak begins

    from causal_openlock import Condition, Session, find_schema
    from causal_openlock.experiment.protocol import PROTOCOLS
    from openlock_learners.random import RandomLearner

    condition = Condition.named("CC4", find_schema)
    human = PROTOCOLS["human"]
    Session(condition, human, 2).play(RandomLearner())  # whatever is loaded only when used
    before = _peak()
    record = Session(condition, replace(human, attempt_limit=attempt_limit), SUBJECTS).play(
        RandomLearner()
    )
    return {"peak": _peak() - before, "attempts": record.num_rows, "record": record.nbytes}


def _peak() -> int:
    """The most memory this process has held, in bytes."""
    status = Path("/proc/self/status")
    if status.exists():
        # Unlike getrusage, this leaves out what the parent held when it started us.
        line = next(x for x in status.read_text().splitlines() if x.startswith("VmHWM"))
        return int(line.split()[1]) * 1024
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return peak if sys.platform == "darwin" else peak * 1024


if __name__ == "__main__":
    print(json.dumps(_play(int(sys.argv[1]))))
