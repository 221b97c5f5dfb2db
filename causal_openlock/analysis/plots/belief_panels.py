"""The panels of the picture of belief (:mod:`causal_openlock.analysis.plots.belief`).

Every panel is drawn into axes that it is given, and takes what it shows from a :class:`TracePart`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch, Rectangle

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import COMMON_CAUSE, COMMON_EFFECT
from causal_openlock.belief.trace import Trace, agreement, percent, shown_name
from causal_openlock.render.arrange import arrange
from causal_openlock.render.graph import draw_schema
from causal_openlock.world.schema import Schema

LEFT, RIGHT = 1.75, 0.62  # margins beside the columns, in inches
NARROWEST = 0.125  # of columns
UNIT, GRAPH_HEIGHT = 0.46, 3.0  # of graphs: inches of a unit, and of the highest
SMALL = 7.0  # size of small type
INK, FAINT = "#222222", "#9A9A9A"
# Told apart by form as well as by colour: an empty ring, filled marks, a star.
MARKS: dict[str, tuple[str, dict[str, Any]]] = {
    "nothing": ("nothing", {"marker": "_", "mec": FAINT, "mew": 1.6, "ms": 7}),
    "moved": ("moved", {"marker": "o", "mfc": "white", "mec": INK, "mew": 1.0, "ms": 6}),
    "unlocked": ("unlocked", {"marker": "D", "mfc": "#56B4E9", "mec": INK, "mew": 0.8, "ms": 5.5}),
    "locked": ("locked again", {"marker": "s", "mfc": INK, "mec": INK, "mew": 0.8, "ms": 5.5}),
    "opened": ("opened", {"marker": "^", "mfc": "#CC79A7", "mec": INK, "mew": 0.8, "ms": 7}),
    "new solution": (
        "new solution",
        {"marker": "*", "mfc": COMMON_CAUSE, "mec": INK, "mew": 0.7, "ms": 11},
    ),
}
EXPECTED: Any = {"fc": "white", "ec": COMMON_EFFECT, "lw": 0.9, "hatch": "////"}
RENEWED: Any = {"color": FAINT, "lw": 1.0, "ls": (0, (1.5, 1.5))}
OBTAINED: Any = {"fc": COMMON_CAUSE, "ec": INK, "lw": 0.6}
_BLUES = LinearSegmentedColormap.from_list("belief", ["#FFFFFF", "#7FA6CC", COMMON_EFFECT])


@dataclass(frozen=True)
class TracePart:
    """The part of a trace that is drawn.

    Attributes:
        trace: What happened.
        number: How many of the actions are shown, the first ones.
        arrows: The arrows that are shown, from position to position or the door, in order.
        true: Whether each of them is in the true structure.
        left_out: How many arrows that were probable at some time are not shown.
    """

    trace: Trace
    number: int
    arrows: list[tuple[int, int]]
    true: list[bool]
    left_out: int

    @property
    def names(self) -> list[str]:
        """The name of each action."""
        return [shown_name(action) for action in self.trace.actions[: self.number]]

    @property
    def width(self) -> float:
        """Width of the figure in inches; wider than a page only where labels would overlap."""
        return max(style.WIDTH, LEFT + RIGHT + NARROWEST * (self.number + 1))

    @property
    def column(self) -> float:
        """Width of a column in inches."""
        return (self.width - LEFT - RIGHT) / (self.number + 1)

    @property
    def cut(self) -> str:
        """What part is shown, in a sentence; empty if it is all."""
        all_actions, all_arrows = len(self.trace.actions), len(self.arrows) + self.left_out
        parts = []
        if self.number < all_actions:
            parts.append(f"the first {self.number} of {all_actions} actions")
        if self.left_out:
            parts.append(f"{len(self.arrows)} of {all_arrows} arrows")
        return f"Shown are {' and '.join(parts)}." if parts else ""

    @property
    def renewed(self) -> bool:
        """Whether hypotheses were replaced by others in between."""
        return any(action.renewed for action in self.trace.actions[: self.number])

    @property
    def attempts(self) -> list[tuple[int, int, int]]:
        """Each attempt's number, and the first and the last of its columns."""
        spans: list[tuple[int, int, int]] = []
        for column, action in enumerate(self.trace.actions[: self.number], start=1):
            if spans and spans[-1][0] == action.attempt:
                spans[-1] = (action.attempt, spans[-1][1], column)
            else:
                spans.append((action.attempt, column, column))
        return spans


