"""The picture of one trial of belief: what was done, what it revealed, what it left probable.

Four panels share their columns, one for each action; under them the structure that is most
probable in the end is next to the true one.
"""

from __future__ import annotations

import textwrap
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import networkx as nx
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.panels import panels
from causal_openlock.analysis.results.material import Material
from causal_openlock.analysis.results.traces import replayed
from causal_openlock.belief.trace import Moment, Trace, agreement, percent, shown_name
from causal_openlock.render.graph import draw_schema

MOST_ACTIONS, MOST_ARROWS = 36, 20
THRESHOLD = 0.1  #: arrows that are not true and were never more probable than this are not shown

# In inches: what is beside the columns, the narrowest column, and the structures below.
_BESIDE, _NARROWEST, _GRAPHS = 2.4, 0.125, 2.1
_SMALL = 7.0  # size of small type
_INK, _FAINT = "#222222", "#9A9A9A"
_LIKENESS = {"same": "the true one", "alike": "acts like the true one"}
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
        ax: An empty figure; by default a new one of pyplot.

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


def plot_trace(trace: Trace, *, actions: int = MOST_ACTIONS, ax: Any = None) -> Any:
    """The same of a trace, such as :func:`causal_openlock.belief.trace.trace_trial` gives.

    Of a trial of more ``actions`` than these, the first attempts are shown that fit.
    """
    shown = Part.of(trace, actions)
    names = list(map(shown_name, shown.actions))
    heading = textwrap.wrap(
        f"{style.label(trace.learner)} in {style.label(trace.condition)}, trial {trace.trial} of "
        f"{trace.trials} (subject {trace.subject}, protocol {style.label(trace.protocol.name)})",
        84,
    )
    # Inches of the axes of the four panels, and of all names and titles around them.
    heights = [0.42, 1.15, 0.85, max(0.135 * len(shown.arrows), 0.5)]
    around = 1.4 + 0.16 * len(heading) + 0.061 * max(map(len, names))
    height = sum(heights) + around + _GRAPHS
    # Wider than a page only where labels would overlap.
    width = max(style.WIDTH, _BESIDE + _NARROWEST * (len(names) + 1))

    def lay_out(figure: Figure) -> list[Axes]:
        figure.set_size_inches(width, height)
        engine: Any = figure.get_layout_engine()
        engine.set(rect=(0, _GRAPHS / height, 1, 1 - _GRAPHS / height), h_pad=0.07)
        boxes = [(left, 0.01, 0.47, _GRAPHS / height - 0.04) for left in (0.015, 0.515)]
        columns = figure.subplots(4, 1, sharex=True, height_ratios=heights)
        return [*columns, *map(figure.add_axes, boxes)]

    with panels(ax, 6, lay_out) as at:
        timeline, entropy, gains, matrix, most_probable, truth = at.axes
        for axes in at.axes:
            axes.grid(False)
            axes.tick_params(axis="x", length=0, labelbottom=False)
        timeline.set_xlim(-0.5, len(names) + 0.5)
        _draw_timeline(timeline, shown, names)
        _draw_entropy(entropy, shown)
        _draw_gains(gains, shown)
        _draw_arrows(matrix, shown, at.axes[:4])
        for axes in (entropy, gains, matrix):
            for begin, _ in shown.attempts:
                axes.axvline(begin, color="#A8A8A8", lw=0.6, zorder=0.5)
        probable = percent(trace.moments[-1].probability)
        likeness = _LIKENESS.get(agreement(trace), "acts otherwise")
        title = f"Most probable in the end ({probable}): {likeness}"
        for axes, schema, text in (
            (most_probable, trace.moments[-1].structure, title),
            (truth, trace.truth, "True structure"),
        ):
            for name in draw_schema(schema, axes).texts:
                name.set(fontsize=0.92 * float(name.get_fontsize()))  # capitals are wide
            axes.set_title(text, loc="center", fontsize="medium")
        handles = timeline.get_legend_handles_labels()[0]
        handles += [Patch(label=f"bits {what}", **look) for what, look in _bars().items()]
        if any(action.renewed for action in shown.actions):
            handles.append(Line2D([], [], label="other hypotheses", **_RENEWED))
        timeline.figure.legend(
            handles=handles, loc="outside upper left", ncols=7, alignment="left",
            title="\n".join(heading), title_fontproperties={"weight": "bold"},
            handlelength=1.3, columnspacing=1.2, handletextpad=0.4,
        )  # fmt: skip
    return at.returned


