"""Subjects of every theory, simulated, and the likelihood of what they did under all theories.

Before any person is asked, subjects are simulated from every theory, and every theory predicts the
actions of all of them (Wilson & Collins 2019); :mod:`~causal_openlock.design.telling` says what
that tells.

Theories are the learners of an experiment. Their parameters may be known: they make and predict
subjects as declared. Those of people are not known. So every parameter for which its learner's
search space has a range, and whose value lies within it, can be unknown as well: each subject draws
its own value from that range, and a theory's likelihood is averaged over other draws. (A value
outside is set, as in an ablation.) Rooms, and draws of parameters that theories share, are the same
for all theories and in all conditions.
"""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.contract.checks import failures_of
from causal_openlock.contract.registry import learner_class
from causal_openlock.design import COPIES
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import Cell, Experiment, LearnerSpec
from causal_openlock.fitting.plan import Range, bundled_plan
from causal_openlock.fitting.steps import begin, fitting_in, steps
from causal_openlock.running.worker import made
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.recorded import Recorded, recorded_subjects
from causal_openlock.scoring.teacher_forcing import known_learners, score_part
from causal_openlock.wording import joined
from causal_openlock.world.randomness import generators

NATS = "nats "  #: before the name of a theory: the log-likelihood of what a subject did under it
TOGETHER = 20
"""Subjects that are simulated, predicted and stored together where parameters are known."""


def unknown(theory: LearnerSpec) -> dict[str, Range]:
    """The ranges of a theory's unknown parameters: those whose value lies in a range."""
    plan = bundled_plan(theory.learner)
    return {
        name: bounds
        for name, bounds in (plan.ranges if plan else {}).items()
        if bounds.low <= theory.parameters[name] <= bounds.high
    }


def drawn(theory: LearnerSpec, seed: int, use: str, number: int) -> LearnerSpec:
    """A theory with its unknown parameters drawn; each ``use`` has draws of its own."""
    parameters = dict(theory.parameters)
    for name, bounds in unknown(theory).items():
        (generator,) = generators(seed, f"{use}/{name}", [number])
        parameters[name] = bounds.at(generator.random())
    return replace(theory, parameters=parameters)


def simulated(cell: Cell, experiment: Experiment) -> Recorded:
    """Simulate the subjects of a cell."""
    with failures_of(cell.spec.name):
        session, learner = made(cell)
        played = session.play(learner)
    (part,) = recorded_subjects(played, experiment)
    return part


def predicted(
    cell: Cell,
    experiment: Experiment,
    theories: Sequence[LearnerSpec],
    draws: int,
    lapse: float,
    copies: int,
) -> list[dict[str, Any]]:
    """Simulate the subjects of a cell, and let theories predict them; see :func:`told_apart`."""
    first, maker = cell.first_subject, cell.spec
    if draws:
        cell = replace(cell, spec=drawn(maker, experiment.seed, "subject", first))
    part = simulated(cell, experiment)

    def nats(theory: LearnerSpec) -> FloatArray:
        """``[B]`` log-likelihood of what each subject did, averaged over draws of parameters."""
        specs = [theory]
        if draws and unknown(theory):  # with nothing unknown, all draws are the same
            numbers = range(first * draws, (first + 1) * draws)
            specs = [drawn(theory, experiment.seed, "theory", number) for number in numbers]
        scores = [score_part(part, spec, lapse, copies)[0] for spec in specs]
        sums = [score.groupby("subject")["log_probability"].sum() for score in scores]
        mean: FloatArray = np.logaddexp.reduce(sums) - math.log(len(sums))
        return mean

    rows = pd.DataFrame(
        {
            "learner": maker.name,
            "condition": cell.condition.name,
            "protocol": maker.protocol.name,
            "subject": part.numbers,
            "attempts": part.rows.groupby("subject").size().to_numpy(),
            "actions": part.asked.sum(axis=1),
            **{NATS + theory.name: nats(theory) for theory in theories},
        }
    )
    return rows.to_dict("records")


