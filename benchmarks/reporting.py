"""How long a report takes, and how much memory: a record of ten million attempts, on one core.

A record is made up in a temporary folder, in the store's own format, cell by cell; then a fresh
process that may use a single core writes the report of it, as ``causal-openlock report`` does, and
tells its seconds, from the start of Python to the end, and the most memory that it held. There are
two such records, because they cost in different places: one of few subjects with very many
attempts each (the paper's protocol ``rl``), and one of very many subjects (``human``). Run as a
script, this file is that process.

The report of the bundled comparison, ``default``, with as many subjects and made-up attempts, is
compared with figures alone: as many as it has, of four panels each, drawn by matplotlib in a fresh
process. Both in seconds of the processor, as both are processes on a machine that may be busy.

``python benchmarks/reporting.py --parts FILE`` runs that comparison itself and writes which part
takes how long: its cells, one after another, with nothing compiled and once more, and all of it.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from measure import Row, Target, in_turns

if TYPE_CHECKING:
    import pyarrow as pa

    from causal_openlock.experiment.experiment import Cell, Experiment

SECONDS, GIGABYTES, MOST_TIMES = 60.0, 2.0, 2.0
CONDITIONS = "[CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4]"
LEARNERS = ("random", "oracle", "ideal", "bayes")
RECORDS = {
    # Subjects of each learner in each condition, subjects in a cell, chance to find a solution.
    "rl": (3, 1, 0.01),
    "human": (6_700, 1_675, 0.25),
}


COMMAND = [sys.executable, "-m", "causal_openlock"]
PEER = "24 figures in bare matplotlib"
FIGURES = """\
import io
from matplotlib.figure import Figure
for _ in range(24):
    figure = Figure((7.2, 4.0), layout="constrained")
    for axes in figure.subplots(2, 2).flat:
        axes.plot(range(10), label="a")
        axes.legend()
    figure.savefig(io.BytesIO(), format="svg")
