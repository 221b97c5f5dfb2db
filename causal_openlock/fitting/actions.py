"""Fitting to actions: with which parameters does a learner predict best what subjects did?

Maximum likelihood: candidates are proposed by Optuna, and the best of them are then moved downhill
by Nelder and Mead's simplex (scipy), within the same bounds. All subjects follow the same
parameters, or each subject its own. Nothing ties subjects to each other here: of a person with few
actions, parameters that the actions say little about can come out anywhere. A prior that is fitted
to all of them ties them (:mod:`~causal_openlock.fitting.hierarchical`).

What was fitted is judged by what it was not fitted to. Trials, or subjects, are dealt into folds;
for each fold the learner is fitted to the others and predicts this one. Every action is predicted
by what the subject saw and did before it, also where that is in another fold.
"""

from __future__ import annotations

import multiprocessing
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import wait
from dataclasses import asdict, dataclass, field
from functools import partial
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from pydantic import TypeAdapter
from scipy.optimize import minimize

from causal_openlock.contract.registry import parse_parameters
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import SHOWN, LearnerSpec
from causal_openlock.experiment.making import learner, make_experiment
from causal_openlock.files.digest import digest
from causal_openlock.fitting.candidates import proposals, require_optuna
from causal_openlock.fitting.effect import ON_ACTIONS, require_effect, without_effect
from causal_openlock.fitting.kept import fit_of, fitting_in, keep_fit
from causal_openlock.fitting.search import Range, SearchSpace, check_chosen
from causal_openlock.running.workers import worker_pool
from causal_openlock.schemas.fsm import BoolArray, FloatArray
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.scores import LN2
from causal_openlock.scoring.teacher_forcing import EXACT, Recorded, score_part, subject_names
from causal_openlock.version import RESULTS_VERSION
from causal_openlock.wording import counted, nearest

FILE = "fit_to_actions.json"
HOLD_OUT = ("trials", "subjects", "none")
WHOLE = -1
"""The number of the fold in which nothing is held out."""
DIFFERING = "its subjects, what they did, search space, the learner's code, seed, folds"
PENALTY = 1e6
"""Surprise, in nats, at an impossible action; finite, so that a search can continue."""
NEAR = 0.01
"""A value this near to a bound, as a share of the range, stands at it."""
NONE = "none"
"""Label in a table, instead of names of parameters."""
LOOK_EVERY = 1.0
"""Seconds between two looks at what workers have tried."""
TOLERANCE = 1e-3
"""Tolerance of parameters, as a share of their range, and of the log-likelihood, in nats."""


@dataclass(frozen=True)
class ActionPlan:
    """The settings of a fit to actions."""

    space: SearchSpace
    lapse: float = LAPSE
    hold_out: str = "trials"  #: one of :data:`HOLD_OUT`
    folds: int = 2
    candidates: int = 40  #: that Optuna proposes
    restarts: int = 2  #: of so many of them, the best, the simplex begins
    moves: int = 60  #: likelihoods that the simplex may ask for each time
    seed: int = 31
    draws: Draws = EXACT  #: how a learner without probabilities is asked

    def __post_init__(self) -> None:
        if self.hold_out not in HOLD_OUT:
            raise OpenLockError(
                f"{self.hold_out!r} cannot be held out of a fit to actions; "
                f"{nearest(str(self.hold_out), HOLD_OUT)}"
            )

    @property
    def tries(self) -> int:
        """About how many sets of parameters a fit tries at most."""
        moved = any(not one.whole for one in self.space.ranges.values())
        return self.candidates + self.restarts * self.moves * moved

    @property
    def numbers(self) -> list[int]:
        """The folds, and :data:`WHOLE`."""
        return [WHOLE, *range(self.folds if self.hold_out != "none" else 0)]

    def as_dict(self) -> dict[str, Any]:
        """All that determines what is fitted."""
        return {**asdict(self), "space": self.space.as_dict(), "version": RESULTS_VERSION}

    def spec(self, chosen: Mapping[str, float]) -> LearnerSpec:
        """The learner with some parameters."""
        name = self.space.learner
        made = learner(name, **self.space.parameters(chosen))
        return make_experiment(["CC4"], [made]).learners[0]


