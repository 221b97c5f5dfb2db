"""Running a study: train its networks, play its experiment, and keep what was measured.

A study can be stopped at any time and goes on where it was. What has been played by then is
already evidence, of fewer units: verdicts on it are undecided where it does not suffice. Records
and networks stay in ``results``, which is not kept; what lasts is in the study's folder
(:mod:`~causal_openlock.evidence.stored`).
"""

from __future__ import annotations

import os
import platform
import re
import shlex
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.results.cost import subject_costs
from causal_openlock.comparison.comparing import play
from causal_openlock.comparison.progress import Show
from causal_openlock.comparison.results import Results
from causal_openlock.errors import CellsFailed, EvidenceError
from causal_openlock.evidence.stored import COSTS, UNITS, read_run, read_units, write_run
from causal_openlock.evidence.study import FILE, Networks, Study
from causal_openlock.evidence.units import of_network, units_of
from causal_openlock.experiment.building import Changes, learner
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.store import merged_versions


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


@dataclass(frozen=True)
class Part:
    """What is played in one go: all of a study without networks, or one network.

    Attributes:
        name: Of its results folder.
        label: Of the networks that it is one of; empty without networks.
        seed: Of its training.
        trained: Label of the training; a variant plays with the networks of another one.
    """

    name: str
    label: str = ""
    seed: int = 0
    trained: str = ""


def parts_of(study: Study) -> list[Part]:
    """The parts of a study in the order in which they are run: a network of each kind, and so on.

    A part is named after a hash of how its network is trained, so that a training that has changed
    since is another part.
    """
    networks = study.file.networks
    if not networks:
        return [Part("played")]
    first = next(iter(networks.files))
    return [
        Part(f"{label}-{seed}-{study.training(trained)[:8]}", label, seed, trained)
        for seed in networks.seeds
        for trained in networks.files
        for label in (trained, *(networks.parameters if trained == first else ()))
    ]


def run_study(study: Study, results: Path, watched: Watched) -> None:
    """Run what is missing of a study, and keep what was measured, even if it is stopped.

    Args:
        study: The study.
        results: Folder for records and networks.
        watched: How it is watched.

    Raises:
        CellsFailed: If cells failed, after all others were played.
        EvidenceError: If a claim or a table is about what is not played, or a training failed.
        StoreError: If the results folder holds another experiment.
    """
    if faults := study.faults():
        raise EvidenceError(f"{study.folder / FILE}: {faults[0]}")
    failed: list[CellsFailed] = []
    found: dict[Part, _Played] = {}
    try:
        for part in parts_of(study):
            lost = play(
                _experiment(study, part, results, watched),
                _folder(results, part),
                warn=watched.warn,
                progress=watched.show,
                workers=watched.workers,
            )
            failed += [lost] if lost else []
            if part.label:
                keep(study, results, found)
    finally:
        keep(study, results, found)
    if failed:
        raise failed[0]


def _folder(results: Path, part: Part) -> Path:
    return results / "cells" / part.name


def _experiment(study: Study, part: Part, results: Path, watched: Watched) -> Experiment:
    """What is played in a part; its network is trained before."""
    networks = study.file.networks
    if not networks:
        return study.asked
    path = _train(study, networks, part, results, watched)
    other = networks.parameters.get(part.label, {}) if part.label != part.trained else {}
    playing = learner(networks.learner, label=part.label, checkpoint=str(path), **other)
    # Other rooms for each network, or luck in drawing them would look like a difference.
    seed = study.asked.seed + part.seed
    found = read_experiment(study.experiment, Changes(learners=[playing], seed=seed))
    return replace(found, name=study.asked.name)


def _train(study: Study, networks: Networks, part: Part, results: Path, watched: Watched) -> Path:
    """The file of a network, which is trained if it is not there."""
    name = part.name.replace(part.label, part.trained, 1)
    out = (results / "networks" / f"{name}.npz").absolute()
    if out.exists():
        return out
    out.parent.mkdir(parents=True, exist_ok=True)
    file = study.training_files[part.trained]
    words = networks.words(file=str(file), seed=str(part.seed), out=str(out))
    if words[0] == "python":
        words[0] = sys.executable
    about = f"{part.trained}, seed {part.seed}"
    log = out.with_suffix(".log")
    watched.say(f"training {about}; its progress is in {log}")
    began = time.monotonic()
    try:
        with log.open("w", encoding="utf-8") as told:
            done = subprocess.run(words, stdout=told, stderr=subprocess.STDOUT, check=False)
    except OSError as error:
        raise EvidenceError(f"{words[0]} cannot be run: {error.strerror}") from None
    if done.returncode or not out.exists():
        last = (log.read_text(encoding="utf-8").strip().splitlines() or ["no reason was given"])[-1]
        raise EvidenceError(f"the training {shlex.join(words)} failed: {last}")
    watched.say(f"trained {about}, in {(time.monotonic() - began) / 60:.0f} minutes")
    return out


