"""Running a study: train its networks, play its experiment, and keep what was measured.

A study can be stopped at any time and goes on where it was. What has been played by then is
already evidence, of fewer units: verdicts on it are undecided where it does not suffice. Records
stay in ``results``, which is not kept; in the study's folder is what lasts:

- ``units.parquet``, a row for each unit (:mod:`~causal_openlock.evidence.units`), and
  ``costs.parquet``, what learning cost each subject, if the study asks for it,
- ``run.json``: the command, the hash of what was declared, versions, machine, time,
- ``verdicts.csv`` and ``README.md``, which follow from these
  (:mod:`~causal_openlock.evidence.pages`).
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.results.cost import subject_costs
from causal_openlock.comparison.comparing import play
from causal_openlock.comparison.progress import Show
from causal_openlock.comparison.results import Results
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.study import Networks, Study
from causal_openlock.evidence.units import of_network, units_of
from causal_openlock.experiment.building import Changes, learner
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.store import merged_versions
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import (
    ChecksumError,
    json_bytes,
    read_json,
    read_table,
    table_bytes,
)

UNITS, COSTS, RUN = "units.parquet", "costs.parquet", "run.json"


@dataclass(frozen=True)
class Watched:
    """How a run is watched.

    Attributes:
        say: Called with a sentence on what goes on.
        warn: Called with a sentence on what a reader should know.
        show: Called with the progress every second.
        workers: Number of processes; by default one for each core.
    """

    say: Callable[[str], None] = lambda _: None
    warn: Callable[[str], None] = lambda _: None
    show: Show | None = None
    workers: int | None = None


@dataclass
class _Kept:
    """What has been played so far."""

    units: list[pd.DataFrame] = field(default_factory=list)
    costs: list[pd.DataFrame] = field(default_factory=list)
    versions: list[dict[str, Any]] = field(default_factory=list)
    seconds: float = 0.0
    cells: int = 0
    missing: int = 0

    def add(self, units: pd.DataFrame, results: Results, seconds: float) -> None:
        self.units.append(units)
        self.versions.append(dict(results.experiment.versions))
        self.seconds += seconds
        self.cells += len(results.experiment.files)
        self.missing += len(results.experiment.missing)


def run_study(study: Study, results: Path, watched: Watched) -> None:
    """Run what is missing of a study, and keep what was measured, even if it is stopped.

    Args:
        study: The study.
        results: Folder for records and networks.
        watched: How it is watched.

    Raises:
        OpenLockError: If a training or all cells failed.
    """
    try:
        for name, experiment in _experiments(study, results, watched):
            play(
                experiment,
                results / "cells" / name,
                warn=watched.warn,
                progress=watched.show,
                workers=watched.workers,
            )
            if study.file.networks:
                keep(study, results)
    finally:
        keep(study, results)


def _experiments(study: Study, results: Path, watched: Watched) -> Iterator[tuple[str, Any]]:
    """The experiments of a study, each with a name; networks are trained before they play."""
    networks = study.file.networks
    if not networks:
        yield "played", read_experiment(study.experiment)
        return
    for seed in networks.seeds:
        for label in networks.files:
            path = _train(study, networks, label, seed, results, watched)
            for name in (label, *_variants(networks, label)):
                other = networks.parameters.get(name, {})
                playing = learner(networks.learner, label=name, checkpoint=str(path), **other)
                changes = Changes(learners=[playing])
                yield f"{name}-{seed}", read_experiment(study.experiment, changes)


def _variants(networks: Networks, label: str) -> tuple[str, ...]:
    """Other ways in which the networks of the first training play."""
    return tuple(networks.parameters) if label == next(iter(networks.files)) else ()


def _train(
    study: Study, networks: Networks, label: str, seed: int, results: Path, watched: Watched
) -> Path:
    """The file of a network, which is trained if it is not there."""
    out = results / "networks" / f"{label}-{seed}.npz"
    if out.exists():
        return out
    out.parent.mkdir(parents=True, exist_ok=True)
    places = {"file": str(study.training_files[label]), "seed": str(seed), "out": str(out)}
    words = [word.format(**places) for word in shlex.split(networks.command)]
    if words[0] == "python":
        words[0] = sys.executable
    watched.say(f"training {label}, seed {seed}")
    began = time.monotonic()
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    if done.returncode:
        why = (done.stderr.strip().splitlines() or ["no reason was given"])[-1]
        raise EvidenceError(f"the training {shlex.join(words)} failed: {why}")
    watched.say(f"trained {label}, seed {seed}, in {(time.monotonic() - began) / 60:.0f} minutes")
    return out


def keep(study: Study, results: Path) -> bool:
    """Keep what has been played so far; returns whether there is anything."""
    kept = _Kept()
    names = ["played"]
    if networks := study.file.networks:
        labels = [*networks.files, *networks.parameters]
        names = [f"{label}-{seed}" for seed in networks.seeds for label in labels]
    for name in names:
        folder = results / "cells" / name
        if not any((folder / "cells").glob("*.parquet")):
            continue
        found = Results.read(folder)
        units = units_of(found.trials, study.file.measured)
        if networks:
            label, _, seed = name.rpartition("-")
            units = of_network(units, label, int(seed))
        if study.file.derived == "learning_costs":
            costs = subject_costs(found, found.trials)
            kept.costs.append(costs.astype(dict.fromkeys(CELL, str)))
        kept.add(units, found, _seconds(folder))
    if not kept.units:
        return False
    import pyarrow as pa

    for name, parts in ((UNITS, kept.units), (COSTS, kept.costs)):
        if parts:
            table = pa.Table.from_pandas(pd.concat(parts), preserve_index=False)
            write_bytes(study.folder / name, table_bytes(table))
    write_bytes(study.folder / RUN, json_bytes(_about(study, kept, len(names))))
    return True


def _about(study: Study, kept: _Kept, runs: int) -> dict[str, Any]:
    """What ``run.json`` holds."""
    return {
        "command": f"causal-openlock evidence {study.name}",
        "declared": study.declared,
        "complete": len(kept.units) == runs and not kept.missing,
        "runs": f"{len(kept.units)} of {runs}",
        "cells": f"{kept.cells - kept.missing} of {kept.cells}",
        "core_hours": round(kept.seconds / 3600, 2),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": _machine(),
        "versions": merged_versions(kept.versions),
    }


def _machine() -> str:
    """The processor in words."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    model = re.search(r"model name\s*:\s*(.+)", text)
    name = model[1].strip() if model else platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores, {platform.system()}"


