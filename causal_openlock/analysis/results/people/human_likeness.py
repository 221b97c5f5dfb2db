"""How like people a learner is: how far its means are from theirs, and which effects it shows.

The paper reports what people did at fourteen *points*: the five trials of each baseline, and the
test of each of the four transfer conditions. A learner's likeness is measured there in two ways.

* *Distance*: the root mean square of its deviations from people's means, in attempts, and in
  people's standard errors, which weighs each deviation by how well people's mean is known.
* *Effects*: what people show, each a difference of means: they learn over the trials, they find
  common effect harder than common cause, and training with the structure of the test helps more
  than training with the other one. An effect is there if it has people's sign.

A small distance without the effects is an average, and effects without a small distance are a
caricature; so both are told. The same is computed for the published theory-based model. Where only
means and error bars are known they are all that is used: a t-test needs no more.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import BASELINES, TRANSFERS, by_subject, mean_by_trial
from causal_openlock.analysis.results.people.hypotheses import Group, contrast_test
from causal_openlock.analysis.results.people.published import model, people
from causal_openlock.world.fsm import FloatArray

POINT = ["condition", "phase", "trial"]
"""What tells the fourteen points apart."""

PUBLISHED_MODEL = "published model"
Place = tuple[str, str, int]


@dataclass(frozen=True)
class Effect:
    """Something that people show: a difference of means, positive in people.

    Attributes:
        name: For tables.
        claim: What it says of whoever shows it.
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
"""What people show at the fourteen points; the last four are tested in the paper as well."""


def published_points() -> pd.DataFrame:
    """What is published at each of the fourteen points.

    Returns:
        Their :data:`POINT`, and ``people_mean``, ``people_se``, ``model_mean`` and ``model_se`` in
        attempts; error bars as published, population SD / √n.
    """
    both = people().merge(model(), on=POINT, suffixes=("", "_model"), validate="one_to_one")
    renamed = both.rename(
        columns={
            "mean": "people_mean",
            "se": "people_se",
            "mean_model": "model_mean",
            "se_model": "model_se",
        }
    )
    columns: pd.DataFrame = renamed[[*POINT, "people_mean", "people_se", "model_mean", "model_se"]]
    return columns


def points_of(trials: pd.DataFrame) -> pd.DataFrame:
    """What each learner did at the points that it came to.

    Args:
        trials: From :func:`~causal_openlock.analysis.measures.attempts_to_solve`, of learners that
            did what people did.

    Returns:
        One row for each ``learner`` and point, in the order of publication: :data:`POINT`,
        ``subjects``, ``mean`` and ``se`` (population SD / √n), ``people_mean`` and ``people_se``.
    """
    means = mean_by_trial(trials)
    plain = means.assign(**{name: means[name].astype(str) for name in ("learner", "condition")})
    plain["phase"] = plain["phase"].astype(str)
    order = published_points().assign(place=lambda table: range(len(table)))
    found = plain.merge(order, on=POINT, how="inner").sort_values(["learner", "place"])
    columns = [*POINT, "subjects", "mean", "se", "people_mean", "people_se"]
    kept: pd.DataFrame = found[["learner", *columns]].reset_index(drop=True)
    return kept


def points_of_model() -> pd.DataFrame:
    """The published model's points, in the form of :func:`points_of`."""
    table = model().merge(published_points(), on=POINT)
    columns = [*POINT, "subjects", "mean", "se", "people_mean", "people_se"]
    named: pd.DataFrame = table[columns]
    named.insert(0, "learner", PUBLISHED_MODEL)
    return named


def points_of_people() -> pd.DataFrame:
    """People's own points, in the form of :func:`points_of`; nobody is nearer to people."""
    table = people().assign(learner="people")
    table = table.assign(people_mean=table["mean"], people_se=table["se"])
    columns = [*POINT, "subjects", "mean", "se", "people_mean", "people_se"]
    named: pd.DataFrame = table[["learner", *columns]]
    return named


def distance(points: pd.DataFrame) -> tuple[float, float]:
    """How far means are from people's: root mean square, in attempts and in standard errors.

    Args:
        points: Some rows of one learner, as :func:`points_of` gives them.

    Returns:
        Distance in attempts, and in standard errors of people's means; NaN without points.
    """
    if points.empty:
        return float("nan"), float("nan")
    off = (points["mean"] - points["people_mean"]).to_numpy(float)
    error = points["people_se"].to_numpy(float)
    return float(np.sqrt((off**2).mean())), float(np.sqrt(((off / error) ** 2).mean()))


