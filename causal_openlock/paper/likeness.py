"""Likeness of learners to people: the distance of their means, and the effects that they show.

The paper reports what people did at fourteen *points*: the five trials of each baseline, and the
test of each of the four transfer conditions. A learner's likeness is measured there in two ways.

* *Distance*: the root mean square of its deviations from people's means.
* *Effects*: what people show, each a difference of means. A learner shows an effect if its
  difference has people's sign.

A small distance without the effects is an average, and effects without a small distance are a
caricature; so both are reported. People's training in three-lever rooms is published elsewhere:
twelve more means, which nothing here is fitted to. What a distance is worth is the question of
:mod:`~causal_openlock.paper.noise_ceiling`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Group, weighted_difference
from causal_openlock.analysis.measures import (
    BASELINES,
    TRANSFERS,
    at_places,
    by_subject,
    mean_by_trial,
)
from causal_openlock.analysis.results.references import POINT, Reference
from causal_openlock.paper.published import model, model_in_training, people, people_in_training

PUBLISHED_MODEL = "published model"
TRAINING_MODEL = "model of CogSci 2019"
MEANS = ["subjects", "mean", "se"]
_OF_PEOPLE = {name: f"people_{name}" for name in MEANS}


class Effect(NamedTuple):
    """Something that people show: a difference of means, positive in people."""

    name: str
    claim: str  #: what it means, for captions
    weights: Mapping[tuple[str, str, int], float]  #: of each point in the difference


EFFECTS = (
    *(
        Effect(
            f"learning, {name}",
            f"fewer attempts in the last trial of {name} than in the first",
            {(name, "train", 1): 1.0, (name, "train", 5): -1.0},
        )
        for name in BASELINES
    ),
    Effect(
        "CE harder, last trial",
        "more attempts in the last trial of CE4 than of CC4",
        {("CE4", "train", 5): 1.0, ("CC4", "train", 5): -1.0},
    ),
    Effect(
        "CE harder, test",
        "more attempts in tests on CE4 than on CC4, whatever the training",
        {(name, "test", 1): 0.5 if name.endswith("CE4") else -0.5 for name in TRANSFERS},
    ),
    *(
        Effect(
            f"congruency, {tested}",
            f"fewer attempts in a test on {tested} after training with its own structure",
            {(f"{other}3-{tested}", "test", 1): 1.0, (f"{same}3-{tested}", "test", 1): -1.0},
        )
        for same, other, tested in (("CC", "CE", "CC4"), ("CE", "CC", "CE4"))
    ),
)
"""People's effects at the fourteen points; the last four are tested in the paper as well."""


def points_of(trials: pd.DataFrame, reference: pd.DataFrame | None = None) -> pd.DataFrame:
    """Means of learners at the points of a reference, by default people's fourteen.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`, of learners that
            did what the reference did.
        reference: Its means, as ``Reference.points``.

    Returns:
        One row for each ``learner`` and point, in the order of the reference: ``condition``,
        ``phase``, ``trial``, ``subjects``, ``mean`` and ``se``; ``people_subjects``,
        ``people_mean`` and ``people_se``, whoever the reference is.
    """
    names = ["learner", "condition", "phase"]
    means = mean_by_trial(trials).astype(dict.fromkeys(names, str))
    return _beside(people() if reference is None else reference, means)


def points_of_model() -> pd.DataFrame:
    """The published model's points, in the form of :func:`points_of`."""
    return _beside(people(), model().assign(learner=PUBLISHED_MODEL))


def points_of_people() -> pd.DataFrame:
    """People's own points, in the form of :func:`points_of`; no learner is nearer to people."""
    return _beside(people(), people().assign(learner="people"))


def training_points_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Means of each learner in the training trials of the transfer conditions.

    As published of people, conditions with the same training are taken together.

    Returns:
        The twelve training trials, in the form of :func:`points_of`; a ``condition`` is the schema
        that was trained.
    """
    played = trials[trials["condition"].isin(TRANSFERS) & (trials["phase"] == "train")]
    condition = played["condition"].astype(str)
    subject = condition + "/" + played["subject"].astype(str)  # each has subjects of its own
    together = played.assign(condition=condition.str[:3], subject=subject)
    return points_of(together, _until_all(people_in_training()))


def training_points_of_model() -> pd.DataFrame:
    """The points of CogSci 2019's own model, in the form of :func:`training_points_of`."""
    means = model_in_training().assign(learner=TRAINING_MODEL)
    return _beside(_until_all(people_in_training()), _until_all(means))