def draw_timeline(axes: Axes, shown: TracePart) -> None:
    """What was done, and what came of it, attempt by attempt."""
    axes.set(ylim=(0, 1), yticks=[])
    axes.spines[:].set_visible(False)
    for index, (attempt, first, last) in enumerate(shown.attempts):
        axes.add_patch(
            Rectangle(
                (first - 0.46, 0.0), last - first + 0.92, 1.0,
                fc=("#EDEDED", "#DCDCDC")[index % 2], ec="none", zorder=0,
            )
        )  # fmt: skip
        middle = (first + last) / 2
        axes.text(middle, 0.97, str(attempt), ha="center", va="top", fontsize=SMALL + 0.5)
    scale = min(1.0, shown.column * 72 / 11.5)
    for column, action in enumerate(shown.trace.actions[: shown.number], start=1):
        mark = dict(MARKS[action.outcome][1])
        mark["ms"] *= scale
        axes.plot(column, 0.32, ls="none", **mark)
    axes.text(-0.08 / 4, 0.84, "Attempt", ha="right", va="center", transform=axes.transAxes)
    axes.text(-0.08 / 4, 0.32, "What came of it", ha="right", va="center", transform=axes.transAxes)
    axes.set_xticks(
        range(shown.number + 1), ["at first", *shown.names], rotation=90, fontsize=SMALL
    )
    axes.tick_params(axis="x", labelbottom=True, pad=2)


def _between_attempts(axes: Axes, shown: TracePart) -> None:
    for _, first, _ in shown.attempts:
        axes.axvline(first - 0.5, color="#C4C4C4", lw=0.6, zorder=0)


def draw_entropy(axes: Axes, shown: TracePart) -> None:
    """The bits that are missing to certainty, at first and after each action."""
    values = shown.trace.entropies[: shown.number + 1]
    _between_attempts(axes, shown)
    size = min(3.2, 18 * shown.column)
    axes.plot(range(len(values)), values, ls="none", color=INK, marker="o", ms=size, clip_on=False)
    for column, action in enumerate(shown.trace.actions[: shown.number]):
        look: Any = RENEWED if action.renewed else {"color": INK, "lw": 1.2}
        axes.plot([column, column + 1], values[column : column + 2], **look)
    axes.set_ylim(0, max(1.0, float(values.max())) * 1.08)
    axes.set_ylabel("Bits missing\nto certainty")
    axes.yaxis.grid(True)


def draw_gains(axes: Axes, shown: TracePart) -> None:
    """The bits expected of each action, and the bits that it gave."""
    columns = np.arange(1, shown.number + 1)
    actions = shown.trace.actions[: shown.number]
    predicted = np.array([action.predicted for action in actions])
    # The difference between beliefs in different hypotheses is no information.
    obtained = np.array([0.0 if action.renewed else action.obtained for action in actions])
    _between_attempts(axes, shown)
    for shift, values, look in ((-0.2, predicted, EXPECTED), (0.2, obtained, OBTAINED)):
        some = np.abs(values) > 0.005  # where there is nothing, no line is drawn
        axes.bar(columns[some] + shift, values[some], width=0.36, zorder=2, **look)
    low, high = min(0.0, float(obtained.min())), max(predicted.max(), obtained.max(), 0.5)
    axes.set_ylim(low * 1.1, high * 1.08)
    axes.spines["bottom"].set_position("zero")
    axes.set_ylabel("Bits given by\nthe action")
    axes.yaxis.grid(True)


