"""How every learner stands: one row for each, over all conditions of a protocol.

It answers before anything else is explained: which share of trials is solved, how many attempts
that takes where it succeeds, where that lies between acting at random and the ideal observer, and
how far it is from the best learner and from people. A trial that is not solved is *censored* at
the limit: it would have taken more attempts than that, and nobody knows how many. So means that
such trials are in are lower bounds, and are marked as that.
"""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import Difference, Group, weighted_difference
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.results.deep.chance import attempts_at_random
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.pairwise import Outcomes, compared, outcomes
from causal_openlock.analysis.results.people.published import HUMAN_PROTOCOL, people
from causal_openlock.analysis.results.scores import PEOPLE, normalised_score
from causal_openlock.analysis.results.summary import judged
from causal_openlock.experiment.protocol import default_action_limit
from causal_openlock.world.room import positions_for

STANDING_COLUMNS = [
    *("learner", "informed", "protocol", "conditions", "subjects", "limit"),
    *("solved", "found", "solutions", "median", "attempts", "score", "best"),
    *("to_best", "to_best_low", "to_best_high"),
    *("to_people", "to_people_low", "to_people_high", "to_people_p"),
]
"""Columns of :func:`standings`."""

MOST_ATTEMPTS = 3000
"""No scores where trials may have more: what random actions need is computed in its square."""

_NONE = Difference(np.nan, np.nan, np.nan, np.nan)


def standings(results: Material) -> pd.DataFrame:
    """One row for each learner and protocol; people come first where learners did what they did.

    >>> import causal_openlock as ol
    >>> table = ol.standings(results)
    >>> table[["learner", "solved", "median"]].values.tolist()[-1]
    ['oracle', 1.0, 3.0]

    Args:
        results: What was played. The trials are those that a condition is judged by: its test, or
            the last trial of a baseline. Shares and means are those of conditions, averaged.

    Returns:
        ``learner``; whether it is ``informed``: given the schema or the room, and so a reference
        like people; ``protocol``, ``conditions`` (how many), ``subjects`` (the fewest in one);
        ``limit``, the most attempts that a trial may have; ``solved``, the share of trials;
        ``found`` of so many ``solutions``, means of trials; ``median`` attempts where trials were
        solved, NaN if none was; mean ``attempts``, where an unsolved trial counts as the limit;
        ``score``, 0 for the attempts of random actions and 1 for those of the ideal observer, NaN
        where these are not known; the ``best`` learner, which is one that has to find out how the
        room works; ``to_best`` and ``to_people``, how many attempts more than these the learner
        needs, each with the ends of its 95% interval, ``_low`` and ``_high``; NaN if nobody
        differs (:func:`~causal_openlock.analysis.effects.weighted_difference`); ``to_people_p``,
        the p of that difference as if it were the only test. Rows of
        :data:`~causal_openlock.analysis.results.scores.PEOPLE` have what is published of them.
    """
    tables = [
        _standings(results, protocol)
        for protocol in ordered(results.trials["protocol"].unique(), (HUMAN_PROTOCOL,))
    ]
    return pd.DataFrame([row for rows in tables for row in rows], columns=STANDING_COLUMNS)


def _standings(results: Material, protocol: str) -> list[tuple[Any, ...]]:
    held = outcomes(results.trials, protocol)
    trials = judged(results.trials[results.trials["protocol"] == protocol])
    medians = trials[trials["solved"]].groupby("learner", observed=True)["attempts"].median()
    limits = {one.name: one.attempt_limit for one in results.experiment.protocols}
    limit = limits.get(protocol, int(trials["last_attempt"].max()))
    ends = _ends(results, protocol, limit)
    best = best_learner(results, held)
    headline = results.headline[results.headline["protocol"] == protocol]
    published = _people(headline)
    informed = _informed(results)
    rows: list[tuple[Any, ...]] = []
    if published:
        gap = _against(published, held[best]) if best else _NONE
        size = next(iter(published.values())).size
        attempts = {name: one.mean for name, one in published.items()}
        about = (PEOPLE, False, protocol, len(published), size, limit)
        shown = (np.nan, np.nan, np.nan, np.nan, np.mean([*attempts.values()]))
        # Their score beside learners' would be of other rooms if they have not played them all.
        whole = set(attempts) == {condition for own in held.values() for condition in own}
        score = _score(attempts, ends) if whole else np.nan
        rows.append((*about, *shown, score, best, *gap[:3], *_NONE))
    for name, own in held.items():
        means = pd.DataFrame({condition: one.mean() for condition, one in own.items()}).T
        to_best = _NONE
        if best is not None and best != name and not own.keys().isdisjoint(held[best]):
            to_best = compared(own, held[best])[0]
        away = _against(_people(headline, name), own)
        to_people = Difference(-away.value, -away.high, -away.low, away.p)
        size = min(map(len, own.values()))
        about = (name, name in informed, protocol, len(own), size, limit)
        shown = (*means[["solved", "found", "solutions"]].mean(), medians.get(name, np.nan))
        score = _score(means["attempts"].to_dict(), ends)
        gaps = (*to_best[:3], *to_people)
        rows.append((*about, *shown, means["attempts"].mean(), score, best, *gaps))
    return rows