def _until_all(means: pd.DataFrame) -> pd.DataFrame:
    """Means of attempts until all solutions are found."""
    return means[means["solution"] == "all"]


def _beside(reference: pd.DataFrame, means: pd.DataFrame) -> pd.DataFrame:
    """Means next to those of a reference in the same trials, learner by learner."""
    known = reference.rename(columns=_OF_PEOPLE)[[*POINT, *_OF_PEOPLE.values()]]
    both = known.merge(means, on=POINT).sort_values("learner", kind="stable")
    return both[["learner", *POINT, *MEANS, *_OF_PEOPLE.values()]].reset_index(drop=True)


def distance(points: pd.DataFrame) -> tuple[float, float]:
    """Distance of means from people's: root mean square, in attempts and in standard errors.

    NaN without points.
    """
    if points.empty:
        return float("nan"), float("nan")
    off = (points["mean"] - points["people_mean"]).to_numpy(float)
    error = points["people_se"].to_numpy(float)
    return float(np.sqrt((off**2).mean())), float(np.sqrt(((off / error) ** 2).mean()))


def effects_of(points: pd.DataFrame, trials: pd.DataFrame | None = None) -> pd.DataFrame:
    """Test which of people's effects a learner shows.

    Args:
        points: Its points, as :func:`points_of` gives them.
        trials: What its subjects did, from
            :func:`~causal_openlock.analysis.measures.attempts_to_solve`; learning is then tested
            within subjects. Without it the trials are compared as if other subjects had played each
            of them, which finds too little rather than too much.

    Returns:
        One row for each of :data:`EFFECTS` that there are points for: ``effect``, ``difference``
        in attempts (positive in people), ``low`` and ``high``, its 95% interval, ``p`` of Student's
        t and ``like_people``, whether the sign is people's.
    """
    at = {
        (row.condition, row.phase, row.trial): Group.published(row.mean, row.se, int(row.subjects))
        for row in points.itertuples()
    }
    each = None if trials is None else by_subject(trials, ["phase", "trial"])
    rows = []
    for name, _, weights in EFFECTS:
        if not all(place in at for place in weights):
            continue
        conditions = {condition for condition, *_ in weights}
        if each is not None and len(conditions) == 1:
            attempts, places = at_places(each[each["condition"].isin(conditions)])
            at_trials = [places.index((phase, trial)) for _, phase, trial in weights]
            groups = [Group.of(attempts[:, at_trials] @ [*weights.values()])]
        else:
            groups = [at[place]._replace(weight=weight) for place, weight in weights.items()]
        found = weighted_difference(groups, pooled=True)
        rows.append((name, *found, found.value > 0))
    columns = ["effect", "difference", "low", "high", "p", "like_people"]
    return pd.DataFrame(rows, columns=columns)


class Likeness(NamedTuple):
    """Learners compared with people, and the published model."""

    points: dict[str, pd.DataFrame]  #: by learner, the nearest first, from :func:`points_of`
    effects: dict[str, pd.DataFrame]  #: by learner, from :func:`effects_of`


def likeness(trials: pd.DataFrame, people: Reference, learners: Sequence[str]) -> Likeness | None:
    """Compare learners that played all six conditions as people did, and the published model.

    Args:
        trials: As :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives them.
        people: The reference, with the learners that are compared with it.
        learners: Their labels.

    Returns:
        None if none of them played.
    """
    trials = trials[people.stands(trials)]
    if trials.empty:
        return None
    found = points_of(trials)
    points = {name: found[found["learner"] == name] for name in learners}
    points = {name: own for name, own in points.items() if len(own) == len(points_of_people())}
    if not points:
        return None
    effects = {name: effects_of(own, trials[trials["learner"] == name])
               for name, own in points.items()}  # fmt: skip
    points[PUBLISHED_MODEL] = points_of_model()
    effects[PUBLISHED_MODEL] = effects_of(points[PUBLISHED_MODEL])
    nearest_first = sorted(points, key=lambda name: distance(points[name]))
    return Likeness({name: points[name] for name in nearest_first}, effects)
