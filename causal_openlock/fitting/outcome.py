"""The result of a fit: tables, a figure, and an experiment that plays the fitted learner."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.experiment.declare import PAPER_CONDITIONS
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting.candidates import Fit
from causal_openlock.fitting.objective import TARGETS, Score, held_out, towards
from causal_openlock.paper.likeness import (
    PUBLISHED_MODEL,
    effects_of,
    points_of,
    points_of_model,
)
from causal_openlock.paper.likeness_figure import draw_points
from causal_openlock.paper.noise_ceiling import misfit, noise_ceiling, null_curves


@dataclass(frozen=True)
class FittedLearner:
    """The learner with the parameters that a fit found."""

    label: str
    learner: str
    parameters: dict[str, Any]  #: that differ from the defaults
    score: Score  #: on a seed that nothing was chosen by
    model: Score  #: of the published model, of which nothing was fitted here
    perfect: Score  #: in means, of a perfect model with as many subjects and fitted numbers
    misfits: dict[str, list[str]]  #: in means, by model: in words, of what :class:`Score` has
    points: pd.DataFrame  #: means at people's points; held_out: whether it was not fitted to them
    effects: pd.DataFrame  #: that people show, tested; like_people: whether the sign is people's

    def entry(self) -> dict[str, Any]:
        """The fitted learner as an entry of an experiment file."""
        return {"learner": self.learner, "name": self.label, "parameters": self.parameters}


def fitted_learner(fitted: Fit, trials: pd.DataFrame) -> FittedLearner:
    """The fitted learner, from what :func:`~causal_openlock.fitting.candidates.fit` returns."""
    plan = fitted.plan
    label = f"{plan.space.learner.rpartition(':')[2]}_fitted"
    points = points_of(trials)
    out = held_out(points, plan.hold_out)
    aim, number = towards(points, plan.target), len(plan.space.ranges)
    parts = (aim[~out], number), (aim[out], 0), (aim, number)
    misfits = {label: [misfit(*part).in_words for part in parts]}
    if plan.target == "people":
        model, curves = points_of_model(), null_curves()
        own = (model[~out], model[out], model)
        misfits[PUBLISHED_MODEL] = [misfit(part).in_words for part in own]
        # How many of a curve's numbers count in a part of the points is not known.
        misfits |= {name: ["", "", misfit(curve.points, len(curve.numbers)).in_words]
                    for name, curve in curves.items()}  # fmt: skip
    return FittedLearner(
        label=label,
        learner=plan.space.learner,
        parameters=plan.space.parameters(fitted.best.chosen),
        score=plan.score(points),
        model=plan.score(points_of_model()),
        perfect=Score(*(noise_ceiling(*part).both for part in parts)),
        misfits=misfits,
        points=points.assign(learner=label, held_out=out),
        effects=effects_of(points, trials),
    )


def write_fitted_learner(fitted: Fit, found: FittedLearner, folder: Path | str) -> list[Path]:
    """Write the result of a fit into a folder.

    Returns:
        The files: ``experiment.yaml``, which plays the fitted learner and the plain one,
        ``candidates.csv``, ``points.csv``, ``effects.csv`` and ``fit.svg``.

    Raises:
        OpenLockError: If they cannot be written.
    """
    folder, plan = Path(folder), fitted.plan
    experiment = {
        "name": found.label,
        "title": f"The learner {plan.space.learner}, fitted to {TARGETS[plan.target]}",
        "seed": plan.seed + 3,
        "protocol": "human",
        "subjects": plan.final_subjects,
        "conditions": list(PAPER_CONDITIONS),
        "learners": [plan.space.learner, found.entry()],
    }
    texts = {
        "experiment.yaml": dump_yaml(experiment),
        "candidates.csv": csv_of(fitted.table()),
        "points.csv": csv_of(found.points),
        "effects.csv": csv_of(found.effects),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    figure, own = Figure(), found.points.drop(columns="held_out")
    model = points_of_model()
    points = {found.label: own, PUBLISHED_MODEL: model}
    effects = {found.label: found.effects, PUBLISHED_MODEL: effects_of(model)}
    fitted_numbers = {found.label: len(plan.space.ranges)} if plan.target == "people" else {}
    draw_points(points, effects, figure, fitted_numbers)
    style.save(figure, folder / "fit.svg")
    return [*(folder / name for name in texts), folder / "fit.svg"]
