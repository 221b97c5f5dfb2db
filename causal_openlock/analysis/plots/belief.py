"""The picture of one trial of belief: what was done, what it revealed, what it left probable.

Four panels share their columns, one for each action; under them the structure that is most
probable in the end is next to the true one. Everything is placed by the inch, so that nothing
depends on how long names are or how many arrows there were.
"""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure, FigureBase
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import Layout, panels
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.traces import replayed
from causal_openlock.belief.trace import Moment, Trace, agreement, percent, shown_name
from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import known_arguments
from causal_openlock.render.arrange import arrange
from causal_openlock.render.graph import draw_schema
from causal_openlock.render.suffixes import path_of_picture
from causal_openlock.schemas.schema import Schema

MOST_ACTIONS, MOST_ARROWS = 36, 20
THRESHOLD = 0.1
"""Arrows that are not true and were never more probable than this are not shown."""

# All in inches: lines of the title, margins beside the columns, and the narrowest column.
_LINE, _LEFT, _RIGHT, _NARROWEST = 0.16, 1.75, 0.62, 0.125
_UNIT, _GRAPH_HEIGHT = 0.46, 3.0  # of graphs: inches of a unit, and of the highest
_SMALL = 7.0  # size of small type
_INK, _FAINT = "#222222", "#9A9A9A"
_RENEWED: Any = {"color": _FAINT, "lw": 1.0, "ls": (0, (1.5, 1.5))}


def plot_beliefs(
    results: Material,
    subject: int | None = None,
    *,
    learner: str | None = None,
    condition: str | None = None,
    trial: int = 1,
    ax: Any = None,
) -> Any:
    """Draw the beliefs of one subject in one trial, action by action.

    Beliefs are not on record: the subject plays up to the trial once more.

    >>> len(plot_beliefs(believed, learner="bayes", condition="CC3", trial=2))
    6

    Args:
        results: What was played.
        subject: Number of the subject; by default the first.
        learner: Label of the learner; by default the first that holds beliefs.
        condition: By default the first that the learner played.
        trial: Number of the trial among those that it played, from 1.
        ax: Six axes, or an empty figure; by default a new figure of pyplot.

    Returns:
        ``[6]`` the axes: what was done, the bits missing to certainty, the bits that each action
        gave, the probability of each arrow, the structure that is most probable in the end, and the
        true one.

    Raises:
        NothingToDrawError: If no learner holds beliefs, or the results are of another version or
            other rooms.
        OpenLockError: If there is no such subject, learner, condition or trial, or ``ax`` does not
            fit.
    """
    return plot_trace(replayed(results, subject, learner, condition, trial), ax=ax)


@known_arguments
def plot_trace(
    trace: Trace, *, actions: int = MOST_ACTIONS, arrows: int = MOST_ARROWS, ax: Any = None
) -> Any:
    """The same of a trace, such as :func:`causal_openlock.belief.trace.trace_trial` gives.

    Args:
        trace: What happened.
        actions: Most actions to show; of a longer trial the first attempts are shown that fit.
        arrows: Most arrows to show, those that were ever most probable.
        ax: As in :func:`plot_beliefs`, as what is returned.
    """
    if not isinstance(trace, Trace):
        raise OpenLockError(
            f"plot_trace draws a trace, which trace_trial returns, and not {type(trace).__name__}"
        )
    shown = Part.of(trace, actions, arrows)
    structures, names = _structures(trace), list(map(shown_name, shown.actions))
    height = _graph_height([schema for schema, _ in structures])
    heading = (
        f"{trace.learner} in {trace.condition}, trial {trace.trial} of {trace.trials} "
        f"(subject {trace.subject}, protocol {trace.protocol.name})"
    )
    with panels(ax, 6, _layout(shown, height, heading, names)) as at:
        timeline, entropy, gains, matrix, *graphs = at.axes
        for axes in at.axes[:4]:
            axes.set_xlim(-0.5, len(shown.actions) + 0.5)
            axes.tick_params(axis="x", length=0, labelbottom=False)
            axes.grid(False)
        _draw_timeline(timeline, shown, names)
        _draw_entropy(entropy, shown)
        _draw_gains(gains, shown)
        _draw_arrows(matrix, shown)
        for axes, (schema, title) in zip(graphs, structures, strict=True):
            draw_schema(schema, axes)
            for name in axes.texts:
                name.set(fontsize=0.92 * float(name.get_fontsize()))  # capitals are wide
            axes.set_title(title, loc="center", fontsize="medium", weight="bold")
        if at.figure is None:
            timeline.set_title(style.label(heading, 84), loc="left", fontsize="medium")
            entropy.legend(handles=_legend_handles(shown), fontsize="small", ncols=2)
    return at.returned


