"""Learners against learners: which is better than which, and how good each is in the middle.

A condition is judged by one number of each subject: the attempts in its test, or in the last trial
of a baseline. Whether one learner is better than another is then a question about two subjects
drawn at random, one of each (:func:`~causal_openlock.analysis.effects.probability_of_improvement`):
it needs no scale, so all conditions count together. How good a learner is by itself is the
interquartile mean over all its subjects in all its conditions.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.effects import (
    improvement_interval,
    interquartile_interval,
    interquartile_mean,
    probability_of_improvement,
)
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots.comparisons import draw_matrix
from causal_openlock.analysis.report.prose import Prose
from causal_openlock.analysis.report.section import Section, SectionPlot, SectionTable
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.scores import normalised_score, scores_by_condition
from causal_openlock.analysis.statistics import SEED
from causal_openlock.wording import file_names
from causal_openlock.world.fsm import FloatArray

Scores = Mapping[str, Mapping[str, FloatArray]]
"""By learner, by condition: ``[n]`` attempts of its subjects."""

_PROSE = Prose("pairwise")
_NAMES = {
    "iqm": "IQM",
    "ci_low": "low",
    "ci_high": "high",
    "better_than_next": "better than next",
    "next_low": "next low",
    "next_high": "next high",
}
_RANKS = {**dict.fromkeys([*_NAMES.values(), "normalised"], ".2f"), "subjects": ","}
_PAIRS = dict.fromkeys(["probability", "ci_low", "ci_high"], ".3f")


def section(material: Material) -> Section | None:
    """Comparisons of all learners under each protocol; None if nowhere two of them can compare."""
    held = scores_by_condition(material.trials)
    protocols: list[dict[str, Any]] = []
    tables: list[SectionTable] = []
    plots: list[SectionPlot] = []
    names = ordered({protocol for _, protocol in held}, ("human",))
    for protocol, part in file_names(names).items():
        scores = {
            name: held[name, protocol] for name in material.learners if (name, protocol) in held
        }
        pairs = pairwise_table(scores)
        if pairs.empty:
            continue
        scores = {name: own for name, own in scores.items() if name in set(pairs["learner"])}
        ranks = ranking_table(scores, pairs, _bounds(material, held, protocol))
        protocols.append({"protocol": protocol, **compared(ranks, pairs)})
        known = bool(ranks["normalised"].notna().any())
        shown = ranks if known else ranks.drop(columns="normalised")
        shown = shown.rename(columns=_NAMES)
        drawn = draw_matrix(list(ranks["learner"]), pairs.assign(decided=_decided(pairs)))
        tables += [
            _PROSE.table(
                "ranking", shown, _RANKS, f"ranking_{part}", protocol=protocol, normalised=known
            ),
            _PROSE.table("pairwise", pairs, _PAIRS, f"pairwise_{part}", protocol=protocol),
        ]
        plots.append(_PROSE.plot(drawn, f"pairwise_{part}", protocol=protocol))
    if not protocols:
        return None
    return _PROSE.section("pairwise", tables, plots, protocols=protocols)


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


def _decided(pairs: pd.DataFrame) -> Any:
    return ((pairs["ci_low"] > 0.5) | (pairs["ci_high"] < 0.5)).to_numpy()


def _bounds(
    material: Material, held: Mapping[tuple[str, str], Mapping[str, FloatArray]], protocol: str
) -> dict[str, tuple[float, float]]:
    """By condition, what the random learner of the record needs, and the ideal observer."""
    found = {}
    in_test = material.trials["phase"] == "test"
    tested = set(material.trials.loc[in_test, "condition"])
    for name in filter(material.experiment.random_learners.__contains__, material.learners):
        for condition, attempts in held.get((name, protocol), {}).items():
            key = (condition, protocol, "test" if condition in tested else "train")
            if key in material.bounds:
                found[condition] = (float(attempts.mean()), material.bounds[key].attempts)
    return found


def compared(ranks: pd.DataFrame, pairs: pd.DataFrame) -> dict[str, Any]:
    """Which learner leads, and which comparisons do not follow the order.

    Returns:
        ``first`` and ``last`` of the ranks; ``total``, how many comparisons there are of more than
        one subject each; those in which the later learner is better (``against``), and those that
        are not decided (``even``), as pairs of names, the one that ranks first at first.
    """
    order = {name: number for number, name in enumerate(ranks["learner"])}
    ahead = pairs["learner"].map(order) < pairs["other"].map(order)
    each = pairs[ahead & pairs["ci_low"].notna()]
    decided = _decided(each)
    behind = decided & (each["probability"] < 0.5).to_numpy()
    return {
        "first": ranks.iloc[0],
        "last": ranks.iloc[-1],
        "total": len(each),
        "against": each.loc[behind, ["learner", "other"]].to_numpy().tolist(),
        "even": each.loc[~decided, ["learner", "other"]].to_numpy().tolist(),
    }
