"""The steps of a recovery: simulate subjects, let learners predict them, fit parameters to them.

Each step continues where it stopped, from the files in its folder.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from causal_openlock.comparison.comparing import play
from causal_openlock.comparison.progress_bar import Show
from causal_openlock.contract.registry import changed_parameters, learner_class
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.declare import Experiment, LearnerSpec
from causal_openlock.experiment.making import make_experiment
from causal_openlock.fitting.recovery import drawn_sets, made_with, recovered, space_of
from causal_openlock.fitting.space import (
    FitSettings,
    Plan,
    SearchSpace,
    parse_range,
    search_space,
)
from causal_openlock.fitting.to_actions import WHOLE, FitJob, fit_all
from causal_openlock.running.workers import available_cores
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.teacher_forcing import recorded_subjects, score_actions
from causal_openlock.storage.store import Store

SIMULATED = "simulated"
"""Folder of the subjects."""


@dataclass(frozen=True)
class ToRecover:
    """Size and settings of a recovery.

    Attributes:
        draws: The most copies to ask of a learner without probabilities.
        lapse: The share of actions that are taken to be random.
        sets: Sets of parameters to recover.
        each: Subjects in each condition that share a set.
        candidates: Settings to try for each fit.
    """

    draws: int = 128
    lapse: float = LAPSE
    sets: int = 20
    each: int = 1
    candidates: int = 160


@dataclass(frozen=True)
class Running:
    """Workers and callbacks of a recovery.

    Attributes:
        workers: Number of processes; 0 for this one, by default one for each core.
        warn: Called with a sentence on what a user should know.
        show: Called with the progress of simulated subjects.
        report: Called with how many parts are scored, or fitted, of how many.
    """

    workers: int | None = None
    warn: Callable[[str], None] = lambda _: None
    show: Show | None = None
    report: Callable[[int, int], None] = lambda done, total: None

    @property
    def processes(self) -> int:
        """Number of processes that work, this one included."""
        return available_cores() if self.workers is None else max(1, self.workers)

    def simulated(self, experiment: Experiment, folder: Path) -> Store:
        """The subjects of an experiment, which are played if they are not there."""
        store = Store(folder / SIMULATED)
        if failed := play(experiment, store.folder, workers=self.workers, warn=self.warn,
                          progress=self.show):  # fmt: skip
            raise failed
        return store


def is_another_twentieth(done: int, total: int) -> bool:
    """Whether a log that has a line for each twentieth has one now.

    >>> [done for done in range(1, 61) if is_another_twentieth(done, 60)][:3]
    [3, 6, 9]
    """
    return done * 20 // total > (done - 1) * 20 // total


def predicted(
    experiment: Experiment, folder: Path, size: ToRecover, running: Running
) -> pd.DataFrame:
    """Simulate subjects of every learner, and let all predict all.

    Returns:
        As :func:`~causal_openlock.scoring.teacher_forcing.score_actions`.

    Raises:
        CellsFailed: If some subjects could not be simulated.
        LearnerError: If a learner cannot be put in another's place.
    """
    for spec in experiment.learners:  # before hours of work
        if not learner_class(spec.learner).learns_from_others:
            raise LearnerError(
                f"{spec.name} learns from its own actions alone, so that it cannot predict others; "
                "leave it out"
            )
    return score_actions(
        *running.simulated(experiment, folder).record(),
        list(experiment.learners),
        size.lapse,
        draws=Draws(most=size.draws),
        workers=running.processes,
        report=running.report,
    )


def searched(spec: LearnerSpec, ranges: Sequence[str] = ()) -> SearchSpace:
    """Search space of a learner as it is set.

    Args:
        spec: The learner.
        ranges: As on the command line, ``name=low:high``; by default those of its search space.

    Raises:
        OpenLockError: If there are none, or they do not fit the learner.
    """
    if ranges:
        wanted = dict(map(parse_range, ranges))
        set_to = changed_parameters(spec.learner, spec.parameters)
        fixed = {name: value for name, value in set_to.items() if name not in wanted}
        return search_space(spec.learner, wanted, fixed)
    space = space_of(spec)
    if space is None:
        raise LearnerError(
            f"{spec.name} has no search space of its own as it is set, so its parameters cannot "
            "be recovered; give ranges, such as --search name=low:high, or take bayes with the "
            "policy thompson, or theory_based"
        )
    return space


def parameters_recovered(
    spec: LearnerSpec,
    experiment: Experiment,
    folder: Path,
    size: ToRecover,
    running: Running,
    space: SearchSpace | None = None,
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Simulate subjects with drawn parameters of a learner, and fit its parameters to them.

    Args:
        spec: The learner.
        experiment: What subjects play.
        folder: Where it is kept.
        size: How many sets, and how they are fitted.
        running: How it is run.
        space: What is searched; by default what :func:`searched` says.

    Returns:
        As :func:`~causal_openlock.fitting.recovery.recovered`.

    Raises:
        CellsFailed: If some subjects could not be simulated.
        LearnerError: If the learner has no search space of its own.
    """
    space = space or searched(spec)
    truth = drawn_sets(space, size.sets, experiment.seed)
    made = make_experiment(
        list(experiment.conditions),
        made_with(space, truth, size.each),
        protocol=spec.protocol,
        seed=experiment.seed,
    )
    record, played = running.simulated(made, folder).record()
    settings = FitSettings(
        lapse=size.lapse, hold_out="none", candidates=size.candidates, seed=experiment.seed
    )
    plan = Plan(space, settings)
    jobs = [
        FitJob(one.name, tuple(recorded_subjects(record, played, [one.name])), WHOLE, plan)
        for one in made.learners
    ]

    def report(done: int, _: int) -> None:
        running.report(done, len(jobs))

    fits = fit_all(jobs, folder, workers=running.processes, report=report)
    return recovered(truth, fits, space)
