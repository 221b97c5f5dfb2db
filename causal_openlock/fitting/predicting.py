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
from typing import TYPE_CHECKING, Any, Literal, get_origin, get_type_hints

import pandas as pd
from pydantic import TypeAdapter

from causal_openlock.contract.registry import learner_class
from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.experiment.declare import LearnerSpec
from causal_openlock.fitting.actions import (
    FILE,
    WHOLE,
    ActionPlan,
    Fitted,
    fits_of,
    held_out,
    subjects_of,
)
from causal_openlock.fitting.kept import kept_fit
from causal_openlock.fitting.search import Range, search_space
from causal_openlock.scoring import LAPSE
from causal_openlock.scoring.inverse_binomial import Draws
from causal_openlock.scoring.score_table import GROUP
from causal_openlock.scoring.scores import Scores, choices_in, score_learners
from causal_openlock.scoring.teacher_forcing import (
    EXACT,
    Recorded,
    recorded_subjects,
    scored_parts,
    subject_names,
)
from causal_openlock.storage.stored import StoredExperiment
from causal_openlock.wording import joined

if TYPE_CHECKING:
    import pyarrow as pa


@dataclass(frozen=True)
class FitOfActions:
    """A whole fit to actions, as it is stored.

    Attributes:
        label: Name of its folder; the learner goes by it.
        plan: Its settings.
        fits: By whom it is of (a subject, or ``all``) and fold.
        subjects: Names of all subjects, each with a digest of what it did.
    """

    label: str
    plan: ActionPlan
    fits: Mapping[tuple[str, int], Fitted]
    subjects: Mapping[str, str]

    @property
    def holds_out(self) -> bool:
        """Whether actions are predicted by what was fitted without them."""
        return self.plan.hold_out != "none"

    def of(self, who: str, fold: int) -> Fitted:
        """The fit for a subject."""
        return self.fits.get((who, fold)) or self.fits["all", fold]

    def price(self, who: str) -> float:
        """Difference of a subject's BIC from twice its negative log-likelihood."""
        if self.holds_out:
            return 0.0
        found = self.of(who, WHOLE)
        return (found.bic - 2 * found.nll) / (len(self.subjects) if found.who == "all" else 1)


def read_fit(folder: Path, named: Collection[str] = ()) -> FitOfActions:
    """A fit to actions, from its folder.

    Args:
        folder: Where ``fit --to`` wrote it.
        named: Learners that may be used whatever they are.

    Raises:
        StoreError: If there is none, it is not whole, its learner has to be named, or is of other
            code than it was fitted with.
    """
    path = folder / FILE
    if not path.exists():
        raise StoreError(f"{folder} holds no fit to actions; make one with: fit NAME --to FOLDER")

    def read(kept: dict[str, Any]) -> FitOfActions:
        plan = kept["plan"]
        space, subjects = (
            plan["space"],
            TypeAdapter(dict[str, str]).validate_python(plan["subjects"]),
        )
        ranges = TypeAdapter(dict[str, Range]).validate_python(space["search"])
        _check_named(str(space["learner"]), dict(space["fixed"]), named, path)
        searched = search_space(space["learner"], ranges, space["fixed"])
        if space.get("code", {}) != searched.code:
            raise StoreError(
                f"{path}: the code of its learner {searched.learner}, or a file that it uses, is "
                "not what it was fitted with; fit it again"
            )
        built = ActionPlan(
            searched,
            lapse=float(plan["lapse"]),
            hold_out=plan["hold_out"],
            folds=int(plan["folds"]),
        )
        fits = {(one.who, one.fold): one for one in fits_of(kept, ranges)}
        return FitOfActions(folder.resolve().name, built, fits, subjects)

    found = kept_fit(path, read, "give the folder that fit NAME --to wrote")
    for who in found.subjects:
        for fold in found.plan.numbers:
            if not {(who, fold), ("all", fold)} & set(found.fits):
                raise StoreError(f"{path}: the fit is not whole; give its command again")
    return found


