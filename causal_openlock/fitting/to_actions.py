"""Fitting to actions: with which parameters does a learner predict best what subjects did?

Maximum likelihood (:mod:`~causal_openlock.fitting.search`): all subjects follow the same
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
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import wait
from dataclasses import asdict, dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.declare import SHOWN
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import json_bytes
from causal_openlock.files.digest import digest
from causal_openlock.files.validation import adapter
from causal_openlock.fitting.search import (
    NONE,
    ON_ACTIONS,
    at_bound,
    require_effect,
    search,
    without_effect,
)
from causal_openlock.fitting.space import Chosen, Plan, SearchSpace
from causal_openlock.fitting.steps import fitting_in, steps
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.scoring.recorded import Recorded, subject_names
from causal_openlock.scoring.scores import LN2
from causal_openlock.scoring.teacher_forcing import score_part

FILE = "fit_to_actions.json"
"""File of a finished fit."""
WHOLE = -1
"""The number of the fold in which nothing is held out."""
PENALTY = 1e6
"""Surprise, in nats, at an impossible action; finite, so that a search can continue."""
LOOK_EVERY = 1.0
"""Seconds between two looks at what workers have tried."""


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
        at_bound: Parameters that stand at a bound of what is searched
            (:func:`~causal_openlock.fitting.search.at_bound`).
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
    plan: Plan


class Predictions:
    """Likelihood of some subjects' actions, by the parameters of the learner that predicts them.

    ``tried`` is called whenever another set of parameters has been tried.
    """

    def __init__(
        self, parts: Sequence[Recorded], plan: Plan, tried: Callable[[], None] = lambda: None
    ) -> None:
        self._parts, self._plan, self._tried = parts, plan, tried
        self._known: dict[tuple[float, ...], pd.DataFrame] = {}

    def __len__(self) -> int:
        """Number of sets of parameters that were tried."""
        return len(self._known)

    def __call__(self, chosen: Chosen) -> pd.DataFrame:
        """A row for each action."""
        key, plan = tuple(chosen.values()), self._plan
        if key not in self._known:
            spec = plan.space.spec(chosen)
            tables = [score_part(part, spec, plan.fit.lapse) for part in self._parts]
            self._known[key] = pd.concat(tables, ignore_index=True)
            self._tried()
        return self._known[key]

    def loss(self, chosen: Chosen, fold: int) -> float:
        """Negative log-likelihood of what is not held out, in nats."""
        table = self(chosen)
        fitted = ~held_out(table, self._plan, fold)
        return float(np.minimum(-table["log_probability"][fitted], PENALTY).sum())


def fit_job(job: FitJob, note: Callable[[], None] = lambda: None) -> Fitted:
    """Do one fit, and call ``note`` whenever another set of parameters has been tried."""
    plan, ranges = job.plan, job.plan.space.ranges
    predicted = Predictions(job.parts, plan, note)
    loss = partial(predicted.loss, fold=job.fold)
    tried = search(ranges, lambda sets: map(loss, sets), plan.candidates, plan.fit.seed)
    best, nll = min(tried, key=lambda one: one.loss)
    table = predicted(best)
    out = held_out(table, plan, job.fold)
    return Fitted(
        who=job.who,
        fold=job.fold,
        chosen=best,
        nll=nll,
        actions=int((~out).sum()),
        held_out=-float(table["log_probability"][out].sum()),
        held_out_actions=int(out.sum()),
        standard_error=float(np.sqrt((table["standard_error"][~out] ** 2).sum())),
        evaluations=len(predicted),
        bic=2 * nll + len(ranges) * float(np.log((~out).sum())),
        at_bound=at_bound(ranges, best),
        idle=without_effect(ranges, best, loss) if job.fold == WHOLE else (),
    )


def numbers_of_folds(plan: Plan) -> list[int]:
    """The folds, and :data:`WHOLE`."""
    return [WHOLE, *range(plan.fit.folds if plan.hold_out != NONE else 0)]


def held_out(table: pd.DataFrame, plan: Plan, fold: int) -> BoolArray:
    """Mask of the actions in one cross-validation fold."""
    if fold == WHOLE:
        return np.zeros(len(table), dtype=bool)
    number = table["trial"] - 1 if plan.hold_out == "trials" else table["subject"]
    dealt: BoolArray = (number % plan.fit.folds == fold).to_numpy(bool)
    return dealt


def impossible(parts: Sequence[Recorded], plan: Plan, fold: int, chosen: Chosen) -> LearnerError:
    """Name the first of the actions that are fitted to and that a learner would never do."""
    table = Predictions(parts, plan)(chosen)
    never = table[np.isneginf(table["log_probability"]) & ~held_out(table, plan, fold)]
    who, first = subject_names(never).iloc[0], never.iloc[0]
    action = alone(parts)[who].session().brief.action_names[first["action_index"]]
    return LearnerError(
        f"{plan.space.learner} cannot have done what {who} did, with the best of the parameters "
        f"that were tried: {action} (trial {first['trial']}, attempt {first['attempt']}, action "
        f"{first['action']}); allow for lapses, as with --set lapse=0.01, or search other ranges"
    )


def alone(parts: Sequence[Recorded]) -> dict[str, Recorded]:
    """Each subject by itself, by its name."""
    return {who: own for part in parts for who, own in part.alone().items()}


def subjects_of(parts: Sequence[Recorded]) -> dict[str, str]:
    """The names of all subjects, each with a digest of what it did."""
    return {who: digest(own.done()[0].tobytes()) for who, own in alone(parts).items()}


# -- all fits of a plan ---------------------------------------------------------------------------


def jobs_of(parts: Sequence[Recorded], plan: Plan) -> list[FitJob]:
    """The fits of a plan: to all subjects together, or to each.

    Raises:
        OpenLockError: If subjects are to be held out of a fit to one subject, there are fewer
            subjects than folds, or nobody has a trial left when one is held out.
    """
    if plan.hold_out == "subjects" and plan.fit.each:
        raise OpenLockError("of a single subject, hold out trials: --set hold_out=trials")
    check_folds(parts, plan)
    groups = {"all": tuple(parts)}
    if plan.fit.each:
        groups = {who: (own,) for who, own in alone(parts).items()}
    for who, group in groups.items():
        if plan.hold_out == "trials" and max(map(_most_trials, group)) < 2:
            raise OpenLockError(
                f"{who} played one trial only, and without it there is nothing to fit to; give "
                "--set hold_out=none, or fit a group with --hierarchical"
            )
    return [
        FitJob(who, group, fold, plan)
        for who, group in groups.items()
        for fold in numbers_of_folds(plan)
    ]


def check_folds(parts: Sequence[Recorded], plan: Plan) -> None:
    """Raise OpenLockError if subjects are to be held out, and a fold has none."""
    numbers, folds = {number for part in parts for number in part.numbers}, plan.fit.folds
    if plan.hold_out == "subjects" and len({number % folds for number in numbers}) < folds:
        raise OpenLockError(
            f"{folds} folds would not each have a subject, dealt by their numbers, of which there "
            f"are {len(numbers)}; give fewer with --set folds=, or --set hold_out=trials"
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
    report: Callable[[int, int], None] = lambda done, tried: None,
) -> list[Fitted]:
    """Do all fits, or those that are missing; finished fits are stored in the folder.

    Args:
        jobs: The fits.
        folder: Where fits are stored.
        workers: How many processes fit.
        report: Called with the numbers of finished fits and of sets of parameters tried.

    Raises:
        StoreError: If another process fits in the folder, or a stored fit is none.
        LearnerError: If the learner cannot have done what was done, or a parameter makes no
            difference to any fit.
    """
    plan = jobs[0].plan
    total = multiprocessing.get_context("spawn").Value("Q")
    done: list[Fitted] = []
    with fitting_in(folder, min(workers, len(jobs)), partial(_count_in, total)) as pool:

        def start(job: FitJob) -> Callable[[], Fitted]:
            if pool is None:
                return lambda: fit_job(job, here)
            future = pool.submit(_fit_counted, job)

            def finished() -> Fitted:
                while wait([future], LOOK_EVERY).not_done:
                    report(len(done), total.value)
                return future.result()

            return finished

        def here() -> None:
            total.value += 1
            report(len(done), total.value)

        about = [[plan.as_dict(), subjects_of(job.parts), job.who, job.fold] for job in jobs]
        results = steps(folder, [*zip(about, jobs, strict=True)], start, Fitted)
        for job, fitted in zip(jobs, results, strict=True):
            if fitted.nll >= PENALTY:
                raise impossible(job.parts, plan, job.fold, fitted.chosen)
            done.append(fitted)
            report(len(done), total.value)
        require_effect(
            [fitted.idle for fitted in done if fitted.fold == WHOLE],
            ON_ACTIONS.format(plan.space.learner),
        )
        write_fits(folder, plan, [part for job in jobs for part in job.parts], done)
    return done


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


def write_fits(folder: Path, plan: Plan, parts: Sequence[Recorded], fits: Sequence[Fitted]) -> None:
    """Write the fits of a plan, with all that decided them."""
    about = {**plan.as_dict(), "subjects": subjects_of(parts)}
    data = {"plan": about, "done": [asdict(fitted) for fitted in fits]}
    write_bytes(folder / FILE, json_bytes(data))


def fits_of(stored: Mapping[str, Any], space: SearchSpace) -> list[Fitted]:
    """The fits in a file, within the ranges of what is searched.

    Raises:
        ValueError: If they are not such fits; or the error that data of another form raise.
    """
    fits: list[Fitted] = adapter(list[Fitted]).validate_python(stored["done"])
    for fitted in fits:
        space.check(fitted.chosen)
        if fitted.fold == WHOLE and fitted.actions < 1:
            raise ValueError("a fit to nothing")
    return fits


def fit_table(fits: Sequence[Fitted]) -> pd.DataFrame:
    """The fits without anything held out, a row each, with what was predicted in the folds.

    Returns:
        Columns ``who``; the parameters; of a hierarchical fit, ``NAME_low`` and ``NAME_high`` of
        each (:attr:`Fitted.between`); ``nll`` in nats with its ``standard_error``; ``actions``;
        ``bits`` per action of what was fitted and ``held_out_bits``; ``bic``; and the names of the
        parameters that stand ``at_bound`` and that are ``without_effect``, or ``none``.
    """
    rows, folds = [], defaultdict(list)
    for fitted in fits:
        if fitted.fold != WHOLE:
            folds[fitted.who].append(fitted)
    for fitted in fits:
        if fitted.fold != WHOLE:
            continue
        apart = sum(fold.held_out for fold in folds[fitted.who])
        actions = sum(fold.held_out_actions for fold in folds[fitted.who])
        rows.append(
            {
                "who": fitted.who,
                **fitted.chosen,
                **{f"{name}_low": low for name, (low, _) in fitted.between.items()},
                **{f"{name}_high": high for name, (_, high) in fitted.between.items()},
                "nll": fitted.nll,
                "standard_error": fitted.standard_error,
                "actions": fitted.actions,
                "bits": fitted.nll / fitted.actions / LN2,
                "held_out_bits": apart / actions / LN2 if actions else np.nan,
                "bic": fitted.bic,
                "at_bound": " ".join(fitted.at_bound) or NONE,
                "without_effect": " ".join(fitted.idle) or NONE,
            }
        )
    return pd.DataFrame(rows)
