"""Learners, or results, against one another: a matrix of probabilities, and rows of differences."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator, PercentFormatter

from causal_openlock.analysis.measures import BASELINES, ordered
from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Names, Panels, in_rows, panels, trials_under
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.pairwise import outcomes, pairwise_table
from causal_openlock.analysis.results.scores import (
    CONGRUENCY,
    MODEL,
    PEOPLE,
    SAVINGS,
    SCORE_COLUMNS,
    scores_of,
)
from causal_openlock.errors import NothingToDrawError

CONGRUENCY_TESTS = {"CC3-CC4": "Test of CC4", "CE3-CE4": "Test of CE4"}
MOST_DRAWN = 60
"""Differences between two results that are drawn: the first ones."""

_PAIRS = "P(row needs fewer attempts than column)"
_COLOURS = LinearSegmentedColormap.from_list("worse_better", ["#8C510A", "#F7F7F7", "#01665E"])
_ROW = 0.21  # height of a learner's row, in inches


def plot_pairs(
    results: Material,
    *,
    learners: Names = None,
    conditions: Names = None,
    protocol: str | None = None,
    ax: Any = None,
) -> Axes:
    """How probable it is that one learner is better than another, as numbers on colours.

    A number is the probability that a subject of the learner in the row needs fewer attempts than
    the subject of the same number, in the same room, of the learner in the column, in the mean over
    the conditions that both played; ties count half. The learners stand in the order of their mean
    attempts, the best first, and each pair is there once.

    >>> import causal_openlock as ol
    >>> [text.get_text() for text in ol.plot_pairs(results).get_yticklabels()]
    ['oracle', 'random']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    protocol, trials = trials_under(results, protocol, learners, conditions)
    held = outcomes(trials, protocol)
    table = pairwise_table(held)
    if table.empty:
        raise NothingToDrawError(
            f"no two such learners played a condition in common under the protocol {protocol}"
        )
    means = {
        name: np.mean([one["attempts"].mean() for one in held[name].values()])
        for name in ordered(set(table["learner"]) | set(table["other"]), list(held))
    }
    names = sorted(means, key=means.__getitem__)
    size = len(names)
    place = {name: number for number, name in enumerate(names)}
    rows, columns = table["learner"].map(place), table["other"].map(place)
    values = np.full((size, size), np.nan)
    values[np.minimum(rows, columns), np.maximum(rows, columns)] = np.where(
        rows < columns, table["probability"], 1 - table["probability"]
    )
    shown = [style.label(name, 22) for name in names]
    counts = sorted(set(table["conditions"]))
    note = (
        f"mean over {' to '.join(map(str, counts[:: max(1, len(counts) - 1)]))} "
        f"condition{'s' * (counts != [1])}; ties count half"
    )
    edge = 0.25 + 0.07 * max(map(len, shown))  # names along the left and, slanted, along the top
    cell = min(0.55, (style.WIDTH - edge - 0.5 * edge) / size)

    def lay_out(figure: Figure) -> list[Axes]:
        figure.set_layout_engine("constrained")
        figure.set_size_inches(max(3.5, 1.5 * edge + cell * size), 0.75 + 0.7 * edge + cell * size)
        figure.suptitle(_PAIRS, x=0.01, ha="left", weight="bold", size="medium")
        figure.supxlabel(note, x=0.01, ha="left", size="medium")
        return [figure.subplots()]

    with panels(ax, 1, lay_out) as drawn:
        (axes,) = drawn.axes
        if drawn.figure is None:
            axes.set_title(_PAIRS, fontsize="medium")
            axes.set_xlabel(note, fontsize="small")
        axes.imshow(values, cmap=_COLOURS, vmin=0, vmax=1)
        for (row, column), value in np.ndenumerate(values):
            if row < column:
                known = not np.isnan(value)
                axes.text(
                    column, row, f"{value:.2f}" if known else "–", ha="center", va="center",
                    fontsize="medium" if cell > 0.45 else "small",
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
    return axes


def plot_congruency(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """What training with the structure of the test saves in the transfer test.

    A panel for each test, a row for each learner, with 95% intervals; people and the published
    model come first, where learners did what people did.

    >>> import causal_openlock as ol
    >>> [axes.get_title(loc="left") for axes in ol.plot_congruency(results)]
    ['Test of CC4', 'Test of CE4']

    The protocol is by default ``human``, or else the first by alphabet. The other arguments, what
    is returned and errors are those of
    :func:`~causal_openlock.analysis.plots.attempts.plot_attempts`.
    """
    names, scores = _scores(results, CONGRUENCY, learners, protocol)
    with panels(ax, 2, _rows_of(names)) as at:
        _name_rows(at, names)
        for (condition, title), axes in zip(CONGRUENCY_TESTS.items(), at.axes, strict=True):
            rows = scores[scores["condition"] == condition]
            _dots(axes, rows, names, (style.current().trained(condition), "o"))
            style.panel_title(axes, title)
            axes.set_xlabel("Attempts, congruent − incongruent training")
            axes.xaxis.set_major_locator(MaxNLocator(5, steps=[1, 2, 5, 10]))
        _same_scale(at)
    return at.returned


def plot_savings(
    results: Material, *, learners: Names = None, protocol: str | None = None, ax: Any = None
) -> Any:
    """The share of attempts that training saves in the first room with four levers.

    >>> import causal_openlock as ol
    >>> [axes.get_title(loc="left") for axes in ol.plot_savings(results)]
    ['Test of CC4', 'Test of CE4']

    Arguments, what is returned and errors are those of :func:`plot_congruency`.
    """
    names, scores = _scores(results, SAVINGS, learners, protocol)
    own = style.current()
    looks = {"CC3": (own.common_cause, "o"), "CE3": (own.common_effect, "s")}
    with panels(ax, 2, _rows_of(names)) as at:
        _name_rows(at, names)
        for tested, axes in zip(BASELINES, at.axes, strict=True):
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
        at.legend(keys)
        _same_scale(at)
    return at.returned


def _scores(
    results: Material, kind: str, learners: Names, protocol: str | None
) -> tuple[list[str], pd.DataFrame]:
    """Names in their order, people and the published model first, and their scores."""
    protocol, trials = trials_under(results, protocol, learners)
    scores = scores_of(replace(results, trials=trials)).get(
        protocol, pd.DataFrame(columns=SCORE_COLUMNS)
    )
    scores = scores[scores["score"] == kind]
    if scores["learner"].isin([PEOPLE, MODEL]).all():
        raise NothingToDrawError(
            f"no such learner played conditions whose {kind} can be scored under the protocol "
            f"{protocol}: the paper's transfer conditions"
            + (", and the baselines" if kind == SAVINGS else "")
        )
    return list(dict.fromkeys(scores["learner"])), scores


def _rows_of(names: Sequence[str]) -> Any:
    """Two panels with a row for each learner."""

    def lay_out(figure: Figure) -> list[Axes]:
        figure.set_layout_engine("constrained")
        figure.set_size_inches(style.WIDTH, 1.15 + _ROW * len(names))
        return list(figure.subplots(1, 2, sharey=True, sharex=True))

    return lay_out


def _name_rows(at: Panels, names: Sequence[str]) -> None:
    """Name the rows, the first at the top, and mark zero."""
    for axes in at.axes:
        axes.grid(axis="x")
        axes.axvline(0, color="#333333", lw=0.9, zorder=1)
        axes.set_yticks(range(len(names)), [style.label(name, 28) for name in names])
        axes.set_ylim(len(names) - 0.4, -0.6)
        axes.tick_params(axis="y", length=0)


def _same_scale(at: Panels) -> None:
    """Give the panels the same x axis, also those that were given."""
    ends = np.array([axes.get_xlim() for axes in at.axes])
    for axes in at.axes:
        axes.set_xlim(ends[:, 0].min(), ends[:, 1].max())


def _dots(
    axes: Axes, rows: pd.DataFrame, names: list[str], look: tuple[str, str], aside: float = 0.0
) -> None:
    """The score of each learner with its interval, in a colour and with a marker."""
    colour, marker = look
    y = np.array([names.index(name) + aside for name in rows["learner"]])
    ends = rows["ci_low"], rows["ci_high"]
    axes.hlines(y, *ends, color=colour, lw=1.6, zorder=2, capstyle="projecting")
    axes.plot(rows["value"], y, marker, color=colour, ms=5, mec="black", mew=0.5, zorder=3)


def plot_differences(table: pd.DataFrame, names: Sequence[str], ax: Any = None) -> Axes:
    """Differences between two results with their intervals, a line each.

    The table has ``learner``, ``condition``, ``difference``, ``ci_low``, ``ci_high`` and whether a
    difference is ``sure``; names are those of the two results.
    """
    rows: list[Mapping[Any, Any]] = table.head(MOST_DRAWN).to_dict("records")
    with panels(ax, 1, in_rows(1, 1, 0.19 * len(rows) + 0.5, style.WIDTH / 0.62)) as at:
        (axes,) = at.axes
        for place, row in enumerate(rows):
            colour = style.current().other(2) if row["sure"] else "#666666"
            axes.plot([row["ci_low"], row["ci_high"]], [place] * 2, color=colour, lw=1.6)
            face = colour if row["sure"] else "white"
            axes.plot(row["difference"], place, "o", color=colour, mfc=face, ms=4.5, zorder=3)
        labels = [
            f"{style.label(row['learner'], 24)}  {style.label(row['condition'], 24)}"
            for row in rows
        ]
        axes.set_yticks(range(len(rows)), labels, fontsize="small")
        axes.set_ylim(len(rows) - 0.4, -0.6)
        axes.axvline(0, color="black", lw=0.8, zorder=1)
        most = max([1.0, *(abs(x) for x in axes.get_xlim())])
        axes.set_xlim(-most, most)
        axes.grid(True, axis="x")
        axes.grid(False, axis="y")
        first, second = (style.label(name, 24) for name in names)
        axes.set_xlabel(f"Attempts, {second} less {first}")
    return axes
