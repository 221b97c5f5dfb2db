"""Learners against learners: which is better than which, and how good each is in the middle.

A condition is judged by one number of each subject: the attempts in its test, or in the last trial
of a baseline. Whether one learner is better than another is then a question about two subjects
drawn at random, one of each (:func:`~causal_openlock.analysis.effects.probability_of_improvement`):
it needs no scale, so all conditions count together. How good a learner is by itself is the
interquartile mean over all its subjects in all its conditions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import combinations
from typing import NamedTuple

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import (
    improvement_interval,
    interquartile_interval,
    interquartile_mean,
    probability_of_improvement,
)
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.scores import normalised_score, scores_by_condition
from causal_openlock.analysis.statistics import SEED
from causal_openlock.world.fsm import BoolArray, FloatArray

Scores = Mapping[str, Mapping[str, FloatArray]]
"""By learner, by condition: ``[n]`` attempts of its subjects."""


class Ranking(NamedTuple):
    """Learners in their order (:func:`ranking_table`), and against each other."""

    ranks: pd.DataFrame
    pairs: pd.DataFrame


def ranking_of(results: Material, protocol: str) -> Ranking | None:
    """Learners compared under a protocol; None if no two of them can be compared."""
    held = scores_by_condition(results.trials)
    scores = scores_under(protocol, held, results.learners)
    pairs = pairwise_table(scores)
    if pairs.empty:
        return None
    scores = {name: own for name, own in scores.items() if name in set(pairs["learner"])}
    ranks = ranking_table(scores, pairs, _bounds(results, held, protocol))
    return Ranking(ranks, pairs)


def scores_under(
    protocol: str, held: Mapping[tuple[str, str], Mapping[str, FloatArray]], learners: Sequence[str]
) -> Scores:
    """The scores of one protocol, of those of all, in the order of the learners."""
    return {name: held[name, protocol] for name in learners if (name, protocol) in held}


def pairwise_table(scores: Scores) -> pd.DataFrame:
    """How probable it is that a subject of one learner needs fewer attempts than one of another.

    Returns:
        A row for each ordered pair of learners that played a condition in common: ``learner``,
        ``other``, ``conditions`` (how many in common), ``probability`` (ties count half, the mean
        over conditions), ``ci_low`` and ``ci_high`` (95% bootstrap, stratified over conditions; NaN
        with a single subject).
    """
    rows = []
    names = list(scores)
    for one, other in combinations(names, 2):
        common = [name for name in scores[one] if name in scores[other]]
        if not common:
            continue
        # Fewer attempts are better, so the negative is the score.
        first, second = ([-scores[of][name] for name in common] for of in (one, other))
        found = probability_of_improvement(first, second)
        low, high = improvement_interval(first, second, np.random.default_rng(SEED))
        rows.append((one, other, len(common), found, low, high))
        rows.append((other, one, len(common), 1 - found, 1 - high, 1 - low))
    rows.sort(key=lambda row: (names.index(row[0]), names.index(row[1])))
    columns = ["learner", "other", "conditions", "probability", "ci_low", "ci_high"]
    return pd.DataFrame(rows, columns=columns)


def ranking_table(
    scores: Scores,
    pairs: pd.DataFrame,
    bounds: Mapping[str, tuple[float, float]] | None = None,
) -> pd.DataFrame:
    """Learners in the order of their interquartile means (of equal ones: means), the best first.

    Args:
        scores: By learner, by condition: ``[n]`` attempts of its subjects.
        pairs: From :func:`pairwise_table`.
        bounds: By condition, what a random learner and the ideal observer need; without it there
            is no normalised score.

    Returns:
        A row for each learner: ``learner``, ``conditions``, ``subjects`` (in all of them),
        ``iqm`` (attempts), ``ci_low``, ``ci_high`` (95% bootstrap, stratified over conditions),
        ``normalised`` (interquartile mean of normalised scores over the conditions whose bounds
        are known, NaN if none is), and of the comparison with the learner in the row below
        ``better_than_next``, ``next_low``, ``next_high``.
    """
    rows = []
    for name, own in scores.items():
        strata = list(own.values())
        everyone = np.concatenate(strata)
        iqm = float(interquartile_mean(everyone))
        interval = interquartile_interval(strata, np.random.default_rng(SEED))
        normalised = [
            normalised_score(own[condition], *bound)
            for condition, bound in (bounds or {}).items()
            if condition in own
        ]
        score = float(interquartile_mean(np.concatenate(normalised))) if normalised else np.nan
        rows.append((name, len(own), len(everyone), iqm, *interval, score, everyone.mean()))
    columns = ["learner", "conditions", "subjects", "iqm", "ci_low", "ci_high", "normalised"]
    table = pd.DataFrame(rows, columns=[*columns, "mean"])
    table = table.sort_values(["iqm", "mean"], kind="stable", ignore_index=True)[columns]
    known = pairs.set_index(["learner", "other"])[["probability", "ci_low", "ci_high"]]
    following = [*table["learner"].iloc[1:], None]
    keys = pd.MultiIndex.from_arrays([table["learner"], following])
    beside = known.reindex(keys).to_numpy(float)
    return table.assign(
        better_than_next=beside[:, 0], next_low=beside[:, 1], next_high=beside[:, 2]
    )


def decided(pairs: pd.DataFrame) -> BoolArray:
    """``[N]`` whether the interval of each comparison leaves out one half."""
    known: BoolArray = ((pairs["ci_low"] > 0.5) | (pairs["ci_high"] < 0.5)).to_numpy(bool)
    return known


def _bounds(
    results: Material, held: Mapping[tuple[str, str], Mapping[str, FloatArray]], protocol: str
) -> dict[str, tuple[float, float]]:
    """By condition, what the random learner of the record needs, and the ideal observer."""
    found = {}
    in_test = results.trials["phase"] == "test"
    tested = set(results.trials.loc[in_test, "condition"])
    for name in filter(results.experiment.random_learners.__contains__, results.learners):
        for condition, attempts in held.get((name, protocol), {}).items():
            key = (condition, protocol, "test" if condition in tested else "train")
            if key in results.bounds:
                found[condition] = (float(attempts.mean()), results.bounds[key].attempts)
    return found
