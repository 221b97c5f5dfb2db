"""Fitted learners that predict: each subject by the parameters that were fitted to it, or to all.

What was fitted to actions predicts them too well. There are two ways to allow for that:

* A fit that held something out predicts each action by what was fitted *without* it: without its
  trial, or its subject. Its log-likelihood is then compared as it is, and no parameter has a price.
* Of one that held nothing out, each subject has its part of the BIC: half a logarithm of the number
  of actions for each parameter, or of the means and spreads of a group (integrated BIC). Its bits
  per action are still those of what it was fitted to.

Both are what random-effects model selection takes as log evidence
(:mod:`~causal_openlock.scoring.model_selection`), in place of learners at parameters that were
chosen. Each learner is fitted as if all subjects followed it.

A fit may come from other people. It is read as numbers; a learner that is code next to it, or whose
settings may name a file or an address, is used only if the user also names this learner.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal, get_origin, get_type_hints

import pandas as pd

from causal_openlock.contract.learner import Account
from causal_openlock.contract.registry import learner_class
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.experiment.making import LearnerForm, listed, make_experiment
from causal_openlock.files.validation import adapter
from causal_openlock.fitting.plan import FitSettings, Plan, Range, make_plan
from causal_openlock.fitting.search import NONE
from causal_openlock.fitting.steps import read_fit_file
from causal_openlock.fitting.to_actions import (
    FILE,
    WHOLE,
    Fitted,
    alone,
    folds_of,
    held_out,
    subjects_of,
)
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.recorded import (
    GROUP,
    Recorded,
    record_digest,
    recorded_subjects,
    subject_names,
)
from causal_openlock.scoring.scores import Scores, choices_in
from causal_openlock.scoring.teacher_forcing import known_learners, scored_parts
from causal_openlock.storage.store import Store
from causal_openlock.wording import joined


@dataclass(frozen=True)
class FitOfActions:
    """A whole fit to actions, as it is stored."""

    label: str  #: name of its folder; the learner goes by it
    plan: Plan
    fits: Mapping[tuple[str, int], Fitted]  #: by whom it is of (a subject, or ``all``) and fold
    subjects: Mapping[str, str]  #: names of all subjects, each with a digest of what it did

    @property
    def holds_out(self) -> bool:
        """Whether actions are predicted by what was fitted without them."""
        return self.plan.fit.hold_out != NONE

    def of(self, who: str, fold: int) -> Fitted:
        """The fit for a subject."""
        return self.fits.get((who, fold)) or self.fits["all", fold]

    def price(self, who: str) -> float:
        """Difference of a subject's BIC from twice its negative log-likelihood."""
        if self.holds_out:
            return 0.0
        fitted = self.of(who, WHOLE)
        return (fitted.bic - 2 * fitted.nll) / (len(self.subjects) if fitted.who == "all" else 1)


def read_fit(folder: Path, named: Collection[str] = ()) -> FitOfActions:
    """A fit to actions, from the folder of ``fit --to``; those of version 0.2 are read as well.

    Learners that are ``named`` may be used whatever they are.

    Raises:
        StoreError: If there is none, it is not whole, its learner has to be named, or is of other
            code than it was fitted with.
    """
    path = folder / FILE
    if not path.exists():
        raise StoreError(f"{folder} holds no fit to actions; make one with: fit NAME --to FOLDER")

    def read(stored: dict[str, Any]) -> FitOfActions:
        about = stored["plan"]
        space, names = about["space"], ("lapse", "hold_out", "folds")
        subjects = adapter(dict[str, str]).validate_python(about["subjects"])
        _check_named(str(space["learner"]), dict(space["fixed"]), named, path)
        ranges = adapter(dict[str, Range]).validate_python(space["search"])
        fit = FitSettings.model_validate({name: about[name] for name in names})
        plan = make_plan(space["learner"], ranges, space["fixed"], fit)
        if space.get("code", {}) != plan.code:
            raise StoreError(
                f"{path}: the code of its learner {plan.learner}, or a file that it uses, is "
                "not what it was fitted with; fit it again"
            )
        fits: list[Fitted] = adapter(list[Fitted]).validate_python(stored["done"])
        for fitted in fits:
            for name, bounds in plan.ranges.items():
                if not bounds.low <= fitted.chosen[name] <= bounds.high:
                    raise ValueError("a parameter is outside its bounds")
        by_fold = {(fitted.who, fitted.fold): fitted for fitted in fits}
        return FitOfActions(folder.resolve().name, plan, by_fold, subjects)

    fit = read_fit_file(path, read, "give the folder that fit NAME --to wrote")
    for who in fit.subjects:
        for fold in folds_of(fit.plan):
            if not {(who, fold), ("all", fold)} & set(fit.fits):
                raise StoreError(f"{path}: the fit is not whole; give its command again")
    return fit


def _check_named(
    learner: str, fixed: Mapping[str, Any], named: Collection[str], path: Path
) -> None:
    """Refuse a learner that is code, or a setting that may name a file, unless it is named."""
    hints = {} if ":" in learner else get_type_hints(learner_class(learner).Parameters)
    texts = [
        f"sets {name}, which may name a file"
        for name, value in fixed.items()
        if not isinstance(value, bool | int | float) and get_origin(hints.get(name)) is not Literal
    ]
    why = ["is code next to it"] if ":" in learner else texts
    if why and learner not in named:
        raise StoreError(
            f"{path}: its learner {learner} {why[0]}; if you trust it, name it too: "
            f"--learner {learner}"
        )


