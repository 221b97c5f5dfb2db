"""Likeness of learners to people: the distance of their means, and the effects that they show.

The paper reports what people did at fourteen *points*: the five trials of each baseline, and the
test of each of the four transfer conditions. A learner's likeness is measured there in two ways.

* *Distance*: the root mean square of its deviations from people's means, in attempts, and in
  people's standard errors, which weighs each deviation by how well people's mean is known.
* *Effects*: what people show, each a difference of means: they learn over the trials, they find
  common effect harder than common cause, and training with the structure of the test helps more
  than training with the other one. A learner shows an effect if its difference has people's sign.

A small distance without the effects is an average, and effects without a small distance are a
caricature; so both are reported. The same is computed for the published theory-based model, of
which, as of people, only means and error bars are known: a t-test needs no more.

People's training in three-lever rooms is published elsewhere: twelve more means, which nothing here
is fitted to. What a distance is worth is the question of
:mod:`~causal_openlock.paper.noise_ceiling`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
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
from causal_openlock.analysis.results.references import POINT, Beside
from causal_openlock.paper.published import (
    model,
    model_in_training,
    people,
    people_in_training,
)
from causal_openlock.paper.significance import contrast_test

PUBLISHED_MODEL = "published model"
TRAINING_MODEL = "model of CogSci 2019"
Place = tuple[str, str, int]


@dataclass(frozen=True)
class Effect:
    """Something that people show: a difference of means, positive in people.

    Attributes:
        name: For tables.
        claim: What it means, for captions.
        weights: Of each point in the difference.
        within: Whether the same subjects are at all of its points.
    """

    name: str
    claim: str
    weights: Mapping[Place, float]
    within: bool = False


def _last(condition: str) -> Place:
    return condition, "train", 5


def _test(condition: str) -> Place:
    return condition, "test", 1


EFFECTS = (
    *(
        Effect(
            f"learning, {name}",
            f"fewer attempts in the last trial of {name} than in the first",
            {(name, "train", 1): 1.0, _last(name): -1.0},
            within=True,
        )
        for name in BASELINES
    ),
    Effect(
        "CE harder, last trial",
        "more attempts in the last trial of CE4 than of CC4",
        {_last("CE4"): 1.0, _last("CC4"): -1.0},
    ),
    Effect(
        "CE harder, test",
        "more attempts in tests on CE4 than on CC4, whatever the training",
        {_test(name): 0.5 if name.endswith("CE4") else -0.5 for name in TRANSFERS},
    ),
    *(
        Effect(
            f"congruency, {tested}",
            f"fewer attempts in a test on {tested} after training with its own structure",
            {_test(f"{other}3-{tested}"): 1.0, _test(f"{own}3-{tested}"): -1.0},
        )
        for own, other, tested in (("CC", "CE", "CC4"), ("CE", "CC", "CE4"))
    ),
)
"""People's effects at the fourteen points; the last four are tested in the paper as well."""


@cache
def published_points() -> pd.DataFrame:
    """People's and the published model's means and error bars at each of the fourteen points.

    Nobody may change them.

    Columns: :data:`~causal_openlock.paper.published.POINT`, and for people and
    model ``X_subjects``, ``X_mean`` and ``X_se``, in attempts.
    """
    both = [
        table.set_index(POINT)[["subjects", "mean", "se"]].add_prefix(f"{name}_")
        for name, table in (("people", people()), ("model", model()))
    ]
    return both[0].join(both[1], validate="one_to_one").reset_index()


def points_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Means at the points, of each learner that played as people did.

    Returns:
        One row for each ``learner`` and point, in the order of publication: ``condition``,
        ``phase``, ``trial``, ``subjects``, ``mean`` and ``se``; ``people_subjects``,
        ``people_mean`` and ``people_se``.
    """
    names = ["learner", "condition", "phase"]
    return _beside_people(mean_by_trial(trials).astype(dict.fromkeys(names, str)))


def points_of_model() -> pd.DataFrame:
    """The published model's points, in the form of :func:`points_of`."""
    return _beside_people(model().assign(learner=PUBLISHED_MODEL))


def points_of_people() -> pd.DataFrame:
    """People's own points, in the form of :func:`points_of`; no learner is nearer to people."""
    return _beside_people(people().assign(learner="people"))


def points_beside(one: Beside, trials: pd.DataFrame) -> pd.DataFrame:
    """Means of learners at the points of any reference, in the form of :func:`points_of`.

    Columns are those of people there, whoever the reference is.
    """
    names = ["learner", "condition", "phase"]
    means = mean_by_trial(trials[one.stands(trials)]).astype(dict.fromkeys(names, str))
    known = one.reference.points.set_index(POINT)[["subjects", "mean", "se"]]
    found = means.merge(known.add_prefix("people_").reset_index(), on=POINT)
    return found[["learner", *POINT, *_MEANS]]


def _beside_people(means: pd.DataFrame) -> pd.DataFrame:
    found = published_points().merge(means, on=POINT).sort_values("learner", kind="stable")
    return found[["learner", *POINT, *_MEANS]].reset_index(drop=True)


_MEANS = ["subjects", "mean", "se", "people_subjects", "people_mean", "people_se"]


