"""Tables of a study as figures, in which every unit can be seen.

A study names under ``figures`` which of its tables are drawn. Where the columns are the parts of a
course a panel has a thin line for each unit and a thick one for their mean, and of a curve a dashed
one for what AAAI 2020 published of the same algorithm; otherwise a panel for each column has a dot
for each unit of a row, and their mean with its interval. Of distances from people the figure has
people's means and the nearest learner's, and of a recovery which learners are taken for which.
A figure is in the study's folder, next to its data, and holds a mark of the data and of
the drawing: so a figure of other units, or one that was changed, is found without drawing it again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd

from causal_openlock.analysis.measures import SOLUTIONS
from causal_openlock.errors import EvidenceError
from causal_openlock.evidence.confusions import subjects_of
from causal_openlock.evidence.derived import beside_people
from causal_openlock.evidence.measured import Evidence
from causal_openlock.evidence.study import (
    ATTEMPTS,
    BLOCK,
    NO_SHARES,
    OF_ALL,
    PUBLISHED,
    RL_2020,
    SAVED,
    Selection,
    Table,
)
from causal_openlock.evidence.study_files import UNITS
from causal_openlock.evidence.units import selected
from causal_openlock.evidence.verdicts import mean_of
from causal_openlock.files.digest import digest
from causal_openlock.paper.likeness import PUBLISHED_MODEL

if TYPE_CHECKING:
    from matplotlib.axes import Axes

FORM = 1
"""Version of the drawings; raising it makes all figures again."""

_NOT_DRAWN = {"trained_before"}
"""Columns of a table that its figure lacks."""

_MARK = "\n<!-- made from "
_PART = re.compile(r"part (\d+)$")
_UNIT, _PUBLISHED = "#1F6F9F", "#777777"
_DASHES = (0, (4, 2))


def figure_path(evidence: Evidence, name: str) -> Path:
    """Path of the figure of a table."""
    return evidence.study.folder / f"{name}.svg"


def is_current(evidence: Evidence, name: str) -> bool:
    """Whether the figure of a table is there, as drawn, of what is stored and declared now."""
    path = figure_path(evidence, name)
    text = path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""
    return text == _marked(text.rpartition(_MARK)[0], evidence, name)


def _marked(svg: str, evidence: Evidence, name: str) -> str:
    """A drawing with the mark of what it was made from, and of itself."""
    file = evidence.study.file
    what = file.derived if name == OF_ALL else file.tables[name].model_dump(exclude=_NOT_DRAWN)
    fitted = [file.fitted] if name == OF_ALL and file.fitted else []
    made_of = json.dumps([FORM, evidence.run["files"][UNITS], what, *fitted, svg])  # rows in order
    return f"{svg}{_MARK}{digest(made_of)} -->\n"


def drawn(evidence: Evidence, name: str) -> str:
    """The figure of a table as SVG, with its mark."""
    from matplotlib.figure import Figure

    from causal_openlock.analysis.plots import style
    from causal_openlock.design.figure import draw_confusion
    from causal_openlock.design.telling import by_size

    figure = Figure()
    if name == OF_ALL and evidence.study.file.derived == "confusion":
        figure = draw_confusion(by_size(subjects_of(evidence.own_units), evidence.run["seed"]))
    elif name == OF_ALL:
        draw_distances(evidence, figure)
    else:
        table = evidence.study.file.tables[name]
        draw = draw_course if all(map(_PART.search, table.columns)) else draw_dots
        draw(evidence, table, figure)
    return _marked(style.image(figure, "svg").decode().rstrip(), evidence, name)


def _units(evidence: Evidence, table: Table, row: str, column: str) -> pd.Series[float] | None:
    """The units of a cell of the table, if there are any."""
    chosen = Selection.parse([*row.split(), *column.split()])
    try:
        return selected(evidence.units, chosen, table.measure)
    except EvidenceError:
        return None


def _rows(evidence: Evidence, table: Table) -> list[str]:
    """The rows that hold something."""
    return [
        row
        for row in table.rows
        if any(_units(evidence, table, row, column) is not None for column in table.columns)
    ]


def _name(row: str) -> str:
    return row.replace("_", " ")


# -- dots ----------------------------------------------------------------------------------------


def draw_dots(evidence: Evidence, table: Table, figure: Any) -> None:
    """A panel for each column, with a line of dots for each row."""
    from causal_openlock.analysis.plots.panels import in_rows, panels

    rows = _rows(evidence, table)
    own = [row for row in rows if row not in PUBLISHED]
    across, count = 3 if len(table.columns) > 2 else 2, len(table.columns)
    with panels(figure, count, in_rows(count, across, 0.2 * len(own) + 0.7)) as at:
        for axes, column in zip(at.axes, table.columns, strict=True):
            axes.set_title(column, loc="left", pad=13)
            axes.set_yticks(range(len(own)), [_name(row) for row in own])
            axes.set_ylim(len(own) - 0.4, -0.6)
            axes.grid(False, axis="y")
            axes.grid(True, axis="x")
            for place, row in enumerate(own):
                if (found := _units(evidence, table, row, column)) is not None:
                    _dots_of_row(axes, place, found)
            for row in (row for row in rows if row in PUBLISHED):
                if (found := _units(evidence, table, row, column)) is not None:
                    axes.axvline(float(found.mean()), color=_PUBLISHED, lw=1, ls=_DASHES)
                    axes.annotate(
                        _name(row), (float(found.mean()), 1), xytext=(2, 1),
                        xycoords=("data", "axes fraction"), textcoords="offset points",
                        color=_PUBLISHED, fontsize="small", ha="left", va="bottom",
                    )  # fmt: skip
            axes.set_xlim(*_limits(evidence, table))
        for axes in at.axes:
            where = axes.get_subplotspec()
            if where and where.is_last_row():
                axes.set_xlabel(_measure(table))


def _dots_of_row(axes: Axes, place: int, found: pd.Series[float]) -> None:
    # Side by side in the order of their numbers, so that equal values do not hide each other.
    spread = np.linspace(-0.22, 0.22, len(found)) if len(found) > 1 else [0.0]
    axes.plot(found, place + np.asarray(spread), ls="", marker="o", ms=2.6, mew=0,
              color=_UNIT, alpha=0.55)  # fmt: skip
    mean = mean_of(found.to_numpy(float))
    low, high = mean.interval
    if np.isfinite(low):
        axes.plot([low, high], [place, place], color="black", lw=1.4, solid_capstyle="butt")
    axes.plot(mean.value, place, marker="D", ms=4, mfc="black", mec="white", mew=0.5)


# -- courses -------------------------------------------------------------------------------------


def draw_course(evidence: Evidence, table: Table, figure: Any) -> None:
    """A panel for each learner, with the course of each unit."""
    from matplotlib.lines import Line2D

    from causal_openlock.analysis.plots import style
    from causal_openlock.analysis.plots.panels import in_rows, panels

    rows = _rows(evidence, table)
    names = list(dict.fromkeys(_panel(row) for row in rows))
    colours = _colours(row.split()[1] for row in rows)
    by_fifties = evidence.study.file.measured == "curve"
    with panels(figure, len(names), in_rows(len(names), 4, 1.75)) as at:
        for axes, name in zip(at.axes, names, strict=True):
            style.panel_title(axes, _name(name))
            for row in (row for row in rows if _panel(row) == name):
                parts = list(_parts(evidence, table, row))
                x = [BLOCK * (part - 0.5) if by_fifties else part for part, _ in parts]
                _lines_of_row(axes, x, [found for _, found in parts], row, colours)
            if not by_fifties:
                axes.set_xticks([float(_part(column)) for column in table.columns])
            if all(row.split()[0] in PUBLISHED for row in rows if _panel(row) == name):
                axes.text(0.5, 0.5, "not run", ha="center", color=_PUBLISHED,
                          transform=axes.transAxes)  # fmt: skip
            axes.set_xlabel("trial" if by_fifties else "part of the training")
            low, high = _limits(evidence, table)
            if by_fifties and table.measure in ATTEMPTS:  # a few, or all that there are
                axes.set(yscale="log", ylim=(2.0, 1.2 * high))
            else:
                axes.set_ylim(low, high)
        at.label_y(_measure(table))
        keys = [Line2D([], [], color=colour, lw=2, label=one) for one, colour in colours.items()]
        if any(row.split()[0] in RL_2020 for row in rows):
            keys.append(Line2D([], [], color=_PUBLISHED, lw=1.2, ls=_DASHES, label="published"))
        at.legend(keys)


def _panel(row: str) -> str:
    """The panel of a row: a published curve is in that of its algorithm."""
    name = row.split()[0]
    return name.removeprefix("paper_") if name in RL_2020 else name


def _colours(conditions: Iterable[str]) -> dict[str, str]:
    from causal_openlock.analysis.plots import style

    each, now = list(dict.fromkeys(conditions)), style.current()
    own = [now.trained(one) for one in each]
    if len(set(own)) < len(own):
        own = [now.other(number) for number in range(len(each))]
    return dict(zip(each, own, strict=True))


def _part(column: str) -> int:
    found = _PART.search(column)
    assert found
    return int(found[1])


def _parts(evidence: Evidence, table: Table, row: str) -> Iterator[tuple[int, pd.Series[float]]]:
    for column in table.columns:
        if (found := _units(evidence, table, row, column)) is not None:
            yield _part(column), found


def _lines_of_row(
    axes: Axes, x: list[float], parts: list[pd.Series[float]], row: str, colours: Mapping[str, str]
) -> None:
    learner, condition = row.split()[:2]
    means, colour = [found.mean() for found in parts], colours[condition]
    if learner in RL_2020:
        axes.plot(x, means, color=colour, lw=1.2, ls=_DASHES, marker="s", ms=2.5)
        return
    if learner not in PUBLISHED:
        for _, course in pd.concat(parts, axis=1, join="inner").iterrows():
            axes.plot(x, course, color=colour, lw=0.6, alpha=0.45)
    axes.plot(x, means, color=colour, lw=2, marker="o", ms=3)


# -- distances from people -----------------------------------------------------------------------


def draw_distances(evidence: Evidence, figure: Any) -> None:
    """People's means, and those of the learner nearest to them and of the published model."""
    from causal_openlock.paper.likeness_figure import draw_points

    _, like = beside_people(evidence.study, evidence.own_units)
    nearest = next(name for name in like.points if name != PUBLISHED_MODEL)
    points = {name: like.points[name] for name in (nearest, PUBLISHED_MODEL)}
    draw_points(points, like.effects, figure, evidence.study.file.fitted)


# -- both ----------------------------------------------------------------------------------------


def _limits(evidence: Evidence, table: Table) -> tuple[float, float]:
    """Limits of all panels: 0 to 1 for shares, otherwise all that units have, and 0."""
    if table.measure not in NO_SHARES:
        return -0.03, 1.03
    cells = [_units(evidence, table, row, c) for row in table.rows for c in table.columns]
    values = np.concatenate([cell for cell in cells if cell is not None])
    return 1.05 * min(0.0, float(values.min())), 1.05 * float(values.max())


def _measure(table: Table) -> str:
    return {
        "attempts": "attempts",
        "first_solution": "attempts to the first solution",
        **{name: f"attempts for the {name} solution" for name in SOLUTIONS},
        SAVED: "attempts saved after the first solution",
        "solved": "share of trials solved",
        "finds_all": "share of visits",
        "found": "share of solutions",
        "opens": "share of attempts",
        "unlocks": "share of attempts",
        "else": "share of attempts",
        "information": "bits",
        "per_minute": "bits a minute",
        "minutes": "minutes",
        "certain": "share of subjects",
        "unlike": "share of subjects",
        "single": "share attributed right",
        "groups": "share attributed right",
        "halves": "share attributed right",
    }[table.measure]
