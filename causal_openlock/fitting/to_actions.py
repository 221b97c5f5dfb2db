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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cache, partial
from pathlib import Path

import numpy as np
import pandas as pd

from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.condition import SHOWN
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import digest, json_bytes
from causal_openlock.fitting.plan import Chosen, Plan
from causal_openlock.fitting.search import NONE, at_bound, require_effect, search, without_effect
from causal_openlock.fitting.steps import begin, fitting_in, steps
from causal_openlock.schemas.fsm import BoolArray
from causal_openlock.scoring.recorded import Recorded, subject_names
from causal_openlock.scoring.scores import LN2
from causal_openlock.scoring.teacher_forcing import score_part

FILE = "fit_to_actions.json"  #: file of a finished fit
WHOLE = -1  #: the number of the fold in which nothing is held out
PENALTY = 1e6  #: surprise, in nats, at an impossible action; finite, so that a search can continue


@dataclass(frozen=True)
class Fitted:
    """The parameters that were fitted to some actions."""

    who: str  #: label of the subjects: a subject's, or ``all``
    fold: int  #: what was held out; :data:`WHOLE` for nothing
    chosen: dict[str, int | float]
    nll: float  #: negative log-likelihood of the actions fitted to, in nats
    actions: int  #: number of these actions
    held_out: float  #: negative log-likelihood of the actions held out; 0 if there are none
    held_out_actions: int  #: number of these actions
    standard_error: float  #: standard error of ``nll``; 0 where it is exact
    bic: float  #: of a subject in a group, its part of the integrated BIC
    #: of a hierarchical fit, between what two thirds of the group are, or a subject probably is
    between: dict[str, tuple[float, float]] = field(default_factory=dict)
    idle: tuple[str, ...] = ()  #: parameters that make no difference to how likely actions are


def predictions(parts: Sequence[Recorded], plan: Plan) -> Callable[[Chosen], pd.DataFrame]:
    """How likely subjects' actions are, a row each, by the parameters of the learner.

    What was computed once for some parameters is not computed again.
    """

    @cache
    def table(*values: float) -> pd.DataFrame:
        spec = plan.spec(dict(zip(plan.ranges, values, strict=True)))
        scores = [score_part(part, spec, plan.fit.lapse)[0] for part in parts]
        return pd.concat(scores, ignore_index=True)

    return lambda chosen: table(*chosen.values())


def surprise(table: pd.DataFrame, plan: Plan, fold: int) -> float:
    """Negative log-likelihood of what is not held out, in nats; of :func:`predictions`."""
    fitted = ~held_out(table, plan, fold)
    return float(np.minimum(-table["log_probability"][fitted], PENALTY).sum())


def held_out(table: pd.DataFrame, plan: Plan, fold: int) -> BoolArray:
    """Mask of the actions in one cross-validation fold."""
    if fold == WHOLE:
        return np.zeros(len(table), dtype=bool)
    number = table["trial"] - 1 if plan.fit.hold_out == "trials" else table["subject"]
    dealt: BoolArray = (number % plan.fit.folds == fold).to_numpy(bool)
    return dealt


def folds_of(plan: Plan) -> list[int]:
    """The folds, and :data:`WHOLE`."""
    return [WHOLE, *range(plan.fit.folds if plan.fit.hold_out != NONE else 0)]


def fit_fold(who: str, parts: Sequence[Recorded], fold: int, plan: Plan) -> Fitted:
    """Fit to some subjects, of this label, without one fold."""
    ranges, predicted = plan.ranges, predictions(parts, plan)

    def loss(chosen: Chosen) -> float:
        return surprise(predicted(chosen), plan, fold)

    tried = search(ranges, lambda sets: map(loss, sets), plan.fit.candidates, plan.fit.seed)
    best, nll = min(tried, key=lambda one: one.loss)
    table = predicted(best)
    out = held_out(table, plan, fold)
    return Fitted(
        who=who,
        fold=fold,
        chosen=best,
        nll=nll,
        actions=int((~out).sum()),
        held_out=-float(table["log_probability"][out].sum()),
        held_out_actions=int(out.sum()),
        standard_error=float(np.sqrt((table["standard_error"][~out] ** 2).sum())),
        bic=2 * nll + len(ranges) * float(np.log((~out).sum())),
        idle=without_effect(ranges, best, loss) if fold == WHOLE else (),
    )


def require_possible(
    nll: float, parts: Sequence[Recorded], fold: int, chosen: Chosen, plan: Plan
) -> None:
    """Raise LearnerError if an action that is fitted to is one that the learner would never do."""
    if nll < PENALTY:
        return
    table = predictions(parts, plan)(chosen)
    never = table[np.isneginf(table["log_probability"]) & ~held_out(table, plan, fold)]
    who, first = subject_names(never).iloc[0], never.iloc[0]
    action = alone(parts)[who].session().brief.action_names[first["action_index"]]
    raise LearnerError(
        f"{plan.learner} cannot have done what {who} did, with the best of the parameters "
        f"that were tried: {action} (trial {first['trial']}, attempt {first['attempt']}, action "
        f"{first['action']}); allow for lapses, as with --set lapse=0.01, or search other ranges"
    )