def training_points_of(trials: pd.DataFrame) -> pd.DataFrame:
    """Means of each learner in the training trials of the transfer conditions.

    As published of people, conditions with the same training are taken together.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`, of learners that
            did what people did.

    Returns:
        One row for each ``learner`` and of the twelve training trials: ``schema``, ``trial``,
        ``subjects``, ``mean``, ``se``, and the same three of people.
    """
    played = trials[trials["condition"].isin(TRANSFERS) & (trials["phase"] == "train")]
    schema = played["condition"].astype(str).str[:3]
    played = played.assign(learner=played["learner"].astype(str), schema=schema)
    each = by_subject(played, ["schema", "trial"]).groupby(["learner", "schema", "trial"])
    means = each["attempts"].agg(subjects="size", mean="mean", sd=lambda some: some.std(ddof=0))
    se = means["sd"] / np.sqrt(means["subjects"])
    return _beside_people_in_training(means.assign(se=se).reset_index())


def training_points_of_model() -> pd.DataFrame:
    """The points of CogSci 2019's own model, in the form of :func:`training_points_of`."""
    whole = model_in_training().query("solution == 'all'")
    return _beside_people_in_training(whole.assign(learner=TRAINING_MODEL))


def _beside_people_in_training(means: pd.DataFrame) -> pd.DataFrame:
    whole = people_in_training().query("solution == 'all'").drop(columns="solution")
    known = whole.set_index(["schema", "trial"]).add_prefix("people_").reset_index()
    found = known.merge(means, on=["schema", "trial"]).sort_values("learner", kind="stable")
    return found[["learner", "schema", "trial", *_MEANS]].reset_index(drop=True)


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
        in attempts (positive in people), ``t``, ``df``, ``p`` and ``like_people``, whether the sign
        is people's.
    """
    at = {
        (row.condition, row.phase, row.trial): Group.published(row.mean, row.se, int(row.subjects))
        for row in points.itertuples()
    }
    rows, each = [], None
    for effect in EFFECTS:
        if not all(place in at for place in effect.weights):
            continue
        if effect.within and trials is not None:
            each = by_subject(trials, ["phase", "trial"]) if each is None else each
            tested = _within(effect, each)
        else:
            groups = [at[place] for place in effect.weights]
            found = contrast_test(groups, list(effect.weights.values()))
            t = float(np.copysign(np.sqrt(found.value), found.difference))
            tested = found.difference, t, found.df[1], found.p
        rows.append((effect.name, *tested, tested[0] > 0))
    return pd.DataFrame(rows, columns=["effect", "difference", "t", "df", "p", "like_people"])


def _within(effect: Effect, each: pd.DataFrame) -> tuple[float, float, int, float]:
    """An effect within subjects: the mean of each one's weighted sum, tested against zero."""
    condition = next(iter(effect.weights))[0]
    attempts, places = at_places(each[each["condition"] == condition])
    sums = sum(
        weight * attempts[:, places.index((phase, trial))]
        for (_, phase, trial), weight in effect.weights.items()
    )
    value, freedom = float(np.mean(sums)), len(attempts) - 1
    if np.ptp(sums) == 0:  # as of a single subject
        return value, float("nan"), freedom, float("nan")
    group = Group.of(np.asarray(sums))
    t = value / float(np.sqrt(group.variance / group.size))
    return value, t, freedom, weighted_difference([group]).p


def likeness_table(points: Sequence[pd.DataFrame], effects: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Learners in the order of their distance from people.

    Returns:
        One row for each, the nearest first, those with fewer points last: ``learner``, ``points``
        (how many), ``rmse`` in attempts, ``shown`` (how many effects have people's sign) and a
        column for each effect with its difference in attempts.
    """
    rows = []
    for own, seen in zip(points, effects, strict=True):
        found = seen.set_index("effect")["difference"]
        rows.append(
            {
                "learner": own["learner"].iloc[0],
                "points": len(own),
                "rmse": distance(own)[0],
                "shown": int(seen["like_people"].sum()),
                **{effect.name: found.get(effect.name, np.nan) for effect in EFFECTS},
            }
        )
    return pd.DataFrame(rows).sort_values(
        ["points", "rmse"], ascending=[False, True], kind="stable", ignore_index=True
    )


class Likeness(NamedTuple):
    """Learners compared with people: :func:`likeness_table`, and its content by learner.

    Attributes:
        table: The nearest learner first, the published model among them.
        points: By learner, in that order.
        effects: By learner.
    """

    table: pd.DataFrame
    points: dict[str, pd.DataFrame]
    effects: dict[str, pd.DataFrame]


def likeness(trials: pd.DataFrame, people: Beside, learners: Sequence[str]) -> Likeness | None:
    """Compare learners that played all six conditions as people did, and the published model.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`.
        people: People, with the learners that they are compared with.
        learners: Their labels.

    Returns:
        None if there are none.
    """
    trials = trials[people.stands(trials)]
    if trials.empty:
        return None
    found = points_of(trials)
    points = {name: found[found["learner"] == name] for name in learners}
    points = {name: own for name, own in points.items() if len(own) == len(published_points())}
    if not points:
        return None
    effects = {name: effects_of(own, trials[trials["learner"] == name])
               for name, own in points.items()}  # fmt: skip
    points[PUBLISHED_MODEL] = points_of_model()
    effects[PUBLISHED_MODEL] = effects_of(points[PUBLISHED_MODEL])
    table = likeness_table(list(points.values()), [effects[name] for name in points])
    return Likeness(table, {name: points[name] for name in table["learner"]}, effects)
