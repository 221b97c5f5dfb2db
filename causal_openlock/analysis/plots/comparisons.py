"""Learners, or results, against one another: a matrix of probabilities, and rows of differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import BASELINES
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Plot

CONGRUENCY_TESTS = {"CC3-CC4": "Test of CC4", "CE3-CE4": "Test of CE4"}
MOST_DRAWN = 60
"""Differences between two results that are drawn: the first ones."""

_COLOURS = LinearSegmentedColormap.from_list("worse_better", ["#8C510A", "#F7F7F7", "#01665E"])
_ROW = 0.21  # height of a learner's row, in inches


def draw_matrix(names: Sequence[str], pairs: pd.DataFrame) -> Plot:
    """Probabilities that one learner is better than another, as numbers on colours.

    A pair has ``learner``, ``other``, ``probability`` and whether the comparison is ``decided``,
    which is printed bold; rows and columns are in the order of names.
    """
    size = len(names)
    place = {name: number for number, name in enumerate(names)}
    at = pairs["learner"].map(place), pairs["other"].map(place)
    values, sure = np.full((size, size), np.nan), np.zeros((size, size), bool)
    values[at], sure[at] = pairs["probability"], pairs["decided"]
    shown = [style.label(name, 22) for name in names]
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
                column, row, f"{value:.2f}" if known else "–", ha="center", va="center",
                fontsize=8 if cell > 0.45 else 7,
                fontweight="bold" if sure[row, column] else "normal",
                color="white" if known and abs(value - 0.5) > 0.34 else "black",
            )  # fmt: skip
        axes.set_xticks(range(size), shown, rotation=40, ha="left", va="bottom")
        axes.set_yticks(range(size), shown)
        axes.tick_params(length=0, top=False, labeltop=True, bottom=False, labelbottom=False)
        for label in axes.get_xticklabels():
            label.set_rotation_mode("anchor")
            label.set_verticalalignment("center")
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_ticks(np.arange(size - 1) + 0.5, minor=True)
        axes.grid(visible=False)
        axes.grid(visible=True, which="minor", axis="both", color="white", linewidth=1.2)
        axes.tick_params(which="minor", length=0)
        axes.set_axisbelow(False)
        axes.spines[:].set_visible(False)
    return Plot("pairwise", figure)


def draw_congruency(scores: pd.DataFrame) -> Plot:
    """What training with the structure of the test saves under one protocol, a panel each."""
    with style.settings():
        names, figure, panels = _rows_of(scores)
        for (condition, title), axes in zip(CONGRUENCY_TESTS.items(), panels, strict=True):
            rows = scores[scores["condition"] == condition]
            _dots(axes, rows, names, (style.trained_colour(condition), "o"))
            style.panel_title(axes, title)
            axes.set_xlabel("Attempts, congruent − incongruent training")
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
    return Plot("transfer_congruency", figure)


def draw_savings(scores: pd.DataFrame) -> Plot:
    """What training saves in the first room with four levers, a panel for each structure."""
    looks = {"CC3": (style.COMMON_CAUSE, "o"), "CE3": (style.COMMON_EFFECT, "s")}
    with style.settings():
        names, figure, panels = _rows_of(scores)
        for tested, axes in zip(BASELINES, panels, strict=True):
            for (trained, look), aside in zip(looks.items(), (-0.14, 0.14), strict=True):
                rows = scores[scores["condition"] == f"{trained}-{tested}"]
                _dots(axes, rows, names, look, aside)
            style.panel_title(axes, f"Test of {tested}")
            axes.set_xlabel("Attempts saved by training")
            axes.xaxis.set_major_formatter(PercentFormatter(1.0))
            axes.xaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 2.5, 5, 10]))
        keys = [
            Line2D([], [], ls="", marker=marker, color=colour, mec="black", mew=0.5,
                   label=f"{trained} training")
            for trained, (colour, marker) in looks.items()
        ]  # fmt: skip
        style.legend(figure, keys)
    return Plot("transfer_savings", figure)


def _rows_of(scores: pd.DataFrame) -> tuple[list[str], Figure, list[Axes]]:
    """Two panels with a row for each learner, the first at the top."""
    names = list(dict.fromkeys(scores["learner"]))
    figure = Figure(figsize=(style.WIDTH, 1.15 + _ROW * len(names)), layout="constrained")
    panels = list(figure.subplots(1, 2, sharey=True, sharex=True))
    for axes in panels:
        axes.grid(axis="x")
        axes.axvline(0, color="#333333", lw=0.9, zorder=0.5)
        axes.set_yticks(range(len(names)), [style.label(name, 28) for name in names])
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)
    return names, figure, panels


def _dots(
    axes: Axes, rows: pd.DataFrame, names: list[str], look: tuple[str, str], aside: float = 0.0
) -> None:
    """The score of each learner with its interval, in a colour and with a marker."""
    colour, marker = look
    y = np.array([names.index(name) + aside for name in rows["learner"]])
    ends = rows["ci_low"], rows["ci_high"]
    axes.hlines(y, *ends, color=colour, lw=1.6, zorder=2, capstyle="projecting")
    axes.plot(rows["value"], y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)


def draw_differences(table: pd.DataFrame, names: Sequence[str]) -> Plot:
    """Differences between two results with their intervals, a line each.

    The table has ``learner``, ``condition``, ``difference``, ``ci_low``, ``ci_high`` and whether a
    difference is ``sure``; names are those of the two results.
    """
    rows: list[Mapping[Any, Any]] = table.head(MOST_DRAWN).to_dict("records")
    with style.settings():
        figure, (axes,) = style.panels(1, 1, 0.19 * len(rows) + 0.5)
        figure.set_figwidth(style.WIDTH)
        for place, row in enumerate(rows):
            colour = style.OTHER[2] if row["sure"] else "#666666"
            axes.plot([row["ci_low"], row["ci_high"]], [place] * 2, color=colour, lw=1.6)
            face = colour if row["sure"] else "white"
            axes.plot(row["difference"], place, "o", color=colour, mfc=face, ms=4.5, zorder=3)
        labels = [
            f"{style.label(row['learner'], 24)}  {style.label(row['condition'], 24)}"
            for row in rows
        ]
        axes.set_yticks(range(len(rows)), labels, fontsize=7.5)
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.axvline(0, color="black", lw=0.8, zorder=1)
        most = max([1.0, *(abs(x) for x in axes.get_xlim())])
        axes.set_xlim(-most, most)
        axes.grid(True, axis="x")
        axes.grid(False, axis="y")
        first, second = (style.label(name, 24) for name in names)
        axes.set_xlabel(f"Attempts, {second} less {first}")
    return Plot("means", figure, facts={"drawn": len(rows), "rows": len(table)})
