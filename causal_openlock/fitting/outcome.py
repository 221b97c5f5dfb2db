"""What came of a fit: tables, a figure, and an experiment that plays the fitted learner."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.report.sections.human_likeness import draw_points
from causal_openlock.analysis.results.people.human_likeness import (
    POINT,
    distance,
    effects_of,
    points_of,
    points_of_model,
)
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of
from causal_openlock.files.yaml_file import dump_yaml
from causal_openlock.fitting.objective import Score, held_out, score
from causal_openlock.fitting.study import Fit


@dataclass(frozen=True)
class Outcome:
    """The fitted learner.

    Attributes:
        label: What it is called.
        parameters: Those that differ from the learner's defaults.
        score: Its distance from people, on a seed that nothing was chosen by.
        model: The same of the published model, of which nothing was fitted here.
        points: Its means at people's points; ``held_out`` says which it was not fitted to.
        effects: Differences that people show, tested; ``like_people`` says whether its sign is
            people's.
    """

    label: str
    parameters: dict[str, Any]
    score: Score
    model: Score
    points: pd.DataFrame
    effects: pd.DataFrame


def outcome(fitted: Fit, trials: pd.DataFrame) -> Outcome:
    """The fitted learner, from what it did in all six conditions.

    Args:
        fitted: The fit.
        trials: From :func:`~causal_openlock.fitting.study.fit`.
    """
    plan = fitted.plan
    label = f"{plan.space.learner.rpartition(':')[2]}_fitted"
    points = points_of(trials)
    published = points_of_model()
    out = held_out(published, plan.hold_out)
    return Outcome(
        label=label,
        parameters=plan.space.parameters(fitted.best.chosen),
        score=score(trials, plan.hold_out),
        model=Score(
            distance(published[~out])[0], distance(published[out])[0], distance(published)[0]
        ),
        points=points.assign(learner=label, held_out=held_out(points, plan.hold_out)),
        effects=effects_of(points, trials),
    )


def entry(found: Outcome, learner: str) -> dict[str, Any]:
    """The fitted learner as an entry of an experiment file."""
    return {"learner": learner, "name": found.label, "parameters": found.parameters}


def write_outcome(fitted: Fit, found: Outcome, folder: Path | str) -> list[Path]:
    """Write what came of a fit.

    Args:
        fitted: The fit.
        found: From :func:`outcome`.
        folder: Where to.

    Returns:
        The files: ``experiment.yaml``, which plays the fitted learner beside the plain one,
        ``candidates.csv``, ``points.csv``, ``effects.csv``, ``fit.svg`` and ``fit.png``.

    Raises:
        OpenLockError: If they cannot be written.
    """
    folder, plan = Path(folder), fitted.plan
    experiment = {
        "name": found.label,
        "title": f"The learner {plan.space.learner}, fitted to people",
        "seed": plan.seed + 3,
        "protocol": "human",
        "subjects": plan.final_subjects,
        "conditions": list(PAPER_CONDITIONS),
        "learners": [plan.space.learner, entry(found, plan.space.learner)],
    }
    texts = {
        "experiment.yaml": dump_yaml(experiment),
        "candidates.csv": csv_of(fitted.table()),
        "points.csv": csv_of(found.points),
        "effects.csv": csv_of(found.effects),
    }
    for name, text in texts.items():
        write_text(folder / name, text)
    own = found.points[["learner", *POINT, *_NUMBERS]]
    drawing = draw_points([own, points_of_model()], effects={found.label: found.effects})
    style.save(drawing.figure, folder / "fit")
    return [*(folder / name for name in texts), folder / "fit.svg", folder / "fit.png"]


_NUMBERS = ("subjects", "mean", "se", "people_mean", "people_se")
