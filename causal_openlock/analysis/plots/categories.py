"""What attempts came to, drawn in the form of the paper's Figures 6 and 7.

Each segment's *height* is log10 of its count, and segments are stacked: the form that the paper
chose. So a stack is a sum of logarithms; it shrinks as one category takes over. The paper's own
DDQN is the first panel, from its published counts. Drawn are learners under protocols with many
attempts in a trial, that is, all but ``human``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from causal_openlock.analysis.measures import TRANSFERS, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.world import reference

_OUTLINES = {"CE4": ":", "CC4": "-"}  # left to right, as in the paper
_LABEL = r"$\log_{10}$ of attempts, stacked"


def baseline_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Plot | None:
    """Figure 6: what attempts came to over the course of the baseline conditions.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.category_counts`.
        learners: The order of the panels.

    Returns:
        The plot, or None if no learner played CC4 or CE4 under a protocol other than ``human``.
    """

    def panel(axes: Axes, blocks: Mapping[str, Sequence[Mapping[str, int]]]) -> None:
        for side, (condition, outline) in enumerate(_OUTLINES.items()):
            for block, values in enumerate(blocks.get(condition, ())):
                _stack(axes, block + 0.4 * side - 0.2, values, outline)

    def name_blocks(axes: Axes, names: Sequence[str], label: str) -> None:
        axes.set_xticks(range(len(names)), names, fontsize=7.5)
        axes.set_xlim(-0.6, len(names) - 0.4)
        axes.set_xlabel(label)

    published = reference.results()["cogsci2018"]["ddqn"]["baseline_counts"]

    def paper(axes: Axes) -> None:
        panel(axes, {name: list(blocks.values()) for name, blocks in published.items()})
        name_blocks(axes, [name.replace("-", "–") for name in published["CE4"]], "Attempts")

    def learner(axes: Axes, rows: pd.DataFrame) -> None:
        blocks = {
            str(condition): [_counts(part) for _, part in own.groupby("block")]
            for condition, own in rows.groupby("condition", observed=True)
        }
        panel(axes, blocks)
        until = rows.groupby("block")["until"].max().to_numpy()
        name_blocks(axes, _ranges(until), "Attempts of each subject")

    outlines = [
        Patch(fc="white", ec="black", lw=1.1, ls=line, label=f"{name} ({side})")
        for (name, line), side in zip(_OUTLINES.items(), ("left", "right"), strict=True)
    ]
    chosen = _chosen(counts, list(_OUTLINES), "train")
    return _beside_paper("baseline_categories", chosen, learners, paper, learner, outlines)


def transfer_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Plot | None:
    """Figure 7: what attempts came to in the test phase of the transfer conditions.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.category_counts`, any number of
            blocks.
        learners: The order of the panels.

    Returns:
        The plot, or None if no learner played a transfer condition of the paper under a protocol
        other than ``human``.
    """

    def panel(axes: Axes, counted: Mapping[str, Mapping[str, int]]) -> None:
        for place, condition in enumerate(TRANSFERS):
            _stack(axes, place, counted.get(condition, {}), "-", width=0.6)
        axes.set_xticks(range(len(TRANSFERS)), TRANSFERS)
        axes.set_xlim(-0.6, len(TRANSFERS) - 0.4)
        axes.set_xlabel("Training and test")

    def paper(axes: Axes) -> None:
        panel(axes, reference.results()["cogsci2018"]["ddqn"]["transfer_counts"])

    def learner(axes: Axes, rows: pd.DataFrame) -> None:
        by_condition = rows.groupby("condition", observed=True)
        panel(axes, {str(condition): _counts(own) for condition, own in by_condition})

    chosen = _chosen(counts, TRANSFERS, "test")
    return _beside_paper("transfer_categories", chosen, learners, paper, learner, [])


def _chosen(counts: pd.DataFrame, conditions: Sequence[str], phase: str) -> pd.DataFrame:
    return counts[
        (counts["protocol"] != HUMAN_PROTOCOL)
        & counts["condition"].isin(conditions)
        & (counts["phase"] == phase)
    ]


def _counts(rows: pd.DataFrame) -> dict[str, int]:
    """By category, how many attempts."""
    total = rows.groupby("category", observed=True)["count"].sum()
    return {str(name): int(count) for name, count in total.items()}


def _beside_paper(
    kind: str,
    chosen: pd.DataFrame,
    learners: Sequence[str],
    paper: Callable[[Axes], None],
    learner: Callable[[Axes, pd.DataFrame], None],
    outlines: Sequence[Any],
) -> Plot | None:
    """A panel for the paper's DDQN, and one for each learner under each protocol."""
    if chosen.empty:
        return None
    by_protocol = dict(list(chosen.groupby(["learner", "protocol"], observed=True)))
    groups = [
        (name, protocol, by_protocol[name, protocol])
        for name in ordered(chosen["learner"], learners)
        for protocol in ordered(chosen.loc[chosen["learner"] == name, "protocol"], ())
    ]
    with style.settings():
        figure, panels = style.panels(1 + len(groups), columns=2, height=2.7)
        paper(panels[0])
        style.panel_title(panels[0], "DDQN of the paper", "published counts")
        for axes, (name, protocol, rows) in zip(panels[1:], groups, strict=True):
            learner(axes, rows)
            style.panel_title(axes, name, f"{protocol}, {style.sizes(rows)}")
        style.label_rows(panels, _LABEL)
        colours = style.CATEGORY_COLOURS
        categories = [
            Patch(fc=colours[name], ec="black", lw=0.6, label=style.CATEGORY_NAMES[name])
            for name in CATEGORIES
        ]
        style.legend(figure, [*categories, *outlines])
    return Plot(kind, figure)


def _stack(
    axes: Axes, x: float, counts: Mapping[str, int], outline: str, width: float = 0.38
) -> None:
    bottom = 0.0
    for category in CATEGORIES:
        count = int(counts.get(category, 0))
        height = float(np.log10(count)) if count else 0.0
        if height:
            colour = style.CATEGORY_COLOURS[category]
            axes.bar(x, height, width, bottom, color=colour, ec="black", lw=1.0, ls=outline)
        bottom += height


def _ranges(until: Sequence[float]) -> list[str]:
    """Names of blocks: ``0–0.6k``, ``0.6–1.2k``, ... as the paper's ``0–30k``; few in full."""
    thousands = bool(until[-1] >= 1000)
    ends = [f"{round(value / 1000, 2):g}" if thousands else f"{value:.0f}" for value in (0, *until)]
    return [f"{low}–{high}{'k' * thousands}" for low, high in pairwise(ends)]
