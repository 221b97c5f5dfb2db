"""Attempts over the course of a condition: every trial, in the order in which it was played.

Each learner has a row of panels and each family of conditions a column, so that a panel holds two
lines of the paper's conditions and not six: what is trained under common cause and under common
effect, on the way to the same test. The first line of a panel is broad and the next one narrow;
where they coincide, as at the limit, both are still seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import FigureBase
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from causal_openlock.analysis.measures import (
    BASELINES,
    CELL,
    SUBJECT,
    TRANSFERS,
    mean_by_trial,
    ordered,
)
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import (
    Layout,
    Names,
    panels,
    set_size,
    trials_under,
)
from causal_openlock.analysis.results.bounds import Bound, bounds_of
from causal_openlock.analysis.results.material import Material
from causal_openlock.experiment.declare import PAPER_CONDITIONS

_FAMILIES = (BASELINES, TRANSFERS[:2], TRANSFERS[2:])
_COLUMNS = 4  # the most that fit the width
_POINTS = 60  # the most that a line is drawn with
_MARKERS = 18  # with more points than this lines have no markers
_HEIGHT = 1.75  # of a panel, in inches
_GREY = "#666666"
_LIMIT: Any = {"color": _GREY, "lw": 0.8, "ls": (0, (1, 1.5))}


class Course(NamedTuple):
    """Data that are drawn of a course, and the parts of its caption.

    Attributes:
        trials: The trials, with the number of the subject's ``visit`` and the ``place`` of the
            point that it belongs to.
        means: Of each point.
        averaged: The most visits in a row that are one point.
        limit: The last attempt of trials that were not solved; None if all were.
        ideal: The bounds that are known, by condition and phase.
    """

    trials: pd.DataFrame
    means: pd.DataFrame
    averaged: int
    limit: float | None
    ideal: dict[tuple[str, str], Bound]


def course_of(
    results: Material,
    protocol: str | None = None,
    learners: Names = None,
    conditions: Names = None,
) -> Course:
    """The course of every condition under a protocol; arguments as in :func:`plot_course`.

    Raises:
        NothingToDrawError: If none of the learners played one of the conditions under it.
    """
    _, shown = trials_under(results, protocol, learners, conditions)
    subjects = shown.groupby([*CELL, *SUBJECT], observed=True, sort=False)
    shown = shown.assign(visit=subjects.cumcount() + 1)
    most = shown.groupby("condition", observed=True)["visit"].transform("max").astype(int)
    width = -(-most // _POINTS)
    first = (shown["visit"] - 1) // width * width + 1
    # A point of a long course stands for as many visits in a row, in its middle.
    shown = shown.assign(place=first + (np.minimum(width, most - first + 1) - 1) / 2)
    unsolved = shown.loc[~shown["solved"], "last_attempt"]
    limit = float(unsolved.max()) if len(unsolved) else None
    ideal = bounds_of(results.bounds, shown)
    return Course(shown, mean_by_trial(shown, ["phase", "place"]), int(width.max()), limit, ideal)


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
    course = course_of(results, protocol, learners, conditions)
    means, limit = course.means, course.limit
    marked = int(means.groupby(["learner", "condition"], observed=True).size().max()) <= _MARKERS
    highest = max((bound.attempts for bound in course.ideal.values()), default=0.0)
    top = 1.06 * max(float((means["mean"] + means["se"]).max()), limit or 0.0, highest)
    names = ordered(means["learner"], results.learners)
    families = _families(ordered(means["condition"], results.conditions))
    looks = _looks(families)
    cells = [(name, family) for name in names for family in families]
    visits = {family: course.trials[course.trials["condition"].isin(family)] for family in families}
    ideal = {family: _spans(own, course.ideal) for family, own in visits.items()}
    points = dict(iter(means.groupby(["learner", "condition"], observed=True)))
    keys = [Line2D([], [], **_LIMIT, label="limit of attempts")] if limit is not None else []
    keys += [style.ideal_key()] if course.ideal else []
    with panels(ax, len(cells), _rows(cells, len(families), looks, bool(keys))) as at:
        for axes, (name, family) in zip(at.axes, cells, strict=True):
            played = {one: points[name, one] for one in family if (name, one) in points}
            for condition, rows in played.items():
                aside = 0.16 * (family.index(condition) - (len(family) - 1) / 2)
                _course(axes, rows, looks[condition], marked, aside)
            if not played:
                axes.text(
                    0.5, 0.5, "not played", transform=axes.transAxes, ha="center", color=_GREY
                )
            _scale(axes, int(visits[family]["visit"].max()), top, limit)
            _mark_test(axes, visits[family])
            for span in sorted(ideal[family]):
                style.ideal_line(axes, *span)
            if len(families) == 1 or family is families[0]:
                style.panel_title(axes, name, style.sizes(means[means["learner"] == name]))
            if at.figure is None:
                axes.set(xlabel="Trial, in order", ylabel="Attempts")
                if name == names[0]:
                    shared = keys if family is families[0] else []
                    axes.legend(handles=_lines(family, looks, 24) + shared, fontsize="small")
        if keys and at.figure is not None:
            at.legend(keys)
    return at.returned


def _families(conditions: Sequence[str]) -> list[tuple[str, ...]]:
    """Conditions that share a panel: the paper's in pairs, the others as room allows."""
    known = [tuple(name for name in family if name in conditions) for family in _FAMILIES]
    families = list(filter(None, known))
    others = [name for name in conditions if name not in PAPER_CONDITIONS]
    share = math.ceil(len(others) / (_COLUMNS - len(families))) or 1
    return families + [tuple(others[i : i + share]) for i in range(0, len(others), share)]


