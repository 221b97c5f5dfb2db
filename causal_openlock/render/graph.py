"""A schema as a figure in the style of the paper's Figure 1, or as text.

Causes stand above their effects: a lever's row is the length of the longest path to it, and the
door has the last row for itself. In a row, nodes stand close to their causes and effects, so that
few edges cross; an edge bends as little as keeps it clear of other nodes.

Lengths are in units of which a lever's circle has 0.72 in diameter. The size of the axes decides
how large a unit is drawn, and type and lines grow with it. The figure is drawn with matplotlib's
objects and without pyplot, so drawing leaves no state behind.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from causal_openlock.files.atomic import replacing
from causal_openlock.render import path_of_picture
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.patches import Patch

Points = NDArray[np.float64]
Places = dict[str, Points]
Edge = tuple[str, str]

RADIUS, GAP = 0.36, 0.34  # half the height of a node, and the space between neighbours in a row
CLEARANCE = 0.1  # between an edge and a node that it does not belong to
LABEL = np.array([0.24, 0.1])  # half the size of a strength written at an edge
INCHES, LARGEST = 0.62, 18.0  # a unit in a figure of its own; the widest and highest such figure
MOST_SOLUTIONS = 12  # in a text


def draw_schema(schema: Schema, ax: Axes | None = None) -> Axes:
    """Draw a schema as a graph: levers as circles, the door as a rounded square.

    A gate other than ``any`` is named in its node, a strength below 1 at its edge; inert levers
    and their edges are dashed.

    Args:
        schema: What to draw.
        ax: Where to draw; by default a figure of its own, ``ax.figure``, of a fitting size.

    Returns:
        The axes.
    """
    from matplotlib.patches import FancyArrowPatch

    places = _places(schema)
    bends = {edge: _bend(edge, places) for edge in schema.graph.edges}
    curves = {edge: _curve(edge, places, bend) for edge, bend in bends.items()}
    strengths = {(a, b): p for a, b, p in schema.graph.edges(data="strength") if p < 1}
    labels = _labels(strengths, curves)
    boxes = [(centre, _half_size(node)) for node, centre in places.items()]
    boxes += [(centre, LABEL) for centre in labels.values()]
    corners = [centre + side * half for centre, half in boxes for side in (-1, 1)]
    outline = np.vstack([*corners, *curves.values()])
    (left, bottom), (right, top) = outline.min(axis=0) - 0.12, outline.max(axis=0) + 0.12
    width, height = float(right - left), float(top - bottom)
    if ax is None:
        from matplotlib.figure import Figure

        inches = min(INCHES, LARGEST / max(width, height))
        ax = Figure(figsize=(width * inches, height * inches)).add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    extent = ax.get_window_extent()
    points = min(extent.width / width, extent.height / height) * 72 / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    outlines = {node: _draw_node(ax, schema, node, places[node], points) for node in places}
    for (cause, effect), bend in bends.items():
        inert = effect in schema.inert
        arrow = FancyArrowPatch(
            tuple(places[cause]),
            tuple(places[effect]),
            patchA=outlines[cause],
            patchB=outlines[effect],
            shrinkA=0,
            shrinkB=0.04 * points,
            connectionstyle=f"arc3,rad={bend}",
            arrowstyle="-|>,head_width=0.2,head_length=0.4",
            mutation_scale=0.32 * points,
            linewidth=0.028 * points,
            linestyle=(0, (4, 2.5)) if inert else "-",
            color="0.35" if inert else "black",
            joinstyle="miter",
            zorder=1,
        )
        ax.add_patch(arrow)
    small: Any = {"ha": "center", "va": "center", "fontsize": 0.19 * points, "zorder": 2}
    box = {"boxstyle": "square,pad=0.08", "facecolor": "white", "edgecolor": "none"}
    for edge, (x, y) in labels.items():
        ax.text(x, y, f"{strengths[edge]:.2g}", bbox=box, **small)
    return ax


def save_schema_figure(schema: Schema, path: Path | str) -> None:
    """Draw a schema into a PNG, SVG or PDF by the suffix; the file is replaced in one step.

    Text in SVG and PDF stays text, and the same schema gives the same file.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    import matplotlib as mpl

    path = path_of_picture(path)
    suffix = path.suffix.lower()
    dates: dict[str, Any] = {".svg": {"Date": None}, ".pdf": {"CreationDate": None}}
    settings: Any = {"svg.fonttype": "none", "svg.hashsalt": schema.name, "pdf.fonttype": 42}
    with mpl.rc_context(), replacing(path) as file:
        mpl.rcdefaults()  # not those of a matplotlibrc, which may ask for a LaTeX that is not there
        mpl.rcParams.update(settings)
        figure: Any = draw_schema(schema).figure
        figure.savefig(file, format=suffix[1:], dpi=200, metadata=dates.get(suffix))


