"""Attempts over the course of a condition: every trial, in the order in which it was played.

Each learner has a row of panels and each family of conditions a column, so that a panel holds two
lines of the paper's conditions and not six: what is trained under common cause and under common
effect, on the way to the same test. The first line of a panel is broad and the next one narrow;
where they coincide, as at the limit, both are still seen.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
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
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.analysis.results.bounds import Bound, Bounds, bounds_in_words
from causal_openlock.experiment.protocol import PAPER_CONDITIONS

_FAMILIES = (BASELINES, TRANSFERS[:2], TRANSFERS[2:])
_COLUMNS = 4  # the most that fit the width
_POINTS = 60  # the most that a line is drawn with
_MARKERS = 18  # with more points than this lines have no markers
_HEIGHT = 1.75  # of a panel, in inches
_GREY = "#666666"


def attempts_by_trial(
    trials: pd.DataFrame,
    protocol: str,
    learners: Sequence[str] = (),
    bounds: Bounds | None = None,
) -> Plot | None:
    """Mean attempts over the course of every condition of a protocol, whichever they are.

    Learners are rows, in the given order. None if there are no trials under that protocol.
    """
    chosen = trials[trials["protocol"] == protocol]
    if chosen.empty:
        return None
    subjects = chosen.groupby([*CELL, *SUBJECT], observed=True, sort=False)
    chosen = chosen.assign(visit=subjects.cumcount() + 1)
    most = chosen.groupby("condition", observed=True)["visit"].transform("max").astype(int)
    width = -(-most // _POINTS)
    first = (chosen["visit"] - 1) // width * width + 1
    # A point of a long course stands for as many visits in a row, in its middle.
    chosen = chosen.assign(place=first + (np.minimum(width, most - first + 1) - 1) / 2)
    means = mean_by_trial(chosen, ["phase", "place"])
    unsolved = chosen.loc[~chosen["solved"], "last_attempt"]
    marked = int(means.groupby(["learner", "condition"], observed=True).size().max()) <= _MARKERS
    limit = float(unsolved.max()) if len(unsolved) else None
    ideal = {
        (condition, phase): bound
        for (condition, of, phase), bound in (bounds or {}).items()
        if of == protocol and condition in set(chosen["condition"])
    }
    highest = max((bound.attempts for bound in ideal.values()), default=0.0)
    top = 1.06 * max(float((means["mean"] + means["se"]).max()), limit or 0.0, highest)

    with style.settings():
        names = ordered(means["learner"], learners)
        families = _families(ordered(means["condition"]))
        looks = _looks(families)
        figure, panels = _grid(names, families, looks)
        for (name, family), axes in panels.items():
            rows = means[(means["learner"] == name) & means["condition"].isin(family)]
            visits = chosen[chosen["condition"].isin(family)]
            for index, condition in enumerate(family):
                aside = 0.16 * (index - (len(family) - 1) / 2)
                one = rows[rows["condition"] == condition]
                _course(axes, one, looks[condition], marked, aside)
            if rows.empty:
                axes.text(
                    0.5, 0.5, "not played", transform=axes.transAxes, ha="center", color=_GREY
                )
            _scale(axes, int(visits["visit"].max()), top, limit)
            _mark_test(axes, visits)
            _mark_ideal(axes, visits, ideal)
            if len(families) == 1 or family is families[0]:
                style.panel_title(axes, name, style.sizes(means[means["learner"] == name]))
        if ideal:
            figure.set_figheight(figure.get_figheight() + 0.25)
            style.legend(figure, [style.ideal_key()])
    facts = {
        "protocol": protocol,
        "averaged": int(width.max()),
        "limit": limit,
        "tested": set(chosen["phase"]) == {"train", "test"},
        "ideal": bounds_in_words(ideal.values()),
    }
    return Plot("attempts_by_trial", figure, facts=facts)


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
            if condition in PAPER_CONDITIONS:
                colour, dash = style.trained_colour(condition), 0
            else:
                colour, dash = style.OTHER[others % len(style.OTHER)], others // len(style.OTHER)
                others += 1
            looks[condition] = {
                "color": colour,
                "ls": ("-", (0, (4, 1.2)), (0, (1, 1.2)))[dash % 3],
                "marker": "os^D"[index % 4],
                "ms": 4,
                "lw": 1.2 if index else 2.8 if len(family) > 1 else 1.6,
            }
    return looks


def _grid(
    names: Sequence[str], families: Sequence[tuple[str, ...]], looks: dict[str, dict[str, Any]]
) -> tuple[Figure, dict[tuple[str, tuple[str, ...]], Axes]]:
    """Panels by learner and family, under a row of keys; a single family is wrapped."""
    cells = [(name, family) for name in names for family in families]
    columns = len(families)
    if columns == 1:
        rows = math.ceil(len(names) / 3)
        columns = math.ceil(len(names) / rows)
    rows = math.ceil(len(cells) / columns)
    head = 0.17 * max(map(len, families)) + 0.1
    figure = Figure(
        figsize=(style.WIDTH if columns > 1 else 0.62 * style.WIDTH, head + rows * _HEIGHT + 0.3),
        layout="constrained",
    )
    grid = figure.add_gridspec(rows + 1, columns, height_ratios=[head, *[_HEIGHT] * rows])
    for column, family in enumerate(families):
        keys = {name: looks[name] for name in family}
        _key(figure.add_subplot(grid[0, column]), keys, most=60 // max(2, columns) + 1)
    panels: dict[tuple[str, tuple[str, ...]], Axes] = {}
    for place, cell in enumerate(cells):
        row, column = divmod(place, columns)
        panels[cell] = axes = figure.add_subplot(grid[row + 1, column])
        lowest = place + columns >= len(cells)
        axes.tick_params(axis="x", length=0, labelbottom=lowest)
        axes.tick_params(axis="y", labelleft=column == 0)
        axes.set_xlabel("Trial, in order" if lowest else "")
        axes.set_ylabel("Attempts" if column == 0 else "")
    return figure, panels


def _key(axes: Axes, looks: dict[str, dict[str, Any]], most: int) -> None:
    """The lines of a column, named in at most so many letters each."""
    axes.set_axis_off()
    lines = [Line2D([], [], label=style.label(name, most), **look) for name, look in looks.items()]
    legend = axes.legend(
        handles=lines, loc="lower left", borderpad=0, borderaxespad=0, labelspacing=0.3,
        handlelength=2.4,
    )  # fmt: skip
    legend.set_in_layout(False)  # a long name must not squeeze the panels


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
        axes.axhline(limit, color=_GREY, lw=0.8, ls=(0, (1, 1.5)), zorder=1)


def _mark_test(axes: Axes, visits: pd.DataFrame) -> None:
    """A dashed line before the test, which begins at the same trial for most subjects."""
    test = visits.loc[visits["phase"] == "test", "visit"]
    if len(test) and (start := float(test.min()) - 0.5) > 1:
        axes.axvline(start, color=_GREY, lw=0.8, ls=(0, (4, 2)), zorder=1)
        axes.annotate(
            "test", ((start + axes.get_xlim()[1]) / 2, 1), xytext=(0, 2),
            xycoords=("data", "axes fraction"), textcoords="offset points",
            ha="center", color=_GREY, fontsize=7.5,
        )  # fmt: skip


def _mark_ideal(axes: Axes, visits: pd.DataFrame, ideal: dict[tuple[str, str], Bound]) -> None:
    """What the ideal observer needs, over the visits of each phase; once where it is the same."""
    spans: dict[float, list[tuple[float, float]]] = {}
    for key, own in visits.groupby(["condition", "phase"], observed=True)["visit"]:
        if key in ideal:
            span = float(own.min()) - 0.5, float(own.max()) + 0.5
            spans.setdefault(ideal[key].attempts, []).append(span)
    for attempts, stretches in spans.items():
        end = -math.inf
        for start, until in sorted(stretches):
            if until > end:
                style.ideal_line(axes, attempts, max(start, end), until)
                end = until
