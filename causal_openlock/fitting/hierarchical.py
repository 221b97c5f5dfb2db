"""Fitting a group and its subjects at once: few actions of one are read in the light of all.

Fitted one by one, a subject with few actions can come out anywhere, and the spread of what was
fitted is that of subjects and of errors together. Here parameters of subjects are drawn from a
group, whose mean and spread are estimated too (:mod:`~causal_openlock.fitting.group`): a subject
with few actions is taken to be like the others, and one with many to be as it acted.

Subjects are asked in rounds for their most probable parameters under the prior of the group, and
the group follows from what they answer. The first search for a subject's peak begins at the best of
a number of evenly spread points, the same for all subjects; later ones at the peak of the round
before. Parameters that are whole numbers have no normal distribution, and of learners without
probabilities likelihoods are too rough for curvatures: both are refused.

The means and spreads of the group were chosen in the light of the evidence, which has a price: that
of the BIC, half a logarithm of the number of all actions for each, of which subjects bear equal
shares (the integrated BIC of Huys et al. 2011).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import expit, logit
from scipy.stats import norm

from causal_openlock.errors import LearnerError
from causal_openlock.fitting.group import SETTLED, SPREADS, Group, Peak, evidence_of, group_of, peak
from causal_openlock.fitting.plan import Plan
from causal_openlock.fitting.search import NO_EFFECT, require_effect, spread
from causal_openlock.fitting.steps import begin, fitting_in, steps
from causal_openlock.fitting.to_actions import (
    WHOLE,
    Fitted,
    alone,
    check_folds,
    folds_of,
    held_out,
    predictions,
    require_possible,
    subjects_of,
    surprise,
    write_fits,
)
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.recorded import Recorded

GROUP = "group"  #: label of the fit of the group itself
ROUNDS = 25  #: the most rounds in which subjects are asked


def fit_group(
    parts: Sequence[Recorded],
    plan: Plan,
    folder: Path,
    workers: int = 1,
    report: Callable[[str], None] = lambda what: None,
) -> tuple[list[Fitted], int]:
    """Fit a group and its subjects, or what is missing of such a fit in the folder.

    Returns:
        The fits of the group and of all subjects, by fold; and the number of rounds that the
        longest fold took, :data:`ROUNDS` if it has not settled.

    Raises:
        LearnerError: If a parameter takes whole numbers only, there is one subject, the learner
            gives no exact probabilities, a parameter makes no difference, or the learner cannot
            have done what a subject did.
        OpenLockError: If subjects are to be held out, and a fold has none.
        StoreError: If another process fits in the folder.
    """
    subjects = alone(parts)
    _check(subjects, plan)
    check_folds(parts, plan)
    about, folds, longest = plan.as_dict(), folds_of(plan), 0
    named = [*zip(subjects_of(parts).items(), subjects.values(), strict=True)]
    fits: list[Fitted] = []
    with fitting_in(folder, workers) as pool:
        report("looking for where to begin")
        jobs = [([about, who], partial(begin, pool, _starts, part, plan)) for who, part in named]
        starts = [*steps(folder, jobs, list[list[float]])]
        for place, fold in enumerate(folds):
            group, at = Group.wide(len(plan.ranges)), [start[place] for start in starts]
            for number in range(1, ROUNDS + 1):
                report(f"fold {place + 1} of {len(folds)}, round {number}")
                prior = [about, fold, group.mean.tolist(), group.spread.tolist()]
                search = partial(begin, pool, _peak, plan, fold, group)
                searches = [
                    ([*prior, who, start], partial(search, part, start))
                    for (who, part), start in zip(named, at, strict=True)
                ]
                peaks = [*steps(folder, searches, Peak)]
                for part, found in zip(subjects.values(), peaks, strict=True):
                    require_possible(found.nll, [part], fold, chosen_at(plan, found.at), plan)
                if fold == WHOLE:
                    idle = [_idle(plan, found) for found in peaks if found.actions]
                    require_effect(idle, plan.learner)
                at = [found.at for found in peaks]
                before, group = group, group_of(peaks, group)
                if group.apart(before) < SETTLED:
                    break
            longest = max(longest, number)
            fits += _fitted([*subjects], plan, fold, before, peaks)
        write_fits(folder, plan, parts, fits)
    return fits, longest


def _check(subjects: dict[str, Recorded], plan: Plan) -> None:
    """Raise LearnerError if these subjects, or this learner, cannot be fitted as a group."""
    for name, bounds in plan.ranges.items():
        if bounds.whole:
            raise LearnerError(
                f"{name} of {plan.learner} takes whole numbers only, and these are "
                f"not normal in a group; fix it: --fix {name}={bounds.low:g}"
            )
    if len(subjects) < 2:
        raise LearnerError(
            "a group has two subjects at least; fit a single one with --set each=true"
        )
    first, middle = next(iter(subjects.values())), chosen_at(plan, [0.0] * len(plan.ranges))
    table = predictions([first], plan)(middle)
    if (table["standard_error"] > 0).any():
        raise LearnerError(
            f"{plan.learner} gives no exact probabilities, and draws are too rough for a "
            "hierarchical fit; fit each subject by itself with --set each=true, or set it so that "
            "they are exact (theory_based: beliefs=mean)"
        )


def _starts(part: Recorded, plan: Plan) -> list[list[float]]:
    """By fold, the best of some points, where the search for a subject's peak begins."""
    shares = spread(plan.ranges, plan.fit.candidates, plan.fit.seed)
    points, predicted = logit(shares.clip(0.01, 0.99)), predictions([part], plan)
    prior = norm.logpdf(points, scale=SPREADS[1]).sum(axis=1)
    tables = [predicted(chosen_at(plan, point)) for point in points]
    losses = [[surprise(table, plan, fold) for table in tables] for fold in folds_of(plan)]
    return [points[np.argmin(of_fold - prior)].tolist() for of_fold in losses]