# -- where things stand ---------------------------------------------------------------------------


def _places(schema: Schema) -> Places:
    """The centre of each node, y up."""
    graph, order = schema.graph, [*schema.levers, DOOR]
    generations = [set(generation) - {DOOR} for generation in nx.topological_generations(graph)]
    rows = [sorted(levers, key=order.index) for levers in generations if levers] + [[DOOR]]
    x = {node: i - (len(row) - 1) / 2 for row in rows for i, node in enumerate(row)}
    # Down, up, and down again: each row follows the one before it.
    for neighbours, sweep in ((graph.pred, rows), (graph.succ, rows[::-1]), (graph.pred, rows)):
        for row in sweep:
            wish = {
                node: float(np.mean([x[n] for n in neighbours[node]] or x[node])) for node in row
            }
            row.sort(key=wish.__getitem__)
            halves = np.array([_half_size(node)[0] for node in row])
            offsets = np.concatenate([[0.0], np.cumsum(halves[:-1] + halves[1:] + GAP)])
            free = np.array([wish[node] for node in row]) - offsets
            # Where neighbours would overlap, halfway between pushing them right and pushing left.
            right, left = np.maximum.accumulate(free), np.minimum.accumulate(free[::-1])[::-1]
            x |= dict(zip(row, ((left + right) / 2 + offsets).tolist(), strict=True))
    widest = max(abs(x[cause] - x[effect]) for cause, effect in graph.edges)
    height = max(1.25 if schema.deterministic else 1.6, 0.35 * widest)
    return {node: np.array([x[node], -height * i]) for i, row in enumerate(rows) for node in row}


def _half_size(node: str) -> Points:
    """Half the width and half the height of a node; levers with long names are wider than high."""
    return np.array([RADIUS if node == DOOR else max(RADIUS, 0.09 * len(node) + 0.09), RADIUS])


def _curve(edge: Edge, places: Places, bend: float) -> Points:
    """``[21, 2]`` points along an edge from centre to centre, as matplotlib's style arc3 bends."""
    start, end = places[edge[0]], places[edge[1]]
    dx, dy = end - start
    middle = (start + end) / 2 + bend * np.array([dy, -dx])
    t = np.linspace(0.0, 1.0, 21)[:, None]
    return np.asarray((1 - t) ** 2 * start + 2 * t * (1 - t) * middle + t**2 * end)


def _bend(edge: Edge, places: Places) -> float:
    """The least bend with which an edge keeps clear of the nodes that it does not belong to."""
    aside = places[edge[0]][0] - places[DOOR][0]
    if abs(aside) < 0.01:  # in one column, edges to the door bend to the right, others to the left
        aside = 1.0 if edge[1] == DOOR else -1.0
    outward = -1 if aside > 0 else 1
    others = set(places) - set(edge)
    for size in np.arange(0.0, 1.0, 0.05).tolist():
        for bend in (outward * size, -outward * size):
            curve = _curve(edge, places, bend)
            if all(_distance(curve, places[node], node) > CLEARANCE for node in others):
                return bend
    return 0.0


def _distance(points: Points, centre: Points, node: str) -> float:
    """The least distance from points to the border of a node with round ends."""
    away = np.abs(points - centre)
    away[:, 0] = np.maximum(away[:, 0] - (_half_size(node)[0] - RADIUS), 0.0)
    return float(np.hypot(*away.T).min()) - RADIUS