def _looks() -> dict[str, tuple[str, dict[str, Any]]]:
    """Marks of the outcomes of actions, distinct in form as well: a ring, filled marks, a star."""
    own, edge = style.current(), {"mec": _INK, "mew": 0.8}
    return {
        "nothing": ("nothing", {"marker": "_", "mec": _FAINT, "mew": 1.6, "ms": 7}),
        "moved": ("moved", {"marker": "o", "mfc": "white", **edge, "ms": 6}),
        "unlocked": ("unlocked", {"marker": "D", "mfc": own.other(3), **edge, "ms": 5.5}),
        "locked": ("locked again", {"marker": "s", "mfc": _INK, **edge, "ms": 5.5}),
        "opened": ("opened", {"marker": "^", "mfc": own.other(1), **edge, "ms": 7}),
        "new solution": (
            "new solution",
            {"marker": "*", "mfc": own.common_cause, **edge, "ms": 11},
        ),
    }


def _bars() -> tuple[dict[str, Any], dict[str, Any]]:
    """How bits that are expected look, and bits that are obtained."""
    own = style.current()
    return (
        {"fc": "white", "ec": own.common_effect, "lw": 0.9, "hatch": "////"},
        {"fc": own.common_cause, "ec": _INK, "lw": 0.6},
    )


def save_trace_figure(trace: Trace, path: Path | str, actions: int = MOST_ACTIONS) -> None:
    """Draw a trace into an SVG, PNG or PDF file; equal traces give equal files.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    path = path_of_picture(path)
    figure = Figure()
    plot_trace(trace, actions=actions, ax=figure)
    style.save(figure, path)


@dataclass(frozen=True)
class Part:
    """The part of a trace that is drawn.

    Attributes:
        trace: What happened.
        actions: The first actions, those that are shown.
        arrows: The arrows that are shown, from position to position or the door, in order.
        true: How many of them are in the true structure; these come first.
        left_out: How many arrows that were probable at some time are not shown.
    """

    trace: Trace
    actions: list[Moment]
    arrows: list[tuple[int, int]]
    true: int
    left_out: int

    @classmethod
    def of(
        cls, trace: Trace, most_actions: int = MOST_ACTIONS, most_arrows: int = MOST_ARROWS
    ) -> Part:
        """The part that is drawn by default, or less."""
        number = 0
        for attempt in trace.attempts:
            if number and number + len(attempt) > most_actions:
                break
            number += len(attempt)
        number = min(number, max(most_actions, 1))
        edges, nodes, graph = trace.edges[: number + 1], trace.nodes, trace.truth.graph
        final, mean, highest = edges[-1], edges.mean(axis=0), edges.max(axis=0)
        true = {(nodes.index(cause), nodes.index(effect)) for cause, effect in graph.edges}
        probable = np.argwhere(highest > THRESHOLD)
        ever = true | {(int(cause), int(effect)) for cause, effect in probable}
        kept = sorted(ever, key=lambda arrow: (arrow not in true, -highest[arrow], arrow))
        kept = kept[: max(most_arrows, 1)]
        # The true arrows first, causes before effects; the others by how probable they stayed.
        generations = enumerate(nx.topological_generations(graph))
        depth = {lever: place for place, together in generations for lever in together}
        kept.sort(
            key=lambda arrow: (
                arrow not in true,
                (depth[nodes[arrow[0]]], *arrow)
                if arrow in true
                else (-round(final[arrow], 6), -round(mean[arrow], 6), *arrow),
            )
        )
        shown = list(trace.actions[:number])
        return cls(trace, shown, kept, len(true.intersection(kept)), len(ever) - len(kept))

    @property
    def width(self) -> float:
        """Width of the figure in inches; wider than a page only where labels would overlap."""
        return max(style.WIDTH, _LEFT + _RIGHT + _NARROWEST * (len(self.actions) + 1))

    @property
    def column(self) -> float:
        """Width of a column in inches."""
        return (self.width - _LEFT - _RIGHT) / (len(self.actions) + 1)

    @property
    def cut(self) -> str:
        """Sentence on the part that is shown; empty if all is shown."""
        number, all_actions = len(self.actions), len(self.trace.actions)
        parts = []
        if number < all_actions:
            parts.append(f"the first {number} of {all_actions} actions")
        if self.left_out:
            parts.append(f"{len(self.arrows)} of {len(self.arrows) + self.left_out} arrows")
        return f"Shown are {' and '.join(parts)}." if parts else ""

    @property
    def renewed(self) -> bool:
        """Whether hypotheses were replaced by others in between."""
        return any(action.renewed for action in self.actions)

    @property
    def attempts(self) -> list[tuple[int, int, int]]:
        """Each attempt's number, and the first and the last of its columns."""
        found = []
        for attempt, own in groupby(enumerate(self.actions, 1), lambda at: at[1].attempt):
            columns = [column for column, _ in own]
            found.append((attempt, columns[0], columns[-1]))
        return found

    def divide(self, axes: Axes, **look: Any) -> None:
        """Draw a line before each attempt."""
        for _, first, _ in self.attempts:
            axes.axvline(first - 0.5, **look)


