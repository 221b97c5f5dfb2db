"""How well learners predict over trials: a line for each, in bits per action."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.analysis.plots.survival import MOST_BANDS


def draw_scores(table: pd.DataFrame, names: Sequence[str], ax: Any = None) -> Any:
    """Draw a panel for each condition, with a line for each learner that predicts.

    Args:
        table: A row for each ``scored`` learner, condition and trial, from
            :func:`~causal_openlock.scoring.scores.over`.
        names: Labels of the learners, in the order of the legend.
        ax: As for :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    table = table[table["scored"].isin(names)].replace(np.inf, np.nan)
    top = 1.04 * float(table[["bits", "ci_high"]].max(axis=None))
    conditions = ordered(table["condition"].unique())
    looks = {name: style.current().line(number) for number, name in enumerate(names)}
    with panels(ax, len(conditions), in_rows(len(conditions), 3, 2.2)) as at:
        for axes, condition in zip(at.axes, conditions, strict=True):
            here = table[table["condition"] == condition]
            for name in names:
                rows, look = here[here["scored"] == name], looks[name]
                axes.plot(rows["trial"], rows["bits"], marker="o", ms=3, label=name, **look)
                if len(names) <= MOST_BANDS:
                    ends = rows["ci_low"], rows["ci_high"]
                    axes.fill_between(rows["trial"], *ends, color=look["color"], alpha=0.15, lw=0)
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlabel="Trial", ylim=(0, top))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        at.label_y("Bits per action")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name]) for name in names]
        at.legend(keys, columns=min(len(names), 4))
    return at.returned
