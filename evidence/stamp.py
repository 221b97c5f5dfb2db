"""Stamps: the declaration of a study is written otherwise than at its run, and the record is equal.

A commit that takes away an option, or another name of one, changes the hash of every study whose
learners have it, and nothing of what they do. Such a study need not be played again: one subject of
every learner goes once through the rooms of one condition by the code of before and by this one.
Where all of their attempts are equal, the study is stored with the present hash, and the reason.

As a script, ``stamp.py EXPERIMENT LEARNER OUT``, this file plays with the code of any checkout.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import pandas as pd

import causal_openlock as ol
from causal_openlock.errors import EvidenceError
from causal_openlock.experiment.making import read_experiment
from causal_openlock.experiment.record import record_schema
from causal_openlock.storage.store import Store
from causal_openlock.version import RESULTS_VERSION

if TYPE_CHECKING:  # which the script does without
    from evidence.study import Study

THIS = Path(ol.__file__).parents[1]


def stamp(study: Study, before: Path, reason: str, say: Callable[[str], None]) -> None:
    """Store a study with the hash of its present declaration, if its learners do what they did.

    The checkout ``before`` has the code before the change, and the study in the same folder.

    Raises:
        EvidenceError: If there is nothing to stamp, or a learner acts otherwise or cannot play.
    """
    from evidence.run import as_declared, older_results, read_run, read_units, write_run

    run, units = read_run(study), read_units(study)
    if run["declared"] == study.declared and not older_results(run):
        raise EvidenceError(f"{study.name} is as it was run, so there is nothing to stamp")
    played = units[units["condition"] != ""].groupby("learner")["unit"].agg(set).to_dict()
    conditions = {*units["condition"]} - {""}
    if played != _units_of(study) or conditions != {one.name for one in study.asked.conditions}:
        raise EvidenceError(f"{study.name} asks for other units than were played; run it")
    for spec in study.asked.learners:
        say(f"{study.name}: {spec.name} plays by the code in {before}, and by this")
        then = _attempts(before, before / study.folder / study.file.experiment, spec.name)
        if not then.equals(_attempts(THIS, study.folder / study.file.experiment, spec.name)):
            raise EvidenceError(
                f"{spec.name} acts otherwise than by the code in {before}, so {study.name} has "
                "to be run again"
            )
    words = ["git", "-C", str(before), "describe", "--always", "--dirty", "--abbrev=12"]
    commit = subprocess.run(words, capture_output=True, text=True, check=False).stdout.strip()
    made = {"was": run["declared"], "by": commit, "results": RESULTS_VERSION, "reason": reason}
    stamps = [*run.get("stamps", ()), made]
    write_run(study, {**run, **as_declared(study), "stamps": stamps})


def _units_of(study: Study) -> dict[str, set[int]]:
    """Numbers of the units that the study asks for, by learner."""
    if networks := study.file.networks:
        return {label: {*networks.seeds} for label in study.learners}
    return {spec.name: {*range(spec.subjects)} for spec in study.asked.learners}


def _attempts(checkout: Path, experiment: Path, learner: str) -> pd.DataFrame:
    """The attempts of a learner by the code of a checkout, in a process of its own."""
    with tempfile.TemporaryDirectory() as out:
        done = subprocess.run(
            [sys.executable, "-P", __file__, experiment.absolute(), learner, out],
            env={**os.environ, "PYTHONPATH": f"{checkout}{os.pathsep}{checkout / 'learners'}"},
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            reason = done.stderr.strip().rpartition("\n")[2]
            raise EvidenceError(f"{learner} cannot play by the code in {checkout}: {reason}")
        columns = [name for name in record_schema().names if name != "wall_time"]
        attempts: pd.DataFrame = Store(out).record(columns)[0].to_pandas()
        return attempts


def play_once(experiment: str, learner: str, out: str) -> None:
    """Let one subject go once through the rooms of the first condition that a learner can play."""
    asked = read_experiment(experiment)
    cell = next(cell for cell in asked.cells() if cell.spec.name == learner)
    once = replace(cell.spec.protocol, baseline_loops=1, train_loops=1, test_loops=1)
    spec = replace(cell.spec, subjects=1, protocol=once)
    ol.compare(replace(asked, conditions=(cell.condition,), learners=(spec,)), out=out, workers=0)


if __name__ == "__main__":
    play_once(*sys.argv[1:])