def _looks() -> dict[str, dict[str, Any]]:
    """Marks of the outcomes of actions, distinct in form: a ring, filled marks, a star.

    They fit into the narrowest column, of 9 points.
    """
    own, edge = style.current(), {"mec": _INK, "mew": 0.8}
    return {
        "nothing": {"marker": "_", "mec": _FAINT, "mew": 1.6, "ms": 6},
        "moved": {"marker": "o", "mfc": "white", **edge, "ms": 5},
        "unlocked": {"marker": "D", "mfc": own.other(3), **edge, "ms": 4.5},
        "locked": {"marker": "s", "mfc": _INK, **edge, "ms": 4.5},
        "opened": {"marker": "^", "mfc": own.other(1), **edge, "ms": 6},
        "new solution": {"marker": "*", "mfc": own.common_cause, **edge, "ms": 9},
    }


def _bars() -> dict[str, dict[str, Any]]:
    """How bits that are expected look, and bits that are obtained."""
    own = style.current()
    return {
        "expected": {"fc": "white", "ec": own.common_effect, "lw": 0.9, "hatch": "////"},
        "obtained": {"fc": own.common_cause, "ec": _INK, "lw": 0.6},
    }


@dataclass(frozen=True)
class Part:
    """The part of a trace that is drawn."""

    trace: Trace  #: what happened
    actions: list[Moment]  #: the first actions, those that are shown
    arrows: list[tuple[int, int]]  #: that are shown, from position to position or the door
    true: int  #: how many of them are in the true structure; these come first
    left_out: int  #: how many arrows that were probable at some time are not shown

    @classmethod
    def of(cls, trace: Trace, most_actions: int = MOST_ACTIONS) -> Part:
        """The first attempts that fit, and the arrows that were ever most probable in them."""
        ends = np.cumsum([len(attempt) for attempt in trace.attempts])
        number = min(max([*ends[ends <= most_actions], ends[0]]), max(most_actions, 1))
        nodes, graph = trace.nodes, trace.truth.graph
        highest = trace.edges[: number + 1].max(axis=0)
        # The true arrows first, causes before effects; the others by how probable they were.
        order = list(nx.topological_sort(graph))
        true = [
            (nodes.index(cause), nodes.index(effect))
            for cause, effect in sorted(graph.edges, key=lambda edge: order.index(edge[0]))
        ]
        others = {(int(a), int(b)) for a, b in np.argwhere(highest > THRESHOLD)} - {*true}
        arrows = true + sorted(others, key=lambda arrow: (-round(highest[arrow], 6), arrow))
        shown = arrows[:MOST_ARROWS]
        left_out = len(arrows) - len(shown)
        return cls(trace, list(trace.actions[:number]), shown, len(true), left_out)

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
    def attempts(self) -> list[tuple[float, float]]:
        """Where each attempt begins and ends, on the common x axis."""
        begins = [column - 0.5 for column, one in enumerate(self.actions, 1) if one.number == 1]
        return list(pairwise([*begins, len(self.actions) + 0.5]))


