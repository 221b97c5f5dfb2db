"""Running a study of theories: simulate subjects, let all predict all, store who is who.

Everything continues where it stopped, from the files in ``results``. What is measured is stored
once it is whole.
"""

from __future__ import annotations

import json
import os
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.design.apart import told_apart
from causal_openlock.design.parameters import parameters_recovered, searched
from causal_openlock.evidence.confusions import units_of_parameters, units_of_subjects
from causal_openlock.evidence.keeping import (
    Measured,
    Watched,
    of_this_run,
    parts_of,
    stored_whole,
    write_measured,
)
from causal_openlock.evidence.study import Study
from causal_openlock.evidence.study_files import UNITS
from causal_openlock.files.atomic import write_text
from causal_openlock.running.workers import available_cores
from causal_openlock.scoring.teacher_forcing import known_learners
from causal_openlock.storage.versions import versions

SECONDS = "seconds.json"
"""File with the processor's time that a study took so far."""


def run_theories(study: Study, results: Path, watched: Watched, anew: bool = False) -> None:
    """Run a study of recovery or of design, unless it is stored.

    The arguments are those of :func:`~causal_openlock.evidence.running.run_study`.

    Raises:
        LearnerError: If a theory cannot predict others, there are fewer than two, or one whose
            parameters are to be recovered has no search space.
    """
    stored = None if anew else stored_whole(study)
    if stored and not stored.missing:
        return
    asked, (part,) = study.asked, parts_of(study)
    folder, before = results / "cells" / part.name, sum(os.times()[:4])
    workers = available_cores() if watched.workers is None else max(1, watched.workers)
    recovery, design = study.file.recovery, study.file.design
    settings: dict[str, Any] = design.model_dump()
    if study.file.measured == "recovery":  # parameters are known
        settings = {"lapse": recovery.lapse, "copies": recovery.draws}
    specs = known_learners(recovery.parameters, asked.learners)
    spaces = [searched(spec) for spec in specs]  # before hours of work
    try:
        subjects = told_apart(
            asked,
            folder,
            workers=workers,
            report=_report(watched, "subjects"),
            **settings,
        )
        units = [units_of_subjects(subjects)]
        for spec, space in zip(specs, spaces, strict=True):
            pairs = parameters_recovered(
                spec,
                space,
                asked,
                folder / f"parameters_{spec.name}",
                sets=recovery.sets,
                each=recovery.each,
                candidates=recovery.candidates,
                lapse=recovery.lapse,
                workers=workers,
                report=_report(watched, f"parameters of {spec.name}"),
            )
            units.append(units_of_parameters(spec.name, pairs, space))
    finally:
        seconds = _seconds(results) + sum(os.times()[:4]) - before
        write_text(results / SECONDS, json.dumps(seconds))
    measured = Measured(
        tables={UNITS: pd.concat(units, ignore_index=True)},
        cells=tuple(cell.file_name for cell in asked.cells()),
        missing=0,
        seconds=seconds,
        run=of_this_run(study, time.time(), versions()),
    )
    write_measured(study, {part.name: measured}, known=False)


def _report(watched: Watched, what: str) -> Callable[[int, int], None]:
    """Say each twentieth that is done."""

    def report(done: int, total: int) -> None:
        if done * 20 // total > (done - 1) * 20 // total:
            watched.say(f"{what}: {done} of {total} are done")

    return report


def _seconds(results: Path) -> float:
    path = results / SECONDS
    return float(json.loads(path.read_text(encoding="utf-8"))) if path.exists() else 0.0