def contrast(
    means: FloatArray, errors: FloatArray, subjects: FloatArray, weights: FloatArray
) -> tuple[float, float, int, float]:
    """A weighted sum of the means of independent groups, tested against zero.

    Variances are pooled, as in the paper's tests:
    :func:`~causal_openlock.analysis.results.people.hypotheses.contrast_test`, whose F has a sign
    here.

    Args:
        means: ``[G]`` of the groups.
        errors: ``[G]`` error bars, population SD / √n.
        subjects: ``[G]`` sizes of the groups.
        weights: ``[G]`` weights, which sum to 0.

    Returns:
        The sum, t, its degrees of freedom and the two-sided p; NaN where there is no variance.
    """
    groups = [
        Group.published(float(mean), float(se), int(n)) if n > 1 else Group(1, float(mean), 0.0)
        for mean, se, n in zip(means, errors, subjects, strict=True)
    ]
    found = contrast_test(groups, weights.tolist())
    if found.value is None or found.p is None:
        return found.difference, float("nan"), found.df[1], float("nan")
    t = float(np.copysign(np.sqrt(found.value), found.difference))
    return found.difference, t, found.df[1], found.p


def effects_of(points: pd.DataFrame, trials: pd.DataFrame | None = None) -> pd.DataFrame:
    """Which of people's effects somebody shows.

    Args:
        points: Somebody's points, as :func:`points_of` gives them.
        trials: What its subjects did, from
            :func:`~causal_openlock.analysis.measures.attempts_to_solve`; learning is then tested
            within subjects. Without it the trials are compared as if others had played each of
            them, which finds too little rather than too much.

    Returns:
        One row for each of :data:`EFFECTS` that there are points for: ``effect``, ``difference``
        in attempts (positive in people), ``t``, ``df``, ``p`` and ``like_people``, whether the sign
        is people's.
    """
    at = {
        (row.condition, row.phase, row.trial): (row.mean, row.se, row.subjects)
        for row in points.itertuples()
    }
    rows = []
    for effect in EFFECTS:
        if not all(place in at for place in effect.weights):
            continue
        numbers = np.array([at[place] for place in effect.weights], dtype=float).T
        weights = np.array(list(effect.weights.values()))
        tested = (
            _within(effect, trials)
            if effect.within and trials is not None
            else contrast(numbers[0], numbers[1], numbers[2], weights)
        )
        rows.append((effect.name, *tested, tested[0] > 0))
    return pd.DataFrame(rows, columns=["effect", "difference", "t", "df", "p", "like_people"])


def _within(effect: Effect, trials: pd.DataFrame) -> tuple[float, float, int, float]:
    """An effect within subjects: the mean of each one's weighted sum, tested against zero."""
    from scipy.stats import t as student

    condition = next(iter(effect.weights))[0]
    own = by_subject(trials[trials["condition"] == condition], ["phase", "trial"])
    wide = own.pivot_table(
        index=["experiment", "seed", "subject"],
        columns=["phase", "trial"],
        values="attempts",
        observed=True,
    )
    sums = sum(
        weight * wide[phase, trial].to_numpy(float)
        for (_, phase, trial), weight in effect.weights.items()
    )
    value, freedom = float(np.mean(sums)), len(wide) - 1
    if np.ptp(sums) == 0:  # as of a single subject
        return value, float("nan"), freedom, float("nan")
    t = value / float(np.std(sums, ddof=1) / np.sqrt(len(wide)))
    return value, t, freedom, float(2 * student.sf(abs(t), freedom))


def likeness_table(points: Sequence[pd.DataFrame], effects: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Everybody by how near they are to people.

    Args:
        points: Of each of them, as :func:`points_of` gives them for one learner.
        effects: Of each of them, from :func:`effects_of`.

    Returns:
        One row for each, the nearest first: ``learner``, ``points`` (how many), ``rmse`` in
        attempts, ``rmse_se`` in standard errors, ``shown`` (how many effects have people's sign)
        and a column for each effect with its difference in attempts. Who came to all points stands
        before who did not.
    """
    rows = []
    for own, seen in zip(points, effects, strict=True):
        attempts, errors = distance(own)
        found = seen.set_index("effect")["difference"]
        rows.append(
            {
                "learner": own["learner"].iloc[0],
                "points": len(own),
                "rmse": attempts,
                "rmse_se": errors,
                "shown": int(seen["like_people"].sum()),
                **{effect.name: found.get(effect.name, np.nan) for effect in EFFECTS},
            }
        )
    table = pd.DataFrame(rows)
    ordered = table.sort_values(["points", "rmse"], ascending=[False, True], kind="stable")
    return ordered.reset_index(drop=True)