def _labels(edges: Iterable[Edge], curves: dict[Edge, Points]) -> dict[Edge, Points]:
    """The place of each strength: on its edge, and where it covers least of others."""
    labels: dict[Edge, Points] = {}
    for edge in edges:
        others = [curve[5:-5] for other, curve in curves.items() if other != edge]
        taken = [np.tile(label, (20, 1)) for label in labels.values()]
        points = np.vstack([np.empty((0, 2)), *others, *taken])
        candidates = curves[edge][[10, 9, 11, 8, 12, 7, 13]]
        near = np.abs(candidates[:, None] - points) < 1.5 * LABEL
        labels[edge] = candidates[near.all(axis=-1).sum(axis=-1).argmin()]
    return labels


# -- drawing --------------------------------------------------------------------------------------


def _draw_node(ax: Axes, schema: Schema, node: str, centre: Points, points: float) -> Patch:
    """Draw a node, its name and its gate; return its outline, at which edges end."""
    from matplotlib.patches import Polygon

    (x, y), half, inert = centre, _half_size(node), node in schema.inert
    # A circle, pulled apart as far as the node is wider or higher.
    corner, angle = RADIUS * (0.25 if node == DOOR else 1.0), np.linspace(0, 2 * np.pi, 121)
    circle = np.stack([np.cos(angle), np.sin(angle)], axis=1).round(9)
    outline = Polygon(
        centre + corner * circle + np.sign(circle) * (half - corner),
        facecolor="0.88" if node == DOOR else "white",
        edgecolor="0.35" if inert else "black",
        linewidth=0.032 * points,
        linestyle=(0, (3, 2)) if inert else "-",
        zorder=3,
    )
    ax.add_patch(outline)
    gate = schema.gate(node)
    mark = {"any": "", "all": "all"}.get(gate.kind, f"≥{gate.k}")
    text: Any = {"ha": "center", "va": "baseline", "zorder": 4, "color": outline.get_edgecolor()}
    size = (0.235 if node == DOOR else 0.28) * points
    # Set by the baseline, so that names with and without descenders are level.
    ax.text(x, y - (0.005 if mark else 0.095), node, fontsize=size, **text)
    if mark:
        ax.text(x, y - 0.235, mark, fontsize=0.185 * points, style="italic", **text)
    return outline


# -- text -----------------------------------------------------------------------------------------


def heading(schema: Schema) -> str:
    """The name of a schema, and its title if it has one."""
    return schema.name if schema.title == schema.name else f"{schema.name}: {schema.title}"


def solutions_text(schema: Schema) -> list[str]:
    """Number of solutions of a schema, and a line for each of the first ones."""
    solutions = schema.solutions
    lines = [" ".join([*levers, DOOR]) for levers in solutions[:MOST_SOLUTIONS]]
    if len(solutions) > MOST_SOLUTIONS:
        lines.append(f"and {len(solutions) - MOST_SOLUTIONS} more")
    return [f"{counted(len(solutions), 'solution')}:", *lines]


def schema_text(schema: Schema) -> str:
    """A schema as text: what each lever waits for, what it enables, and what opens the door."""
    place = [*schema.levers, DOOR].index
    order = [*nx.lexicographical_topological_sort(schema.graph, place)]  # the door comes last
    effects = {node: ", ".join(sorted(schema.graph.succ[node], key=place)) for node in order}
    arrows = {node: f"──► {effects[node]}" if effects[node] else "" for node in order}
    width, reach = max(map(len, order)), max(map(len, arrows.values()))
    lines = [heading(schema), ""]
    for node in order:
        does = "unlocks" if node == DOOR else "moves"
        inert = " (inert)" if node in schema.inert else ""
        says = f"{does} {_condition(schema, node)}{inert}"
        lines.append(f"  {node:{width}} {arrows[node]:{reach}}  {says}")
    return "\n".join([*lines, "", "\n  ".join(solutions_text(schema)), ""])


def _condition(schema: Schema, node: str) -> str:
    causes = [
        cause if strength == 1.0 else f"{cause} ({strength:.3g})"
        for cause, strength in zip(schema.causes(node), schema.strengths(node), strict=True)
    ]
    if not causes:
        return "freely"
    if len(causes) == 1:
        return f"while {causes[0]} is pushed"
    verb = "are" if schema.threshold(node) > 1 else "is"
    return f"while {schema.gate(node)} of {', '.join(causes)} {verb} pushed"
