"""Fitting a group and its subjects at once: few actions of one are read in the light of all.

Fitted one by one, a subject with few actions can come out anywhere, and the spread of what was
fitted is that of subjects and of errors together. Here parameters of subjects are drawn from a
group, whose mean and spread are estimated too (:mod:`~causal_openlock.fitting.group`): a subject
with few actions is taken to be like the others, and one with many to be as it acted.

Subjects are asked in rounds for their most probable parameters under the prior of the group
(:mod:`~causal_openlock.fitting.subject_peak`), and the group follows from what they answer; what
they answered is kept (:mod:`~causal_openlock.fitting.group_progress`). Parameters that are whole
numbers have no normal distribution, and of learners without probabilities likelihoods are too rough
for curvatures: both are refused.

The means and spreads of the group were chosen in the light of the evidence, which has a price: that
of the BIC, half a logarithm of the number of all actions for each, of which subjects bear equal
shares (the integrated BIC of Huys et al. 2011).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import numpy as np

from causal_openlock.errors import LearnerError
from causal_openlock.fitting.actions import (
    PENALTY,
    WHOLE,
    ActionPlan,
    Fitted,
    Predictions,
    at_bound,
    check_folds,
    impossible,
)
from causal_openlock.fitting.effect import NO_EFFECT, ON_ACTIONS, require_effect
from causal_openlock.fitting.group import SETTLED, Group, Peak, evidence_of, group_of
from causal_openlock.fitting.group_progress import Progress
from causal_openlock.fitting.kept import fitting_in
from causal_openlock.fitting.subject_peak import PeakJob, chosen_at
from causal_openlock.running.workers import worker_pool
from causal_openlock.schemas.fsm import FloatArray
from causal_openlock.scoring.teacher_forcing import Recorded

GROUP = "group"
"""Label of the fit of the group itself."""
ROUNDS = 25
"""The most rounds in which subjects are asked."""


class GroupFit:
    """A hierarchical fit, which continues where it stopped.

    Args:
        parts: The subjects.
        plan: The settings of the fit.
        folder: Where it is kept.

    Attributes:
        rounds: By fold, how many rounds it took, or :data:`ROUNDS` if it has not settled.

    Raises:
        LearnerError: If a parameter takes whole numbers only, or there is one subject.
        OpenLockError: If subjects are to be held out, and a fold has none.
    """

    def __init__(self, parts: Sequence[Recorded], plan: ActionPlan, folder: Path) -> None:
        for name, one in plan.space.ranges.items():
            if one.whole:
                raise LearnerError(
                    f"{name} of {plan.space.learner} takes whole numbers only, and these are "
                    f"not normal in a group; fix it: --fix {name}={one.low:g}"
                )
        self.plan, self._parts, self._folder = plan, parts, folder
        self._alone = {who: own for part in parts for who, own in part.alone().items()}
        if len(self._alone) < 2:
            raise LearnerError("a group has two subjects at least; fit a single one with --each")
        check_folds(parts, plan)
        self.rounds: dict[int, int] = {}

    def run(
        self, workers: int = 1, report: Callable[[str], None] = lambda what: None
    ) -> list[Fitted]:
        """Fit what is missing; the fits of the group and of all subjects, by fold.

        Raises:
            LearnerError: If the learner gives no exact probabilities, a parameter makes no
                difference, or it cannot have done what a subject did.
            StoreError: If the folder holds another fit, or another process fits there.
        """
        _require_exact(self.plan, next(iter(self._alone.values())))
        fits = []
        numbers = self.plan.numbers
        pools = worker_pool(workers) if workers > 1 else nullcontext()
        with fitting_in(self._folder), pools as pool:
            steps = Progress(self._parts, self.plan, self._folder, pool.map if pool else map)
            report("looking for where to begin")
            starts = steps.starts()
            for place, fold in enumerate(numbers):

                def say(number: int, place: int = place) -> None:
                    report(f"fold {place + 1} of {len(numbers)}, round {number}")

                at = [np.array(starts[who][place]) for who in self._alone]
                fits += self._fold(fold, at, steps, say)
            steps.finish(fits)
        return fits

    def _fold(
        self, fold: int, at: Sequence[FloatArray], steps: Progress, say: Callable[[int], None]
    ) -> list[Fitted]:
        """The fits without a fold."""
        group = Group.wide(len(self.plan.space.ranges))
        evaluations = np.full(len(self._alone), self.plan.candidates)
        for number in range(1, ROUNDS + 1):
            say(number)
            subjects = zip(self._alone.values(), at, strict=True)
            jobs = [PeakJob(part, self.plan, fold, group, start) for part, start in subjects]
            peaks = steps.peaks(jobs)
            for who, peak in zip(self._alone, peaks, strict=True):
                if why := self._impossible(who, fold, peak):
                    raise LearnerError(why)
            if fold == WHOLE:
                idle = [_idle(self.plan, peak) for peak in peaks if peak.actions]
                require_effect(idle, ON_ACTIONS.format(self.plan.space.learner))
            evaluations += [peak.evaluations for peak in peaks]
            after = group_of(peaks, group)
            self.rounds[fold] = number
            if after.apart(group) < SETTLED:
                break
            group, at = after, [np.array(peak.at) for peak in peaks]
        return self._fitted(fold, group, peaks, evaluations.tolist())

    def _impossible(self, who: str, fold: int, peak: Peak) -> str:
        if peak.nll < PENALTY:
            return ""
        chosen = chosen_at(self.plan, np.array(peak.at))
        return impossible([self._alone[who]], self.plan, fold, chosen)

    def _fitted(
        self, fold: int, group: Group, peaks: Sequence[Peak], evaluations: Sequence[int]
    ) -> list[Fitted]:
        """The fit of the group, and those of its subjects."""
        plan, ranges = self.plan, self.plan.space.ranges
        known = [peak.actions for peak in peaks if peak.actions] or [1]
        price = 2 * len(ranges) * np.log(sum(known)) / len(known)
        fits = []
        for who, peak, asked in zip(self._alone, peaks, evaluations, strict=True):
            at = np.array(peak.at)
            evidence, spread = evidence_of(peak, group)
            fits.append(
                Fitted(
                    who,
                    fold,
                    chosen_at(plan, at),
                    peak.nll,
                    peak.actions,
                    peak.held_out,
                    peak.held_out_actions,
                    0.0,
                    asked,
                    float(price - 2 * evidence) if peak.actions else 0.0,
                    between=_between(plan, at, spread),
                    at_bound=at_bound(ranges, chosen_at(plan, at)),
                    idle=_idle(plan, peak) if peak.actions else tuple(ranges),
                )
            )
        of_group = Fitted(
            GROUP,
            fold,
            chosen_at(plan, group.mean),
            at_bound=at_bound(ranges, chosen_at(plan, group.mean)),
            **_summed(fits),
            between=_between(plan, group.mean, group.spread),
        )
        return [of_group, *fits]


def _require_exact(plan: ActionPlan, part: Recorded) -> None:
    """Raise LearnerError if likelihoods are from draws: these are too rough for curvatures."""
    middle = chosen_at(plan, np.zeros(len(plan.space.ranges)))
    table = Predictions([part], plan)(middle)
    if (table["standard_error"] > 0).any():
        raise LearnerError(
            f"{plan.space.learner} gives no exact probabilities, and draws are too rough for a "
            "hierarchical fit; fit each subject by itself with --each, or set it so that they are "
            "exact (theory_based: beliefs=mean)"
        )


def _idle(plan: ActionPlan, one: Peak) -> tuple[str, ...]:
    """The parameters that make no difference to a subject around its peak."""
    effects = (abs(slope) + one.curvature[place][place] for place, slope in enumerate(one.slope))
    named = zip(plan.space.ranges, effects, strict=True)
    return tuple(name for name, effect in named if effect < NO_EFFECT)


def _summed(fits: Sequence[Fitted]) -> dict[str, Any]:
    names = (
        *("nll", "actions", "held_out", "held_out_actions"),
        *("standard_error", "evaluations", "bic"),
    )
    return {name: sum(getattr(one, name) for one in fits) for name in names}


def _between(
    plan: ActionPlan, mean: FloatArray, spread: FloatArray
) -> dict[str, tuple[float, float]]:
    low, high = (chosen_at(plan, mean + sign * spread) for sign in (-1, 1))
    return {name: (low[name], high[name]) for name in low}
