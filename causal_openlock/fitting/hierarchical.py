"""Fitting groups and their subjects at once: few actions of one are read in the light of all.

Fitted one by one, a subject with few actions can come out anywhere, and the spread of what was
fitted is that of subjects and of errors together. Here parameters of subjects are drawn from a
group, whose mean and spread are estimated too (:mod:`~causal_openlock.fitting.group`): a subject
with few actions is taken to be like the others, and one with many to be as it acted.

Subjects may be of several groups, each of another learner or of one with other settings: a mixture
over learners and their parameters. Which of them a subject follows is inferred from the evidence of
each (:mod:`~causal_openlock.fitting.mixture`), and counts for as much in fitting each group: those
who follow another learner do not spoil it (Piray et al. 2019, PLoS Computational Biology 15:
e1007043; there groups have priors, where here they have a price).

Subjects are asked in rounds for their most probable parameters under the priors of their groups
(:mod:`~causal_openlock.fitting.subject_peak`), and groups follow from what they answer; what they
answered is kept (:mod:`~causal_openlock.fitting.group_progress`). Parameters that are whole numbers
have no normal distribution, and of learners without probabilities likelihoods are too rough for
curvatures: both are refused. A learner of which nothing is searched takes part in a mixture as it
is.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import nullcontext
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
from scipy.special import logsumexp

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
from causal_openlock.fitting.mixture import MIXTURE, Mixture, mixture_of
from causal_openlock.fitting.subject_peak import PeakJob, chosen_at
from causal_openlock.running.workers import worker_pool
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.scoring.teacher_forcing import Recorded

GROUP = "group"
"""Label of the fit of a group itself."""
ROUNDS = 25
"""The most rounds in which subjects are asked."""


class GroupFit:
    """A hierarchical fit, which continues where it stopped.

    Args:
        parts: The subjects.
        plans: By label, the settings of the fit of each learner, which differ in what is searched.
        folder: Where it is kept.

    Attributes:
        rounds: By fold, how many rounds it took, or :data:`ROUNDS` if it has not settled.

    Raises:
        LearnerError: If a parameter takes whole numbers only, two learners are the same, or there
            is one subject.
        OpenLockError: If subjects are to be held out, and a fold has none.
    """

    def __init__(
        self, parts: Sequence[Recorded], plans: Mapping[str, ActionPlan], folder: Path
    ) -> None:
        for plan in plans.values():
            for name, one in plan.space.ranges.items():
                if one.whole:
                    raise LearnerError(
                        f"{name} of {plan.space.learner} takes whole numbers only, and these are "
                        f"not normal in a group; fix it: --fix {name}={one.low:g}"
                    )
        for (label, plan), (other, same) in combinations(plans.items(), 2):
            if plan.space == same.space:
                raise LearnerError(
                    f"{label} and {other} are the same learner, of which the same is searched: who "
                    "follows which cannot be told; leave one out, or give it other settings"
                )
        self.plans, self._parts, self._folder = dict(plans), parts, folder
        self._alone = {who: own for part in parts for who, own in part.alone().items()}
        if len(self._alone) < 2:
            raise LearnerError("a group has two subjects at least; fit a single one with --each")
        for plan in plans.values():
            check_folds(parts, plan)
        self.rounds: dict[int, int] = {}

    def run(
        self, workers: int = 1, report: Callable[[str], None] = lambda what: None
    ) -> list[Fitted]:
        """Fit what is missing; the fits of all subjects and of the groups, by fold.

        Raises:
            LearnerError: If a learner gives no exact probabilities, a parameter makes no
                difference, or no learner can have done what a subject did.
            StoreError: If the folder holds another fit, or another process fits there.
        """
        anybody = next(iter(self._alone.values()))
        for plan in self.plans.values():
            _require_exact(plan, anybody)
        fits = []
        numbers = next(iter(self.plans.values())).numbers
        pools = worker_pool(workers) if workers > 1 else nullcontext()
        with fitting_in(self._folder), pools as pool:
            steps = Progress(self._parts, self.plans, self._folder, pool.map if pool else map)
            report("looking for where to begin")
            starts = steps.starts()
            for place, fold in enumerate(numbers):

                def say(number: int, place: int = place) -> None:
                    report(f"fold {place + 1} of {len(numbers)}, round {number}")

                at = [[np.array(own[who][place]) for who in self._alone] for own in starts]
                fits += self._fold(fold, at, steps, say)
            steps.finish(fits)
        return fits

    def _fold(
        self,
        fold: int,
        at: Sequence[Sequence[FloatArray]],
        steps: Progress,
        say: Callable[[int], None],
    ) -> list[Fitted]:
        """The fits without a fold."""
        plans = list(self.plans.values())
        groups = [Group.wide(len(plan.space.ranges)) for plan in plans]
        asked = np.array(
            [[plan.candidates if plan.space.ranges else 1] * len(self._alone) for plan in plans]
        )
        for number in range(1, ROUNDS + 1):
            say(number)
            peaks = []
            for plan, group, begin in zip(plans, groups, at, strict=True):
                who = zip(self._alone.values(), begin, strict=True)
                jobs = [PeakJob(part, plan, fold, group, start) for part, start in who]
                peaks.append(steps.peaks(jobs))
            self._require_possible(fold, peaks)
            if fold == WHOLE:
                for (label, plan), own in zip(self.plans.items(), peaks, strict=True):
                    known = [_idle(plan, one) for one in own if one.actions]
                    require_effect(known, ON_ACTIONS.format(label))
            asked += [[one.evaluations for one in own] for own in peaks]
            mixed = self._mixed(peaks, groups)
            after = [
                group_of(own, group, mixed.followed[:, place])
                for place, (own, group) in enumerate(zip(peaks, groups, strict=True))
            ]
            self.rounds[fold] = number
            moved = [new.apart(old) for new, old in zip(after, groups, strict=True)]
            if max(moved) < SETTLED:
                break
            groups, at = after, [[np.array(one.at) for one in own] for own in peaks]
        fits = []
        for place, label in enumerate(self.plans):
            fits += self._fitted(label, fold, groups[place], peaks[place], asked[place], mixed)
        if len(plans) > 1:
            fits.append(_together(fold, peaks, mixed))
        return fits

    def _require_possible(self, fold: int, peaks: Sequence[Sequence[Peak]]) -> None:
        """Raise LearnerError if there is a subject that can follow none of the learners."""
        plans = list(self.plans.values())
        for row, who in enumerate(self._alone):
            own = zip(plans, (each[row] for each in peaks), strict=True)
            if all(why := [self._impossible(who, plan, fold, one) for plan, one in own]):
                raise LearnerError(why[0])

    def _impossible(self, who: str, plan: ActionPlan, fold: int, one: Peak) -> str:
        if one.nll < PENALTY:
            return ""
        return impossible([self._alone[who]], plan, fold, chosen_at(plan, np.array(one.at)))

    def _mixed(self, peaks: Sequence[Sequence[Peak]], groups: Sequence[Group]) -> Mixture:
        evidence = [
            [evidence_of(one, group)[0] for one in own]
            for own, group in zip(peaks, groups, strict=True)
        ]
        actions = np.array([one.actions for one in peaks[0]])
        parameters = np.array([2 * len(group.mean) for group in groups])
        return mixture_of(np.array(evidence).T, actions, parameters)

    def _fitted(
        self,
        label: str,
        fold: int,
        group: Group,
        peaks: Sequence[Peak],
        asked: IntArray,
        mixed: Mixture,
    ) -> list[Fitted]:
        """The fit of a group, and those of its subjects."""
        plan, place = self.plans[label], list(self.plans).index(label)
        named = label if len(self.plans) > 1 else ""
        fits = []
        for row, (who, one) in enumerate(zip(self._alone, peaks, strict=True)):
            spread = evidence_of(one, group)[1]
            never = self._impossible(who, plan, fold, one)
            fits.append(
                Fitted(
                    who,
                    fold,
                    chosen_at(plan, np.array(one.at)),
                    np.inf if never else one.nll,
                    one.actions,
                    one.held_out,
                    one.held_out_actions,
                    0.0,
                    int(asked[row]),
                    np.inf if never else float(mixed.bic[row, place]),
                    between=_between(plan, np.array(one.at), spread),
                    followed=float(mixed.followed[row, place]),
                    learner=named,
                    at_bound=at_bound(plan.space.ranges, chosen_at(plan, np.array(one.at))),
                    idle=_idle(plan, one) if one.actions else tuple(plan.space.ranges),
                )
            )
        of_group = Fitted(
            GROUP,
            fold,
            chosen_at(plan, group.mean),
            at_bound=at_bound(plan.space.ranges, chosen_at(plan, group.mean)),
            **_summed(fits),
            between=_between(plan, group.mean, group.spread),
            followed=float(mixed.frequencies[place]),
            learner=named,
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


def _together(fold: int, peaks: Sequence[Sequence[Peak]], mixed: Mixture) -> Fitted:
    """Scores of all groups: each subject by all learners, as it probably follows them."""
    of_one = peaks[0]

    def surprise(name: str) -> float:
        each = np.array([[getattr(one, name) for one in own] for own in peaks]).T
        return -float(logsumexp(-each, axis=1, b=mixed.followed).sum())

    return Fitted(
        GROUP,
        fold,
        {},
        surprise("nll"),
        sum(one.actions for one in of_one),
        surprise("held_out"),
        sum(one.held_out_actions for one in of_one),
        0.0,
        0,
        -2.0 * mixed.evidence,
        learner=MIXTURE,
    )
