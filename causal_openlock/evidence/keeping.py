"""Stored files of a run, whatever was measured: units, and how they were made."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.comparison.progress_bar import Show
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.study import Study
from causal_openlock.evidence.study_files import (
    UNITS,
    older_results,
    read_run,
    read_units,
    write_run,
)
from causal_openlock.files.validation import present
from causal_openlock.storage.versions import merged_versions
from causal_openlock.wording import joined


@dataclass(frozen=True)
class Watched:
    """Callbacks that watch a run.

    Attributes:
        say: Called with a sentence on the progress.
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
    """Part that is played at once: a whole study without networks, or one network.

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


OF_A_RUN = ("date", "machine", "commit", "versions")


@dataclass(frozen=True)
class Measured:
    """Measurements of a part.

    Attributes:
        tables: By file, what is kept: a row for each unit and time, or subject.
        cells: File names of the cells that these are of; of a network, its name.
        missing: How many cells were not played yet.
        seconds: How long the others took together.
        run: Of the run: ``date``, ``machine``, ``commit`` and ``versions``, a list of each.
    """

    tables: dict[str, pd.DataFrame]
    cells: tuple[str, ...]
    missing: int
    seconds: float
    run: dict[str, list[Any]]

    def as_dict(self) -> dict[str, Any]:
        """All but the tables, as ``run.json`` holds it."""
        return {
            "cells": list(self.cells),
            "missing": self.missing,
            "seconds": round(self.seconds),
            **self.run,
        }


def of_this_run(study: Study, last: float, versions: Mapping[str, Any]) -> dict[str, list[Any]]:
    """Facts about a run that ended at this time, in seconds since 1970."""
    return {
        "date": [datetime.fromtimestamp(last, UTC).date().isoformat()],
        "machine": [_machine()],
        "commit": [commit_of(study.folder)],
        "versions": [dict(versions)],
    }


def stored_whole(study: Study) -> Measured | None:
    """Measurements of a study without networks, if they fit what it declares now."""
    try:
        run, units = read_run(study), read_units(study)
    except EvidenceError:
        return None
    if run["declared"] != study.declared or older_results(run):
        return None
    held = run["parts"][parts_of(study)[0].name]
    return Measured(
        tables={UNITS: units},
        cells=tuple(held["cells"]),
        missing=held["missing"],
        seconds=held["seconds"],
        run={name: held[name] for name in OF_A_RUN},
    )


def write_measured(study: Study, found: Mapping[str, Measured], known: bool) -> bool:
    """Write the measurements; returns whether there are more than were stored before.

    Args:
        study: The study.
        found: What was measured, by part.
        known: Whether some of it was known before.
    """
    tables = {
        name: pd.concat([one.tables[name] for one in found.values()], ignore_index=True)
        for name in next(iter(found.values())).tables
    }
    claims = {name: study.margin(name) for name in study.file.claims}
    try:
        last, more = read_run(study), len(read_units(study)) > len(tables[UNITS])
    except EvidenceError:
        pass
    else:
        same = last["declared"] == study.declared
        if same and more:
            return False
        # What was stated or changed once results were known stays marked, whatever is run later.
        claims = last["claims"] if same or known else {**claims, **last["claims"]}
    write_run(study, tables, _about(study, found, claims))
    return True


def each_once(values: list[Any]) -> list[Any]:
    """Values without those that came before."""
    return [value for i, value in enumerate(values) if value not in values[:i]]


def as_declared(study: Study) -> dict[str, Any]:
    """Return what ``run.json`` stores of the declaration: its hash and its seed."""
    return {
        "declared": study.declared,
        "seed": study.asked.seed,
    }


def _about(study: Study, found: Mapping[str, Measured], claims: dict[str, str]) -> dict[str, Any]:
    """Content of ``run.json``."""
    kept = found.values()
    missing = sum(one.missing for one in kept) + len(parts_of(study)) - len(found)
    cells = missing + sum(len(one.cells) for one in kept)
    run = {name: each_once([value for one in kept for value in one.run[name]]) for name in OF_A_RUN}
    return {
        "command": f"causal-openlock evidence {study.name}",
        **as_declared(study),
        "claims": claims,
        "complete": not missing,
        "cells": f"{cells - missing} of {cells}",
        "core_hours": round(sum(one.seconds for one in kept) / 3600, 2),
        "date": max(run["date"]),
        "machine": joined(run["machine"]),
        "versions": merged_versions(run["versions"]),
        "parts": {
            part.name: {
                **found[part.name].as_dict(),
                **present({"asked": study.asks_of(part.label) if part.label else None}),
            }
            for part in parts_of(study)
            if part.name in found
        },
    }


def commit_of(folder: Path) -> str:
    """The commit that a folder is at, if it is under version control."""
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
