"""What `bayes` costs as levers grow: ``python benchmarks/belief_levers.py --levers 3 12``.

One subject plays two trials of the human protocol in each room: levers that unlock the door
themselves (``any``), a common cause (``cause``), and roots of some leaves each (``pairs``). The
counts (attempts, structures looked at, states of plans) are the same on every machine; the seconds
are the processor's. The first trial of a room pays for its tables.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from run import ONE_THREAD

TRIALS = 2
SEED = 2018


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--levers", type=int, nargs=2, default=(3, 12), metavar=("LEAST", "MOST"))
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the rows here")
    chosen = parser.parse_args()
    os.environ.update(dict.fromkeys(ONE_THREAD, "1"))  # before NumPy is loaded
    rows = []
    print(f"{'room':>9} {'solutions':>9} {'found':>9} {'attempts':>9} {'looked at':>10} "
          f"{'plan states':>11} {'seconds a trial':>18}")  # fmt: skip
    for levers in range(chosen.levers[0], chosen.levers[1] + 1):
        for schema in rooms(levers):
            row = played(schema)
            rows.append(row)
            print(f"{row['room']:>9} {row['solutions']:>9} {_list(row['found']):>9} "
                  f"{_list(row['attempts']):>9} {row['structures']:>10,} {row['states']:>11,} "
                  f"{_list(row['seconds']):>18}", flush=True)  # fmt: skip
    if chosen.json:
        chosen.json.write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")


def rooms(levers: int) -> Iterator[Any]:
    """Schemas of so many levers."""
    from causal_openlock.schemas.schema import Schema

    names = [f"L{index}" for index in range(levers)]
    yield Schema(f"any{levers}", names, {name: ["door"] for name in names})
    leaves: dict[str, list[str]] = {name: ["door"] for name in names[1:]}
    yield Schema(f"cause{levers}", names, {"L0": names[1:], **leaves})
    if levers >= 4:
        roots = (levers + 1) // 3
        edges: dict[str, list[str]] = {name: ["door"] for name in names[roots:]}
        for index, leaf in enumerate(names[roots:]):
            edges.setdefault(names[index % roots], []).append(leaf)
        yield Schema(f"pairs{levers}", names, edges)


def played(schema: Any) -> dict[str, Any]:
    """What two trials came to."""
    from causal_openlock import Condition, Session
    from causal_openlock.belief import sampling
    from causal_openlock.belief.planning import Planner
    from causal_openlock.experiment.protocol import PROTOCOLS
    from openlock_learners.bayes import Bayes

    counts = {"structures": 0, "states": 0}
    distance, look = sampling.distance, Planner._look

    def counted(structures: Any, *promise: int) -> Any:
        counts["structures"] += len(structures)
        return distance(structures, *promise)

    def seen(*arguments: Any) -> float:
        counts["states"] += 1
        return look(*arguments)

    patched: list[tuple[Any, str, Any, Any]] = [
        (sampling, "distance", counted, distance),
        (Planner, "_look", seen, look),
    ]
    for where, name, ours, _ in patched:
        setattr(where, name, ours)
    condition = Condition.named(schema.name, {schema.name: schema}.__getitem__)
    protocol = replace(PROTOCOLS["human"], baseline_trials=TRIALS)
    session = Session(condition, protocol, 1, seed=SEED, learner="bayes")
    learner = Bayes()
    learner.begin(session.brief)
    seconds, began = [], time.process_time()
    while not session.over:
        step = session.step(learner.act(session.view))
        learner.learn(step)
        if step.trial_over.any():
            seconds.append(round(time.process_time() - began, 2))
            began = time.process_time()
    for where, name, _, theirs in patched:
        setattr(where, name, theirs)
    trials = session.record().to_pandas().groupby("trial")["new_solution"]
    return {
        "room": schema.name,
        "solutions": len(schema.solutions),
        "found": trials.sum().astype(int).tolist(),
        "attempts": trials.size().tolist(),
        "seconds": seconds,
        **counts,
    }


def _list(values: list[Any]) -> str:
    return ", ".join(map(str, values))


if __name__ == "__main__":
    main()