@dataclass(frozen=True)
class Fitted:
    """The parameters that were fitted to some actions.

    Attributes:
        who: Label of the subjects: a subject's, or ``all``.
        fold: What was held out; :data:`WHOLE` for nothing.
        chosen: The parameters.
        nll: Negative log-likelihood of the actions fitted to, in nats.
        actions: Number of these actions.
        held_out: Negative log-likelihood of the actions held out; 0 if there are none.
        held_out_actions: Number of these actions.
        standard_error: Standard error of ``nll``; 0 where it is exact.
        evaluations: How often likelihoods were computed.
        bic: Of the learner with these parameters; of a subject of a hierarchical fit, its part of
            the integrated BIC.
        between: Of a hierarchical fit, by parameter between what two thirds of the group are, or
            what a subject's is with a probability of two thirds.
        at_bound: Parameters that stand at a bound of what is searched (:func:`at_bound`).
        idle: Parameters that make no difference to how likely the actions are.
    """

    who: str
    fold: int
    chosen: dict[str, int | float]
    nll: float
    actions: int
    held_out: float
    held_out_actions: int
    standard_error: float
    evaluations: int
    bic: float
    between: dict[str, tuple[float, float]] = field(default_factory=dict)
    at_bound: tuple[str, ...] = ()
    idle: tuple[str, ...] = ()


@dataclass(frozen=True)
class FitJob:
    """One fit: to some subjects, without one fold."""

    who: str
    parts: tuple[Recorded, ...]
    fold: int
    plan: ActionPlan


def _ignore() -> None:
    """Count nothing."""


class Predictions:
    """Likelihood of some subjects' actions, by the parameters of the learner that predicts them.

    Args:
        parts: The subjects.
        plan: Which learner predicts, and how.
        tried: Called whenever another set of parameters has been tried.

    Attributes:
        known: What was computed so far.
    """

    def __init__(
        self, parts: Sequence[Recorded], plan: ActionPlan, tried: Callable[[], None] = _ignore
    ) -> None:
        self._parts, self._plan, self._tried = parts, plan, tried
        self.known: dict[tuple[float, ...], pd.DataFrame] = {}

    def __call__(self, chosen: Mapping[str, float]) -> pd.DataFrame:
        """A row for each action."""
        key, plan = tuple(chosen.values()), self._plan
        if key not in self.known:
            spec = plan.spec(chosen)
            tables = [score_part(part, spec, plan.lapse, plan.draws) for part in self._parts]
            self.known[key] = pd.concat(tables, ignore_index=True)
            self._tried()
        return self.known[key]

    def loss(self, chosen: Mapping[str, float], fold: int) -> float:
        """Negative log-likelihood of what is not held out, in nats."""
        table = self(chosen)
        own = ~held_out(table, self._plan, fold)
        return float(np.minimum(-table["log_probability"][own], PENALTY).sum())


def fit_job(job: FitJob, note: Callable[[], None] = _ignore) -> Fitted:
    """Do one fit, and call ``note`` whenever another set of parameters has been tried."""
    plan, ranges = job.plan, job.plan.space.ranges
    predicted = Predictions(job.parts, plan, note)

    def loss(chosen: Mapping[str, float]) -> float:
        return predicted.loss(chosen, job.fold)

    tried: list[tuple[dict[str, int | float], float]] = []
    while len(tried) < plan.candidates:
        for chosen in proposals(plan.space, tried, plan.seed)[: plan.candidates - len(tried)]:
            tried.append((chosen, loss(chosen)))
    tried.sort(key=lambda one: one[1])
    for chosen, _ in tried[: plan.restarts]:
        tried.append(_downhill(loss, chosen, ranges, plan.moves))
    best, nll = min(tried, key=lambda one: one[1])
    table = predicted(best)
    out = held_out(table, plan, job.fold)
    apart = -float(table["log_probability"][out].sum())
    error = float(np.sqrt((table["standard_error"][~out] ** 2).sum()))
    own, other, asked = int((~out).sum()), int(out.sum()), len(predicted.known)
    bic = 2 * nll + len(ranges) * float(np.log(own))
    return Fitted(
        job.who, job.fold, best, nll, own, apart, other, error, asked, bic,
        at_bound=at_bound(ranges, best),
        idle=without_effect(ranges, best, loss) if job.fold == WHOLE else (),
    )  # fmt: skip