def _layout(shown: Part, graph_height: float, heading: str, names: list[str]) -> Layout:
    """The six panels under a title and a legend, every one as high as what it shows."""
    title = [(line, "bold") for line in textwrap.wrap(heading, 84)]
    if shown.cut:
        title.append((shown.cut, "normal"))
    handles = _legend_handles(shown)
    rows = -(-len(handles) // 7)
    heights = {
        "title": 0.12 + _LINE * len(title) + 0.22 * rows + 0.03,
        "timeline": 0.42,
        "names": 0.16 + 0.061 * max(map(len, names)),
        "entropy": 1.15,
        "gap": 0.14,
        "gains": 0.85,
        "another gap": 0.14,
        "arrows": max(0.135 * len(shown.arrows), 0.5),
        "below": 0.55,
        "graphs": graph_height,
        "bottom": 0.08,
    }
    total, width = sum(heights.values()), shown.width
    place = dict(zip(heights, range(len(heights)), strict=True))

    def lay_out(figure: FigureBase) -> list[Axes]:
        if isinstance(figure, Figure):
            figure.set_size_inches(width, total)
        grid = figure.add_gridspec(
            len(heights), left=_LEFT / width, right=1 - _RIGHT / width, bottom=0, top=1,
            hspace=0, height_ratios=list(heights.values()),
        )  # fmt: skip
        for line, (text, weight) in enumerate(title):
            figure.text(
                0.1 / width, 1 - (0.07 + _LINE * line) / total, text,
                va="top", fontsize="medium", weight=weight,
            )  # fmt: skip
        figure.legend(
            handles=handles, loc="upper left", ncols=-(-len(handles) // rows),
            bbox_to_anchor=(0.05 / width, 1 - (0.07 + _LINE * len(title)) / total),
            handlelength=1.3, columnspacing=1.2, handletextpad=0.4, borderaxespad=0,
        )  # fmt: skip
        axes = [
            figure.add_subplot(grid[place[name]], label=name)
            for name in ("timeline", "entropy", "gains", "arrows")
        ]
        for left, name in ((0.015, "most probable"), (0.515, "truth")):
            box = (left, heights["bottom"] / total, 0.47, graph_height / total)
            axes.append(figure.add_axes(box, label=name))
        return axes

    return lay_out


def _draw_timeline(axes: Axes, shown: Part, names: list[str]) -> None:
    """Draw actions and their outcomes, attempt by attempt."""
    axes.set(ylim=(0, 1), yticks=[])
    axes.spines[:].set_visible(False)
    for index, (attempt, first, last) in enumerate(shown.attempts):
        face = ("#EDEDED", "#DCDCDC")[index % 2]
        width = last - first + 0.92
        axes.add_patch(Rectangle((first - 0.46, 0), width, 1, fc=face, ec="none", zorder=0))
        middle = (first + last) / 2
        axes.text(middle, 0.97, str(attempt), ha="center", va="top", fontsize=_SMALL + 0.5)
    looks, scale = _looks(), min(1.0, shown.column * 72 / 11.5)
    for column, action in enumerate(shown.actions, start=1):
        _, mark = looks[action.outcome]
        axes.plot(column, 0.32, ls="none", **{**mark, "ms": mark["ms"] * scale})
    for y, text in ((0.84, "Attempt"), (0.32, "What came of it")):
        axes.text(-0.02, y, text, ha="right", va="center", transform=axes.transAxes)
    axes.set_xticks(range(len(names) + 1), ["at first", *names], rotation=90, fontsize=_SMALL)
    axes.tick_params(axis="x", labelbottom=True, pad=2)


def _draw_entropy(axes: Axes, shown: Part) -> None:
    """The bits that are missing to certainty, at first and after each action."""
    values = shown.trace.entropies[: len(shown.actions) + 1]
    shown.divide(axes, color="#C4C4C4", lw=0.6, zorder=0)
    size = min(3.2, 18 * shown.column)
    axes.plot(range(len(values)), values, ls="none", color=_INK, marker="o", ms=size, clip_on=False)
    for column, action in enumerate(shown.actions):
        look: Any = _RENEWED if action.renewed else {"color": _INK, "lw": 1.2}
        axes.plot([column, column + 1], values[column : column + 2], **look)
    axes.set_ylim(0, max(1.0, float(values.max())) * 1.08)
    axes.set_ylabel("Bits missing\nto certainty")
    axes.yaxis.grid(True)


def _draw_gains(axes: Axes, shown: Part) -> None:
    """The bits expected of each action, and the bits that it gave."""
    columns = np.arange(1, len(shown.actions) + 1)
    predicted = np.array([action.gain_predicted for action in shown.actions])
    # The difference between beliefs in different hypotheses is no information.
    obtained = np.array(
        [0.0 if action.renewed else action.gain_obtained for action in shown.actions]
    )
    shown.divide(axes, color="#C4C4C4", lw=0.6, zorder=0)
    expected_look, obtained_look = _bars()
    for shift, values, look in (
        (-0.2, predicted, expected_look),
        (0.2, obtained, obtained_look),
    ):
        some = np.abs(values) > 0.005  # where there is nothing, no line is drawn
        axes.bar(columns[some] + shift, values[some], width=0.36, zorder=2, **look)
    low, high = min(0.0, float(obtained.min())), max(predicted.max(), obtained.max(), 0.5)
    axes.set_ylim(low * 1.1, high * 1.08)
    axes.spines["bottom"].set_position("zero")
    axes.set_ylabel("Bits given by\nthe action")
    axes.yaxis.grid(True)


def _shades() -> LinearSegmentedColormap:
    colours = ["#FFFFFF", "#7FA6CC", style.current().common_effect]
    return LinearSegmentedColormap.from_list("belief", colours)


def _draw_arrows(axes: Axes, shown: Part) -> None:
    """The probability of each arrow, at first and after each action, and its scale."""
    nodes, count = shown.trace.nodes, len(shown.arrows)
    values = shown.trace.edges[: len(shown.actions) + 1]
    table = np.array([values[:, cause, effect] for cause, effect in shown.arrows])
    mesh = axes.pcolormesh(
        np.arange(len(values) + 1) - 0.5, np.arange(count + 1) - 0.5, table.reshape(count, -1),
        cmap=_shades(), vmin=0, vmax=1, edgecolors="#E6E6E6", linewidth=0.3,
    )  # fmt: skip
    axes.set_ylim(max(count, 1) - 0.5, -0.5)
    labels = [f"{nodes[cause]} → {nodes[effect]}" for cause, effect in shown.arrows]
    axes.set_yticks(range(count), labels, fontsize=_SMALL)
    axes.tick_params(axis="y", length=0)
    for place, tick in enumerate(axes.get_yticklabels()):
        tick.set_color("black" if place < shown.true else "#6A6A6A")
        tick.set_fontweight("bold" if place < shown.true else "normal")
    axes.spines[:].set_visible(False)
    if 0 < shown.true < count:
        axes.axhline(shown.true - 0.5, color=_INK, lw=1.0)
    shown.divide(axes, color="#8C8C8C", lw=0.7)
    box = axes.get_window_extent()
    inch = 1 / axes.get_figure(root=True).dpi  # type: ignore[union-attr]
    wide, high = 0.1 / (box.width * inch), min(1.0, 1.3 / (box.height * inch))
    bar = axes.inset_axes((1 + wide, 1 - high, wide, high), label="scale")
    axes.figure.colorbar(mesh, cax=bar, ticks=[0, 0.5, 1])
    bar.tick_params(labelsize=_SMALL, length=2)
    bar.set_ylabel("probability", fontsize=_SMALL)


def _legend_handles(shown: Part) -> list[Any]:
    """Entries of the legend: the outcomes that occurred, and the bars."""
    happened = {action.outcome for action in shown.actions}
    handles: list[Any] = [
        Line2D([], [], ls="none", label=label, **mark)
        for outcome, (label, mark) in _looks().items()
        if outcome in happened
    ]
    handles += [
        Patch(label=f"bits {name}", **look)
        for name, look in zip(("expected", "obtained"), _bars(), strict=True)
    ]
    if shown.renewed:
        handles.append(Line2D([], [], label="other hypotheses", **_RENEWED))
    return handles


def _structures(trace: Trace) -> list[tuple[Schema, str]]:
    """The most probable structure in the end and the true one, with their titles."""
    final = trace.moments[-1]
    same = {
        "same": "the true one",
        "alike": "acts like the true one",
        "different": "acts otherwise",
    }[agreement(trace)]
    return [
        (final.structure, f"Most probable in the end ({percent(final.probability)}): {same}"),
        (trace.truth, "True structure"),
    ]


def _graph_height(schemas: Sequence[Schema]) -> float:
    """Height of the graphs in inches."""
    limits = [arrange(schema).limits for schema in schemas]
    return min(_GRAPH_HEIGHT, _UNIT * max(top - bottom for _, _, bottom, top in limits))
