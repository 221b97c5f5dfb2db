"""Tables of a study as figures, in which every unit can be seen.

Where the columns are the parts of a course a panel has a thin line for each unit and a thick one
for their mean; otherwise a panel for each column has a dot for each unit of a row, and their mean
with its interval. Of distances from people the figure has people's means and the nearest learner's,
and of theories which are taken for which.
"""

from __future__ import annotations

import io

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from PIL import Image

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import in_rows, panels
from causal_openlock.design.figure import draw_confusion
from causal_openlock.paper.likeness import PUBLISHED_MODEL
from causal_openlock.paper.likeness_section import draw_points
from evidence.measured import Evidence, beside_people
from evidence.published import BLOCK, PUBLISHED, RL_2020
from evidence.run import read_units
from evidence.study import ATTEMPTS, DERIVED, NO_SHARES, Table
from evidence.theories import sizes_of
from evidence.verdicts import mean_of

DOTS, COLOURS = 110, 64
"""Dots per inch of a figure, and its colours: enough to read, and at most 50 KB."""
BLUE, GREY, DASHES = "#1F6F9F", "#777777", (0, (4, 2))

Rows = dict[str, pd.DataFrame]
"""Units of each row of a table, by column."""


def drawn(evidence: Evidence, name: str) -> bytes:
    """The figure of a table, as PNG."""
    figure, study, file = Figure(), evidence.study, evidence.study.file
    if name == DERIVED and file.derived == "confusion":
        figure = draw_confusion(sizes_of(study, read_units(study)))
    elif name == DERIVED:
        _, like = beside_people(study, read_units(study))
        nearest = next(name for name in like.points if name != PUBLISHED_MODEL)
        points = {name: like.points[name] for name in (nearest, PUBLISHED_MODEL)}
        draw_points(points, like.effects, figure, file.fitted)
    else:
        table = file.tables[name]
        rows = evidence.rows(table)
        if all(column.startswith("part ") for column in table.columns):
            draw_course(table, rows, file.measured == "curve", figure)
        else:
            draw_dots(table, rows, figure)
    smaller = io.BytesIO()
    with Image.open(io.BytesIO(style.image(figure, "png", DOTS))) as image:
        # A median cut, the default, would give thin lines of several colours one between them.
        few = image.convert("RGB").quantize(COLOURS, Image.Quantize.FASTOCTREE)
        few.save(smaller, "png", optimize=True)
    return smaller.getvalue()


def draw_dots(table: Table, rows: Rows, figure: Figure) -> None:
    """A panel for each column, with a line of dots for each row."""
    learners = [row for row in rows if row not in PUBLISHED]
    count = len(table.columns)
    with panels(figure, count, in_rows(count, min(count, 3), 0.2 * len(learners) + 0.7)) as at:
        for axes, column in zip(at.axes, table.columns, strict=True):
            axes.set_title(column, loc="left", pad=13)
            axes.set_yticks(range(len(learners)), [_words(row) for row in learners])
            axes.set_ylim(len(learners) - 0.4, -0.6)
            axes.grid(False, axis="y")
            axes.grid(True, axis="x")
            axes.set_xlim(*_limits(table, rows))
            axes.set_xlabel(_measure(table))
            for row, units in rows.items():
                if column in units and row in learners:
                    _draw_row(axes, learners.index(row), units[column].dropna())
                elif column in units:
                    mean = units[column].mean()
                    axes.axvline(mean, color=GREY, lw=1, ls=DASHES, label=_words(row))
        if handles := at.axes[0].get_legend_handles_labels()[0]:
            at.legend(handles)


def _draw_row(axes: Axes, place: int, units: pd.Series) -> None:
    # Side by side in the order of their numbers, so that equal values do not hide each other.
    spread = np.linspace(-0.22, 0.22, len(units)) if len(units) > 1 else np.zeros(1)
    axes.plot(units, place + spread, ls="", marker="o", ms=2.6, mew=0, color=BLUE, alpha=0.55)
    mean = mean_of(units.to_numpy(float))
    axes.plot(mean.interval, [place, place], color="black", lw=1.4, solid_capstyle="butt")
    axes.plot(mean.value, place, marker="D", ms=4, mfc="black", mec="white", mew=0.5)


def draw_course(table: Table, rows: Rows, by_fifties: bool, figure: Figure) -> None:
    """A panel for each learner, with the course of each unit by condition.

    A published curve is in the panel of its algorithm, and a curve has its parts by trials.
    """
    algorithms = {name: algorithm.lower() for algorithm, name in RL_2020.items()}
    names = {row: algorithms.get(row.split()[0], row.split()[0]) for row in rows}
    conditions = [*dict.fromkeys(row.split()[1] for row in rows)]
    colours = {one: style.current().trained(one) for one in conditions}
    if len({*colours.values()}) < len(colours):
        colours = {one: style.current().other(number) for number, one in enumerate(conditions)}
    low, high = _limits(table, rows)
    learners = [*dict.fromkeys(names.values())]
    with panels(figure, len(learners), in_rows(len(learners), 4, 1.75)) as at:
        for axes, name in zip(at.axes, learners, strict=True):
            style.panel_title(axes, _words(name))
            axes.set_xlabel("trial" if by_fifties else "part of the training")
        for row, units in rows.items():
            axes = at.axes[learners.index(names[row])]
            learner, condition = row.split()[:2]
            parts = [int(column.split()[1]) for column in units]
            x = [BLOCK * (part - 0.5) if by_fifties else part for part in parts]
            if learner in algorithms:
                axes.plot(
                    x, units.mean(), lw=1.2, marker="s", ms=3, ls=DASHES, color=colours[condition]
                )
            else:
                axes.plot(x, units.dropna().T, lw=0.6, alpha=0.45, color=colours[condition])
                axes.plot(x, units.mean(), lw=2, marker="o", ms=3, color=colours[condition])
        if by_fifties and table.measure in ATTEMPTS:  # a few, or all that there are
            at.axes[0].set(yscale="log", ylim=(2.0, 1.2 * high))
        else:
            at.axes[0].set_ylim(low, high)
        at.label_y(_measure(table))
        keys = [Line2D([], [], color=colour, lw=2, label=one) for one, colour in colours.items()]
        if by_fifties:
            keys.append(Line2D([], [], color=GREY, lw=1.2, ls=DASHES, label="published"))
        at.legend(keys)


def _limits(table: Table, rows: Rows) -> tuple[float, float]:
    """Limits of all panels: 0 to 1 for shares, otherwise all that units have, and 0."""
    if table.measure not in NO_SHARES:
        return -0.03, 1.03
    every = pd.concat(rows.values()).to_numpy(float)
    return 1.05 * min(0.0, np.nanmin(every)), 1.05 * np.nanmax(every)


def _measure(table: Table) -> str:
    return _words(table.measure) + ("" if table.measure in NO_SHARES else " (share)")


def _words(name: str) -> str:
    return name.replace("_", " ")
