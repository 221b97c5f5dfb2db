"""Panels with a row for each learner: an estimate as a dot, its interval as a line."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Layout, Panels, set_size

_HEIGHT = 0.21  # of a row, in inches


def two_panels(names: Sequence[str]) -> Layout:
    """Return the layout of two panels with a row for each name."""

    def lay_out(figure: Figure) -> list[Axes]:
        set_size(figure, style.WIDTH, 1.15 + _HEIGHT * len(names))
        return list(figure.subplots(1, 2, sharey=True, sharex=True))

    return lay_out


def name_rows(at: Panels, names: Sequence[str]) -> None:
    """Name the rows, the first at the top, and mark zero."""
    for axes in at.axes:
        axes.grid(axis="x")
        axes.axvline(0, color="#333333", lw=0.9, zorder=1)
        axes.set_yticks(range(len(names)), [style.label(name, 28) for name in names])
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)


def dots(
    axes: Axes,
    rows: pd.DataFrame,
    names: Sequence[str],
    value: str,
    look: tuple[str, str],
    aside: float = 0.0,
) -> None:
    """Draw the values of learners with their intervals.

    Args:
        axes: The panel.
        rows: A row for each ``learner`` with ``low`` and ``high``; one without a value is left out.
        names: The rows of the panel.
        value: The column of values.
        look: Colour and marker.
        aside: How far below its row's middle a dot is, in rows.
    """
    colour, marker = look
    y = np.array([list(names).index(name) + aside for name in rows["learner"]])
    axes.hlines(y, rows["low"], rows["high"], color=colour, lw=1.6, zorder=2, capstyle="projecting")
    axes.plot(rows[value], y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)