def held_out(table: pd.DataFrame, plan: ActionPlan, fold: int) -> BoolArray:
    """Mask of the actions in one cross-validation fold."""
    if fold == WHOLE:
        return np.zeros(len(table), dtype=bool)
    number = table["trial"] - 1 if plan.hold_out == "trials" else table["subject"]
    dealt: BoolArray = (number % plan.folds == fold).to_numpy(bool)
    return dealt


def impossible(
    parts: Sequence[Recorded], plan: ActionPlan, fold: int, chosen: Mapping[str, float]
) -> str:
    """The first of the actions that are fitted to and that a learner would never do, in words."""
    table = Predictions(parts, plan)(chosen)
    never = table[np.isneginf(table["log_probability"]) & ~held_out(table, plan, fold)]
    if never.empty:
        return ""
    who, row = subject_names(never), never.iloc[0]
    alone = {name: own for part in parts for name, own in part.alone().items()}
    action = alone[who.iloc[0]].session().brief.action_names[row["action_index"]]
    others = f" and {counted(more, 'other subject')}" if (more := who.nunique() - 1) else ""
    return (
        f"{plan.space.learner} cannot have done what {who.iloc[0]}{others} did, with the best of "
        f"the parameters that were tried; the first such action is {action} (trial {row['trial']}, "
        f"attempt {row['attempt']}, action {row['action']}); allow for lapses, as with --lapse "
        "0.01, or search other ranges"
    )


def _downhill(
    loss: Callable[[Mapping[str, float]], float],
    start: Mapping[str, int | float],
    ranges: Mapping[str, Range],
    moves: int,
) -> tuple[dict[str, int | float], float]:
    """Descend from a candidate to the nearest minimum; whole numbers stay as they are."""
    free = [name for name, one in ranges.items() if not one.whole]
    if not free or not moves:
        return dict(start), loss(start)

    def there(place: FloatArray) -> dict[str, int | float]:
        moved = {name: of_share(ranges[name], x) for name, x in zip(free, place, strict=True)}
        return {**start, **moved}

    first = np.array([share_of(ranges[name], start[name]) for name in free])
    # The simplex begins with steps of a tenth of each range, away from the nearer bound.
    steps = np.where(first > 0.5, -0.1, 0.1)
    found = minimize(
        lambda place: loss(there(place)),
        first,
        method="Nelder-Mead",
        bounds=[(0.0, 1.0)] * len(free),
        options={
            "maxfev": moves,
            "xatol": TOLERANCE,
            "fatol": TOLERANCE,
            "initial_simplex": np.vstack([first, first + np.diag(steps)]),
        },
    )
    return there(found.x), float(found.fun)


def share_of(one: Range, value: float) -> float:
    """Position of a value between its bounds, from 0 to 1.

    >>> share_of(Range(1.0, 100.0, log=True), 10.0)
    0.5
    """
    low, high, x = (np.log(v) if one.log else v for v in (one.low, one.high, value))
    return float((x - low) / (high - low))


def of_share(one: Range, share: float) -> float:
    """Value at a position between the bounds, from 0 to 1.

    >>> of_share(Range(0.0, 4.0), 0.25)
    1.0
    """
    low, high = (np.log(v) if one.log else v for v in (one.low, one.high))
    value = low + (high - low) * float(share)
    found = float(np.exp(value)) if one.log else float(value)
    return min(max(found, one.low), one.high)


def at_bound(ranges: Mapping[str, Range], chosen: Mapping[str, float]) -> tuple[str, ...]:
    """The parameters that stand at a bound of what is searched; better values may lie beyond.

    >>> at_bound({"a": Range(0.0, 1.0), "b": Range(0.0, 1.0)}, {"a": 0.5, "b": 0.999})
    ('b',)
    """
    shares = {name: share_of(one, chosen[name]) for name, one in ranges.items()}
    return tuple(name for name, share in shares.items() if not NEAR < share < 1 - NEAR)


