"""Running a study: train its networks, play its experiment, store what was measured.

Records and networks stay in a folder of results, where a study that was stopped continues. What
lasts is in the study's folder: ``units.parquet`` and ``run.json``, the facts about the run with the
hash of the units, so that neither can be of another run.
"""

from __future__ import annotations

import hashlib
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.topics.learning_cost import subject_costs
from causal_openlock.comparison.comparing import compare
from causal_openlock.comparison.results import Results
from causal_openlock.errors import EvidenceError, in_short
from causal_openlock.experiment.declare import Experiment
from causal_openlock.experiment.making import Changes, learner, read_experiment
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import (
    ChecksumError,
    digest,
    json_bytes,
    read_json,
    read_table,
    table_bytes,
)
from causal_openlock.storage.versions import versions
from evidence.study import FILE, Study
from evidence.theories import units_of_theories
from evidence.units import of_network, units_of

UNITS, COSTS, RUN = "units.parquet", "costs.parquet", "run.json"
NEEDED = ("declared", "seed", "claims", "versions", "files")  #: keys of ``run.json`` that are read


def run_study(study: Study, results: Path, workers: int | None) -> None:
    """Run a study, and store what was measured once all of it was played.

    Records and networks that are in the folder of ``results`` are not played again.

    Raises:
        CellsFailed: If all cells failed.
        EvidenceError: If a claim or a table is about what is not played, or something failed.
    """
    if faults := study.faults():
        raise EvidenceError(f"{study.folder / FILE}: {faults[0]}")
    claims = _margins(study, results)
    tables, hours = {}, 0.0
    if study.file.measured == "theories":
        tables[UNITS], hours = units_of_theories(study, results / "played", workers)
    elif networks := study.file.networks:
        parts = []
        for seed in networks.seeds:
            for label in study.learners:
                experiment = _with_network(study, label, seed, results)
                played, spent = _played(experiment, results / f"{label}-{seed}", workers)
                units = units_of(played.trials, study.file.measured)
                parts.append(of_network(units, label, seed))
                hours += spent
        tables[UNITS] = pd.concat(parts, ignore_index=True)
    else:
        played, hours = _played(study.asked, results / "played", workers)
        tables[UNITS] = units_of(played.trials, study.file.measured)
        if study.file.derived == "learning_costs":
            costs = subject_costs(played, played.trials)
            tables[COSTS] = costs.astype(dict.fromkeys(CELL, str))
    store(study, tables, hours, claims)


def _margins(study: Study, results: Path) -> dict[str, str]:
    """The margins of claims as they were before anything was played.

    Those of a study that was run before are those of that run, and under its seed no claim is
    added: what is stated or changed once results are known stays marked.
    """
    path = results / "claims.json"
    if not path.exists():
        claims = {name: study.margin(name) for name in study.file.claims}
        if (study.folder / RUN).exists():
            before = read_run(study)
            new = {} if before["seed"] == study.asked.seed else claims
            claims = new | before["claims"]
        path.parent.mkdir(parents=True, exist_ok=True)
        write_bytes(path, json_bytes(claims))
    return read_json(path.read_bytes())


def _played(experiment: Experiment, out: Path, workers: int | None) -> tuple[Results, float]:
    """The results of an experiment, all of whose cells were played, and the hours these took."""
    played = compare(experiment, out=out, workers=workers)
    if missing := played.experiment.missing:
        raise EvidenceError(f"{out}: {len(missing)} cells failed; run the study again")
    cells = [pq.read_table(path, columns=["wall_time"]) for path in out.glob("cells/*.parquet")]
    return played, sum(pc.max(cell["wall_time"]).as_py() or 0 for cell in cells) / 3600


def _with_network(study: Study, label: str, seed: int, results: Path) -> Experiment:
    """The experiment as a network plays it, which is trained if it is not there."""
    networks = study.file.networks
    assert networks
    trained = networks.played_by(label)
    file = study.folder / networks.files[trained]
    name = f"{trained}-{seed}-{digest(file.read_bytes())[:8]}"  # of another training another one
    network = (results / "networks" / f"{name}.npz").absolute()
    if not network.exists():
        network.parent.mkdir(parents=True, exist_ok=True)
        print(f"training {network.stem}")
        words = [sys.executable, "-m", "causal_openlock", "train", str(file), "--seed", str(seed)]
        if subprocess.run([*words, "--out", str(network)], check=False).returncode:
            raise EvidenceError(f"the training of {network.stem} failed, as is said above")
    parameters = networks.parameters.get(label, {})
    playing = learner(networks.learner, label=label, checkpoint=str(network), **parameters)
    # Other rooms for each network, or luck in drawing them would look like a difference.
    changes = Changes(learners=[playing], seed=study.asked.seed + seed)
    found = read_experiment(study.folder / study.file.experiment, changes)
    return replace(found, name=study.asked.name)


def store(
    study: Study, tables: dict[str, pd.DataFrame], hours: float, claims: dict[str, str]
) -> None:
    """Write what was measured, and then the facts about the run."""
    hashes = {}
    for name, table in tables.items():
        content = table_bytes(pa.Table.from_pandas(table, preserve_index=False))
        hashes[name] = hashlib.sha256(content).hexdigest()
        write_bytes(study.folder / name, content)
    about = {
        "declared": study.declared,
        "seed": study.asked.seed,
        "claims": claims,
        "core_hours": round(hours, 2),
        "date": datetime.now(UTC).date().isoformat(),
        "machine": f"{_processor()}, {os.cpu_count()} cores, {platform.system()}",
        "versions": versions(),
        "files": hashes,
    }
    write_bytes(study.folder / RUN, json_bytes(about))


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    text = path.read_text(encoding="utf-8") if path.exists() else ""
    model = re.search(r"model name\s*:\s*(.+)", text)
    return model[1].strip() if model else platform.processor() or platform.machine()


def read_run(study: Study) -> dict[str, Any]:
    """Facts about the run: the content of ``run.json``.

    Raises:
        EvidenceError: If it has not been run, or the file is damaged or lacks a key.
    """
    run: dict[str, Any] = _read(study, RUN, read_json)
    if missing := [name for name in NEEDED if name not in run]:
        raise EvidenceError(f"{study.folder / RUN} has no {missing[0]}; run the study again")
    return run


def read_units(study: Study, name: str = UNITS) -> pd.DataFrame:
    """Measured units, or with :data:`COSTS` what learning cost each subject.

    Raises:
        EvidenceError: If it has not been run, or the file is damaged or of another run.
    """
    sha256 = read_run(study)["files"].get(name)
    units: pd.DataFrame = _read(study, name, read_table, sha256).to_pandas()
    return units


def _read(study: Study, name: str, parse: Callable[[bytes], Any], sha256: str = "") -> Any:
    path = study.folder / name
    try:
        content = path.read_bytes()
        if sha256 and hashlib.sha256(content).hexdigest() != sha256:
            raise ChecksumError(f"{RUN} is of another run")
        return parse(content)
    except FileNotFoundError:
        raise EvidenceError(
            f"{study.name} has not been run; run it with: make evidence NAME={study.name}"
        ) from None
    except (ChecksumError, OSError) as error:
        raise EvidenceError(f"{path} is damaged: {in_short(error)}; run the study again") from None
