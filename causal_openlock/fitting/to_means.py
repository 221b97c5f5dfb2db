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
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, attempts_to_solve
from causal_openlock.analysis.plots import style
from causal_openlock.comparison.progress_bar import counting
from causal_openlock.contract.checks import failures_of
from causal_openlock.contract.registry import create
from causal_openlock.experiment.condition import PAPER_CONDITIONS, find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.files.atomic import write_bytes, write_text
from causal_openlock.files.checksums import json_bytes
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting.plan import Chosen, FitSettings, Plan
from causal_openlock.fitting.search import NONE, Tried, at_bound, search, without_effect
from causal_openlock.fitting.steps import SEEDS, begin, fitting_in, steps
from causal_openlock.paper.likeness import (
    PUBLISHED_MODEL,
    distance,
    effects_of,
    points_of,
    points_of_model,
)
from causal_openlock.paper.likeness_section import draw_points
from causal_openlock.paper.noise_ceiling import (
    CURVE,
    CURVE_NUMBERS,
    misfit,
    noise_ceiling,
    null_curve,
)
from causal_openlock.paper.published import model, people

FILE = "fit.json"  #: file of a finished fit
TARGETS = {"people": "people", "model": "the published model"}
"""Targets of a fit, in words: whose published means it is fitted to."""
PARTS = ("fitted", "held out", "all 14 points")
"""The points that are fitted to, the others, and all."""
CHUNK = 10  #: subjects that are played at once


def means_plan(plan: Plan) -> Plan:
    """A plan with the usual settings of a fit to means.

    Raises:
        OpenLockError: If nothing of this name can be held out.
    """
    given = {name: getattr(plan.fit, name) for name in plan.fit.model_fields_set}
    plan = replace(plan, fit=FitSettings(**{"hold_out": "transfer", "candidates": 60, **given}))
    plan.require_hold_out(("transfer", "none"))
    return plan


def play(
    learner: str, parameters: dict[str, Any], condition: str, subjects: range, seed: int
) -> pd.DataFrame:
    """Play in one of the paper's conditions, under the human protocol.

    Returns:
        As :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives it.
    """
    room, human = find_condition(condition), PROTOCOLS["human"]
    session = Session(room, human, subjects, seed=seed, learner=learner, experiment="fit")
    with failures_of(learner):
        trials = attempts_to_solve(session.play(create(learner, parameters)))
    return trials.astype(dict.fromkeys(("learner", "condition", "protocol", "phase"), str))


def points_towards(trials: pd.DataFrame, target: str) -> pd.DataFrame:
    """Means of a learner next to those of a target, one of :data:`TARGETS`."""
    return points_of(trials, model() if target == "model" else people())


def parts_of(points: pd.DataFrame, hold_out: str) -> list[pd.DataFrame]:
    """The points that are fitted to, those held out (``transfer`` or ``none``), and all."""
    out = points["condition"].isin(list(TRANSFERS)) & (hold_out == "transfer")
    return [points[~out], points[out], points]