"""


def reporting(repeats: int) -> Iterator[Row]:
    """Seconds for each kind of record; the target is about both time and memory."""
    from causal_openlock import find_experiment, read_experiment

    with tempfile.TemporaryDirectory() as folder:
        default = read_experiment(find_experiment("default"))
        attempts = fabricate(Path(folder), default, RECORDS["human"][-1])
        report = [*COMMAND, "report", folder]
        figures = [sys.executable, "-c", FIGURES]
        mine, others = in_turns(
            lambda: _processor(report), lambda: _processor(figures), max(1, repeats // 2)
        )
    yield Row(
        "reporting",
        f"report of default, {attempts / 1e3:.0f} k attempts, seconds of the processor",
        "s",
        mine,
        PEER,
        others,
        target=Target("at most", MOST_TIMES),
    )
    for protocol, (subjects, cell_size, chance) in RECORDS.items():
        with tempfile.TemporaryDirectory() as folder:
            declared = Path(folder, "declared.yaml")
            declared.write_text(
                f"name: fabricated\nprotocol: {protocol}\nconditions: {CONDITIONS}\n"
                f"learners: [{', '.join(LEARNERS)}]\n"
                f"subjects: {subjects}\ncell_size: {cell_size}\n",
                encoding="utf-8",
            )
            experiment = read_experiment(declared)
            declared.unlink()
            attempts = fabricate(Path(folder), experiment, chance)
            told = [_in_a_process(Path(folder)) for _ in range(max(1, repeats // 3))]
        peak = max(one["peak"] for one in told) / 1e9
        yield Row(
            "reporting",
            f"report, {attempts / 1e6:.1f} M attempts, protocol {protocol}",
            "s",
            [one["seconds"] for one in told],
            target=Target("under", SECONDS, on="ours"),
            broken="" if peak < GIGABYTES else f"it held more than {GIGABYTES:g} GB",
            note=f"it held at most {peak:.2f} GB (to stay under {GIGABYTES:g} GB)",
        )


def fabricate(folder: Path, experiment: Experiment, chance: float) -> int:
    """Make a results folder up.

    Args:
        folder: An empty folder.
        experiment: What it is of.
        chance: About how probable it is that an attempt finds a solution.

    Returns:
        How many attempts it has.
    """
    from causal_openlock.storage.store import Store

    store = Store(folder)
    store.open(experiment)
    made = 0
    for number, cell in enumerate(experiment.cells()):
        record = _record(cell, number, chance)
        store.write(cell, record)
        made += record.num_rows
    store.close()
    return made


def _record(cell: Cell, number: int, chance: float) -> pa.Table:
    """A cell whose attempts find solutions by chance, the more often the later in a phase."""
    import numpy as np

    from causal_openlock.experiment.protocol import plan
    from causal_openlock.experiment.record import AttemptLog, assemble

    rng = np.random.default_rng(number)
    protocol = cell.spec.protocol
    visits = [plan(cell.condition, protocol, rng) for _ in range(cell.subjects)]
    trials, limit = len(visits[0]), protocol.attempt_limit
    solutions = np.array([[len(v.schema.solutions) for v in row] for row in visits])

    def told(name: str) -> Any:
        return np.array([[getattr(visit, name) for visit in row] for row in visits])

    skill = chance * rng.gamma(8, 1 / 8, (cell.subjects, 1, 1)) * np.linspace(0.5, 1.5, trials)
    hits = rng.random((cell.subjects, trials, limit)) < skill.reshape(cell.subjects, trials, 1)
    found = np.minimum(hits.cumsum(axis=2), solutions[..., None])
    attempt = np.arange(1, limit + 1)
    solved_at = np.where(found >= solutions[..., None], attempt, limit).min(axis=2)
    last = solved_at if protocol.stop_when_solved else np.full_like(solved_at, limit)
    subject, visit, place = np.nonzero(attempt <= last[..., None])
    found = found[subject, visit, place]
    new = np.diff(found, prepend=0) > 0
    new &= hits[subject, visit, place]
    rows = len(subject)
    moved = rng.random((rows, 3)) < 0.6
    log = AttemptLog(3)
    log.append(
        subject=subject,
        visit=visit,
        attempt=place + 1,
        used=3,
        actions=rng.integers(0, 15, (rows, 3)),
        moved=moved,
        unlocked=new | moved.all(axis=1),
        opened=new,
        solution=np.where(new, found - 1, -1),
        new_solution=new,
        solutions_found=found,
        reward=rng.random(rows),
        wall_time=np.linspace(0.0, 100.0, rows),
    )
    layouts = [[visit.layout.name for visit in row] for row in visits]
    schemas = [[visit.schema.name for visit in row] for row in visits]
    return assemble(
        log,
        {
            "phase": np.array(told("phase"), dtype=object),
            "loop": told("loop").astype(np.int32),
            "trial": told("trial").astype(np.int32),
            "schema": np.array(schemas, dtype=object),
            "layout": np.array(layouts, dtype=object),
            "solutions": solutions.astype(np.int16),
        },
        {
            "experiment": cell.experiment,
            "learner": cell.spec.name,
            "condition": cell.condition.name,
            "protocol": protocol.name,
            "seed": cell.seed,
            "subjects": np.arange(cell.first_subject, cell.first_subject + cell.subjects),
        },
    )


def _in_a_process(folder: Path) -> dict[str, float]:
    began = time.perf_counter()
    command = [sys.executable, __file__, str(folder)]
    told = json.loads(subprocess.check_output(command, text=True).splitlines()[-1])
    return {"seconds": time.perf_counter() - began, "peak": told["peak"]}


def _processor(command: list[str]) -> float:
    """Seconds of the processor that a process takes."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def _report(folder: Path) -> dict[str, float]:
    if hasattr(os, "sched_setaffinity"):  # before anything counts the cores
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    from causal_openlock.cli.report import report

    report(folder)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return {"peak": peak if sys.platform == "darwin" else peak * 1024}


def parts() -> dict[str, Any]:
    """Seconds of each part of the comparison ``default``; all but ``wall`` are of the processor."""
    with tempfile.TemporaryDirectory() as compiled, tempfile.TemporaryDirectory() as folder:
        os.environ["NUMBA_CACHE_DIR"] = compiled
        play = [sys.executable, __file__, "--play"]
        first, later = (json.loads(subprocess.check_output(play)) for _ in range(2))
        began = time.perf_counter()
        whole = _processor([*COMMAND, "compare", "default", "--out", folder])
        wall = time.perf_counter() - began
        report = _processor([*COMMAND, "report", folder])
    return {
        "wall": round(wall, 1),
        "compare": round(whole, 1),
        "report": round(report, 1),
        "play": {one: round(later[one], 1) for one in sorted(later, key=later.get, reverse=True)},
        "compile": round(sum(first.values()) - sum(later.values()), 1),
    }


def _play() -> dict[str, float]:
    """Seconds of the processor that the cells of each learner take, in this process."""
    from causal_openlock import find_experiment, read_experiment
    from causal_openlock.running.runner import run

    seconds: dict[str, float] = {}
    last = [time.process_time()]

    def note(cell: Cell, _: bool) -> None:
        last.append(time.process_time())
        seconds[cell.spec.name] = seconds.get(cell.spec.name, 0.0) + last[-1] - last[-2]

    with tempfile.TemporaryDirectory() as folder:
        run(read_experiment(find_experiment("default")), folder, workers=0, done=note)
    return seconds


if __name__ == "__main__":
    if sys.argv[1] == "--parts":
        Path(sys.argv[2]).write_text(json.dumps(parts(), indent=1) + "\n", encoding="utf-8")
    elif sys.argv[1] == "--play":
        print(json.dumps(_play()))
    else:
        print(json.dumps(_report(Path(sys.argv[1]))))
