"""Most probable parameters of one subject: the steps of a hierarchical fit.

The first peaks are looked for from the best of a number of points that are spread evenly (Halton),
the same for all subjects; later ones from the peaks of the round before. Each step is a job that
any worker can do.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import expit, logit
from scipy.stats import norm, qmc

from causal_openlock.fitting.actions import ActionPlan, Predictions, held_out, of_share
from causal_openlock.fitting.group import SPREADS, Group, Peak, peak
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.teacher_forcing import Recorded


@dataclass(frozen=True)
class StartJob:
    """A job that finds where the search begins for some subjects."""

    part: Recorded
    plan: ActionPlan


@dataclass(frozen=True)
class PeakJob:
    """The most probable parameters of one subject, without one fold."""

    part: Recorded
    plan: ActionPlan
    fold: int
    group: Group
    start: FloatArray


Starts = dict[str, list[list[float]]]
"""Starts of the search by subject, and then by fold, in log-odds."""


def start_job(job: StartJob) -> Starts:
    """Try the same points for all subjects; the best of each, by fold."""
    plan, numbers = job.plan, job.part.numbers
    shares = qmc.Halton(len(plan.space.ranges), rng=plan.seed).random(plan.candidates)
    points = logit(shares.clip(0.01, 0.99))
    prior = norm.logpdf(points, scale=SPREADS[1]).sum(axis=1)
    predicted = Predictions([job.part], plan)
    losses = np.zeros((len(plan.numbers), len(numbers), len(points)))
    for number, point in enumerate(points):
        table = predicted(chosen_at(plan, point))
        for row, fold in enumerate(plan.numbers):
            own = table[~held_out(table, plan, fold)]
            sums = -own.groupby("subject")["log_probability"].sum()
            losses[row, :, number] = sums.reindex(numbers, fill_value=0.0).clip(upper=1e6)
    best = (losses - prior).argmin(axis=2)
    return {who: points[best[:, row]].tolist() for row, who in enumerate(job.part.alone())}


def peak_job(job: PeakJob) -> Peak:
    """Find the peak of one subject, and predict what is held out of its actions there."""
    plan, predicted = job.plan, Predictions([job.part], job.plan)

    def loss(x: FloatArray) -> float:
        return predicted.loss(chosen_at(plan, x), job.fold)

    out = held_out(predicted(chosen_at(plan, job.start)), plan, job.fold)
    if out.all():
        zero = np.zeros_like(job.start)
        found = Peak(job.group.mean.tolist(), zero.tolist(), np.diag(zero).tolist(), 0.0)
    else:
        found = peak(loss, job.group, job.start)
    there = predicted(chosen_at(plan, np.array(found.at)))
    return replace(
        found,
        actions=int((~out).sum()),
        held_out=-float(there["log_probability"][out].sum()),
        held_out_actions=int(out.sum()),
        evaluations=len(predicted.known),
    )


def chosen_at(plan: ActionPlan, x: FloatArray) -> dict[str, float]:
    """The parameters that have these log-odds, ``[D]``."""
    ranges = plan.space.ranges
    return {name: of_share(one, expit(v)) for (name, one), v in zip(ranges.items(), x, strict=True)}
