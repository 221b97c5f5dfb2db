"""Readers of what is made of results: scores, fits that predict, the status of a comparison."""

from __future__ import annotations

from contextlib import redirect_stdout
from io import StringIO
from pathlib import Path

from causal_openlock.cli.status import status
from causal_openlock.comparison.results import Results
from causal_openlock.experiment.building import make_experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.fitting.actions import FILE, ActionPlan, fit_all, jobs_of
from causal_openlock.fitting.predicting import read_fit, score_fits
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.running.runner import run
from causal_openlock.scoring.on_record import scores_on_record
from causal_openlock.scoring.scores import ACTIONS, FOLDER, score_learners
from causal_openlock.scoring.teacher_forcing import recorded_subjects
from causal_openlock.scoring.worst_predicted import failures, worst_attempts
from causal_openlock.storage.running_files import report_progress
from causal_openlock.storage.store import Store
from causal_openlock.world.room import positions_for

BRIEF = Protocol("brief", 4, stop_when_solved=True, baseline_trials=2)
LEARNERS = make_experiment(["CC3"], ["random"]).learners


def played(folder: Path) -> Path:
    """Two subjects of two trials, in a results folder; returns the file of their cell."""
    made = make_experiment(["CC3"], ["associative"], subjects=2, protocol=BRIEF, seed=5)
    run(made, folder, workers=0)
    (cell,) = (folder / "cells").glob("*.parquet")
    return cell


def scored(folder: Path) -> bytes:
    """The scores of a learner on these subjects."""
    score_learners(*Store(folder).record(), LEARNERS).save(folder / FOLDER)
    return (folder / FOLDER / ACTIONS).read_bytes()


def read_scores(folder: Path) -> object:
    """What the report makes of scores, but for figures."""
    results = Results.read(folder)
    positions = {
        one.name: max(map(positions_for, one.schemas)) for one in results.experiment.conditions
    }
    found = scores_on_record(results)
    for one in found.each.values():
        best = one.actions[one.actions["scored"] == one.ranking["scored"].iloc[0]]
        parts = failures(best, positions), worst_attempts(best, positions)
        drawn = one.attributed, one.over("condition", "trial")
        assert parts, drawn
    return found


def predict(folder: Path) -> object:
    """Score the subjects of a results folder."""
    return score_learners(*Store(folder).record(), LEARNERS).ranking


def fitted(folder: Path) -> bytes:
    """A fit to the actions of these subjects."""
    space = search_space("associative", {"temperature": Range(0.02, 2.0, log=True)})
    plan = ActionPlan(space, candidates=2, restarts=1, moves=0)
    fit_all(jobs_of(recorded_subjects(*Store(folder).record()), plan, False), folder / "fit")
    return (folder / "fit" / FILE).read_bytes()


def predict_fitted(folder: Path) -> object:
    """Let what was fitted predict."""
    fit = read_fit(folder / "fit", ["associative"])
    return score_fits(*Store(folder).record(), [fit]).ranking


def reported(cell: Path) -> bytes:
    """What a worker says of a cell that is being played."""
    report_progress(cell, 0.25, 12.5)
    return cell.with_suffix(".progress").read_bytes()


def standing(folder: Path) -> object:
    """How the comparison stands, in the words of the command."""
    words = StringIO()
    with redirect_stdout(words):
        status(folder)
    return words.getvalue()
