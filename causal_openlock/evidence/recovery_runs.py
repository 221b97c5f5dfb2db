"""Running a study of recovery or design: simulate subjects, let all predict all, keep who is who.

Everything continues where it stopped, from the files in ``results``, or, if these are gone, from
the stored units. These are written once every learner has predicted every subject, and again once
the parameters of a learner are recovered.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from causal_openlock.evidence.confusions import (
    units_of_design,
    units_of_parameters,
    units_of_recovery,
)
from causal_openlock.evidence.keeping import (
    Measured,
    Watched,
    each_once,
    of_this_run,
    parts_of,
    stored_whole,
    write_measured,
)
from causal_openlock.evidence.study import Study
from causal_openlock.evidence.study_files import UNITS
from causal_openlock.files.atomic import write_text
from causal_openlock.fitting.design import Effort, told_apart
from causal_openlock.fitting.recovering import (
    SIMULATED,
    Running,
    ToRecover,
    is_another_twentieth,
    parameters_recovered,
    predicted,
    searched,
)
from causal_openlock.scoring.teacher_forcing import known_learners
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions

SECONDS = "seconds.json"


def run_recovery(study: Study, results: Path, watched: Watched, anew: bool = False) -> None:
    """Run what is missing of a study of recovery.

    The arguments are those of :func:`~causal_openlock.evidence.running.run_study`.

    Raises:
        CellsFailed: If some subjects could not be simulated.
        LearnerError: If a learner cannot be put in another's place, or one whose parameters are to
            be recovered has no search space.
    """
    asked, settings = study.asked, study.file.recovery
    size = ToRecover(**settings.model_dump(exclude={"parameters", "restarts"}))
    specs = known_learners(settings.parameters, asked.learners)
    spaces = [searched(spec) for spec in specs]  # before hours of work
    folder = results / "cells" / parts_of(study)[0].name
    kept = None if anew else stored_whole(study)
    if kept and not results.exists():
        if not kept.missing:
            return
        write_text(results / SECONDS, json.dumps(kept.seconds))  # time counts on from there
    if kept is None or (folder / SIMULATED).exists():
        with _timed(results):
            actions = predicted(asked, folder, size, _running(watched, "subjects"))
        units = units_of_recovery(actions)
        if kept:  # parameters that are stored, and not here, are not recovered again
            before = kept.tables[UNITS]
            units = pd.concat([units, before[_of_parameters(before)]], ignore_index=True)
        kept = _keep(study, results, folder, units, kept)
    for spec, space in zip(specs, spaces, strict=True):
        units, own = kept.tables[UNITS], folder / f"parameters_{spec.name}"
        if not own.exists() and spec.name in _recovered(units):
            continue
        with _timed(results):
            what = f"parameters of {spec.name}"
            pairs, _ = parameters_recovered(spec, asked, own, size, _running(watched, what))
        others = units[~_of_parameters(units) | (units["learner"] != spec.name)]
        units = pd.concat([others, units_of_parameters(spec.name, pairs, space)], ignore_index=True)
        kept = _keep(study, results, own, units, kept)


def run_design(study: Study, results: Path, watched: Watched, anew: bool = False) -> None:
    """Run what is missing of a study of theories with unknown parameters.

    The arguments are those of :func:`~causal_openlock.evidence.running.run_study`.

    Raises:
        LearnerError: If a theory cannot predict others, or there are fewer than two.
    """
    if not anew and stored_whole(study):
        return
    asked, settings, running = study.asked, study.file.design, _running(watched, "subjects")
    folder = results / "cells" / parts_of(study)[0].name
    with _timed(results):
        subjects = told_apart(
            asked,
            Effort(settings.draws, settings.lapse),
            outside=settings.outside,
            folder=folder,
            workers=running.processes,
            report=running.report,
        )
    measured = Measured(
        tables={UNITS: units_of_design(subjects)},
        cells=tuple(cell.file_name for cell in asked.cells()),
        missing=0,
        seconds=_seconds(results),
        run=of_this_run(study, time.time(), versions()),
    )
    write_measured(study, {parts_of(study)[0].name: measured}, known=False)


def _of_parameters(units: pd.DataFrame) -> pd.Series[bool]:
    return units["parameter"].notna() if "parameter" in units else units["unit"].lt(0)


def _recovered(units: pd.DataFrame) -> set[str]:
    """The learners whose parameters were recovered."""
    return set(units.loc[_of_parameters(units), "learner"])


def _running(watched: Watched, what: str) -> Running:
    def report(done: int, total: int) -> None:
        if is_another_twentieth(done, total):
            watched.say(f"{what}: {done} of {total} parts are done")

    return Running(watched.workers, watched.warn, watched.show, report)


def _keep(
    study: Study,
    results: Path,
    folder: Path,
    units: pd.DataFrame,
    before: Measured | None,
) -> Measured:
    """Keep units; what is missing are the learners whose parameters are not among them.

    Args:
        study: The study.
        results: Where its time is kept.
        folder: Where the subjects of this step were simulated.
        units: All rows that there are by now.
        before: What was kept before.
    """
    experiment = Store(folder / SIMULATED).record()[1]
    last = max(path.stat().st_mtime for path in folder.rglob("*") if path.is_file())
    run = of_this_run(study, last, experiment.versions)
    measured = Measured(
        tables={UNITS: units},
        cells=tuple(cell.file_name for cell in study.asked.cells()),
        missing=len(set(study.file.recovery.parameters) - _recovered(units)),
        seconds=_seconds(results),
        run={name: each_once([*(before.run[name] if before else ()), *run[name]]) for name in run},
    )
    write_measured(study, {parts_of(study)[0].name: measured}, known=before is not None)
    return measured


@contextmanager
def _timed(results: Path) -> Iterator[None]:
    """Add the processor's time, that of processes that have ended included, to what it took."""
    before = sum(os.times()[:4])
    try:
        yield
    finally:
        spent = _seconds(results) + sum(os.times()[:4]) - before
        write_text(results / SECONDS, json.dumps(spent))


def _seconds(results: Path) -> float:
    path = results / SECONDS
    return float(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else 0.0