def _check_named(
    learner: str, fixed: Mapping[str, Any], named: Collection[str], path: Path
) -> None:
    if learner in named:
        return
    free = []
    if ":" not in learner:
        hints = get_type_hints(learner_class(learner).Parameters)
        free = [
            name
            for name, value in fixed.items()
            if not isinstance(value, bool | int | float)
            and get_origin(hints.get(name)) is not Literal
        ]
    if ":" in learner or free:
        why = f"sets {free[0]}, which may name a file" if free else "is code next to it"
        raise StoreError(
            f"{path}: its learner {learner} {why}; if you trust it, name it too: "
            f"--learner {learner}"
        )


def score_fits(
    record: pa.Table,
    experiment: StoredExperiment,
    fits: Sequence[FitOfActions],
    learners: Sequence[LearnerSpec] = (),
    *,
    of: Sequence[str] = (),
    lapse: float = LAPSE,
    draws: Draws = EXACT,
    workers: int = 1,
    report: Callable[[int, int], None] = lambda done, total: None,
) -> Scores:
    """Score fitted learners, and other learners, on the subjects of all these fits.

    The other arguments and errors are those of
    :func:`~causal_openlock.scoring.scores.score_learners`.

    Raises:
        StoreError: If a fit is of other subjects, or of other actions of theirs.
        OpenLockError: If fits cannot be compared: one held something out and another nothing, they
            took another share of lapses, or have the same name.
    """
    if not (fits or learners):
        raise OpenLockError("name who predicts: learners, or fits")
    given: dict[str, Any] = {"of": of, "lapse": lapse, "draws": draws, "workers": workers}
    others = (
        [score_learners(record, experiment, learners, **given, report=report)] if learners else []
    )
    if not fits:
        return others[0]
    parts = recorded_subjects(record, experiment, of)
    _check(fits, learners, parts, lapse)
    shared = [who for who in subjects_of(parts) if all(who in one.subjects for one in fits)]
    if not shared:
        labels = joined([one.label for one in fits])
        raise StoreError(f"no subject was fitted in each of {labels}; fit to the same subjects")
    tables = [_predicted(one, parts, set(shared), lapse, draws, workers) for one in fits]
    tables += [one.actions[subject_names(one.actions).isin(shared)] for one in others]
    return Scores(pd.concat(tables, ignore_index=True), choices_in(experiment))


def _check(
    fits: Sequence[FitOfActions],
    learners: Sequence[LearnerSpec],
    parts: Sequence[Recorded],
    lapse: float,
) -> None:
    known, labels = subjects_of(parts), [spec.name for spec in learners]
    for one in fits:
        if one.label in labels:
            raise OpenLockError(f"{one.label} is there twice; rename the folder of a fit")
        labels.append(one.label)
        if one.plan.lapse != lapse:
            raise OpenLockError(
                f"{one.label} was fitted with a share of lapses of {one.plan.lapse:g}; give "
                f"--lapse {one.plan.lapse:g}"
            )
        if one.holds_out != fits[0].holds_out:
            raise OpenLockError(
                f"one of {fits[0].label} and {one.label} held something out and the other nothing, "
                "so that they cannot be compared; fit one of them again, with --hold-out"
            )
        if any(one.subjects.get(who, done) != done for who, done in known.items()):
            raise StoreError(
                f"{one.label} was fitted to other actions of these subjects; fit again"
            )


def _predicted(
    fit: FitOfActions,
    parts: Sequence[Recorded],
    shared: Collection[str],
    lapse: float,
    draws: Draws,
    workers: int,
) -> pd.DataFrame:
    """The scores of a fitted learner, where possible by what was fitted without the action."""
    plan = fit.plan
    folds = [fold for fold in plan.numbers if fold != WHOLE] if fit.holds_out else [WHOLE]
    jobs = []
    for part in parts:
        for who, own in part.alone().items():
            if who in shared:
                jobs += [(own, fold, fit.of(who, fold).chosen) for fold in folds]
    specs = [(own, replace(plan.spec(chosen), name=fit.label)) for own, _, chosen in jobs]
    tables = []
    for (_, fold, _), table in zip(jobs, scored_parts(specs, lapse, draws, workers), strict=True):
        tables.append(table[held_out(table, plan, fold)] if fit.holds_out else table)
    order = [*GROUP, "subject", "trial", "attempt", "action"]
    found = pd.concat(tables).sort_values(order, kind="stable", ignore_index=True)
    return found.assign(price=subject_names(found).map(fit.price))
