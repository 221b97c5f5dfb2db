"""Attempts over the course of a condition: every trial, in the order in which it was played.

Each learner has a row of panels and each family of conditions a column, so that a panel holds two
lines of the paper's conditions and not six: what is trained under common cause and under common
effect, on the way to the same test. The first line of a panel is broad and the next one narrow;
where they coincide, as at the limit, both are still seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from matplotlib.transforms import offset_copy

from causal_openlock.analysis.measures import (
    BASELINES,
    CELL,
    SUBJECT,
    TRANSFERS,
    mean_by_trial,
    ordered,
)
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, in_rows, panels, trials_under
from causal_openlock.analysis.results.bounds import bounds_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.statistics import sizes
from causal_openlock.experiment.condition import PAPER_CONDITIONS

_FAMILIES = (BASELINES, TRANSFERS[:2], TRANSFERS[2:])
_TOGETHER = 4  # conditions of one's own in a panel
_HEIGHT = 1.75  # of a panel, in inches
_POINTS = 60  # the most that a line is drawn with
_MARKERS = 18  # with more points than this lines have no markers
_GREY = "#666666"
_LIMIT: Any = {"color": _GREY, "lw": 0.8, "ls": (0, (1, 1.5))}


def plot_course(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Any:
    """Mean attempts over the course of every condition of a protocol, whichever they are.

    Learners are rows of panels, families of conditions columns.

    >>> axes = plot_course(results, learners=["oracle"], conditions=["CC4"])
    >>> axes.get_title(loc="left"), axes.get_ylabel()
    ('oracle', 'Attempts')

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    _, trials = trials_under(results, protocol, learners, conditions)
    subjects = trials.groupby([*CELL, *SUBJECT], observed=True, sort=False)
    trials = trials.assign(visit=subjects.cumcount() + 1)
    # A point of a long course stands for as many visits in a row, in its middle.
    most = trials.groupby("condition", observed=True)["visit"].transform("max").astype(int)
    width = -(-most // _POINTS)
    first = (trials["visit"] - 1) // width * width + 1
    trials = trials.assign(place=first + (np.minimum(width, most - first + 1) - 1) / 2)
    means = mean_by_trial(trials, ["phase", "place"])
    unsolved = trials.loc[~trials["solved"], "last_attempt"]
    limit = float(unsolved.max()) if len(unsolved) else None
    ideal = bounds_of(results.bounds, trials)
    marked = int(means.groupby(["learner", "condition"], observed=True).size().max()) <= _MARKERS
    top = 1.06 * max(float((means["mean"] + means["se"]).max()), limit or 0.0, *ideal.values())
    names = ordered(means["learner"], results.learners)
    families = _families(ordered(means["condition"], results.conditions))
    looks = _looks(families)
    cells = [(name, family) for name in names for family in families]
    visits = trials.groupby(["condition", "phase"], observed=True)["visit"]
    spans = visits.agg(["min", "max"]).reset_index()
    points = dict(iter(means.groupby(["learner", "condition"], observed=True)))
    keys = [Line2D([], [], **_LIMIT, label="limit of attempts")] if limit is not None else []
    keys += [style.ideal_key()] if ideal else []
    columns = len(families) if len(families) > 1 else 3
    above = 0.45 + 0.25 * bool(keys) + 0.17 * max(map(len, families))
    with panels(ax, len(cells), in_rows(len(cells), columns, _HEIGHT, above=above)) as at:
        for axes, (name, family) in zip(at.axes, cells, strict=True):
            for place, condition in enumerate(family):
                aside = 0.16 * (place - (len(family) - 1) / 2) * marked
                if (name, condition) in points:
                    _draw_line(axes, points[name, condition], looks[condition], marked, aside)
            if not axes.lines:
                axes.text(
                    0.5, 0.5, "not played", transform=axes.transAxes, ha="center", color=_GREY
                )
            own = spans[spans["condition"].isin(family)]
            _scale(axes, int(own["max"].max()), top, limit)
            _mark_test(axes, own.loc[own["phase"] == "test", "min"])
            levels = {
                (ideal[row.condition, row.phase], row.min - 0.5, row.max + 0.5)
                for row in own.itertuples()
                if (row.condition, row.phase) in ideal
            }
            for level in sorted(levels):
                style.ideal_line(axes, *level)
            axes.set_xlabel("Trial, in order")
            if len(families) > 1:
                axes.label_outer()
            if len(families) == 1 or family is families[0]:
                style.panel_title(axes, name, sizes(means[means["learner"] == name]))
        title = 27 + 11 * at.axes[0].get_title(loc="left").count("\n")  # its height in points
        for axes, family in zip(at.axes, families, strict=False):  # of the first row
            lines = [Line2D([], [], label=style.label(one, 24), **looks[one]) for one in family]
            if at.figure is None:
                at.legend([*lines, *keys])
                break
            axes.legend(
                handles=lines, loc="lower left", bbox_to_anchor=(0, 1), borderpad=0,
                bbox_transform=offset_copy(axes.transAxes, at.figure, y=title, units="points"),
                borderaxespad=0, labelspacing=0.3, handlelength=2.4,
            )  # fmt: skip
        if keys and at.figure:
            at.legend(keys)
        at.label_y("Attempts")
    return at.returned


def _families(conditions: Sequence[str]) -> list[tuple[str, ...]]:
    """Conditions that share a panel: the paper's in pairs, the others in fours."""
    known = [tuple(name for name in family if name in conditions) for family in _FAMILIES]
    others = [name for name in conditions if name not in PAPER_CONDITIONS]
    fours = [tuple(others[i : i + _TOGETHER]) for i in range(0, len(others), _TOGETHER)]
    return [*filter(None, known), *fours]


def _looks(families: Sequence[Sequence[str]]) -> dict[str, dict[str, Any]]:
    """How each condition's line looks; the paper's say by colour what they train."""
    looks: dict[str, dict[str, Any]] = {}
    for family in families:
        for place, condition in enumerate(family):
            look = style.current().line(place, condition)
            if condition in PAPER_CONDITIONS:
                look = {"color": style.current().trained(condition), "ls": "-"}
            width = 1.2 if place else 2.8 if len(family) > 1 else 1.6
            looks[condition] = {**look, "marker": "os^D"[place % 4], "ms": 4, "lw": width}
    return looks


def _draw_line(
    axes: Axes, rows: pd.DataFrame, look: dict[str, Any], marked: bool, aside: float
) -> None:
    """A line for each phase; points that have markers stand a little aside of one another."""
    for phase, part in rows.groupby("phase", observed=True):
        x, mean, se = (part[column].to_numpy(dtype=float) for column in ("place", "mean", "se"))
        x = x + aside
        axes.fill_between(x, mean - se, mean + se, color=look["color"], alpha=0.15, lw=0)
        if len(x) == 1:  # a band of no width
            axes.errorbar(x, mean, se, fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
        line = {**look, "marker": look["marker"] if marked or len(x) == 1 else ""}
        face = "white" if phase == "test" else look["color"]
        axes.plot(x, mean, **line, mfc=face, mew=1, zorder=3)


def _scale(axes: Axes, most: int, top: float, limit: float | None) -> None:
    """The same scale in every panel, and the limit where some trial was not solved."""
    margin = max(0.5, 0.02 * most)
    axes.set(xlim=(1 - margin, most + margin), ylim=(0, top))
    axes.xaxis.set_major_locator(MaxNLocator(7, integer=True, steps=[1, 2, 5, 10]))
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    if limit is not None:
        axes.axhline(limit, **_LIMIT, zorder=1)


def _mark_test(axes: Axes, starts: pd.Series) -> None:
    """A dashed line before the test, which begins at the same trial for most subjects."""
    if len(starts) and (start := float(starts.min()) - 0.5) > 1:
        axes.axvline(start, color=_GREY, lw=0.8, ls=(0, (4, 2)), zorder=1)
        axes.annotate(
            "test", ((start + axes.get_xlim()[1]) / 2, 1), xytext=(0, 2),
            xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", color=_GREY, fontsize="small",
        )  # fmt: skip