def score_folder(
    folder: Path,
    learners: LearnerForm | Sequence[LearnerForm | LearnerSpec] = (),
    *,
    fits: Path | str | Sequence[Path | str] = (),
    of: Sequence[str] | str = (),
    lapse: float = LAPSE,
    draws: int | None = None,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Scores:
    """Let learners predict every action of these subjects: who predicts best?

    Args:
        folder: The results folder; in ``results.score(...)`` it is given.
        learners: As in :func:`~causal_openlock.compare`.
        fits: Folders of fits to actions; each predicts by its folder's name, and only subjects that
            were fitted in each of them are predicted.
        of: Labels of the learners whose subjects are predicted; by default all.
        lapse: The share of actions that are taken to be random.
        draws: Most copies to ask of a learner that gives no probabilities; see
            :func:`~causal_openlock.scoring.inverse_binomial.limit_of_draws`; None for predictions.
        workers: How many processes work; with one it is this process.
        report: Called with how many parts of the work are done, of how many.

    Raises:
        LearnerError: If a learner cannot be put in another's place.
        StoreError: If the results are from several folders, or cannot be played again; or if a fit
            is of other subjects, or of other actions of theirs.
        OpenLockError: If nobody predicts, or fits cannot be compared: one held something out and
            another nothing, they took another share of lapses, or have the same name.

    Example:
        >>> from causal_openlock import compare
        >>> results = compare("CC3", ["oracle"], subjects=2, workers=1)
        >>> results.score(["random", "oracle"]).ranking["scored"].tolist()
        ['oracle', 'random']
    """
    asked, fits = listed(learners), listed(fits)
    if not (asked or fits):
        raise OpenLockError("name who predicts: learners (--learner, --from), or fits (--fits)")
    specs = make_experiment(["CC4"], asked).learners if asked else ()
    fitted = [read_fit(Path(path), [spec.learner for spec in specs]) for path in fits]
    record, experiment = Store(folder).record()
    of = [spec.name for spec in known_learners(of, experiment.learners)]
    parts = recorded_subjects(record, experiment, of)
    tables, shared, accounts = [], dict[str, Recorded](), list[Account]()
    how: dict[str, Any] = {"draws": draws, "workers": workers, "accounts": accounts}
    if fitted:
        _check(fitted, [spec.name for spec in specs], subjects_of(parts), lapse)
        in_all = set.intersection(*(set(fit.subjects) for fit in fitted))
        shared = {who: own for who, own in alone(parts).items() if who in in_all}
        if not shared:
            labels = joined([fit.label for fit in fitted])
            raise StoreError(f"no subject was fitted in each of {labels}; fit to the same subjects")
        tables = [_predicted(fit, shared, **how) for fit in fitted]
    if specs:
        jobs = [(part, spec) for part in parts for spec in specs]
        table = pd.concat(scored_parts(jobs, lapse, **how, report=report), ignore_index=True)
        tables.append(table[subject_names(table).isin(shared)] if fitted else table)
    actions = pd.concat(tables, ignore_index=True)
    digest = record_digest(record, experiment, set(actions["learner"]))
    return Scores(actions, choices_in(experiment), digest, tuple(accounts))


def _check(
    fits: Sequence[FitOfActions], learners: Sequence[str], subjects: Mapping[str, str], lapse: float
) -> None:
    """Refuse fits that cannot be compared, or that are of other actions of these subjects."""
    labels = [*learners, *(fit.label for fit in fits)]
    for fit in fits:
        if labels.count(fit.label) > 1:
            raise OpenLockError(f"{fit.label} is there twice; rename the folder of a fit")
        if fit.plan.fit.lapse != lapse:
            raise OpenLockError(
                f"{fit.label} was fitted with a share of lapses of {fit.plan.fit.lapse:g}; give "
                f"--lapse {fit.plan.fit.lapse:g}"
            )
        if fit.holds_out != fits[0].holds_out:
            raise OpenLockError(
                f"one of {fits[0].label} and {fit.label} held something out and the other nothing, "
                "so that they cannot be compared; fit one of them again, with another hold_out"
            )
        if any(fit.subjects.get(who, actions) != actions for who, actions in subjects.items()):
            raise StoreError(
                f"{fit.label} was fitted to other actions of these subjects; fit again"
            )


def _predicted(fit: FitOfActions, subjects: Mapping[str, Recorded], **how: Any) -> pd.DataFrame:
    """The scores of a fitted learner, where possible by what was fitted without the action."""
    plan = fit.plan
    folds = [fold for fold in folds_of(plan) if (fold != WHOLE) == fit.holds_out]
    jobs = [(who, fold) for who in subjects for fold in folds]
    parts = [
        (subjects[who], replace(plan.spec(fit.of(who, fold).chosen), name=fit.label))
        for who, fold in jobs
    ]
    scored = scored_parts(parts, plan.fit.lapse, **how)
    tables = [
        table[held_out(table, plan, fold) == fit.holds_out]
        for (_, fold), table in zip(jobs, scored, strict=True)
    ]
    order = [*GROUP, "subject", "trial", "attempt", "action"]
    table = pd.concat(tables).sort_values(order, kind="stable", ignore_index=True)
    return table.assign(price=subject_names(table).map(fit.price))
