"""What attempts came to, drawn in the form of the paper's Figures 6 and 7.

Each segment's *height* is log10 of its count, and segments are stacked: the form that the paper
chose. So a stack is a sum of logarithms; it shrinks as one category takes over. The paper's own
DDQN is the first panel, from its published counts. Drawn are learners under protocols with many
attempts in a trial, that is, all but ``human``.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from causal_openlock.analysis.measures import TRANSFERS, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.results.people.comparable import HUMAN_PROTOCOL
from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.world import reference

_OUTLINES = {"CE4": ":", "CC4": "-"}  # left to right, as in the paper
_LABEL = r"$\log_{10}$ of attempts, stacked"
_CAPTION = (
    "Open 1, 2 and 3: the attempt opened the door with the first, second or third new solution of "
    "its trial (later ones count as the third, a repeated one as open 1); unlock: it unlocked the "
    "door but did not open it; else: neither. The height of a segment is log10 of its number of "
    "attempts, all subjects together, so one attempt has no height, panels of unequal totals "
    "differ in height, and a stack shrinks as one category takes over."
)


def baseline_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Drawing | None:
    """Figure 6: what attempts came to over the course of the baseline conditions.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.category_counts`.
        learners: The order of the panels.

    Returns:
        The drawing, or None if nobody played CC4 or CE4 under a protocol other than ``human``.
    """
    chosen = _chosen(counts, list(_OUTLINES), "train")
    if chosen.empty:
        return None
    published = reference.results()["cogsci2018"]["ddqn"]["baseline_counts"]
    with style.settings():
        groups = _groups(chosen, learners)
        figure, axes = style.panels(1 + len(groups), columns=2, height=2.7)
        for side, (condition, outline) in enumerate(_OUTLINES.items()):
            for block, values in enumerate(published[condition].values()):
                _stack(axes[0], block + 0.4 * side - 0.2, values, outline)
        _name_blocks(axes[0], [name.replace("-", "–") for name in published["CE4"]], "Attempts")
        style.panel_title(axes[0], "DDQN of the paper", "published counts")
        for panel, (learner, protocol, rows) in zip(axes[1:], groups, strict=True):
            for side, (condition, outline) in enumerate(_OUTLINES.items()):
                one = rows[rows["condition"] == condition]
                for block, part in one.groupby("block"):
                    values = dict(zip(part["category"], part["count"], strict=True))
                    _stack(panel, int(str(block)) - 1 + 0.4 * side - 0.2, values, outline)
            until = rows.groupby("block")["until"].max().to_numpy()
            _name_blocks(panel, _ranges(until), "Attempts of each subject")
            style.panel_title(panel, learner, f"{protocol}, {style.sizes(rows)}")
        outlines = [
            Patch(fc="white", ec="black", lw=1.1, ls=line, label=f"{name} ({side})")
            for (name, line), side in zip(_OUTLINES.items(), ("left", "right"), strict=True)
        ]
        _finish(figure, axes, outlines)
    return Drawing(
        "baseline_categories",
        "What baseline attempts came to",
        "How often attempts came to each category in five successive blocks of the attempts of "
        "the baseline conditions; the first panel shows the paper's own DDQN (Figure 6). "
        + _CAPTION,
        figure,
    )


def transfer_categories(counts: pd.DataFrame, learners: Sequence[str] = ()) -> Drawing | None:
    """Figure 7: what attempts came to in the test phase of the transfer conditions.

    Args:
        counts: From :func:`~causal_openlock.analysis.measures.category_counts`, any number of
            blocks.
        learners: The order of the panels.

    Returns:
        The drawing, or None if nobody played one of the paper's transfer conditions under a
        protocol other than ``human``.
    """
    chosen = _chosen(counts, TRANSFERS, "test")
    if chosen.empty:
        return None
    published = reference.results()["cogsci2018"]["ddqn"]["transfer_counts"]
    with style.settings():
        groups = _groups(chosen, learners)
        figure, axes = style.panels(1 + len(groups), columns=2, height=2.7)
        for place, condition in enumerate(TRANSFERS):
            _stack(axes[0], place, published[condition], "-", width=0.6)
        style.panel_title(axes[0], "DDQN of the paper", "published counts")
        for panel, (learner, protocol, rows) in zip(axes[1:], groups, strict=True):
            for place, condition in enumerate(TRANSFERS):
                one = rows[rows["condition"] == condition]
                total = one.groupby("category", observed=True)["count"].sum()
                values = {str(name): int(count) for name, count in total.items()}
                _stack(panel, place, values, "-", width=0.6)
            style.panel_title(panel, learner, f"{protocol}, {style.sizes(rows)}")
        for panel in axes:
            panel.set_xticks(range(len(TRANSFERS)), TRANSFERS)
            panel.set_xlim(-0.6, len(TRANSFERS) - 0.4)
            panel.set_xlabel("Training and test")
        _finish(figure, axes, [])
    return Drawing(
        "transfer_categories",
        "What attempts in the transfer test came to",
        "How often attempts of the test phase came to each category in the transfer conditions; "
        "the first panel shows the paper's own DDQN (Figure 7). " + _CAPTION,
        figure,
    )


def _chosen(counts: pd.DataFrame, conditions: Sequence[str], phase: str) -> pd.DataFrame:
    return counts[
        (counts["protocol"] != HUMAN_PROTOCOL)
        & counts["condition"].isin(conditions)
        & (counts["phase"] == phase)
    ]


def _groups(chosen: pd.DataFrame, learners: Sequence[str]) -> list[tuple[str, str, pd.DataFrame]]:
    """A panel's learner, protocol and rows, for each panel."""
    return [
        (learner, protocol, chosen[(chosen["learner"] == learner) & mine])
        for learner in ordered(chosen["learner"], learners)
        for protocol in ordered(chosen.loc[chosen["learner"] == learner, "protocol"], ())
        if (mine := chosen["protocol"] == protocol).any()
    ]


def _stack(
    axes: Axes, x: float, counts: Mapping[str, int], outline: str, width: float = 0.38
) -> None:
    bottom = 0.0
    for category in CATEGORIES:
        count = int(counts.get(category, 0))
        height = float(np.log10(count)) if count else 0.0
        if height:
            axes.bar(
                x,
                height,
                width,
                bottom,
                color=style.CATEGORY_COLOURS[category],
                edgecolor="black",
                linewidth=1.0,
                linestyle=outline,
            )
        bottom += height


def _name_blocks(axes: Axes, names: Sequence[str], label: str) -> None:
    axes.set_xticks(range(len(names)), names, fontsize=7.5)
    axes.set_xlim(-0.6, len(names) - 0.4)
    axes.set_xlabel(label)


def _ranges(until: Sequence[float]) -> list[str]:
    """Names of blocks: ``0–0.6k``, ``0.6–1.2k``, ... as the paper's ``0–30k``; few in full."""
    thousands = bool(until[-1] >= 1000)
    ends = [f"{round(value / 1000, 2):g}" if thousands else f"{value:.0f}" for value in (0, *until)]
    return [f"{low}–{high}{'k' * thousands}" for low, high in pairwise(ends)]


def _finish(figure: Figure, axes: Sequence[Axes], outlines: Sequence[Patch]) -> None:
    style.label_rows(axes, _LABEL)
    categories = [
        Patch(fc=style.CATEGORY_COLOURS[name], ec="black", lw=0.6, label=style.CATEGORY_NAMES[name])
        for name in CATEGORIES
    ]
    style.legend(figure, [*categories, *outlines])