def draw_arrows(axes: Axes, shown: TracePart) -> None:
    """The probability of each arrow, at first and after each action, and its scale."""
    nodes, count = shown.trace.nodes, len(shown.arrows)
    values = shown.trace.edges[: shown.number + 1]
    table = np.array([values[:, cause, effect] for cause, effect in shown.arrows])
    edges = np.arange(shown.number + 2) - 0.5
    mesh = axes.pcolormesh(
        edges, np.arange(count + 1) - 0.5, table.reshape(count, -1), cmap=_BLUES, vmin=0, vmax=1,
        edgecolors="#E6E6E6", linewidth=0.3,
    )  # fmt: skip
    axes.set_ylim(max(count, 1) - 0.5, -0.5)
    labels = [f"{nodes[cause]} → {nodes[effect]}" for cause, effect in shown.arrows]
    axes.set_yticks(range(count), labels, fontsize=SMALL)
    axes.tick_params(axis="y", length=0)
    for tick, true in zip(axes.get_yticklabels(), shown.true, strict=True):
        tick.set_color("black" if true else "#6A6A6A")
        tick.set_fontweight("bold" if true else "normal")
    axes.spines[:].set_visible(False)
    if 0 < sum(shown.true) < count:
        axes.axhline(sum(shown.true) - 0.5, color=INK, lw=1.0)
    for _, first, _ in shown.attempts:
        axes.axvline(first - 0.5, color="#8C8C8C", lw=0.7)
    box, figure = axes.get_position(), axes.get_figure(root=True)
    assert figure is not None
    height = min(box.height, 1.3 / figure.get_figheight())
    bar = figure.add_axes(
        (box.x1 + 0.1 / shown.width, box.y1 - height, 0.1 / shown.width, height), label="scale"
    )
    figure.colorbar(mesh, cax=bar, ticks=[0, 0.5, 1])
    bar.tick_params(labelsize=SMALL, length=2)
    bar.set_ylabel("probability", fontsize=SMALL)


def legend_handles(shown: TracePart) -> list[Any]:
    """What came of actions, as far as it did, and the bars."""
    happened = {action.outcome for action in shown.trace.actions[: shown.number]}
    handles: list[Any] = [
        Line2D([], [], ls="none", label=label, **mark)
        for outcome, (label, mark) in MARKS.items()
        if outcome in happened
    ]
    handles += [
        Patch(label="bits expected", **EXPECTED),
        Patch(label="bits obtained", **OBTAINED),
    ]
    if shown.renewed:
        handles.append(Line2D([], [], label="other hypotheses", **RENEWED))
    return handles


class Graph(NamedTuple):
    """A structure to draw, under which title, and how large in inches."""

    schema: Schema
    title: str
    width: float
    height: float


def plan_graphs(shown: TracePart) -> list[Graph]:
    """The most probable structure in the end and the true one, both at one scale."""
    trace = shown.trace
    final = trace.snapshots[-1]
    same = {
        "same": "the true one",
        "alike": "acts like the true one",
        "different": "acts otherwise",
    }[agreement(trace)]
    titled = (
        (final.structure, f"Most probable in the end ({percent(final.probability)}): {same}"),
        (trace.truth, "True structure"),
    )
    sizes = []
    for schema, _ in titled:
        left, right, bottom, top = arrange(schema).limits
        sizes.append((right - left, top - bottom))
    most = 0.47 * shown.width
    unit = min(UNIT, *(min(most / width, GRAPH_HEIGHT / height) for width, height in sizes))
    return [
        Graph(schema, title, width * unit, height * unit)
        for (schema, title), (width, height) in zip(titled, sizes, strict=True)
    ]


def draw_graphs(figure: Figure, graphs: list[Graph], top: float) -> None:
    """Draw the graphs side by side below ``top``, in inches from the bottom."""
    across, total = figure.get_size_inches()
    for index, (schema, title, width, height) in enumerate(graphs):
        middle = (0.25 + 0.5 * index) * across
        axes = figure.add_axes(
            (
                (middle - width / 2) / across,
                (top - height) / total,
                width / across,
                height / total,
            ),
            label=("most probable", "truth")[index],
        )
        draw_schema(schema, axes)
        for name in axes.texts:
            name.set(fontsize=0.92 * float(name.get_fontsize()))  # capitals are wide
        figure.text(
            middle / across, (top + 0.08) / total, title,
            ha="center", va="bottom", fontsize=8.5, weight="bold",
        )  # fmt: skip