def _seconds(folder: Path) -> float:
    """How long the cells of a run took together."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    cells = (folder / "cells").glob("*.parquet")
    times = (pq.read_table(cell, columns=["wall_time"])["wall_time"] for cell in cells)
    return sum(float(pc.max(each).as_py() or 0) for each in times)


def read_units(study: Study, name: str = UNITS) -> pd.DataFrame:
    """What was measured.

    Args:
        study: The study.
        name: :data:`UNITS` or :data:`COSTS`.

    Raises:
        EvidenceError: If it has not been run, or the file is damaged.
    """
    path = study.folder / name
    try:
        found: pd.DataFrame = read_table(path.read_bytes()).to_pandas()
    except FileNotFoundError:
        raise EvidenceError(
            f"{study.name} has not been run; run it with: causal-openlock evidence {study.name}"
        ) from None
    except ChecksumError as error:
        raise EvidenceError(f"{path} is damaged: {error}; run the study again") from None
    return found


def read_run(study: Study) -> dict[str, Any]:
    """What is known of the run: the content of ``run.json``.

    Raises:
        EvidenceError: If it has not been run.
    """
    try:
        return read_json((study.folder / RUN).read_bytes())
    except FileNotFoundError:
        raise EvidenceError(
            f"{study.name} has not been run; run it with: causal-openlock evidence {study.name}"
        ) from None
    except ChecksumError as error:
        raise EvidenceError(f"{study.folder / RUN} is damaged: {error}; run it again") from None
