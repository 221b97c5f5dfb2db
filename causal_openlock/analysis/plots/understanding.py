"""How well subjects understand the rooms that they leave, over trials."""

from __future__ import annotations

from typing import Any

import pandas as pd
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.plots.survival import MOST_BANDS
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.understanding import ASKED, understanding, understood
from causal_openlock.errors import NothingToDrawError


def plot_understanding(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    subjects: int | None = ASKED,
    ax: Any = None,
) -> Any:
    """How many edges of each room's graph subjects had wrong when they left it, trial by trial.

    That is the structural Hamming distance between what they take the structure to be and the
    schema (:func:`~causal_openlock.analysis.results.understanding.understanding`); 0 is perfect. A
    panel for each condition, a line for each learner; with at most four learners a band is the 95%
    bootstrap interval over subjects. Learners play again what is on record, which takes as long as
    it took then, so that of each condition the first ``subjects`` do; None stands for all.

    >>> import causal_openlock as ol
    >>> bayes = ol.compare("CC3", ["bayes", "ideal"], subjects=2, workers=1)
    >>> [line.get_label() for line in ol.plot_understanding(bayes).lines]
    ['bayes', 'ideal']

    The other arguments, what is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    table = understanding(results, subjects=subjects)
    return draw_understanding(results, table, learners=learners, conditions=conditions, ax=ax)


def draw_understanding(
    results: Material,
    table: pd.DataFrame,
    *,
    learners: Names = None,
    conditions: Names = None,
    ax: Any = None,
) -> Any:
    """Draw a table of :func:`~causal_openlock.analysis.results.understanding.understanding`."""
    table = rows_of(results, understood(table), learners, conditions)
    if table.empty:
        raise NothingToDrawError("nobody said what they take the structure of a room to be")
    names = ordered(table["learner"].unique(), results.learners)
    top = max(1.0, 1.04 * float(table[["shd", "ci_high"]].max(axis=None)))
    looks = {name: style.current().line(number) for number, name in enumerate(names)}
    shown = ordered(table["condition"].unique(), results.conditions)
    with panels(ax, len(shown), in_rows(len(shown), 3, 2.0)) as at:
        for axes, condition in zip(at.axes, shown, strict=True):
            here = table[table["condition"] == condition]
            for name in names:
                own = here[here["learner"] == name]
                look = looks[name]
                axes.plot(own["visit"], own["shd"], marker="o", ms=3, label=name, **look)
                if len(names) <= MOST_BANDS:
                    ends = own["ci_low"], own["ci_high"]
                    axes.fill_between(own["visit"], *ends, color=look["color"], alpha=0.15, lw=0)
            style.panel_title(axes, condition, style.sizes(here))
            axes.set(xlabel="Trial", ylim=(-0.1, top))
            axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        at.label_y("Edges wrong")
        keys = [Line2D([], [], label=style.label(name, 24), **looks[name]) for name in names]
        at.legend(keys, columns=min(len(names), 4))
    return at.returned
