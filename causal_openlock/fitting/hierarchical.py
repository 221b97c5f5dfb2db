"""Fitting a group and its subjects at once: few actions of one are read in the light of all.

Fitted one by one, a subject with few actions can come out anywhere, and the spread of what was
fitted is that of subjects and of errors together. Here parameters of subjects are drawn from a
group, whose mean and spread are estimated too (empirical Bayes): a subject of whom little is known
is taken to be like the others, and one of whom much is known to be as it acted.

A parameter between two bounds becomes a number without bounds: the log-odds of where it stands
between them (on a logarithmic scale where that is searched). In these, the group is normal, each
parameter by itself. Mean and spread are those that make the actions of all subjects most probable,
by expectation and maximisation with Laplace's approximation (Huys et al. 2011, PLoS Computational
Biology 7: e1002028):

* for each subject, its most probable parameters under the prior of the group, and the curvature
  there (:func:`peak`; scipy's Newton method in a trust region, derivatives from differences);
* mean and spread of the group from all of these (:func:`group_of`), and so on until they stay.

In between, likelihoods are taken to be normal around the last peaks, so that rounds of the second
step, which cost nothing, are repeated until they have settled before subjects are asked again. This
changes how fast, and not to what, it settles. The first peaks are looked for from the best of a
number of points that are spread evenly (Halton), the same for all subjects.

What a subject adds to the evidence for the learner is the integral over its parameters, by the same
approximation. The integrated BIC of Huys et al. takes a price for the means and spreads of the
group, of which each subject here bears its share. Parameters that are whole numbers have no normal
distribution, and of learners without probabilities likelihoods are too rough for curvatures: both
are refused.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from functools import cache
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import TypeAdapter
from scipy.optimize import minimize
from scipy.special import expit, logit
from scipy.stats import norm, qmc

from causal_openlock.errors import LearnerError
from causal_openlock.experiment.workers import worker_pool
from causal_openlock.files.atomic import sweep
from causal_openlock.fitting.actions import (
    DIFFERING,
    FILE,
    ActionPlan,
    Fitted,
    Predictions,
    fits_of,
    held_out,
    of_share,
    subjects_of,
)
from causal_openlock.fitting.kept import fit_of, keep_fit
from causal_openlock.scoring.teacher_forcing import Recorded
from causal_openlock.world.fsm import FloatArray, IntArray

GROUP = "group"
"""Label of the fit of the group itself."""
PROGRESS = "hierarchical.json"
"""What is done of a fit that goes on."""
STEP = 0.05
"""Of differences, in log-odds."""
SPREADS = 0.05, 1.6
"""The least spread of a group, and the greatest, with which it begins: about even over a range."""
FARTHEST = 4.6
"""The mean of a group stays so near the middle: between the hundredths at the ends of a range."""
GRADIENT = 0.05
"""A peak is where the slope is less than this, in nats per spread of the group."""
SETTLED = 0.02
"""A round that changes no mean and no spread by more is the last one; in log-odds."""
ROUNDS, EASY_ROUNDS = 25, 10_000
"""The most rounds in which subjects are asked, and in which their likelihoods are normal."""

Do = Callable[[Callable[[Any], Any], Iterable[Any]], Iterable[Any]]
"""What carries out a function on several jobs, in their order."""


@dataclass(frozen=True)
class Group:
    """A normal distribution of subjects' parameters, in log-odds.

    Attributes:
        mean: ``[D]``.
        spread: ``[D]`` standard deviations.
    """

    mean: FloatArray
    spread: FloatArray


@dataclass(frozen=True)
class Peak:
    """The most probable parameters of a subject under the prior of a group; plain data.

    Attributes:
        at: ``[D]`` where it is, in log-odds.
        curvature: ``[D, D]`` second derivatives of the negative log-likelihood there, in nats; no
            direction bends down.
        nll: Negative log-likelihood there, in nats, of what is fitted.
        actions: Of so many actions.
        held_out: The same of what is held out.
        held_out_actions: Of so many actions.
        evaluations: How often likelihoods were computed.
    """

    at: list[float]
    curvature: list[list[float]]
    nll: float
    actions: int = 1
    held_out: float = 0.0
    held_out_actions: int = 0
    evaluations: int = 0


def peak(loss: Callable[[FloatArray], float], group: Group, start: FloatArray) -> Peak:
    """The most probable parameters of a subject, and how its likelihood bends there.

    Args:
        loss: Negative log-likelihood at ``[D]`` log-odds.
        group: The prior.
        start: ``[D]`` where the search begins.

    Example:
        One measurement, 2, with variance 1, and a prior around 0 with variance 1:

        >>> around = Group(np.zeros(1), np.ones(1))
        >>> found = peak(lambda x: float((x[0] - 2) ** 2) / 2, around, np.zeros(1))
        >>> round(found.at[0], 4), round(found.curvature[0][0], 4)
        (1.0, 1.0)
    """

    @cache
    def bent(*x: float) -> tuple[FloatArray, FloatArray]:
        return derivatives(loss, np.array(x))

    # In units of the prior, where the curvature is at least 1 and slopes so have a scale.
    def there(y: FloatArray) -> FloatArray:
        return group.mean + group.spread * y

    found = minimize(
        lambda y: loss(there(y)) + 0.5 * float(y @ y),
        (start - group.mean) / group.spread,
        jac=lambda y: group.spread * bent(*there(y))[0] + y,
        hess=lambda y: np.outer(group.spread, group.spread) * bent(*there(y))[1] + np.eye(len(y)),
        method="trust-exact",
        options={"gtol": GRADIENT, "maxiter": 50},
    )
    at = there(found.x)
    values, vectors = np.linalg.eigh(bent(*at)[1])
    upward = (vectors * np.maximum(values, 0.0)) @ vectors.T
    return Peak(at.tolist(), upward.tolist(), loss(at))


def derivatives(f: Callable[[FloatArray], float], x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """``[D]`` first and ``[D, D]`` second derivatives, from differences by :data:`STEP`."""
    steps = STEP * np.eye(len(x))
    here = f(x)
    up, down = (np.array([f(x + sign * step) for step in steps]) for sign in (1, -1))
    second = np.diag(up - 2 * here + down)
    for i, one in enumerate(steps):
        for j, other in enumerate(steps[:i]):
            # Forwards and backwards in both at once, less what each does by itself.
            both = (f(x + one + other) + f(x - one - other)) / 2 - here
            own = (up[i] + down[i] + up[j] + down[j]) / 2 - 2 * here
            second[i, j] = second[j, i] = both - own
    return (up - down) / (2 * STEP), second / STEP**2


def group_of(peaks: Sequence[Peak], group: Group) -> Group:
    """The group that makes what subjects did most probable, if likelihoods are normal.

    Args:
        peaks: Of the subjects; those without actions do not count.
        group: The prior under which they are the peaks.

    Example:
        Three measurements with variance 1 and a variance of 5 in all leave 4 for the group.

        >>> far = np.sqrt(7.5)  # the mean square of -far, 0 and far is 5
        >>> flat = Group(np.zeros(1), np.full(1, 1e6))
        >>> three = [Peak([x], [[1.0]], 0.0) for x in (-far, 0.0, far)]
        >>> group_of(three, flat).spread.round(3).tolist()
        [1.6]
    """
    known = [one for one in peaks if one.actions]
    if not known:
        return group
    at, bends = (np.array([getattr(one, name) for one in known]) for name in ("at", "curvature"))
    mean, spread = group.mean, group.spread
    # A normal likelihood with these curvatures, of which each peak is where it is.
    pull = (bends @ at[..., None])[..., 0] + (at - mean) / spread**2
    for _ in range(EASY_ROUNDS):
        covariance = np.linalg.inv(bends + np.diag(1.0 / spread**2))
        each = (covariance @ (pull + mean / spread**2)[..., None])[..., 0]
        before = mean, spread
        mean = each.mean(axis=0).clip(-FARTHEST, FARTHEST)
        variance = ((each - mean) ** 2 + covariance.diagonal(axis1=1, axis2=2)).mean(axis=0)
        spread = np.sqrt(variance).clip(*SPREADS)
        if _apart(Group(mean, spread), Group(*before)) < SETTLED * 1e-3:
            break
    return Group(mean, spread)


def _apart(one: Group, other: Group) -> float:
    return float(np.abs([one.mean - other.mean, one.spread - other.spread]).max())


# -- the fit of a group ---------------------------------------------------------------------------


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
    points = qmc.Halton(len(plan.space.ranges), rng=plan.seed).random(plan.candidates)
    points = logit(points.clip(0.01, 0.99))
    prior = norm.logpdf(points, scale=SPREADS[1]).sum(axis=1)
    predicted = Predictions([job.part], plan)
    losses = np.zeros((len(plan.numbers), len(numbers), len(points)))
    for number, point in enumerate(points):
        table = predicted(chosen_at(plan, point))
        if (table["standard_error"] > 0).any():
            raise LearnerError(
                f"{plan.space.learner} gives no probabilities, and likelihoods from draws are too "
                "rough for a hierarchical fit; fit each subject by itself with --each"
            )
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
        nothing = np.zeros((len(job.start), len(job.start))).tolist()
        found = Peak(job.group.mean.tolist(), nothing, 0.0)
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
        plan: The settings of the fit.
        folder: Where it is kept.

    Attributes:
        rounds: By fold, how many rounds it took, or :data:`ROUNDS` if it has not settled.

    Raises:
        LearnerError: If a parameter takes whole numbers only.
        StoreError: If the folder holds another fit.
    """

    def __init__(self, parts: Sequence[Recorded], plan: ActionPlan, folder: Path) -> None:
        for name, one in plan.space.ranges.items():
            if one.whole:
                raise LearnerError(
                    f"{name} of {plan.space.learner} takes whole numbers only, and these are not "
                    f"normal in a group; fix it: --fix {name}={one.low:g}"
                )
        self.plan, self._parts, self._folder = plan, parts, folder
        self._alone = {who: own for part in parts for who, own in part.alone().items()}
        self._about = {**plan.as_dict(), "hierarchical": True, "subjects": subjects_of(parts)}
        sweep(folder)
        fit_of(folder / FILE, self._about, fits_of, "fit to actions", DIFFERING)
        kept = fit_of(folder / PROGRESS, self._about, _progress, "fit to actions", DIFFERING)
        self._starts, self._peaks = kept or ([], [])
        self.rounds: dict[int, int] = {}

    def run(
        self, workers: int = 1, report: Callable[[str], None] = lambda what: None
    ) -> list[Fitted]:
        """Fit what is missing; the fits of all subjects and of the group, by fold."""
        plan, fits = self.plan, []
        with worker_pool(workers) if workers > 1 else nullcontext() as pool:
            do: Do = pool.map if pool else map
            report("looking for where to begin")
            left = [StartJob(part, plan) for part in self._parts[len(self._starts) :]]
            for found in do(start_job, left):
                self._starts.append(found)
                self._keep()
            starts = {who: own for part in self._starts for who, own in part.items()}
            known = iter(list(self._peaks))
            for place, fold in enumerate(plan.numbers):
                at = [np.array(starts[who][place]) for who in self._alone]
                group = Group(np.zeros(len(at[0])), np.full(len(at[0]), SPREADS[1]))
                asked = np.full(len(at), plan.candidates)
                for number in range(1, ROUNDS + 1):
                    report(f"fold {place + 1} of {len(plan.numbers)}, round {number}")
                    peaks = self._round(fold, group, at, known, do)
                    asked += [one.evaluations for one in peaks]
                    after = group_of(peaks, group)
                    self.rounds[fold] = number
                    if _apart(after, group) < SETTLED:
                        break
                    group, at = after, [np.array(one.at) for one in peaks]
                fits += self._fitted(fold, group, peaks, asked)
        keep_fit(self._folder / FILE, self._about, done=[asdict(one) for one in fits])
        return fits

    def _round(
        self, fold: int, group: Group, at: Sequence[FloatArray], known: Iterator[Peak], do: Do
    ) -> list[Peak]:
        """The peaks of all subjects under a prior: those that are known, and then the others."""
        peaks = list(islice(known, len(at)))
        jobs = [
            PeakJob(part, self.plan, fold, group, start)
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
        self, fold: int, group: Group, peaks: Sequence[Peak], asked: IntArray
    ) -> list[Fitted]:
        """The fit of the group, and those of its subjects."""
        known = [one.actions for one in peaks if one.actions]
        total = max(sum(known), 1)
        price = 2 * len(group.mean) * np.log(total) / max(len(known), 1)
        fits = []
        for who, one, times in zip(self._alone, peaks, asked.tolist(), strict=True):
            evidence, spread = evidence_of(one, group)
            fits.append(
                Fitted(
                    who,
                    fold,
                    chosen_at(self.plan, np.array(one.at)),
                    one.nll,
                    one.actions,
                    one.held_out,
                    one.held_out_actions,
                    0.0,
                    times,
                    price - 2 * evidence if one.actions else 0.0,
                    between=self._between(np.array(one.at), spread),
                )
            )
        summed: dict[str, Any] = {
            name: sum(getattr(one, name) for one in fits)
            for name in ("nll", "actions", "held_out", "held_out_actions", "standard_error",
                         "evaluations", "bic")
        }  # fmt: skip
        middle = chosen_at(self.plan, group.mean)
        between = self._between(group.mean, group.spread)
        of_group = Fitted(GROUP, fold, middle, **summed, between=between)
        return [of_group, *fits]

    def _between(self, mean: FloatArray, spread: FloatArray) -> dict[str, tuple[float, float]]:
        low, high = (chosen_at(self.plan, mean + sign * spread) for sign in (-1, 1))
        return {name: (low[name], high[name]) for name in low}


def evidence_of(found: Peak, group: Group) -> tuple[float, FloatArray]:
    """Log evidence of a subject under a prior, and ``[D]`` the spread of its parameters.

    >>> one = Peak([0.5], [[1.0]], nll=0.125 + 0.5 * np.log(2 * np.pi))  # a measurement of 1
    >>> evidence, spread = evidence_of(one, Group(np.zeros(1), np.ones(1)))
    >>> bool(np.isclose(evidence, norm.logpdf(1, scale=2**0.5))), (spread**2).round(3).tolist()
    (True, [0.5])
    """
    precision = np.array(found.curvature) + np.diag(1.0 / group.spread**2)
    prior = norm.logpdf(found.at, group.mean, group.spread).sum()
    volume = np.linalg.slogdet(precision / (2 * np.pi))[1] / 2
    spread: FloatArray = np.sqrt(np.linalg.inv(precision).diagonal())
    return float(prior - found.nll - volume), spread


def _progress(kept: dict[str, Any]) -> tuple[list[Starts], list[Peak]]:
    starts = TypeAdapter(list[Starts]).validate_python(kept["starts"])
    return starts, TypeAdapter(list[Peak]).validate_python(kept["peaks"])