def _draw_timeline(axes: Axes, shown: Part, names: list[str]) -> None:
    """Draw actions and their outcomes, attempt by attempt."""
    axes.set(ylim=(0, 1))
    axes.spines[:].set_visible(False)
    for number, (begin, end) in enumerate(shown.attempts):
        axes.axvspan(begin + 0.04, end - 0.04, fc=("#EDEDED", "#DCDCDC")[number % 2], zorder=0)
        middle = (begin + end) / 2
        axes.text(middle, 0.97, str(number + 1), ha="center", va="top", fontsize=_SMALL + 0.5)
    for outcome, mark in _looks().items():
        columns = [place for place, one in enumerate(shown.actions, 1) if one.outcome == outcome]
        if columns:
            axes.plot(columns, [0.32] * len(columns), ls="none", label=outcome, **mark)
    axes.set_yticks([0.84, 0.32], ["Attempt", "What came of it"])
    axes.set_xticks(range(len(names) + 1), ["at first", *names], rotation=90, fontsize=_SMALL)
    axes.tick_params(length=0)
    axes.tick_params(axis="x", labelbottom=True)


def _draw_entropy(axes: Axes, shown: Part) -> None:
    """The bits that are missing to certainty, at first and after each action."""
    values = shown.trace.entropies[: len(shown.actions) + 1]
    axes.plot(range(len(values)), values, ls="none", color=_INK, marker="o", ms=2.5, clip_on=False)
    for column, action in enumerate(shown.actions):
        look: Any = _RENEWED if action.renewed else {"color": _INK, "lw": 1.2}
        axes.plot([column, column + 1], values[column : column + 2], **look)
    axes.set_ylim(0, max(1.0, float(values.max())) * 1.08)
    axes.set_ylabel("Bits missing\nto certainty")
    axes.yaxis.grid(True)


def _draw_gains(axes: Axes, shown: Part) -> None:
    """The bits expected of each action, and the bits that it gave."""
    expected = np.array([action.gain_predicted for action in shown.actions])
    # The difference between beliefs in different hypotheses is no information.
    obtained = np.array([0.0 if one.renewed else one.gain_obtained for one in shown.actions])
    looks = _bars().values()
    for aside, values, look in zip((-0.2, 0.2), (expected, obtained), looks, strict=True):
        (some,) = np.nonzero(np.abs(values) > 0.005)  # where there is nothing, no line is drawn
        axes.bar(some + 1 + aside, values[some], width=0.36, zorder=2, **look)
    low, high = min(0.0, obtained.min()), max(expected.max(), obtained.max(), 0.5)
    axes.set_ylim(low * 1.1, high * 1.08)
    axes.axhline(0, color=_INK, lw=0.8)
    axes.spines["bottom"].set_visible(False)
    axes.set_ylabel("Bits given by\nthe action")
    axes.yaxis.grid(True)


def _draw_arrows(axes: Axes, shown: Part, beside: list[Axes]) -> None:
    """The probability of each arrow, at first and after each action, and its scale."""
    nodes, count = shown.trace.nodes, len(shown.arrows)
    values = shown.trace.edges[: len(shown.actions) + 1]
    colours = ["#FFFFFF", "#7FA6CC", style.current().common_effect]
    mesh = axes.pcolormesh(
        np.arange(len(values) + 1) - 0.5, np.arange(count + 1) - 0.5,
        np.array([values[:, cause, effect] for cause, effect in shown.arrows]),
        cmap=LinearSegmentedColormap.from_list("belief", colours), vmin=0, vmax=1,
        edgecolors="#E6E6E6", linewidth=0.3,
    )  # fmt: skip
    labels = [f"{nodes[cause]} → {nodes[effect]}" for cause, effect in shown.arrows]
    axes.set_yticks(range(count), labels, fontsize=_SMALL)
    axes.tick_params(axis="y", length=0, labelcolor="#6A6A6A")
    for tick in axes.get_yticklabels()[: shown.true]:
        tick.set(color="black", fontweight="bold")
    axes.set_ylim(count - 0.5, -0.5)
    axes.spines[:].set_visible(False)
    if 0 < shown.true < count:
        axes.axhline(shown.true - 0.5, color=_INK, lw=1.0)
    axes.set_xlabel(shown.cut)
    axes.figure.colorbar(
        mesh, ax=beside, label="probability", ticks=[0, 0.5, 1], shrink=0.3, anchor=(0, 0.1),
        aspect=12,
    )  # fmt: skip