# -- all fits of a plan ---------------------------------------------------------------------------


def jobs_of(parts: Sequence[Recorded], plan: ActionPlan, each: bool) -> list[FitJob]:
    """The fits of a plan: to all subjects together, or to each.

    Raises:
        OpenLockError: If subjects are to be held out of a fit to one subject, there are fewer
            subjects than folds, or nobody has a trial left when one is held out.
    """
    parse_parameters(plan.space.learner, plan.space.fixed)
    if plan.hold_out == "subjects" and each:
        raise OpenLockError("of a single subject, hold out trials: --hold-out trials")
    check_folds(parts, plan)
    groups: dict[str, tuple[Recorded, ...]] = {"all": tuple(parts)}
    if each:
        groups = {who: (own,) for part in parts for who, own in part.alone().items()}
    if plan.hold_out == "trials":
        for who, own in groups.items():
            if max(map(_most_trials, own)) < 2:
                raise OpenLockError(
                    f"{who} played one trial only, and without it there is nothing to fit to; give "
                    "--hold-out none, or fit a group with --hierarchical"
                )
    return [FitJob(who, own, fold, plan) for who, own in groups.items() for fold in plan.numbers]


def check_folds(parts: Sequence[Recorded], plan: ActionPlan) -> None:
    """Refuse to hold out subjects if a fold has none.

    Raises:
        OpenLockError: If it does, with how many folds there can be.
    """
    numbers = {number for part in parts for number in part.numbers}

    def have_subjects(folds: int) -> bool:
        return len({number % folds for number in numbers}) == folds

    if plan.hold_out != "subjects" or have_subjects(plan.folds):
        return
    fewer = next(filter(have_subjects, range(plan.folds - 1, 1, -1)), None)
    remedy = f"give --folds {fewer}" if fewer else "give --hold-out trials or --hold-out none"
    raise OpenLockError(
        f"{plan.folds} folds would not each have a subject: subjects are dealt by number, "
        f"and there {'is' if len(numbers) == 1 else 'are'} {len(numbers)}; {remedy}"
    )


def _most_trials(part: Recorded) -> int:
    """Largest number of trials that a subject played."""
    first = (part.rows["attempt"] == 1) & (part.rows["phase"] != SHOWN)
    return int(first.groupby(part.rows["subject"]).sum().max())


def fit_all(
    jobs: Sequence[FitJob],
    folder: Path,
    *,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
    tried: Callable[[int], None] = lambda number: None,
) -> list[Fitted]:
    """Do all fits, or those that are missing; finished fits are stored in the folder.

    Args:
        jobs: The fits.
        folder: Where what is done is kept.
        workers: How many processes fit.
        report: Called with the number of fits that are done, and of all.
        tried: Called now and then with how many sets of parameters have been tried so far.

    Raises:
        OpenLockError: If Optuna is not installed.
        StoreError: If the folder holds another fit, or another process fits there.
        LearnerError: If the learner cannot have done what was done, or a parameter makes no
            difference to any fit.
    """
    require_optuna()
    path, plan = folder / FILE, jobs[0].plan
    whole = {**plan.as_dict(), "jobs": [[one.who, one.fold] for one in jobs]}
    whole["subjects"] = subjects_of([part for job in jobs for part in job.parts])

    def read(kept: Mapping[str, Any]) -> list[Fitted]:
        found = fits_of(kept, plan.space.ranges)
        if [[one.who, one.fold] for one in found] != whole["jobs"][: len(found)]:
            raise ValueError("the fits are not in the order of the jobs")
        return found

    with fitting_in(folder):
        done = fit_of(path, whole, read, "fit to actions", DIFFERING) or []
        for number in range(1, len(done) + 1):
            _check(jobs, done[:number])
        for found in _fits(jobs[len(done) :], workers, tried):
            done.append(found)
            keep_fit(path, whole, done=[asdict(one) for one in done])
            _check(jobs, done)
            report(len(done), len(jobs))
    return done