def beside_people(table: pd.DataFrame) -> dict[Hashable, float]:
    """The p of every learner against people, by protocol and name, from :func:`standings`."""
    own = table[table["to_people"].notna()]
    return {(row.protocol, row.learner): row.to_people_p for row in own.itertuples()}


def best_learner(results: Material, held: Outcomes) -> str | None:
    """The learner that needs the fewest attempts, of those that have to find out how rooms work.

    Learners that know the schema or the room are no competitors, unless there are no others; none
    is the best where none solves a trial. Only those count that played the most conditions.
    """
    informed = _informed(results)
    able = {
        name: np.mean([one["attempts"].mean() for one in own.values()])
        for name, own in held.items()
        if any((one["solved"] > 0).any() for one in own.values())
    }
    most = max((len(held[name]) for name in able), default=0)
    whole = [name for name in able if len(held[name]) == most]
    chosen = [name for name in whole if name not in informed] or whole
    return min(chosen, key=able.__getitem__, default=None)


def _informed(results: Material) -> set[str]:
    """Learners that are given what subjects cannot perceive."""
    return {spec.name for spec in results.experiment.learners if spec.origin.informed}


def _ends(results: Material, protocol: str, limit: int) -> dict[str, tuple[float, float]]:
    """By condition, what random actions need where it is judged, and what the ideal observer."""
    budgets = {one.name: one.action_limit for one in results.experiment.protocols}
    found = {}
    for condition in results.experiment.conditions:
        phase = "test" if condition.test else "train"
        bound = results.bounds.get((condition.name, protocol, phase))
        schemas = {one.name: one for one in condition.schemas}
        if bound is None or bound.schema not in schemas or limit > MOST_ATTEMPTS:
            continue
        schema = schemas[bound.schema]
        actions = budgets.get(protocol) or default_action_limit(schema)
        positions = max(map(positions_for, condition.schemas))
        random = attempts_at_random(schema, actions, positions, limit)
        found[condition.name] = (random, bound.attempts)
    return found


def _score(attempts: Mapping[str, float], ends: Mapping[str, tuple[float, float]]) -> float:
    scores = [
        float(normalised_score(np.array(mean), *ends[name]))
        for name, mean in attempts.items()
        if name in ends
    ]
    return float(np.mean(scores)) if scores else np.nan


def _people(headline: pd.DataFrame, of: str | None = None) -> dict[str, Group]:
    """People by condition, where this learner, or any, did what they did."""
    rows = headline[headline["human_attempts"].notna()]
    rows = rows if of is None else rows[rows["learner"] == of]
    n = int(people()["subjects"].iloc[0])
    return {
        str(row.condition): Group(1.0, n, row.human_attempts, row.human_se**2 * n**2 / (n - 1))
        for row in rows.itertuples()
    }


def _against(published: Mapping[str, Group], own: Mapping[str, pd.DataFrame]) -> Difference:
    """How many attempts more people need than a learner."""
    common = [name for name in published if name in own]
    if not common:
        return _NONE
    weight = 1 / len(common)
    groups = [published[name]._replace(weight=weight) for name in common]
    groups += [Group.of(-weight, own[name]["attempts"].to_numpy(float)) for name in common]
    return weighted_difference(groups)
