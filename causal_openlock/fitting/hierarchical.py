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

The first peaks are looked for from the best of a number of points that are spread evenly (Halton),
the same for all subjects. Parameters that are whole numbers have no normal distribution, and of
learners without probabilities likelihoods are too rough for curvatures: both are refused. A learner
of which nothing is searched takes part in a mixture as it is.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from itertools import combinations, islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from scipy.special import expit, logit, logsumexp
from scipy.stats import norm, qmc

from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.workers import worker_pool
from causal_openlock.fitting.actions import (
    DIFFERING,
    FILE,
    WHOLE,
    ActionPlan,
    Fitted,
    Predictions,
    fits_of,
    held_out,
    of_share,
    subjects_of,
)
from causal_openlock.fitting.group import (
    SETTLED,
    SPREADS,
    Group,
    Peak,
    evidence_of,
    group_of,
    peak,
)
from causal_openlock.fitting.kept import fit_of, fitting_in, keep_fit
from causal_openlock.fitting.mixture import Mixture, mixture_of
from causal_openlock.scoring.teacher_forcing import Recorded
from causal_openlock.world.fsm import FloatArray, IntArray

GROUP = "group"
"""Label of the fit of a group itself."""
MIXTURE = "mixture"
"""Learner of the fit of all groups together."""
PROGRESS = "hierarchical.json"
"""What is done of a fit that goes on."""
ROUNDS = 25
"""The most rounds in which subjects are asked."""
NO_EFFECT = 1e-6
"""Slopes and curvatures below are rounding errors, in nats per log-odds."""