def _check(jobs: Sequence[FitJob], done: Sequence[Fitted]) -> None:
    """Raise LearnerError if the last fit is to the impossible, or all are without some effect."""
    job, last = jobs[len(done) - 1], done[-1]
    if last.nll >= PENALTY and (why := impossible(job.parts, job.plan, job.fold, last.chosen)):
        raise LearnerError(why)
    idle = [one.idle for one in done if one.fold == WHOLE]
    if len(idle) == sum(one.fold == WHOLE for one in jobs):
        require_effect(idle, ON_ACTIONS.format(job.plan.space.learner))


def subjects_of(parts: Sequence[Recorded]) -> dict[str, str]:
    """The names of all subjects, each with a digest of what it did."""
    alone = {who: own for part in parts for who, own in part.alone().items()}
    return {who: digest(own.done()[0].tobytes()) for who, own in alone.items()}


def fits_of(kept: Mapping[str, Any], ranges: Mapping[str, Range]) -> list[Fitted]:
    """The fits that a file keeps, within the ranges of what is searched.

    Raises:
        ValueError: If they are not such fits; or the error that data of another form raise.
    """
    found = TypeAdapter(list[Fitted]).validate_python(kept["done"])
    for one in found:
        check_chosen(one.chosen, ranges)
    if any(one.fold == WHOLE and one.actions < 1 for one in found):
        raise ValueError("a fit to nothing")
    return found


def _fits(jobs: Sequence[FitJob], workers: int, tried: Callable[[int], None]) -> Iterator[Fitted]:
    """Do fits, in order."""
    if workers == 1 or len(jobs) == 1:
        number = count(1)
        for job in jobs:
            yield fit_job(job, lambda: tried(next(number)))
        return
    total = multiprocessing.get_context("spawn").Value("Q")
    with worker_pool(min(workers, len(jobs)), partial(_count_in, total)) as pool:
        for found in [pool.submit(_fit_counted, job) for job in jobs]:
            while wait([found], LOOK_EVERY).not_done:
                tried(total.value)
            yield found.result()


_total: Any = None
"""Number of sets of parameters that all workers have tried, in a worker."""


def _count_in(total: Any) -> None:
    """Make a worker count in a number that it shares with the others."""
    global _total
    _total = total


def _fit_counted(job: FitJob) -> Fitted:
    return fit_job(job, _count)


def _count() -> None:
    with _total.get_lock():
        _total.value += 1


def fit_table(fits: Sequence[Fitted]) -> pd.DataFrame:
    """The fits without anything held out, a row each, with what was predicted in the folds.

    Returns:
        Columns ``who``; the parameters; of a hierarchical fit, ``NAME_low`` and ``NAME_high`` of
        each (:attr:`Fitted.between`); ``nll`` in nats with its ``standard_error``; ``actions``;
        ``bits`` per action of what was fitted and ``held_out_bits``; ``bic``; and the names of the
        parameters that stand ``at_bound`` and that are ``without_effect``, or ``none``.
    """
    rows, folds = [], defaultdict(list)
    for one in fits:
        if one.fold != WHOLE:
            folds[one.who].append(one)
    for one in fits:
        if one.fold != WHOLE:
            continue
        own = folds[one.who]
        apart = sum(other.held_out for other in own)
        of = sum(other.held_out_actions for other in own)
        rows.append(
            {
                "who": one.who,
                **one.chosen,
                **{f"{name}_low": low for name, (low, _) in one.between.items()},
                **{f"{name}_high": high for name, (_, high) in one.between.items()},
                "nll": one.nll,
                "standard_error": one.standard_error,
                "actions": one.actions,
                "bits": one.nll / one.actions / LN2,
                "held_out_bits": apart / of / LN2 if of else np.nan,
                "bic": one.bic,
                "at_bound": " ".join(one.at_bound) or NONE,
                "without_effect": " ".join(one.idle) or NONE,
            }
        )
    return pd.DataFrame(rows)
