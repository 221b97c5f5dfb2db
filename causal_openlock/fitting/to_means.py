"""Fitting to published means: with which parameters do a learner's means come nearest to people's?

The loss is a distance: the root mean square of differences in attempts, over fourteen points
(:mod:`~causal_openlock.paper.likeness`). Of a theory that claims to be the published model one may
ask instead whether it *is* that model: with the target ``model`` the fourteen means are those that
were published of it.

A fit that is judged by what it was fitted to says little. So some points can be held out of the
search, which plays only the conditions that it needs:

* ``transfer``: fitted to the ten points of the baselines; the four transfer tests are predicted.
* ``none``: fitted to all.

All candidates meet the same rooms and the same random numbers, so that their parameters alone make
the difference. Distances are of means over subjects, and the least of many noisy numbers is too
good. So the best few candidates are played again with more subjects and another seed, which decides
between them; and the numbers that are reported come from a third seed that nothing was chosen by.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from causal_openlock.analysis.measures import TRANSFERS, attempts_to_solve
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.results.references import POINT
from causal_openlock.contract.registry import create
from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.declare import PAPER_CONDITIONS, PROTOCOLS, find_condition
from causal_openlock.experiment.session import Session
from causal_openlock.files.atomic import write_bytes, write_text
from causal_openlock.files.checksums import json_bytes
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting.search import Tried, search, without_effect
from causal_openlock.fitting.space import Chosen, FitSettings, Plan, SearchSpace
from causal_openlock.fitting.steps import SEEDS, fitting_in, starting, steps
from causal_openlock.paper.likeness import (
    PUBLISHED_MODEL,
    distance,
    effects_of,
    points_of,
    points_of_model,
    published_points,
)
from causal_openlock.paper.likeness_figure import draw_points
from causal_openlock.paper.noise_ceiling import misfit, noise_ceiling, null_curves
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.wording import nearest

FILE = "fit.json"
"""File of a finished fit."""
TARGETS = {"people": "people", "model": "the published model"}
"""Targets of a fit, in words: whose published means it is fitted to."""
PARTS = ("fitted", "held out", "all 14 points")
"""The points that are fitted to, the others, and all: columns of an :class:`Outcome`."""
CHUNK = 10
"""Subjects that are played at once."""


def means_plan(space: SearchSpace, fit: FitSettings) -> Plan:
    """The plan of a fit to means.

    Raises:
        OpenLockError: If there is no such target, or nothing of this name can be held out.
    """
    if fit.target not in TARGETS:
        raise OpenLockError(f"a fit has no target {fit.target!r}; {nearest(fit.target, TARGETS)}")
    return Plan(space, fit, hold_outs=("transfer", "none"), tries=60)


# -- what a candidate does ------------------------------------------------------------------------


class Job(NamedTuple):
    """Subjects of a learner in one of the paper's conditions, from number ``first`` on.

    ``parameters`` are those that differ from the learner's defaults.
    """

    learner: str
    parameters: dict[str, Any]
    condition: str
    first: int
    subjects: int
    seed: int


def jobs(
    learner: str, parameters: dict[str, Any], conditions: Sequence[str], subjects: int, seed: int
) -> list[Job]:
    """The jobs of one candidate."""
    return [
        Job(learner, parameters, name, first, min(CHUNK, subjects - first), seed)
        for name in conditions
        for first in range(0, subjects, CHUNK)
    ]


def play(job: Job) -> pd.DataFrame:
    """Play under the human protocol.

    Returns:
        As :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives it.
    """
    session = Session(
        find_condition(job.condition),
        PROTOCOLS["human"],
        range(job.first, job.first + job.subjects),
        seed=job.seed,
        learner=job.learner,
        experiment="fit",
    )
    return attempts_to_solve(session.play(create(job.learner, job.parameters)))


def joined(played: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """The trials of several jobs of one candidate."""
    names = dict.fromkeys(("learner", "condition", "protocol", "phase"), str)
    return pd.concat([part.astype(names) for part in played], ignore_index=True)


# -- how far that is from people ------------------------------------------------------------------


class Score(NamedTuple):
    """Distance of a learner from people, in attempts."""

    fitted: float  #: on the points that it is fitted to
    held_out: float  #: on the others; NaN if it did not play them
    all: float


def held_out(points: pd.DataFrame, how: str) -> BoolArray:
    """``[N]`` which points are held out of a fit: the tests of transfer, or none."""
    tests: BoolArray = points["condition"].isin(list(TRANSFERS)).to_numpy(bool)
    return tests & (how == "transfer")


def conditions_to_fit(how: str) -> tuple[str, ...]:
    """The conditions that have any point to fit."""
    points = published_points()
    fitted = points[~held_out(points, how)]
    return tuple(name for name in PAPER_CONDITIONS if (fitted["condition"] == name).any())


def towards(points: pd.DataFrame, target: str) -> pd.DataFrame:
    """The points, with what the target did in the place of what people did.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        target: One of :data:`TARGETS`.
    """
    names = {f"{target}_{name}": f"people_{name}" for name in ("subjects", "mean", "se")}
    theirs = published_points()[[*POINT, *names]].rename(columns=names)
    return points.drop(columns=[*names.values()]).merge(theirs, on=POINT, how="left")


def score(points: pd.DataFrame, how: str, target: str = "people") -> Score:
    """Distance of one learner from people, or from the published model.

    Args:
        points: From :func:`~causal_openlock.paper.likeness.points_of`.
        how: What is held out, ``transfer`` or ``none``.
        target: One of :data:`TARGETS`.
    """
    points = towards(points, target)
    out = held_out(points, how)
    return Score(*(distance(part)[0] for part in (points[~out], points[out], points)))


# -- the fit --------------------------------------------------------------------------------------


@dataclass(frozen=True)
class MeansFit:
    """A finished fit.

    Attributes:
        plan: Its settings.
        tried: The candidates, with their distances on the points that they are fitted to.
        again: Distances of the best, by number, played with more subjects and another seed.
        idle: Parameters that make no difference around the best.
        trials: What the best did in all six conditions with a fresh seed, from
            :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
    """

    plan: Plan
    tried: list[Tried]
    again: dict[int, float]
    idle: tuple[str, ...]
    trials: pd.DataFrame

    @property
    def best(self) -> int:
        """Number of the candidate nearest to people, among those played again."""
        return min(self.again, key=lambda number: (self.again[number], number))

    def table(self) -> pd.DataFrame:
        """All candidates, the nearest first: ``number``, their parameters, ``rmse``, ``again``."""
        table = pd.DataFrame([tried.chosen for tried in self.tried])
        table.insert(0, "number", range(len(table)))
        table["rmse"] = [tried.loss for tried in self.tried]
        table["again"] = table["number"].map(self.again).astype(float)
        return table.sort_values(["rmse", "number"], ignore_index=True)

    def store(self, path: Path) -> None:
        """Write the fit, with all that decided it, as JSON."""
        done = [
            {"number": number, "chosen": chosen, "rmse": rmse}
            for number, (chosen, rmse) in enumerate(self.tried)
        ]
        again = {str(number): rmse for number, rmse in sorted(self.again.items())}
        idle = {str(self.best): self.idle}
        about = {"plan": self.plan.as_dict(), "done": done, "again": again, "idle": idle}
        write_bytes(path, json_bytes(about))


class Playing:
    """Plays candidates of a plan; how far they are from the target is stored in a folder.

    Args:
        plan: The settings of the fit.
        folder: Its folder.
        pool: Processes to play in; by default this one plays.
        report: Called with each step, in words.
    """

    def __init__(
        self, plan: Plan, folder: Path, pool: Executor | None, report: Callable[[str], None]
    ) -> None:
        self._plan, self._folder, self._report = plan, folder, report
        self._start = starting(play, pool)
        self._conditions = conditions_to_fit(plan.hold_out)

    def begin(
        self, chosen: Chosen, conditions: Sequence[str], subjects: int, seed: int
    ) -> Callable[[], pd.DataFrame]:
        """Begin to play a candidate; what is returned waits for the trials."""
        space = self._plan.space
        parts = jobs(space.learner, space.parameters(chosen), conditions, subjects, seed)
        waiting = [self._start(job) for job in parts]
        return lambda: joined([trials() for trials in waiting])

    def distances(
        self, sets: Sequence[Chosen], subjects: int, seed: int, step: str
    ) -> Iterator[float]:
        """Distances of some candidates on the points that they are fitted to."""
        space, hold_out, target = self._plan.space, self._plan.hold_out, self._plan.fit.target
        about = {"space": space.as_dict(), "hold_out": hold_out, "target": target, "seed": seed,
                 "subjects": subjects}  # fmt: skip

        def start(chosen: Chosen) -> Callable[[], float]:
            trials = self.begin(chosen, self._conditions, subjects, seed)
            return lambda: score(points_of(trials()), hold_out, target).fitted

        asked = [({**about, "chosen": dict(chosen)}, chosen) for chosen in sets]
        for rmse in steps(self._folder, asked, start, float):
            self._report(step)
            yield rmse


def fit(
    plan: Plan,
    folder: Path | str,
    *,
    workers: int = 1,
    report: Callable[[str], None] = lambda step: None,
) -> MeansFit:
    """Fit a learner to means, or do the rest of a fit that was stopped.

    Args:
        plan: Its settings, from :func:`means_plan`.
        folder: Where distances of candidates are stored.
        workers: How many processes play; with one it is this process.
        report: Called with each step, in words.

    Raises:
        OpenLockError: If the folder cannot be written to.
        StoreError: If another process fits in the folder.
        LearnerError: If the learner fails. Candidates that were done stay done.
    """
    how, ranges, seed, count = plan.fit, plan.space.ranges, plan.fit.seed, itertools.count(1)
    with fitting_in(Path(folder), workers) as pool:
        playing = Playing(plan, Path(folder), pool, report)

        def search_step(sets: Sequence[Chosen]) -> Iterator[float]:
            for rmse in playing.distances(sets, how.subjects, seed, "searching"):
                report(f"{next(count)} of up to {plan.candidates} sets of parameters tried")
                yield rmse

        tried = search(ranges, search_step, plan.candidates, seed)
        nearest = sorted(range(len(tried)), key=lambda number: tried[number].loss)[: how.finalists]
        sets = [tried[number].chosen for number in nearest]
        distances = playing.distances(sets, how.final_subjects, seed + 1, "the best few again")
        again = dict(zip(nearest, distances, strict=True))
        best = tried[min(again, key=lambda number: (again[number], number))].chosen

        def loss(chosen: Chosen) -> float:
            step = "which parameters make a difference"
            return next(playing.distances([chosen], how.subjects, seed + 1, step))

        idle = without_effect(ranges, best, loss)
        report("the best, on a fresh seed")
        trials = playing.begin(best, PAPER_CONDITIONS, how.final_subjects, seed + 2)()
        fitted = MeansFit(plan, tried, again, idle, trials)
        fitted.store(Path(folder) / FILE)
    return fitted


# -- what comes of it -----------------------------------------------------------------------------


class Outcome(NamedTuple):
    """The fitted learner on a seed that nothing was chosen by.

    Attributes:
        entry: The learner, for an experiment file.
        distances: A row for it and for models to compare it with: distances from the target, root
            mean square in attempts. The perfect model has as many subjects and fitted numbers.
        misfits: Whether sampling error explains them, in words.
        points: Its means, from :func:`~causal_openlock.paper.likeness.points_of`; ``held_out`` says
            which it was not fitted to.
        effects: What people show, from :func:`~causal_openlock.paper.likeness.effects_of`.
    """

    entry: dict[str, Any]
    distances: pd.DataFrame
    misfits: pd.DataFrame
    points: pd.DataFrame
    effects: pd.DataFrame


def outcome_of(fitted: MeansFit) -> Outcome:
    """Compare a fitted learner with its target, and with other models."""
    plan, space = fitted.plan, fitted.plan.space
    label, hold_out, target = space.fitted_name, plan.hold_out, plan.fit.target
    points = points_of(fitted.trials)
    aim, out, fits = towards(points, target), held_out(points, hold_out), len(space.ranges)
    parts = (aim[~out], fits), (aim[out], 0), (aim, fits)
    distances = {label: score(points, hold_out, target)}
    misfits = {label: [misfit(*part).in_words for part in parts]}
    if target == "people":
        model = points_of_model()
        distances[PUBLISHED_MODEL] = score(model, hold_out)
        misfits[PUBLISHED_MODEL] = [misfit(p).in_words for p in (model[~out], model[out], model)]
    distances["perfect model"] = Score(*(noise_ceiling(*part).both for part in parts))
    for name, curve in null_curves().items() if target == "people" else ():
        distances[name] = score(curve.points, hold_out)
        # How many of a curve's numbers count in a part of the points is not known.
        misfits[name] = ["", "", misfit(curve.points, len(curve.numbers)).in_words]
    chosen = space.parameters(fitted.tried[fitted.best].chosen)
    return Outcome(
        {"learner": space.learner, "name": label, "parameters": chosen},
        pd.DataFrame.from_dict(distances, orient="index", columns=PARTS),
        pd.DataFrame.from_dict(misfits, orient="index", columns=PARTS),
        points.assign(learner=label, held_out=out),
        effects_of(points, fitted.trials),
    )


def write_outcome(fitted: MeansFit, outcome: Outcome, folder: Path | str) -> None:
    """Write the result of a fit into a folder.

    The files are ``experiment.yaml``, which plays the fitted learner and the plain one,
    ``candidates.csv``, ``points.csv``, ``effects.csv`` and ``fit.svg``.

    Raises:
        OpenLockError: If they cannot be written.
    """
    folder, plan, label = Path(folder), fitted.plan, outcome.entry["name"]
    experiment = {
        "name": label,
        "title": f"The learner {plan.space.learner}, fitted to {TARGETS[plan.fit.target]}",
        "seed": plan.fit.seed + SEEDS,
        "protocol": "human",
        "subjects": plan.fit.final_subjects,
        "conditions": list(PAPER_CONDITIONS),
        "learners": [plan.space.learner, outcome.entry],
    }
    write_text(folder / "experiment.yaml", dump_yaml(experiment))
    write_text(folder / "candidates.csv", csv_of(fitted.table()))
    write_text(folder / "points.csv", csv_of(outcome.points))
    write_text(folder / "effects.csv", csv_of(outcome.effects))
    figure, model = Figure(), points_of_model()
    points = {label: outcome.points.drop(columns="held_out"), PUBLISHED_MODEL: model}
    effects = {label: outcome.effects, PUBLISHED_MODEL: effects_of(model)}
    numbers = {label: len(plan.space.ranges)} if plan.fit.target == "people" else {}
    draw_points(points, effects, figure, numbers)
    style.save(figure, folder / "fit.svg")
