"""Running a study of recovery: simulate subjects, let all learners predict all, keep who is who.

All of it goes on where it was, from what is in ``results``. What is kept with the study is written
once every learner has predicted every subject, and again once parameters are recovered.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pandas as pd

from causal_openlock.comparison.recovering import (
    SIMULATED,
    Running,
    ToRecover,
    parameters_recovered,
    predicted,
    searched,
)
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.confusions import units_of_parameters, units_of_recovery
from causal_openlock.evidence.keeping import (
    Measured,
    Watched,
    of_this_run,
    parts_of,
    write_measured,
)
from causal_openlock.evidence.stored import UNITS, read_run
from causal_openlock.evidence.study import Study
from causal_openlock.experiment.store import Store
from causal_openlock.files.atomic import write_text
from causal_openlock.scoring.teacher_forcing import known_learners

SECONDS = "seconds.json"


def run_recovery(study: Study, results: Path, watched: Watched, anew: bool = False) -> None:
    """Run what is missing of a study of recovery.

    The arguments are those of :func:`~causal_openlock.evidence.running.run_study`.

    Raises:
        CellsFailed: If some subjects could not be simulated.
        LearnerError: If a learner cannot be put in another's place, or one whose parameters are to
            be recovered has no search space.
    """
    if not (anew or results.exists()) and _is_complete(study):
        return
    asked, settings = study.asked, study.file.recovery
    size = ToRecover(**settings.model_dump(exclude={"parameters"}))
    specs = known_learners(settings.parameters, asked.learners)
    spaces = [searched(spec) for spec in specs]  # before hours of work
    folder = results / "cells" / parts_of(study)[0].name
    with _timed(results):
        actions = predicted(asked, folder, size, _running(watched, "subjects"))
        units = units_of_recovery(actions, asked.seed)
    _keep(study, results, folder, units, left=len(specs))
    for number, (spec, space) in enumerate(zip(specs, spaces, strict=True), 1):
        with _timed(results):
            pairs, _ = parameters_recovered(
                spec,
                asked,
                folder / f"parameters_{spec.name}",
                size,
                _running(watched, f"parameters of {spec.name}"),
            )
        own = units_of_parameters(spec.name, pairs, space)
        units = pd.concat([units, own], ignore_index=True)
        _keep(study, results, folder, units, left=len(specs) - number)


def _is_complete(study: Study) -> bool:
    try:
        run = read_run(study)
    except EvidenceError:
        return False
    return bool(run["complete"]) and run["declared"] == study.declared


def _running(watched: Watched, what: str) -> Running:
    def report(done: int, total: int) -> None:
        if done * 20 // total > (done - 1) * 20 // total:
            watched.say(f"{what}: {done} of {total} parts are done")

    return Running(watched.workers, watched.warn, watched.show, report)


def _keep(study: Study, results: Path, folder: Path, units: pd.DataFrame, left: int) -> None:
    """Keep units, while the parameters of so many learners are still to be recovered."""
    experiment = Store(folder / SIMULATED).record()[1]
    last = max(path.stat().st_mtime for path in folder.rglob("*") if path.is_file())
    measured = Measured(
        tables={UNITS: units},
        cells=tuple(experiment.files),
        missing=left,
        seconds=_seconds(results),
        run=of_this_run(study, last, experiment.versions),
    )
    write_measured(study, {parts_of(study)[0].name: measured}, known=False)


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
