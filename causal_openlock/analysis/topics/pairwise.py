"""Learners against learners, paired by subject: the same number, the same room.

A condition is judged by one number of each subject: the attempts in its test, or in the last trial
of a baseline. Subjects of the same number meet the same rooms in the same order, whatever learner
they are of, so that rooms that are harder are harder for both: a comparison is the mean of the
differences of such pairs, the mean over conditions. Where learners share no rooms, their subjects
count as independent.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import combinations
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap

from causal_openlock.analysis.effects import ALPHA, Difference, contrast, holm, weighted_difference
from causal_openlock.analysis.measures import CELL, SUBJECT, VISIT, judged, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.table import Table, printed
from causal_openlock.analysis.topic import Section, Topic, drawn, sentences
from causal_openlock.errors import NothingToDrawError
from causal_openlock.wording import counted, file_names, some

Outcomes = Mapping[str, Mapping[str, pd.DataFrame]]  #: :func:`outcomes` by learner, by condition
PAIR_COLUMNS = [
    *("learner", "other", "conditions", "pairs"),
    *("difference", "ci_low", "ci_high", "p", "probability", "p_corrected"),
]  #: columns of :func:`pairwise_table`
_COLOURS = LinearSegmentedColormap.from_list("worse_better", ["#8C510A", "#F7F7F7", "#01665E"])
_NAMES = {"ci_low": "low", "ci_high": "high", "probability": "P(fewer)"}
_FORMATS = {
    **dict.fromkeys(("difference", "low", "high"), "+.2f"),
    **dict.fromkeys(("p", "p_corrected"), ".2g"),
    "P(fewer)": ".3f",
}


def outcomes(trials: pd.DataFrame, protocol: str) -> dict[str, dict[str, pd.DataFrame]]:
    """Outcomes of subjects in the trials that conditions are judged by, under a protocol.

    Returns:
        By learner, by condition: a row for each subject with the means over its trials of
        ``attempts``, ``solved``, ``found`` (solutions) and ``solutions``. The index is what pairs
        subjects of different learners: seed, subject, the first layout and how many trials.
    """
    rows = judged(trials[trials["protocol"] == protocol]).sort_values(VISIT, kind="stable")
    grouped = rows.assign(layout=rows["layout"].astype(str)).groupby(
        ["learner", "condition", *SUBJECT], observed=True, sort=True
    )
    table = grouped.agg(
        layout=("layout", "first"),
        trials=("layout", "size"),
        attempts=("attempts", "mean"),
        solved=("solved", "mean"),
        found=("solutions_found", "mean"),
        solutions=("solutions", "mean"),
    ).reset_index()
    table = table.set_index([*SUBJECT[1:], "layout", "trials"]).drop(columns=SUBJECT[0])
    held: dict[str, dict[str, pd.DataFrame]] = {}
    for (learner, condition), own in table.groupby(["learner", "condition"], observed=True):
        held.setdefault(str(learner), {})[str(condition)] = own.drop(columns=CELL[:2])
    return held


def compared(
    one: Mapping[str, pd.DataFrame], other: Mapping[str, pd.DataFrame]
) -> tuple[Difference, int, float]:
    """How many attempts more the one learner needs than the other, over their common conditions.

    Returns:
        The difference; how many pairs of subjects it is of (0 where they share no rooms); and how
        probable it is that a subject of the one needs fewer attempts than its pair, or than any
        subject of the other; ties count half.
    """
    common = [name for name in one if name in other]
    groups, wins, pairs = [], [], 0
    for name in common:
        own = contrast(one[name]["attempts"], other[name]["attempts"], 1 / len(common))
        groups += own
        if len(own) == 1:
            gap = own[0].values
            pairs += len(gap)
        else:
            gap = np.subtract.outer(own[0].values, own[1].values)
        wins.append(float(np.mean((gap < 0) + (gap == 0) / 2)))
    return weighted_difference(groups), pairs, float(np.mean(wins)) if wins else np.nan


def pairwise_table(held: Outcomes) -> pd.DataFrame:
    """Every two learners that played a condition in common, each pair once, of :func:`outcomes`.

    Returns:
        A row for each pair with the columns :data:`PAIR_COLUMNS`: ``learner``, ``other``,
        ``conditions`` (how many in common), ``pairs`` (of subjects), ``difference`` (by how many
        attempts the learner needs more than the other) with its 95% interval ``ci_low`` and
        ``ci_high``, ``p`` (as if it were the only comparison), ``probability`` (that a subject
        of the learner needs fewer attempts than one of the other) and ``p_corrected`` (for all
        pairs, after Holm).
    """
    rows = []
    for one, other in combinations(held, 2):
        common = len(held[one].keys() & held[other].keys())
        if common:
            found, pairs, wins = compared(held[one], held[other])
            rows.append((one, other, common, pairs, *found, wins))
    table = pd.DataFrame(rows, columns=PAIR_COLUMNS[:-1])
    return table.assign(p_corrected=holm(table["p"].to_numpy(float)))


def plot_pairs(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Axes:
    """How probable it is that one learner is better than another, as numbers on colours.

    A number is the probability that a subject of the learner in the row needs fewer attempts than
    the subject of the same number, in the same room, of the learner in the column, in the mean over
    the conditions that both played; ties count half. The learners stand in the order of their mean
    attempts, the best first, and each pair is there once.

    >>> [text.get_text() for text in plot_pairs(results).get_yticklabels()]
    ['oracle', 'random']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    protocol, trials = trials_under(results, protocol, learners, conditions)
    if learners is None and conditions is None:
        held, table = results.once(all_outcomes)[protocol], results.once(pairs)
        table = table[table["protocol"] == protocol]
    else:
        held = outcomes(trials, protocol)
        table = pairwise_table(held)
    if table.empty:
        raise NothingToDrawError(
            f"no two such learners played a condition in common under the protocol {protocol}"
        )
    means = {
        name: np.mean([one["attempts"].mean() for one in held[name].values()])
        for name in sorted({*table["learner"], *table["other"]})
    }
    names = sorted(means, key=means.__getitem__)
    size = len(names)
    known = table.pivot(index="learner", columns="other", values="probability")
    known = known.reindex(index=names, columns=names)
    values = known.fillna(1 - known.T).where(np.triu(np.ones((size, size), bool), 1)).to_numpy()
    shown = [style.label(name, 22) for name in names]
    counts = sorted(set(table["conditions"]))
    many = counted(counts[-1], "condition")
    many = many if len(counts) == 1 else f"{counts[0]} to {many}"
    edge = 0.25 + 0.07 * max(map(len, shown))  # names along the left and, slanted, along the top
    cell = min(0.55, (style.WIDTH - edge - 0.5 * edge) / size)
    width, height = max(3.5, 1.5 * edge + cell * size), 0.7 * edge + cell * size
    with panels(ax, 1, in_rows(1, 1, height, width, above=0.75)) as at:
        (axes,) = at.axes
        axes.set_xlabel(
            f"P(row needs fewer attempts than column),\nmean over {many}; ties count half"
        )
        axes.pcolormesh(
            range(size), range(size), values, shading="nearest", cmap=_COLOURS, vmin=0, vmax=1,
            edgecolors="white", linewidth=1.2,
        )  # fmt: skip
        axes.set_aspect("equal")
        axes.invert_yaxis()
        for (row, column), value in np.ndenumerate(values):
            if row < column:
                axes.text(
                    column, row, printed(value, ".2f"), ha="center", va="center",
                    fontsize="medium" if cell > 0.45 else "small",
                    color="white" if abs(value - 0.5) > 0.34 else "black",
                )  # fmt: skip
        axes.set_xticks(
            range(size), shown, rotation=40, rotation_mode="anchor", ha="left", va="center"
        )
        axes.set_yticks(range(size), shown)
        axes.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
        axes.grid(visible=False)
        axes.spines[:].set_visible(False)
    return axes