@dataclass(frozen=True)
class MeansFit:
    """A finished fit."""

    plan: Plan
    tried: list[Tried]  #: the candidates, with their distances on the points fitted to
    again: dict[int, float]  #: of the best, by number, with more subjects and another seed
    best: int  #: number of the nearest of these, the fitted learner
    idle: tuple[str, ...]  #: parameters that make no difference around it
    trials: pd.DataFrame  #: what it did in all six conditions with a fresh seed

    @property
    def entry(self) -> dict[str, Any]:
        """The fitted learner, for an experiment file."""
        return self.plan.entry(self.tried[self.best].chosen)

    @property
    def effects(self) -> pd.DataFrame:
        """What people show, from :func:`~causal_openlock.paper.likeness.effects_of`."""
        return effects_of(points_of(self.trials), self.trials)

    def table(self) -> pd.DataFrame:
        """All candidates, the nearest first.

        Columns are ``number``, their parameters, ``rmse``, ``again``, and the names of parameters
        ``at_bound`` and ``without_effect`` (of the fitted learner alone), or ``none``.
        """
        ranges = self.plan.ranges
        rows = [
            {"number": number, **chosen, "rmse": rmse, "again": self.again.get(number, np.nan),
             "at_bound": " ".join(at_bound(ranges, chosen)) or NONE,
             "without_effect": " ".join(self.idle if number == self.best else ()) or NONE}
            for number, (chosen, rmse) in enumerate(self.tried)
        ]  # fmt: skip
        return pd.DataFrame(rows).sort_values(["rmse", "number"], ignore_index=True)

    def compared(self) -> tuple[pd.DataFrame, pd.DataFrame]:
        """Distances from the target in attempts, and whether sampling error explains them.

        A row for the fitted learner and, if it is fitted to people, for other models; the perfect
        model has as many subjects and fitted numbers. Columns are :data:`PARTS`.
        """
        plan, target, hold_out = self.plan, self.plan.fit.target, self.plan.fit.hold_out
        searched = len(plan.ranges)
        own = points_towards(self.trials, target), (searched, 0, searched)
        models: dict[str, tuple[pd.DataFrame, tuple[int | None, ...]]] = {plan.fitted_name: own}
        if target == "people":
            models[PUBLISHED_MODEL] = points_of_model(), (0, 0, 0)
            # How many of the curve's numbers count in a part of the points is not known.
            models[CURVE] = null_curve(), (None, None, CURVE_NUMBERS)
        distances, misfits = {}, {}
        for name, (points, numbers) in models.items():
            parts = parts_of(points, hold_out)
            distances[name] = [distance(part)[0] for part in parts]
            fits = zip(parts, numbers, strict=True)
            misfits[name] = ["" if many is None else misfit(part, many).in_words
                             for part, many in fits]  # fmt: skip
        fitted = zip(parts_of(own[0], hold_out), own[1], strict=True)
        distances["perfect model"] = [noise_ceiling(part, many).both for part, many in fitted]
        framed = partial(pd.DataFrame.from_dict, orient="index", columns=PARTS)
        return framed(distances), framed(misfits)

    def write(self, folder: Path) -> None:
        """Write the fit, with all that decided it, into a folder.

        The files are ``fit.json``, ``experiment.yaml``, which plays the fitted learner and the
        plain one, ``candidates.csv``, ``points.csv``, ``effects.csv`` and ``fit.svg``.

        Raises:
            OpenLockError: If they cannot be written.
        """
        plan, label, effects = self.plan, self.plan.fitted_name, self.effects
        done = [{"number": number, "chosen": chosen, "rmse": rmse}
                for number, (chosen, rmse) in enumerate(self.tried)]  # fmt: skip
        again = {str(number): rmse for number, rmse in sorted(self.again.items())}
        about = {"plan": plan.as_dict(), "done": done, "again": again}
        write_bytes(folder / FILE, json_bytes({**about, "idle": {str(self.best): self.idle}}))
        experiment = {
            "name": label,
            "title": f"The learner {plan.learner}, fitted to {TARGETS[plan.fit.target]}",
            "seed": plan.fit.seed + SEEDS,
            "protocol": "human",
            "subjects": plan.fit.final_subjects,
            "conditions": list(PAPER_CONDITIONS),
            "learners": [plan.learner, self.entry],
        }
        write_text(folder / "experiment.yaml", dump_yaml(experiment))
        points = points_of(self.trials).assign(learner=label)
        out = points.index.isin(parts_of(points, plan.fit.hold_out)[1].index)
        write_text(folder / "candidates.csv", csv_of(self.table()))
        write_text(folder / "points.csv", csv_of(points.assign(held_out=out)))
        write_text(folder / "effects.csv", csv_of(effects))
        figure, published = Figure(), points_of_model()
        numbers = {label: len(plan.ranges)} if plan.fit.target == "people" else {}
        drawn = {label: points, PUBLISHED_MODEL: published}
        shown = {label: effects, PUBLISHED_MODEL: effects_of(published)}
        draw_points(drawn, shown, figure, numbers)
        style.save(figure, folder / "fit.svg")


def fit(
    plan: Plan, folder: Path, *, workers: int = 1, report: Callable[[str], None] = lambda step: None
) -> MeansFit:
    """Fit a learner to means by a :func:`means_plan`, or do the rest of a fit that was stopped.

    Raises:
        OpenLockError: If the folder cannot be written to.
        StoreError: If another process fits in the folder.
        LearnerError: If the learner fails. Candidates that were done stay done.
    """
    how, hold_out, target = plan.fit, plan.fit.hold_out, plan.fit.target
    conditions = BASELINES if hold_out == "transfer" else PAPER_CONDITIONS
    count, tell = itertools.count(1), counting(report, "sets of parameters are tried")
    with fitting_in(folder, workers) as pool:

        def begin_to_play(
            chosen: Chosen, conditions: Sequence[str], subjects: int, seed: int
        ) -> Callable[[], pd.DataFrame]:
            waiting = [
                begin(pool, play, plan.learner, plan.parameters(chosen), name,
                      range(first, min(first + CHUNK, subjects)), seed)
                for name in conditions
                for first in range(0, subjects, CHUNK)
            ]  # fmt: skip
            return lambda: pd.concat([trials() for trials in waiting], ignore_index=True)

        def distances(sets: Sequence[Chosen], subjects: int, seed: int) -> Iterator[float]:
            about = {"space": plan.as_dict()["space"], "hold_out": hold_out, "target": target,
                     "subjects": subjects, "seed": seed}  # fmt: skip

            def start(chosen: Chosen) -> Callable[[], float]:
                trials = begin_to_play(chosen, conditions, subjects, seed)
                return lambda: distance(parts_of(points_towards(trials(), target), hold_out)[0])[0]

            jobs = [({**about, "chosen": dict(chosen)}, partial(start, chosen)) for chosen in sets]
            return steps(folder, jobs, float)

        def losses(sets: Sequence[Chosen]) -> Iterator[float]:
            for rmse in distances(sets, how.subjects, how.seed):
                tell(next(count), how.candidates)
                yield rmse

        tried = search(plan.ranges, losses, how.candidates, how.seed)
        report("the best few again")
        nearest = sorted(range(len(tried)), key=lambda number: tried[number].loss)[: how.finalists]
        sets = [tried[number].chosen for number in nearest]
        again = dict(zip(nearest, distances(sets, how.final_subjects, how.seed + 1), strict=True))
        number = min(again, key=lambda number: (again[number], number))
        best = tried[number].chosen
        report("which parameters make a difference")
        idle = without_effect(
            plan.ranges, best, lambda chosen: next(distances([chosen], how.subjects, how.seed + 1))
        )
        report("the best, on a fresh seed")
        trials = begin_to_play(best, PAPER_CONDITIONS, how.final_subjects, how.seed + 2)()
    return MeansFit(plan, tried, again, number, idle, trials)
