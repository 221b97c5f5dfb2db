"""Running a study: train its networks, play its experiment, and keep what was measured.

A study can be stopped at any time and continues where it stopped. What has been played by then is
already evidence, of fewer units: verdicts on it are undecided where it does not suffice. Records
and networks stay in ``results``, which is not kept; what lasts is in the study's folder
(:mod:`~causal_openlock.evidence.study_files`). A study whose records are gone, on another machine
for instance, continues from there: what was measured is not played again.
"""

from __future__ import annotations

import shlex
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import CELL
from causal_openlock.analysis.topics.learning_cost import subject_costs
from causal_openlock.comparison.comparing import play
from causal_openlock.comparison.results import Results
from causal_openlock.contract.registry import changed_parameters, file_that_runs
from causal_openlock.errors import CellsFailed, EvidenceError
from causal_openlock.evidence.keeping import (
    OF_A_RUN,
    Measured,
    Part,
    Watched,
    each_once,
    of_this_run,
    parts_of,
    write_measured,
)
from causal_openlock.evidence.recovery_runs import run_theories
from causal_openlock.evidence.study import ATTRIBUTED, FILE, Networks, Study
from causal_openlock.evidence.study_files import COSTS, UNITS, older_results, read_run, read_units
from causal_openlock.evidence.units import of_network, units_of
from causal_openlock.experiment.declare import Cell, Experiment, LearnerSpec
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.making import Changes, learner
from causal_openlock.schemas.fsm import BoolArray

OUR_OWN = {"python": (), "causal-openlock": ("-m", "causal_openlock")}
"""Commands that run with the interpreter that runs the study: by name, its options."""


def run_study(study: Study, results: Path, watched: Watched, anew: bool = False) -> None:
    """Run what is missing of a study, and keep what was measured, even if it is stopped.

    Args:
        study: The study.
        results: Folder for records and networks.
        watched: How it is watched.
        anew: Whether what is stored with the study and not in ``results`` is played as well.

    Raises:
        CellsFailed: If cells failed, after all others were played.
        EvidenceError: If a claim or a table is about what is not played, or a training failed.
        StoreError: If the results folder holds another experiment.
    """
    if faults := study.faults():
        raise EvidenceError(f"{study.folder / FILE}: {faults[0]}")
    if study.tell:
        _tell_what_runs(study, study.tell)
    if study.file.measured in ATTRIBUTED:
        run_theories(study, results, watched, anew)
        return
    if study.file.measured == "metrics":
        raise EvidenceError(
            f"{study.name}: what learners measure of themselves, version 0.2 stored"
        )
    failed: list[CellsFailed] = []
    found = {} if anew else _stored(study)
    try:
        for part in parts_of(study):
            held = found.get(part.name)
            if part.label and held and not _folder(results, part).exists():
                continue
            lost = play(
                _experiment(study, part, results, watched),
                _folder(results, part),
                warn=watched.warn,
                progress=watched.show,
                workers=watched.workers,
                elsewhere=held.cells if held else (),
                allow_version=True,  # its pages name all versions
            )
            failed += [lost] if lost else []
            if part.label:
                keep(study, results, found)
    finally:
        keep(study, results, found)
    if failed:
        raise failed[0]


def _tell_what_runs(study: Study, tell: Callable[[str], None]) -> None:
    """Say which code of networks will run; that of the experiment is told where it is read."""
    if networks := study.file.networks:
        tell(f"{networks.command} will run to train networks")
        if code := file_that_runs(networks.learner, study.experiment.parent):
            tell(code)


def _folder(results: Path, part: Part) -> Path:
    return results / "cells" / part.name


def _experiment(study: Study, part: Part, results: Path, watched: Watched) -> Experiment:
    """Experiment that a part plays; its network is trained first."""
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
    if words[0] in OUR_OWN:
        words[:1] = [sys.executable, *OUR_OWN[words[0]]]
    about = f"{part.trained}, seed {part.seed}"
    log = out.with_suffix(".log")
    watched.say(f"training {about}; its progress is in {log}")
    began = time.monotonic()
    try:
        with log.open("w", encoding="utf-8") as output:
            done = subprocess.run(words, stdout=output, stderr=subprocess.STDOUT, check=False)
    except OSError as error:
        raise EvidenceError(f"{words[0]} cannot be run: {error.strerror}") from None
    if done.returncode or not out.exists():
        last = (log.read_text(encoding="utf-8").strip().splitlines() or ["no reason was given"])[-1]
        raise EvidenceError(f"the training {shlex.join(words)} failed: {last}")
    watched.say(f"trained {about}, in {(time.monotonic() - began) / 60:.0f} minutes")
    return out


def keep(study: Study, results: Path, found: dict[str, Measured] | None = None) -> bool:
    """Store what has been played so far; returns whether that is more than was stored before.

    Args:
        study: The study.
        results: Folder for records and networks.
        found: By part, what is known already; by default what is stored.
    """
    found = _stored(study) if found is None else found
    for part in parts_of(study):
        before = found.get(part.name)
        if before and not before.missing and part.label:
            continue
        if played := _played(study, part, results):
            found[part.name] = _added(study, played, before)
    if not found:
        return False
    return write_measured(study, found, bool(_stored(study)))