def all_outcomes(material: Material) -> dict[str, Outcomes]:
    """Outcomes of all subjects, by protocol."""
    protocols = ordered(material.trials["protocol"].unique(), ("human",))
    return {one: outcomes(material.trials, one) for one in protocols}


def pairs(material: Material) -> pd.DataFrame:
    """Every two learners under each protocol: :func:`pairwise_table`, and the ``protocol``."""
    held = {name: pairwise_table(own) for name, own in material.once(all_outcomes).items()}
    tables = [table.assign(protocol=name) for name, table in held.items()]
    return pd.concat(tables, ignore_index=True) if tables else pairwise_table({})


def section(material: Material) -> Section | None:
    """Comparisons of all learners under each protocol; None if nowhere two of them can compare."""
    every = material.once(pairs)
    if every.empty:
        return None
    text, tables, plots = [], [], []
    for protocol, part in file_names(every["protocol"].unique()).items():
        table, name = every[every["protocol"] == protocol], f"pairwise_{part}"
        text.append(_compared(protocol, table))
        caption = (
            "Difference: by how many attempts the learner needs more than the other, the mean over "
            "the conditions that both played, with its 95% interval; pairs: of subjects, 0 where "
            "learners share no rooms and Welch's test takes their subjects for independent. p: as "
            "if it were the only comparison, and corrected for all pairs of the protocol. "
            "P(fewer): how probable it is that a subject needs fewer attempts than its pair."
        )
        shown = table.drop(columns="protocol").rename(columns=_NAMES)
        tables.append(Table(name, f"Every pair, protocol {protocol}", shown, _FORMATS, caption))
        if len(table) > 1:
            title = f"How often one learner is quicker than another, protocol {protocol}"
            caption = (
                "Probability that a subject of the learner in the row needs fewer attempts than "
                "its pair, in the same rooms, of the learner in the column; ties count half; the "
                "mean over the conditions that both played."
            )
            plots.append(drawn(name, plot_pairs, material, title, caption, protocol=protocol))
    text.append(
        "An interval is for its comparison alone; what is significant is decided after correction "
        "for all pairs, so a difference may not be significant though its interval leaves out 0."
    )
    title = "Learners against learners"
    return Section("pairwise", title, tuple(text), tuple(tables), tuple(plots))


def _compared(protocol: str, table: pd.DataFrame) -> str:
    """How many pairs differ, and which do not."""
    alike = table[~(table["p_corrected"] < ALPHA)]
    differ = len(table) - len(alike)
    gaps = []
    for row in alike.itertuples():
        low, high = printed(row.ci_low, "+.2f"), printed(row.ci_high, "+.2f")
        interval = f", {low} to {high}" if np.isfinite(row.ci_low) else ""
        gaps.append(f"{row.learner} and {row.other} ({printed(row.difference, '+.2f')}{interval})")
    return sentences(
        f"Protocol {protocol}: of {counted(len(table), 'pair')} of learners {differ} "
        f"{'differs' if differ == 1 else 'differ'} in the attempts that they need.",
        f"Not significantly different, which is not to say that they are equal: {some(gaps)}."
        if gaps
        else "",
    )


TOPIC = Topic("pairwise", 90, section)