Do = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""What carries out a function on several jobs, in their order."""


@dataclass(frozen=True)
class StartJob:
    """Where the search begins for some subjects."""

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
"""By subject, and then by fold, where the search begins, in log-odds."""


def start_job(job: StartJob) -> Starts:
    """Try the same points for all subjects; the best of each, by fold."""
    plan, numbers = job.plan, job.part.numbers
    points = np.zeros((1, 0))
    if free := len(plan.space.ranges):
        points = qmc.Halton(free, rng=plan.seed).random(plan.candidates)
        points = logit(points.clip(0.01, 0.99))
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
    elif not len(job.start):
        found = Peak([], [], [], loss(job.start))
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


class GroupFit:
    """A hierarchical fit, which goes on where it was stopped.

    Args:
        parts: The subjects.
        plans: By label, the settings of the fit of each learner, which differ in what is searched.
        folder: Where it is kept.

    Attributes:
        rounds: By fold, how many rounds it took, or :data:`ROUNDS` if it has not settled.

    Raises:
        LearnerError: If a parameter takes whole numbers only, or two learners are the same.
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
        asked = {label: plan.as_dict() for label, plan in plans.items()}
        first = next(iter(asked.values()))
        about = {MIXTURE: asked} if len(plans) > 1 else first
        self._numbers = next(iter(plans.values())).numbers
        self._about = {**about, "hierarchical": True, "subjects": subjects_of(parts)}
        self._starts: list[Starts] = []
        self._peaks: list[Peak] = []
        self.rounds: dict[int, int] = {}

    def run(
        self, workers: int = 1, report: Callable[[str], None] = lambda what: None
    ) -> list[Fitted]:
        """Fit what is missing; the fits of all subjects and of the groups, by fold.

        Raises:
            LearnerError: If a learner gives no exact probabilities, or a parameter makes no
                difference.
            StoreError: If the folder holds another fit, or another process fits there.
        """
        anybody = next(iter(self._alone.values()))
        for plan in self.plans.values():
            _require_exact(plan, anybody)
        fits = []
        pools = worker_pool(workers) if workers > 1 else nullcontext()
        with fitting_in(self._folder), pools as pool:
            self._go_on()
            do: Do = pool.map if pool else map
            report("looking for where to begin")
            jobs = [StartJob(part, plan) for plan in self.plans.values() for part in self._parts]
            for found in do(start_job, jobs[len(self._starts) :]):
                self._starts.append(found)
                self._keep()
            known = iter(list(self._peaks))
            for place, fold in enumerate(self._numbers):

                def say(number: int, place: int = place) -> None:
                    report(f"fold {place + 1} of {len(self._numbers)}, round {number}")

                fits += self._fold(fold, self._begins(place), known, do, say)
            if next(known, None):
                raise StoreError(
                    f"{self._folder / PROGRESS}: this is no fit; choose another folder with --out"
                )
            keep_fit(self._folder / FILE, self._about, done=[asdict(one) for one in fits])
        return fits

    def _go_on(self) -> None:
        """Read what is done."""
        several = len(self.plans) > 1
        ranges = {label if several else "": one.space.ranges for label, one in self.plans.items()}
        whose = [[*part.alone()] for _ in self.plans for part in self._parts]

        def fits(kept: Mapping[str, Any]) -> list[Fitted]:
            return fits_of(kept, {**ranges, MIXTURE: {}} if several else ranges)

        def progress(kept: Mapping[str, Any]) -> tuple[list[Starts], list[Peak]]:
            starts = TypeAdapter(list[Starts]).validate_python(kept["starts"])
            if [[*one] for one in starts] != whose[: len(starts)]:
                raise ValueError("the subjects are in another order")
            peaks = TypeAdapter(list[Peak]).validate_python(kept["peaks"])
            self._check(starts, peaks)
            return starts, peaks

        fit_of(self._folder / FILE, self._about, fits, "fit to actions", DIFFERING)
        kept = fit_of(self._folder / PROGRESS, self._about, progress, "fit to actions", DIFFERING)
        self._starts, self._peaks = kept or ([], [])

    def _check(self, starts: Sequence[Starts], peaks: Sequence[Peak]) -> None:
        """Raise ValueError if some are not of these learners and subjects."""
        free = [len(plan.space.ranges) for plan in self.plans.values()]
        actions = [len(part.done()[0]) for part in self._alone.values()]
        for number, found in enumerate(starts):
            wanted = len(self._numbers), free[number // len(self._parts)]
            for at in found.values():
                if np.shape(at) != wanted or not np.isfinite(at).all():
                    raise ValueError("a search that begins nowhere")
        for number, one in enumerate(peaks):
            learner, subject = divmod(number, len(actions))
            one.check(free[learner % len(free)])
            if one.actions + one.held_out_actions != actions[subject]:
                raise ValueError("a peak of another subject")

    def _begins(self, place: int) -> list[list[FloatArray]]:
        """By learner and subject, where the search of a fold begins."""
        by_learner, many = [], len(self._parts)
        for number in range(len(self.plans)):
            found = self._starts[number * many : (number + 1) * many]
            own = {who: at for part in found for who, at in part.items()}
            by_learner.append([np.array(own[who][place]) for who in self._alone])
        return by_learner

    def _fold(
        self,
        fold: int,
        at: list[list[FloatArray]],
        known: Iterator[Peak],
        do: Do,
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
            peaks = [
                self._round(plan, fold, group, own, known, do)
                for plan, group, own in zip(plans, groups, at, strict=True)
            ]
            if fold == WHOLE:
                for (label, plan), own in zip(self.plans.items(), peaks, strict=True):
                    _require_effect(label, plan, own)
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

    def _mixed(self, peaks: Sequence[Sequence[Peak]], groups: Sequence[Group]) -> Mixture:
        evidence = [
            [evidence_of(one, group)[0] for one in own]
            for own, group in zip(peaks, groups, strict=True)
        ]
        actions = np.array([one.actions for one in peaks[0]])
        parameters = np.array([2 * len(group.mean) for group in groups])
        return mixture_of(np.array(evidence).T, actions, parameters)

    def _round(
        self,
        plan: ActionPlan,
        fold: int,
        group: Group,
        at: Sequence[FloatArray],
        known: Iterator[Peak],
        do: Do,
    ) -> list[Peak]:
        """The peaks of all subjects under a prior: those that are known, and then the others."""
        peaks = list(islice(known, len(at)))
        jobs = [
            PeakJob(part, plan, fold, group, start)
            for part, start in zip(self._alone.values(), at, strict=True)
        ]
        for found in do(peak_job, jobs[len(peaks) :]):
            peaks.append(found)
            self._peaks.append(found)
            self._keep()
        return peaks

    def _keep(self) -> None:
        peaks = [asdict(one) for one in self._peaks]
        keep_fit(self._folder / PROGRESS, self._about, starts=self._starts, peaks=peaks)

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
            fits.append(
                Fitted(
                    who,
                    fold,
                    chosen_at(plan, np.array(one.at)),
                    one.nll,
                    one.actions,
                    one.held_out,
                    one.held_out_actions,
                    0.0,
                    int(asked[row]),
                    float(mixed.bic[row, place]),
                    between=_between(plan, np.array(one.at), spread),
                    followed=float(mixed.followed[row, place]),
                    learner=named,
                )
            )
        of_group = Fitted(
            GROUP,
            fold,
            chosen_at(plan, group.mean),
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
        what, exact = "gives no probabilities, and draws are", ""
        if not table["entropy"].isna().all():
            what = "estimates its probabilities from draws, which are"
            exact = ", or set it so that they are exact (theory_based: beliefs=mean)"
        raise LearnerError(
            f"{plan.space.learner} {what} too rough for a hierarchical fit; fit each subject by "
            f"itself with --each{exact}"
        )


def _require_effect(label: str, plan: ActionPlan, peaks: Sequence[Peak]) -> None:
    """Raise LearnerError if a parameter makes no difference: it could come out anywhere."""
    known = [one for one in peaks if one.actions]
    for place, name in enumerate(plan.space.ranges):
        effects = (abs(one.slope[place]) + one.curvature[place][place] for one in known)
        if max(effects, default=1.0) < NO_EFFECT:
            raise LearnerError(
                f"{name} makes no difference to how likely {label} finds what was done, as it is "
                "set; take it out of what is searched, or set otherwise what it depends on (--fix)"
            )


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
    """How well all groups predict: each subject by all learners, as it probably follows them."""
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