def _stored(study: Study) -> dict[str, Measured]:
    """Measurements stored with the study, by part, as far as the study asks for them now."""
    try:
        run, tables = read_run(study), {UNITS: read_units(study)}
        if COSTS in run["files"]:
            tables[COSTS] = read_units(study, COSTS)
    except EvidenceError:
        return {}
    if (COSTS in tables) != (study.file.derived == "learning_costs"):
        return {}
    found = {}
    for part in parts_of(study):
        if not (held := run["parts"].get(part.name)):
            continue
        of_run = {name: held[name] for name in OF_A_RUN}
        names, seconds, units = held["cells"], held["seconds"], tables[UNITS]
        asked_then = None if older_results(run) else held.get("asked")
        if part.label and asked_then == study.asks_of(part.label):
            own = units[(units["learner"] == part.label) & (units["unit"] == part.seed)]
            found[part.name] = Measured({UNITS: own}, tuple(names), 0, seconds, of_run)
        elif not part.label and study.stored() <= set(units):
            # A name holds the hash of all that decides a cell: a learner that was added since
            # leaves the others as they are.
            asked = study.asked.cells()
            if not (cells := [cell for cell in asked if cell.file_name in names]):
                continue
            found[part.name] = Measured(
                tables={name: table[_of(table, cells)] for name, table in tables.items()},
                cells=tuple(cell.file_name for cell in cells),
                missing=len(asked) - len(cells),
                seconds=seconds * len(cells) / max(1, len(names)),
                run=of_run,
            )
    return found


def _played(study: Study, part: Part, results: Path) -> Measured | None:
    """Measurements of a part from its played cells, if they fit what the study asks for now."""
    folder = _folder(results, part)
    if not any((folder / "cells").glob("*.parquet")):
        return None
    read = Results.read(folder)
    asked = study.asked
    if part.label:
        seed, learners = asked.seed + part.seed, read.experiment.learners
        if not _is_part(study, part, learners):
            return None
        asked = replace(asked, seed=seed, learners=learners)
    if read.experiment.declaration != asked.declaration:
        return None
    there = ((folder / "cells" / name) for name in read.experiment.files)
    cells = [path for path in there if path.exists()]
    tables = {UNITS: units_of(read.trials, study.file.measured)}
    if part.label:
        if read.experiment.missing:
            return None
        tables = {UNITS: of_network(tables[UNITS], part.label, part.seed)}
    elif study.file.derived == "learning_costs":
        tables[COSTS] = subject_costs(read, read.trials).astype(dict.fromkeys(CELL, str))
    last = max(cell.stat().st_mtime for cell in cells)
    return Measured(
        tables=tables,
        cells=(part.name,) if part.label else tuple(cell.name for cell in cells),
        missing=len(read.experiment.missing),
        seconds=_seconds(cells),
        run=of_this_run(study, last, read.experiment.versions),
    )


def _is_part(study: Study, part: Part, learners: Sequence[LearnerSpec]) -> bool:
    """Whether learners are the one of a part, with its parameters."""
    networks = study.file.networks
    assert networks
    wanted = networks.parameters.get(part.label, {}) if part.label != part.trained else {}
    (spec,) = learners
    changed = changed_parameters(spec.learner, spec.parameters)
    changed.pop("checkpoint", None)
    return spec.learner == networks.learner and changed == wanted


def _added(study: Study, played: Measured, before: Measured | None) -> Measured:
    """Measurements of this run, with those of other cells from before."""
    names = set(before.cells) - set(played.cells) if before else set()
    cells = [cell for cell in study.asked.cells() if cell.file_name in names]
    if not (before and cells):
        return played
    return Measured(
        tables={
            name: pd.concat([before.tables[name][_of(before.tables[name], cells)], table])
            for name, table in played.tables.items()
        },
        cells=(*(cell.file_name for cell in cells), *played.cells),
        missing=played.missing - len(cells),
        seconds=played.seconds + before.seconds * len(cells) / len(before.cells),
        run={name: each_once([*before.run[name], *played.run[name]]) for name in OF_A_RUN},
    )


def _of(table: pd.DataFrame, cells: list[Cell]) -> BoolArray:
    """Mask of the rows that belong to some cells."""
    subjects = table["unit" if "unit" in table else "subject"]
    own: BoolArray = np.zeros(len(table), dtype=bool)
    for cell in cells:
        own |= (
            (table["learner"] == cell.spec.name)
            & (table["condition"] == cell.condition.name)
            & subjects.between(cell.first_subject, cell.first_subject + cell.subjects - 1)
        ).to_numpy()
    return own


def _seconds(cells: list[Path]) -> float:
    """Seconds that cells took together."""
    import pyarrow.compute as pc
    import pyarrow.parquet as pq

    times = (pq.read_table(cell, columns=["wall_time"])["wall_time"] for cell in cells)
    return sum(float(pc.max(each).as_py() or 0) for each in times)