def alone(parts: Sequence[Recorded]) -> dict[str, Recorded]:
    """Each subject by itself, by its name."""
    return {who: own for part in parts for who, own in part.alone().items()}


def subjects_of(parts: Sequence[Recorded]) -> dict[str, str]:
    """The names of all subjects, each with a digest of what it did."""
    return {who: digest(own.done()[0].tobytes()) for who, own in alone(parts).items()}


def groups_of(parts: Sequence[Recorded], plan: Plan) -> dict[str, Sequence[Recorded]]:
    """By label, the subjects that have parameters together: all of them, or each.

    Raises:
        OpenLockError: If subjects are to be held out of a fit to one subject, there are fewer
            subjects or trials than folds, or nobody has a trial left when one is held out.
    """
    if plan.fit.hold_out == "subjects" and plan.fit.each:
        raise OpenLockError("of a single subject, hold out trials: --set hold_out=trials")
    check_folds(parts, plan)
    groups: dict[str, Sequence[Recorded]] = {"all": parts}
    if plan.fit.each:
        groups = {who: (own,) for who, own in alone(parts).items()}
    for who, group in groups.items():
        trials = max(
            part.done_actions["trial"][part.done_actions["phase"] != SHOWN].nunique()
            for part in group
        )
        if plan.fit.hold_out == "trials" and trials < 2:
            raise OpenLockError(
                f"{who} played one trial only, and without it there is nothing to fit to; give "
                "--set hold_out=none, or fit a group with --hierarchical"
            )
    return groups


def check_folds(parts: Sequence[Recorded], plan: Plan) -> None:
    """Raise OpenLockError if subjects or trials are to be held out, and a fold has none."""
    what, other, folds = "subject", "trials", plan.fit.folds
    numbers = {number for part in parts for number in part.numbers}
    if plan.fit.hold_out == "trials":
        what, other = "trial", "none"
        done = pd.concat([part.done_actions for part in parts])
        numbers = set(done.loc[done["phase"] != SHOWN, "trial"])
    if plan.fit.hold_out != NONE and len({number % folds for number in numbers}) < folds:
        raise OpenLockError(
            f"{folds} folds would not each have a {what}, dealt by their numbers, of which there "
            f"are {len(numbers)}; give fewer with --set folds=, or --set hold_out={other}"
        )


def fit_all(
    groups: Mapping[str, Sequence[Recorded]],
    plan: Plan,
    folder: Path,
    *,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> list[Fitted]:
    """Do all fits of a plan, or those that are missing; finished fits are stored in the folder.

    The groups are from :func:`groups_of`; ``report`` is called with the number of finished fits,
    and of all.

    Raises:
        StoreError: If another process fits in the folder, or a stored fit is none.
        LearnerError: If the learner cannot have done what was done, or a parameter makes no
            difference to any fit.
    """
    about, done = plan.as_dict(), list[Fitted]()
    with fitting_in(folder, min(workers, len(groups) * len(folds_of(plan)))) as pool:
        jobs = [
            ([about, subjects_of(parts), who, fold],
             partial(begin, pool, fit_fold, who, parts, fold, plan))
            for who, parts in groups.items()
            for fold in folds_of(plan)
        ]  # fmt: skip
        for fitted in steps(folder, jobs, Fitted):
            parts = groups[fitted.who]
            require_possible(fitted.nll, parts, fitted.fold, fitted.chosen, plan)
            done.append(fitted)
            report(len(done), len(jobs))
        require_effect([fitted.idle for fitted in done if fitted.fold == WHOLE], plan.learner)
        write_fits(folder, plan, [part for parts in groups.values() for part in parts], done)
    return done


def write_fits(folder: Path, plan: Plan, parts: Sequence[Recorded], fits: Sequence[Fitted]) -> None:
    """Write the fits of a plan, with all that decided them."""
    about = {**plan.as_dict(), "subjects": subjects_of(parts)}
    data = {"plan": about, "done": [asdict(fitted) for fitted in fits]}
    write_bytes(folder / FILE, json_bytes(data))


def fit_table(fits: Sequence[Fitted], plan: Plan) -> pd.DataFrame:
    """The fits without anything held out, a row each, with what was predicted in the folds.

    Returns:
        Columns ``who``; the parameters; of a hierarchical fit, ``NAME_low`` and ``NAME_high`` of
        each (:attr:`Fitted.between`); ``nll`` in nats with its ``standard_error``; ``actions``;
        ``bits`` per action of what was fitted and ``held_out_bits``; ``bic``; and the names of the
        parameters that stand ``at_bound`` and that are ``without_effect``, or ``none``.
    """
    rows = []
    for fitted in fits:
        if fitted.fold != WHOLE:
            continue
        folds = [one for one in fits if one.who == fitted.who and one.fold != WHOLE]
        apart = sum(fold.held_out for fold in folds)
        actions = sum(fold.held_out_actions for fold in folds)
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
                "at_bound": " ".join(at_bound(plan.ranges, fitted.chosen)) or NONE,
                "without_effect": " ".join(fitted.idle) or NONE,
            }
        )
    return pd.DataFrame(rows)