def _looks(families: Sequence[Sequence[str]]) -> dict[str, dict[str, Any]]:
    """How each condition's line looks; the paper's say by colour what they train."""
    looks: dict[str, dict[str, Any]] = {}
    others = 0
    for family in families:
        for index, condition in enumerate(family):
            known = condition in PAPER_CONDITIONS
            line = style.current().line(others)
            if known:
                line = {"color": style.current().trained(condition), "ls": "-"}
            looks[condition] = {
                **line,
                "marker": "os^D"[index % 4],
                "ms": 4,
                "lw": 1.2 if index else 2.8 if len(family) > 1 else 1.6,
            }
            others += not known
    return looks


def _lines(family: Sequence[str], looks: dict[str, dict[str, Any]], most: int) -> list[Any]:
    """Entries of a legend, named in at most ``most`` letters each."""
    return [Line2D([], [], label=style.label(name, most), **looks[name]) for name in family]


def _rows(
    cells: Sequence[tuple[str, tuple[str, ...]]],
    columns: int,
    looks: dict[str, dict[str, Any]],
    keyed: bool,
) -> Layout:
    """Panels by learner and family, under a row of keys; a single family is wrapped."""
    families = [family for _, family in cells[:columns]]
    if columns == 1:
        rows = math.ceil(len(cells) / 3)
        columns = math.ceil(len(cells) / rows)
    rows = math.ceil(len(cells) / columns)
    head = 0.17 * max(map(len, families)) + 0.1

    def lay_out(figure: FigureBase) -> list[Axes]:
        height = head + rows * _HEIGHT + 0.3 + 0.25 * keyed
        set_size(figure, style.WIDTH if columns > 1 else 0.62 * style.WIDTH, height)
        grid = figure.add_gridspec(rows + 1, columns, height_ratios=[head, *[_HEIGHT] * rows])
        for column, family in enumerate(families):
            key = figure.add_subplot(grid[0, column])
            key.set_axis_off()
            legend = key.legend(
                handles=_lines(family, looks, 60 // max(2, columns) + 1), loc="lower left",
                borderpad=0, borderaxespad=0, labelspacing=0.3, handlelength=2.4,
            )  # fmt: skip
            legend.set_in_layout(False)  # a long name must not squeeze the panels
        axes = []
        for place in range(len(cells)):
            row, column = divmod(place, columns)
            axes.append(figure.add_subplot(grid[row + 1, column]))
            lowest = place + columns >= len(cells)
            axes[-1].tick_params(axis="x", length=0)
            axes[-1].xaxis.set_visible(lowest)  # nothing of the others is seen
            axes[-1].tick_params(axis="y", labelleft=column == 0)
            axes[-1].set_xlabel("Trial, in order")
            axes[-1].set_ylabel("Attempts" if column == 0 else "")
        return axes

    return lay_out


def _course(
    axes: Axes, rows: pd.DataFrame, look: dict[str, Any], marked: bool, aside: float
) -> None:
    """A line for each phase; points that have markers stand a little aside of one another."""
    for phase, part in rows.groupby("phase", observed=True):
        x, mean, se = (part[column].to_numpy(dtype=float) for column in ("place", "mean", "se"))
        face = "white" if phase == "test" else look["color"]
        x = x + aside * marked
        axes.fill_between(x, mean - se, mean + se, color=look["color"], alpha=0.15, lw=0)
        if len(x) == 1:  # a band of no width
            axes.errorbar(x, mean, se, fmt="none", ecolor=look["color"], elinewidth=1, capsize=2)
        line = {**look, "marker": look["marker"] if marked or len(x) == 1 else ""}
        axes.plot(x, mean, **line, mfc=face, mew=1, zorder=3)


def _scale(axes: Axes, most: int, top: float, limit: float | None) -> None:
    """The same scale in every panel, and the limit where some trial was not solved."""
    beside = max(0.5, 0.02 * most)
    axes.set_xlim(1 - beside, most + beside)
    axes.xaxis.set_major_locator(MaxNLocator(7, integer=True, steps=[1, 2, 5, 10]))
    axes.set_ylim(0, top)
    axes.yaxis.set_major_locator(MaxNLocator(5, integer=True, steps=[1, 2, 5, 10]))
    if limit is not None:
        axes.axhline(limit, **_LIMIT, zorder=1)


def _mark_test(axes: Axes, visits: pd.DataFrame) -> None:
    """A dashed line before the test, which begins at the same trial for most subjects."""
    test = visits.loc[visits["phase"] == "test", "visit"]
    if len(test) and (start := float(test.min()) - 0.5) > 1:
        axes.axvline(start, color=_GREY, lw=0.8, ls=(0, (4, 2)), zorder=1)
        axes.annotate(
            "test", ((start + axes.get_xlim()[1]) / 2, 1), xytext=(0, 2),
            xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", color=_GREY, fontsize="small",
        )  # fmt: skip


def _spans(
    visits: pd.DataFrame, ideal: dict[tuple[str, str], Bound]
) -> set[tuple[float, float, float]]:
    """Attempts of the ideal observer in each condition and phase, from where to where."""
    phases = visits.groupby(["condition", "phase"], observed=True)["visit"]
    return {
        (ideal[key].attempts, float(played.min()) - 0.5, float(played.max()) + 0.5)
        for key, played in phases
        if key in ideal
    }