@dataclass
class _Played:
    """What has been played of a part."""

    units: pd.DataFrame
    costs: list[pd.DataFrame]
    versions: dict[str, Any]
    seconds: float
    played: float
    cells: int
    missing: int


def keep(study: Study, results: Path, found: dict[Part, _Played] | None = None) -> bool:
    """Keep what has been played so far; returns whether that is more than was kept before.

    Args:
        study: The study.
        results: Folder for records and networks.
        found: What is known already of parts that are complete.
    """
    found = {} if found is None else found
    for part in parts_of(study):
        if part not in found and (played := _played(study, part, results)):
            found[part] = played
    kept = list(found.values())
    if not kept:
        return False
    units = pd.concat([one.units for one in kept], ignore_index=True)
    claims = {name: study.margin(name) for name in study.file.claims}
    try:
        before = read_run(study)
        # A margin that was changed once results were known stays marked, whatever is run later.
        claims = (
            before["claims"]
            if before["declared"] == study.declared
            else {**claims, **before["claims"]}
        )
        if before["declared"] == study.declared and len(read_units(study)) > len(units):
            return False
    except (EvidenceError, KeyError):
        pass
    tables = {UNITS: units}
    if costs := [one for part in kept for one in part.costs]:
        tables[COSTS] = pd.concat(costs, ignore_index=True)
    write_run(study, tables, _about(study, kept, claims))
    for part in [part for part, one in found.items() if one.missing]:
        del found[part]  # there may be more of it later
    return True


def _played(study: Study, part: Part, results: Path) -> _Played | None:
    """What has been played of a part, if it is what the study asks for now."""
    folder = _folder(results, part)
    cells = list((folder / "cells").glob("*.parquet"))
    if not cells:
        return None
    read = Results.read(folder)
    asked = study.asked
    if part.label:
        seed, learners = asked.seed + part.seed, read.experiment.learners
        asked = replace(asked, seed=seed, learners=learners)
    if read.experiment.declaration != asked.declaration:
        return None
    units, costs = units_of(read.trials, study.file.measured), []
    if part.label:
        if read.experiment.missing:
            return None
        units = of_network(units, part.label, part.seed)
    elif study.file.derived == "learning_costs":
        costs = [subject_costs(read, read.trials).astype(dict.fromkeys(CELL, str))]
    return _Played(
        units=units,
        costs=costs,
        versions=dict(read.experiment.versions),
        seconds=_seconds(cells),
        played=max(cell.stat().st_mtime for cell in cells),
        cells=len(read.experiment.files),
        missing=len(read.experiment.missing),
    )


def _about(study: Study, kept: list[_Played], claims: dict[str, str]) -> dict[str, Any]:
    """What ``run.json`` holds."""
    last = datetime.fromtimestamp(max(one.played for one in kept), UTC)
    missing, cells = sum(one.missing for one in kept), sum(one.cells for one in kept)
    return {
        "command": f"causal-openlock evidence {study.name}",
        "declared": study.declared,
        "claims": claims,
        "complete": not missing,
        "cells": f"{cells - missing} of {cells}",
        "core_hours": round(sum(one.seconds for one in kept) / 3600, 2),
        "date": last.date().isoformat(),
        "machine": _machine(),
        "commit": _commit(study.folder),
        "versions": merged_versions([one.versions for one in kept]),
    }


def _commit(folder: Path) -> str:
    """The commit that the study's folder is at, if it is under version control."""
    try:
        words = ["git", "-C", str(folder), "describe", "--always", "--dirty", "--abbrev=12"]
        done = subprocess.run(words, capture_output=True, text=True, check=False)
    except OSError:
        return ""
    return done.stdout.strip()


def _machine() -> str:
    """The processor in words."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    model = re.search(r"model name\s*:\s*(.+)", text)
    name = model[1].strip() if model else platform.processor() or platform.machine()
    return f"{name}, {os.cpu_count()} cores, {platform.system()}"


def _seconds(cells: list[Path]) -> float:
    """How long cells took together."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    times = (pq.read_table(cell, columns=["wall_time"])["wall_time"] for cell in cells)
    return sum(float(pc.max(each).as_py() or 0) for each in times)
