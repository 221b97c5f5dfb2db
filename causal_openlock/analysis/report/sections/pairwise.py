"""Learners against learners: who is better than whom, and how good each is in the middle.

A condition is judged by one number of each subject: the attempts in its test, or in the last trial
of a baseline. Whether one learner is better than another is then a question about two subjects
drawn at random, one of each (:func:`~causal_openlock.analysis.effects.probability_of_improvement`):
it needs no scale, so all conditions can be asked together. How good a learner is, is told by the
interquartile mean over all its subjects in all its conditions.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure

from causal_openlock.analysis.effects import (
    improvement_interval,
    interquartile_interval,
    interquartile_mean,
    probability_of_improvement,
)
from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report.section import Material, Section, Table
from causal_openlock.analysis.results.scores import normalised_score, scores_by_condition
from causal_openlock.analysis.statistics import SEED
from causal_openlock.wording import file_names, joined
from causal_openlock.world.fsm import FloatArray

Scores = Mapping[str, Mapping[str, FloatArray]]
"""By learner, by condition: ``[n]`` attempts of its subjects."""

_COLOURS = LinearSegmentedColormap.from_list("worse_better", ["#8C510A", "#F7F7F7", "#01665E"])
_LONGEST = 22  # letters of a name in the drawing
_NAMED = 6  # comparisons that are named before "and n more"


def section(material: Material) -> Section | None:
    """Comparisons of all learners under each protocol; None if nowhere two of them can compare."""
    held = scores_by_condition(material.trials)
    text: list[str] = []
    tables: list[Table] = []
    drawings: list[Drawing] = []
    protocols = ordered({protocol for _, protocol in held}, ("human",))
    for protocol, part in file_names(protocols).items():
        scores = {
            name: held[name, protocol] for name in material.learners if (name, protocol) in held
        }
        pairs = pairwise_table(scores)
        if pairs.empty:
            continue
        names = [name for name in scores if name in set(pairs["learner"])]
        scores = {name: scores[name] for name in names}
        ranks = ranking_table(scores, pairs, _bounds(material, held, protocol))
        text.append(_told(protocol, ranks, pairs))
        tables += [_ranking(protocol, part, ranks), _every_pair(protocol, part, pairs)]
        drawings.append(matrix_drawing(protocol, list(ranks["learner"]), pairs, part))
    if not text:
        return None
    text.append(
        "A learner counts as better than another if the 95% interval of the probability that its "
        "subject needs fewer attempts leaves out one half. Intervals are of each comparison by "
        "itself: of twenty comparisons between equals one leaves out one half by chance."
    )
    return Section(
        "pairwise", "Learners against learners", tuple(text), tuple(tables), tuple(drawings)
    )


def pairwise_table(scores: Scores) -> pd.DataFrame:
    """How probable it is that a subject of one learner needs fewer attempts than one of another.

    Args:
        scores: By learner, by condition: ``[n]`` attempts of its subjects.

    Returns:
        A row for each ordered pair of learners that played a condition in common: ``learner``,
        ``other``, ``conditions`` (how many in common), ``probability`` (ties count half, the mean
        over conditions), ``ci_low`` and ``ci_high`` (95% bootstrap, stratified over conditions; NaN
        with a single subject).
    """
    rows = []
    names = list(scores)
    for index, one in enumerate(names):
        for other in names[index + 1 :]:
            common = [name for name in scores[one] if name in scores[other]]
            if not common:
                continue
            # Fewer attempts are better, so the negative is the score.
            first = [-scores[one][name] for name in common]
            second = [-scores[other][name] for name in common]
            found = probability_of_improvement(first, second)
            low, high = improvement_interval(first, second, np.random.default_rng(SEED))
            rows.append((one, other, len(common), found, low, high))
            rows.append((other, one, len(common), 1 - found, 1 - high, 1 - low))
    columns = ["learner", "other", "conditions", "probability", "ci_low", "ci_high"]
    table = pd.DataFrame(rows, columns=columns)
    place = {name: number for number, name in enumerate(names)}
    order = np.lexsort([table["other"].map(place), table["learner"].map(place)])
    return table.iloc[order].reset_index(drop=True)


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
        low, high = interquartile_interval(strata, np.random.default_rng(SEED))
        everyone = np.concatenate(strata)
        normalised = [
            normalised_score(values, *(bounds or {})[condition])
            for condition, values in own.items()
            if condition in (bounds or {})
        ]
        rows.append(
            {
                "learner": name,
                "conditions": len(own),
                "subjects": len(everyone),
                "mean": float(everyone.mean()),
                "iqm": float(interquartile_mean(everyone)),
                "ci_low": low,
                "ci_high": high,
                "normalised": float(interquartile_mean(np.concatenate(normalised)))
                if normalised
                else np.nan,
            }
        )
    table = pd.DataFrame(rows).sort_values(["iqm", "mean"], kind="stable", ignore_index=True)
    table = table.drop(columns="mean")
    known = pairs.set_index(["learner", "other"])[["probability", "ci_low", "ci_high"]]
    following = [*table["learner"].iloc[1:], None]
    keys = pd.MultiIndex.from_arrays([table["learner"], following])
    beside = known.reindex(keys).to_numpy(float)
    return table.assign(
        better_than_next=beside[:, 0], next_low=beside[:, 1], next_high=beside[:, 2]
    )


def matrix_drawing(
    protocol: str, names: Sequence[str], pairs: pd.DataFrame, part: str = "human"
) -> Drawing:
    """The probabilities of a protocol as a matrix of numbers on colours.

    Args:
        protocol: Its name.
        names: Learners in the order of rows and columns.
        pairs: From :func:`pairwise_table`.
        part: What its file is called after.
    """
    size = len(names)
    place = {name: number for number, name in enumerate(names)}
    values = np.full((size, size), np.nan)
    values[pairs["learner"].map(place), pairs["other"].map(place)] = pairs["probability"]
    sure = np.zeros((size, size), bool)
    sure[pairs["learner"].map(place), pairs["other"].map(place)] = _decided(pairs)
    shown = [name if len(name) <= _LONGEST else f"{name[: _LONGEST - 1]}…" for name in names]
    shown = [name.replace("$", r"\$") for name in shown]
    edge = 0.25 + 0.07 * max(map(len, shown))  # names along the left and, slanted, along the top
    cell = min(0.55, (style.WIDTH - edge - 0.5 * edge) / size)
    with style.settings():
        figure = Figure(
            figsize=(1.5 * edge + cell * size, 0.7 * edge + cell * size), layout="constrained"
        )
        axes = figure.subplots()
        axes.imshow(values, cmap=_COLOURS, vmin=0, vmax=1)
        for (row, column), value in np.ndenumerate(values):
            known = not np.isnan(value)
            axes.text(
                column,
                row,
                f"{value:.2f}" if known else "–",
                ha="center",
                va="center",
                fontsize=8 if cell > 0.45 else 7,
                fontweight="bold" if sure[row, column] else "normal",
                color="white" if known and abs(value - 0.5) > 0.34 else "black",
            )
        axes.set_xticks(range(size), shown, rotation=40, ha="left", va="bottom")
        axes.set_yticks(range(size), shown)
        axes.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
        for label in axes.get_xticklabels():
            label.set_rotation_mode("anchor")
            label.set_verticalalignment("center")
        axes.set_xticks(np.arange(size - 1) + 0.5, minor=True)
        axes.set_yticks(np.arange(size - 1) + 0.5, minor=True)
        axes.grid(visible=False)
        axes.grid(visible=True, which="minor", axis="both", color="white", linewidth=1.2)
        axes.tick_params(which="minor", length=0)
        axes.set_axisbelow(False)
        for side in axes.spines.values():
            side.set_visible(False)
    return Drawing(
        f"pairwise_{part}",
        f"Who is better than whom, protocol {protocol}",
        "Probability that a subject of the learner in the row needs fewer attempts than a subject "
        "of the learner in the column, ties counting half, averaged over the conditions that both "
        "played. Bold: the 95% bootstrap interval, stratified over conditions, leaves out one "
        "half.",
        figure,
    )


def _decided(pairs: pd.DataFrame) -> Any:
    return ((pairs["ci_low"] > 0.5) | (pairs["ci_high"] < 0.5)).to_numpy()


def _bounds(
    material: Material, held: Mapping[tuple[str, str], Mapping[str, FloatArray]], protocol: str
) -> dict[str, tuple[float, float]]:
    """By condition, what the random learner of the record needs, and the ideal observer."""
    found = {}
    in_test = material.trials.loc[material.trials["phase"] == "test", "condition"]
    tested = set(in_test.unique())
    by_chance = material.experiment.random_learners
    for name in (one for one in material.learners if one in by_chance):
        for condition, attempts in held.get((name, protocol), {}).items():
            phase = "test" if condition in tested else "train"
            if (condition, protocol, phase) in material.bounds:
                bound = material.bounds[condition, protocol, phase]
                found[condition] = (float(attempts.mean()), bound.attempts)
    return found


def _every_pair(protocol: str, part: str, pairs: pd.DataFrame) -> Table:
    return Table(
        f"pairwise_{part}",
        f"Every comparison, protocol {protocol}",
        pairs,
        dict.fromkeys(["probability", "ci_low", "ci_high"], ".3f"),
        "Probability that a subject of the learner needs fewer attempts than one of the other, "
        "ties counting half, averaged over the conditions that both played, with the ends of its "
        "95% bootstrap interval.",
    )


def _told(protocol: str, ranks: pd.DataFrame, pairs: pd.DataFrame) -> str:
    """Who leads, and which comparisons do not follow the order, in words."""
    order = {name: number for number, name in enumerate(ranks["learner"])}
    ahead = pairs["learner"].map(order) < pairs["other"].map(order)
    each = pairs[ahead & pairs["ci_low"].notna()]
    first, last = ranks.iloc[0], ranks.iloc[-1]
    least, most = f"{first['iqm']:.2f}", f"{last['iqm']:.2f}"
    text = [
        f"Protocol {protocol}: in the interquartile mean "
        + (
            f"all learners need the same number of attempts, {least}."
            if least == most
            else f"{first['learner']} needs the fewest attempts, {least}, and {last['learner']} "
            f"the most, {most}."
        )
    ]
    if each.empty:
        return " ".join([*text, "A single subject of each decides nothing."])
    decided = _decided(each)
    even = [f"{one} and {other}" for one, other in _names(each[~decided])]
    against = [
        f"{other} is better than {one}"
        for one, other in _names(each[decided & (each["probability"] < 0.5).to_numpy()])
    ]
    if not even and not against:
        text.append("Every learner is better than all those after it in the table.")
    elif len(even) == len(each):
        return " ".join([*text, "No comparison is decided."])
    else:
        text.append(
            f"In {len(each) - len(even) - len(against)} of {len(each)} comparisons the learner "
            "that stands first in the table is the better one."
        )
    if against:
        text.append(f"Against the order of the table {joined(against[:_NAMED])}{_rest(against)}.")
    if even:
        text.append(f"Not decided: {'; '.join(even[:_NAMED])}{_rest(even)}.")
    return " ".join(text)


def _names(pairs: pd.DataFrame) -> list[tuple[str, str]]:
    return list(zip(pairs["learner"], pairs["other"], strict=True))


def _rest(names: Sequence[str]) -> str:
    return f", and {len(names) - _NAMED} more" if len(names) > _NAMED else ""


def _ranking(protocol: str, part: str, ranks: pd.DataFrame) -> Table:
    shown = ranks.rename(
        columns={
            "iqm": "IQM",
            "ci_low": "low",
            "ci_high": "high",
            "better_than_next": "better than next",
        }
    )
    numbers = ["IQM", "low", "high", "normalised", "better than next", "next_low", "next_high"]
    shown = shown.rename(columns={"next_low": "next low", "next_high": "next high"})
    if shown["normalised"].isna().all():
        shown = shown.drop(columns="normalised")
    formats = {name.replace("_", " "): ".2f" for name in numbers} | {"subjects": ","}
    return Table(
        f"ranking_{part}",
        f"Learners in order, protocol {protocol}",
        shown,
        {name: spec for name, spec in formats.items() if name in shown},
        "IQM: interquartile mean of attempts (a quarter of the subjects is left out at either end) "
        "over all subjects of all conditions, with the ends of its 95% bootstrap interval, "
        "stratified over conditions; an unsolved trial counts as the limit. "
        + (
            "Normalised: the same of scores, where 0 is what the random learner of this record "
            "needs on average and 1 what the ideal observer needs. "
            if "normalised" in shown
            else ""
        )
        + "Better than next: probability that a subject needs fewer attempts than one of the "
        "learner in the row below, with the ends of its interval; one half for equals.",
    )
