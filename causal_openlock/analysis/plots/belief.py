"""The picture of one trial of belief: what was done, what it revealed, what it left probable.

Four panels share their columns, one for each action; under them the structure that is most
probable in the end stands beside the true one. Everything is placed by the inch, so that nothing
depends on how long names are or how many arrows there were.
"""

from __future__ import annotations

import textwrap
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.belief_panels import (
    LEFT,
    RIGHT,
    TracePart,
    draw_arrows,
    draw_entropy,
    draw_gains,
    draw_graphs,
    draw_timeline,
    legend_handles,
    plan_graphs,
)
from causal_openlock.analysis.plots.style import Plot
from causal_openlock.belief.trace import Trace
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_bytes
from causal_openlock.render.graph import SUFFIXES
from causal_openlock.wording import nearest

MOST_ACTIONS, MOST_ARROWS = 36, 20
LINE = 0.16  # inches between lines of the title
THRESHOLD = 0.1
"""Arrows that are not true and were never more probable than this are not shown."""


def draw_trace(trace: Trace, actions: int = MOST_ACTIONS, arrows: int = MOST_ARROWS) -> Plot:
    """Draw a trace.

    Args:
        trace: What happened.
        actions: Most actions to show; of a longer trial the first attempts are shown that fit.
        arrows: Most arrows to show, those that were ever most probable.
    """
    shown = _choose(trace, actions, arrows)
    with style.settings():
        figure = _draw(shown)
    facts = {
        "learner": trace.learner,
        "threshold": THRESHOLD,
        "cut": shown.cut,
        "forgetting": trace.forgetting,
        "renewed": shown.renewed,
    }
    return Plot("belief", figure, facts=facts)


def save_trace_figure(trace: Trace, path: Path | str, actions: int = MOST_ACTIONS) -> None:
    """Draw a trace into a file, which is replaced in one step; equal traces give equal files.

    Args:
        trace: What happened.
        path: Its suffix says whether it is SVG, PNG or PDF.
        actions: Most actions to show.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    path = check_suffix(path)
    write_bytes(path, style.image(draw_trace(trace, actions).figure, path.suffix.lower()[1:]))


def check_suffix(path: Path | str) -> Path:
    """The path, if a picture can be saved in it.

    Raises:
        OpenLockError: If its suffix is none of a picture's.
    """
    path = Path(path)
    if path.suffix.lower() not in SUFFIXES:
        raise OpenLockError(
            f"{path}: a figure cannot be saved as {path.suffix!r}; "
            f"{nearest(path.suffix.lower(), SUFFIXES)}"
        )
    return path


# -- what is shown --------------------------------------------------------------------------------


def _choose(trace: Trace, actions: int, arrows: int) -> TracePart:
    number = 0
    for attempt in trace.attempts:
        if number and number + len(attempt) > actions:
            break
        number += len(attempt)
    number = min(number, max(actions, 1))
    edges = trace.edges[: number + 1]
    nodes = trace.nodes
    highest = edges.max(axis=0)
    true = {(nodes.index(cause), nodes.index(effect)) for cause, effect in trace.truth.graph.edges}
    ever = {
        *true,
        *((int(cause), int(effect)) for cause, effect in np.argwhere(highest > THRESHOLD)),
    }
    kept = sorted(ever, key=lambda arrow: (arrow not in true, -highest[arrow], arrow))
    kept = kept[: max(arrows, 1)]
    # The true arrows first, causes before effects; the others by how probable they stayed.
    final, mean = edges[-1], edges.mean(axis=0)
    depth = _depths(trace)
    kept.sort(
        key=lambda arrow: (
            arrow not in true,
            (depth[nodes[arrow[0]]], *arrow)
            if arrow in true
            else (-round(final[arrow], 6), -round(mean[arrow], 6), *arrow),
        )
    )
    return TracePart(trace, number, kept, [arrow in true for arrow in kept], len(ever) - len(kept))


def _depths(trace: Trace) -> dict[str, int]:
    """How many levers stand before each in the longest chain of causes."""
    import networkx as nx

    generations = nx.topological_generations(trace.truth.graph)
    return {lever: depth for depth, together in enumerate(generations) for lever in together}


def _title(trace: Trace) -> str:
    return (
        f"{trace.learner} in {trace.condition}, trial {trace.trial} of {trace.trials} "
        f"(subject {trace.subject}, protocol {trace.protocol.name})"
    )


# -- drawing --------------------------------------------------------------------------------------


def _draw(shown: TracePart) -> Figure:
    graphs = plan_graphs(shown)
    title = [(line, "bold") for line in textwrap.wrap(_title(shown.trace), 84)]
    title += [(shown.cut, "normal")] * bool(shown.cut)
    handles = legend_handles(shown)
    rows = -(-len(handles) // 7)
    heights = {
        "title": 0.12 + LINE * len(title) + 0.22 * rows + 0.03,
        "timeline": 0.42,
        "names": 0.16 + 0.061 * max(map(len, shown.names)),
        "entropy": 1.15,
        "gap": 0.14,
        "gains": 0.85,
        "another gap": 0.14,
        "arrows": max(0.135 * len(shown.arrows), 0.5),
        "below": 0.55,
        "graphs": max(graph.height for graph in graphs),
        "bottom": 0.08,
    }
    total = sum(heights.values())
    figure = Figure(figsize=(shown.width, total))
    top = total
    place: dict[str, tuple[float, float]] = {}
    for name, height in heights.items():
        top -= height
        place[name] = (top / total, height / total)
    left, width = LEFT / shown.width, (shown.width - LEFT - RIGHT) / shown.width

    def panel(name: str) -> Axes:
        bottom, height = place[name]
        axes = figure.add_axes((left, bottom, width, height), label=name)
        axes.set_xlim(-0.5, shown.number + 0.5)
        axes.tick_params(axis="x", length=0, labelbottom=False)
        axes.grid(False)
        return axes

    for line, (text, weight) in enumerate(title):
        figure.text(
            0.1 / shown.width, 1 - (0.07 + LINE * line) / total, text,
            va="top", fontsize=9 if weight == "bold" else 8, weight=weight,
        )  # fmt: skip
    figure.legend(
        handles=handles,
        loc="upper left",
        bbox_to_anchor=(0.05 / shown.width, 1 - (0.07 + LINE * len(title)) / total),
        ncols=-(-len(handles) // rows),
        handlelength=1.3,
        columnspacing=1.2,
        handletextpad=0.4,
        fontsize=8,
        borderaxespad=0,
    )
    draw_timeline(panel("timeline"), shown)
    draw_entropy(panel("entropy"), shown)
    draw_gains(panel("gains"), shown)
    draw_arrows(panel("arrows"), shown)
    draw_graphs(figure, graphs, heights["graphs"] + heights["bottom"])
    figure.align_ylabels()
    return figure