def _peak(plan: Plan, fold: int, group: Group, part: Recorded, start: Sequence[float]) -> Peak:
    """Find the peak of one subject, and predict what is held out of its actions there."""
    predicted = predictions([part], plan)
    out = held_out(predicted(chosen_at(plan, start)), plan, fold)
    zero = np.zeros_like(group.mean)
    found = Peak(group.mean.tolist(), zero.tolist(), np.diag(zero).tolist(), 0.0)
    if not out.all():
        found = peak(
            lambda x: surprise(predicted(chosen_at(plan, x)), plan, fold), group, np.array(start)
        )
    there = predicted(chosen_at(plan, found.at))
    return replace(
        found,
        actions=int((~out).sum()),
        held_out=-float(there["log_probability"][out].sum()),
        held_out_actions=int(out.sum()),
    )


def chosen_at(plan: Plan, x: Iterable[float]) -> dict[str, float]:
    """The parameters that have these log-odds, ``[D]``."""
    ranges = plan.ranges.items()
    return {name: bounds.at(expit(v)) for (name, bounds), v in zip(ranges, x, strict=True)}


def _fitted(
    names: Sequence[str], plan: Plan, fold: int, group: Group, peaks: Sequence[Peak]
) -> list[Fitted]:
    """The fit of the group, and those of its subjects."""
    ranges = plan.ranges
    counts = [found.actions for found in peaks if found.actions] or [1]
    price = 2 * len(ranges) * np.log(sum(counts)) / len(counts)

    def fitted(who: str, at: Sequence[float], spread: FloatArray, **rest: Any) -> Fitted:
        chosen, low, high = (chosen_at(plan, at + sign * spread) for sign in (0, -1, 1))
        between = {name: (low[name], high[name]) for name in chosen}
        return Fitted(who, fold, chosen, standard_error=0.0, between=between, **rest)

    fits, summed = [], ("nll", "actions", "held_out", "held_out_actions")
    for who, found in zip(names, peaks, strict=True):
        evidence, spread = evidence_of(found, group)
        bic = float(price - 2 * evidence) if found.actions else 0.0
        counted = {name: getattr(found, name) for name in summed}
        fits.append(fitted(who, found.at, spread, bic=bic, idle=_idle(plan, found), **counted))
    total: dict[str, Any] = {
        name: sum(getattr(own, name) for own in fits) for name in (*summed, "bic")
    }
    return [fitted(GROUP, group.mean.tolist(), group.spread, **total), *fits]


def _idle(plan: Plan, found: Peak) -> tuple[str, ...]:
    """The parameters that make no difference to a subject around its peak."""
    effects = np.abs(found.slope) + np.diag(found.curvature)
    named = zip(plan.ranges, effects, strict=True)
    return tuple(name for name, effect in named if effect < NO_EFFECT)
