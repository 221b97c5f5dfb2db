"""Stamps: the declaration of a study is written otherwise than at its run, and the record is equal.

A commit that takes away an option, or another name of one, changes the hash of every study whose
learners have it, and nothing of what they do. Such a study need not be played again: one subject of
every learner goes once through the rooms of one condition by the code of before and by this one.
Where all of their attempts are equal, the study is stored with the present hash, and the reason.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd

import causal_openlock
from causal_openlock.comparison.comparing import play
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.keeping import as_declared, commit_of, parts_of
from causal_openlock.evidence.study import Study, read_study
from causal_openlock.evidence.study_files import RUN, older_results, read_run
from causal_openlock.experiment.record import record_schema
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import json_bytes
from causal_openlock.storage.store import Store
from causal_openlock.version import RESULTS_VERSION

THIS = Path(causal_openlock.__file__).parents[1]


def stamp(study: Study, before: Path, reason: str, say: Callable[[str], None]) -> None:
    """Store a study with the hash of its present declaration, if its learners do what they did.

    Args:
        study: The study; of ``before`` it is the one in the folder of the same relative path.
        before: A checkout of the code before the change.
        reason: Why the declaration is written otherwise, in a sentence.
        say: Called with a sentence on the progress.

    Raises:
        EvidenceError: If there is nothing to stamp, or a learner acts otherwise or cannot play.
    """
    run, cells = read_run(study), {cell.name: cell.file_name for cell in study.asked.cells()}
    if run["declared"] == study.declared and not older_results(run):
        raise EvidenceError(f"{study.name} is as it was run, so there is nothing to stamp")
    for part in parts_of(study):
        stored = run["parts"].get(part.name, {"cells": ()})
        if stored["cells"] == [part.name]:  # a network
            stored["asked"] = study.asks_of(part.label)
        elif {name.rpartition("_")[0] for name in stored["cells"]} == {*cells}:
            stored["cells"] = [*cells.values()]
        else:
            raise EvidenceError(f"{study.name} asks for other cells than were played; run it")
    for spec in study.asked.learners:
        say(f"{study.name}: {spec.name} plays by the code in {before}, and by this")
        then = attempts_of(before, before / study.folder, spec.name)
        if not then.equals(attempts_of(THIS, study.folder, spec.name)):
            raise EvidenceError(
                f"{spec.name} acts otherwise than by the code in {before}, so {study.name} has "
                "to be run again"
            )
    made = {"was": run["declared"], "by": commit_of(before), "results": RESULTS_VERSION}
    stamps = [*run.get("stamps", ()), {**made, "reason": reason}]
    write_bytes(study.folder / RUN, json_bytes({**run, **as_declared(study), "stamps": stamps}))


def attempts_of(checkout: Path, study: Path, learner: str) -> pd.DataFrame:
    """Return the attempts of a learner by the code of a checkout, in a process of its own.

    Raises:
        EvidenceError: If it cannot play.
    """
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run(
            [sys.executable, "-P", "-m", __name__, study.absolute(), learner, out],
            env={**os.environ, "PYTHONPATH": f"{checkout}{os.pathsep}{checkout / 'learners'}"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            reason = (done.stderr.strip().splitlines() or ["it says nothing"])[-1]
            raise EvidenceError(f"{learner} cannot play by the code in {checkout}: {reason}")
        columns = [name for name in record_schema().names if name != "wall_time"]
        attempts: pd.DataFrame = Store(out).record(columns)[0].to_pandas()
        return attempts


def play_once(study: Path, learner: str, out: Path) -> None:
    """Let one subject of a learner go once through the rooms of the first condition it can play."""
    asked = read_study(study, tell=lambda _: None).asked
    cell = next(cell for cell in asked.cells() if cell.spec.name == learner)
    once = replace(cell.spec.protocol, baseline_loops=1, train_loops=1, test_loops=1)
    spec = replace(cell.spec, subjects=1, protocol=once)
    played = replace(asked, conditions=(cell.condition,), learners=(spec,))
    play(played, out, warn=lambda _: None, workers=0)


if __name__ == "__main__":
    play_once(Path(sys.argv[1]), sys.argv[2], Path(sys.argv[3]))
