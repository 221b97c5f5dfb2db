"""What learning costs, in attempts: each subject, and the median of each learner."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import LogLocator, NullFormatter

from causal_openlock.analysis.measures import ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, rows_of
from causal_openlock.analysis.results.cost import WITHIN, median_cost, subject_costs
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import NothingToDrawError

_NEVER = "#F2F2F2"  # behind subjects that never came so far


def plot_cost(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    within: float = WITHIN,
    repeats: bool = False,
    ax: Any = None,
) -> Any:
    """How many attempts, all training counted, until a new room is first solved well.

    Well is within ``within`` times the attempts of the ideal observer; see
    :func:`~causal_openlock.analysis.results.cost.learning_costs`. A row for each learner, a dot for
    each subject of all conditions, on a logarithmic axis; black: the median with its 95% bootstrap
    interval. On the right, in grey, are subjects that never came so far, with how many there are,
    and the most attempts that one of them made. What a learner was trained with before the
    experiment, such as the meta-training of ``rl2``, counts.

    >>> import causal_openlock as ol
    >>> axes = ol.plot_cost(results, conditions=["CC4"])
    >>> [label.get_text() for label in axes.get_yticklabels()]
    ['random', 'oracle']

    With ``repeats`` rooms count that the subject has visited before. The other arguments, what is
    returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    trials = rows_of(results, results.trials, learners, conditions)
    table = subject_costs(results, trials, within, repeats)
    if table.empty:
        raise NothingToDrawError(
            "no such learner played a condition of which the attempts of the ideal observer are "
            "known"
        )
    table = table.assign(row=_rows(table))
    names = [name for learner in results.learners
             for name in ordered(table.loc[table["learner"] == learner, "row"])]  # fmt: skip
    finite = table.loc[np.isfinite(table["cost"]), "cost"]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (1.0, 10.0)
    edge = max(high, 3 * low) * 1.6
    end = edge * max(edge / low, 20) ** 0.55  # of the grey part
    with panels(ax, 1, in_rows(1, 1, 0.27 * len(names) + 0.75, style.WIDTH / 0.62)) as at:
        (axes,) = at.axes
        _scale(axes, names, (low / 1.5, edge, end))
        for place, name in enumerate(names):
            _row(axes, place, table[table["row"] == name], (edge, end))
        dots: Any = {"ls": "", "marker": "o", "ms": 4, "mec": "#1F6F9F", "label": "subjects"}
        line: Any = {"color": "black", "lw": 1.6, "marker": "|", "ms": 9, "mew": 2}
        at.legend(
            [
                Line2D([], [], color=style.current().other(3), **dots),
                Line2D([], [], label="median, 95% interval", **line),
            ]
        )
    return at.returned


def _rows(table: pd.DataFrame) -> list[str]:
    """Names of rows: of learners, with the protocol where one of them has several."""
    several = table.groupby("learner", observed=True)["protocol"].nunique()
    return [
        f"{learner} ({protocol})" if several[learner] > 1 else str(learner)
        for learner, protocol in zip(table["learner"], table["protocol"], strict=True)
    ]


def _scale(axes: Axes, names: Sequence[str], limits: tuple[float, float, float]) -> None:
    low, edge, end = limits
    axes.set_xscale("log")
    axes.set_xlim(low, end)
    few = end < 1000 * low
    for subs, minor in (((1, 2, 5) if few else (1,), False), (range(1, 10), True)):
        ticks = np.asarray(LogLocator(subs=subs, numticks=8).tick_values(low, edge))
        within = ticks[(low <= ticks) & (ticks <= edge)]  # the grey part has no attempts
        axes.xaxis.set_ticks(within, minor=minor)
    axes.xaxis.set_major_formatter("{x:,.0f}")
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set_xlabel("Attempts, all training counted")
    axes.set_yticks(range(len(names)), [style.label(name, 28) for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")
    axes.grid(False, axis="y")
    axes.axvspan(edge, end, color=_NEVER, zorder=0.6)


def _row(axes: Axes, place: int, own: pd.DataFrame, never: tuple[float, float]) -> None:
    cost = np.sort(own["cost"].to_numpy(float))
    reached = cost[np.isfinite(cost)]
    edge, end = never
    # Subjects stand a little above and below one another, the same ones in every drawing.
    aside = 0.22 * np.sin(2.4 * np.arange(len(reached)))
    axes.plot(
        reached, place + aside, "o", ms=3.5, color=style.current().other(3), mec="#1F6F9F", mew=0.4,
        alpha=0.8, zorder=2,
    )  # fmt: skip
    middle, low, high = median_cost(cost)
    if np.isfinite(low):
        axes.plot([low, min(high, edge)], [place] * 2, color="black", lw=1.6, zorder=3)
    if np.isfinite(middle):
        axes.plot(middle, place, "|", color="black", ms=9, mew=2, zorder=3)
    if missed := len(cost) - len(reached):
        asked = int(own.loc[np.isinf(own["cost"]), "asked"].max())
        axes.text(
            (edge * end) ** 0.5, place, f"{missed} of {len(cost)} not within {asked:,}",
            ha="center", va="center", fontsize="small",
        )  # fmt: skip