def told_apart(
    experiment: Experiment,
    folder: Path,
    *,
    draws: int = 0,
    lapse: float = LAPSE,
    copies: int = COPIES,
    outside: Sequence[str] = (),
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> pd.DataFrame:
    """Simulate subjects of every theory in every condition, and let all theories predict them.

    Args:
        experiment: Its conditions; its learners are the theories, and their subjects are made.
        folder: Where each subject is stored, so that the work continues after an interruption.
        draws: Sets of unknown parameters over which a theory's likelihood is averaged; with 0 all
            parameters are known, as declared.
        lapse: The share of actions that are taken to be random.
        copies: The most copies to ask of a learner without probabilities; with few, what it hardly
            ever does is estimated too low.
        outside: Labels of learners that make subjects and predict none: as if people followed no
            theory of the set.
        workers: Number of processes.
        report: Called with how many subjects are done, of how many.

    Returns:
        A row for each subject: the ``learner`` that made it, ``condition``, ``protocol``,
        ``subject``, how many ``attempts`` and ``actions`` it took, and ``nats NAME`` for each
        theory.

    Raises:
        LearnerError: If a theory cannot predict others or play a condition, or there are fewer than
            two different ones.
        OpenLockError: If no action is taken to be random: one that no theory does would be
            impossible under all of them.
    """
    theories = theories_of(experiment, outside)
    _check(theories, experiment, draws)
    if lapse <= 0:
        raise OpenLockError("lapse must be above 0, or nothing can be said of unexpected actions")
    together = 1 if draws else TOGETHER  # each subject has parameters of its own, or all have one
    name, seed, apart = experiment.name, experiment.seed, experiment.not_applicable
    cells = [
        Cell(name, seed, maker, condition, first, min(together, maker.subjects - first))
        for condition in experiment.conditions
        for maker in experiment.learners
        if condition.name not in apart.get(maker.name, {})
        for first in range(0, maker.subjects, together)
    ]

    def about(cell: Cell) -> list[Any]:
        """All that decides the rows of a cell, as plain data."""
        specs = [cell.spec, *theories]
        return [draws, lapse, copies, *map(unknown, specs),
                *(replace(cell, spec=spec).identity for spec in specs)]  # fmt: skip

    total, rows = sum(cell.subjects for cell in cells), []
    with fitting_in(folder, workers) as pool:
        given = (experiment, theories, draws, lapse, copies)
        jobs = [(about(cell), partial(begin, pool, predicted, cell, *given)) for cell in cells]
        for found in steps(folder, jobs, list[dict[str, Any]]):
            rows += found
            report(len(rows), total)
    return pd.DataFrame(rows)


def theories_of(experiment: Experiment, outside: Sequence[str]) -> tuple[LearnerSpec, ...]:
    """The learners of an experiment that are theories.

    Raises:
        LearnerError: If ``outside`` names a learner that is not in the experiment.
    """
    known_learners(outside, experiment.learners)
    return tuple(spec for spec in experiment.learners if spec.name not in outside)


def _check(theories: Sequence[LearnerSpec], experiment: Experiment, draws: int) -> None:
    if len(theories) < 2:
        raise LearnerError(
            "theories are told from each other, so there must be two at least, apart from those "
            "outside; add a learner to the experiment"
        )
    if len({theory.subjects for theory in theories}) > 1:
        raise LearnerError(
            "theories make different numbers of subjects, so that some would count more; give all "
            "the same, with --subjects or subjects: in the file"
        )
    same: dict[str, str] = {}
    for theory in theories:
        ranges = unknown(theory) if draws else {}
        known = {name: value for name, value in theory.parameters.items() if name not in ranges}
        what = json.dumps([theory.learner, known, [*ranges]], sort_keys=True, default=str)
        if (other := same.setdefault(what, theory.name)) != theory.name:
            why = f", as {joined([*ranges])} can be anything in its range" if ranges else ""
            raise LearnerError(
                f"{other} and {theory.name} are the same theory{why}; leave one of them out"
            )
        if not learner_class(theory.learner).learns_from_others:
            raise LearnerError(
                f"{theory.name} learns from its own actions alone, so that it cannot predict "
                f"others; leave it out, or give --outside {theory.name}"
            )
        for condition, why in experiment.not_applicable.get(theory.name, {}).items():
            raise LearnerError(f"{why}; leave out {condition}, or the theory")
