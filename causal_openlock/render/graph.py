"""A schema as a figure in the style of the paper's Figure 1, or as text.

The figure is drawn with matplotlib's objects and without pyplot, so drawing leaves no state
behind. Where things go is worked out in :mod:`causal_openlock.render.arrange`, in units; the size
of the axes decides how large a unit is drawn, and type and lines grow with it.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import networkx as nx
import numpy as np

from causal_openlock.files.atomic import replacing
from causal_openlock.render.arrange import RADIUS, Arrangement, arrange
from causal_openlock.render.suffixes import path_of_picture
from causal_openlock.schemas.schema import DOOR, Schema
from causal_openlock.wording import counted

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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
    drawing = arrange(schema)
    left, right, bottom, top = drawing.limits
    width, height = right - left, top - bottom
    if ax is None:
        from matplotlib.figure import Figure

        inches = min(INCHES, LARGEST / max(width, height))
        ax = Figure(figsize=(width * inches, height * inches)).add_axes((0, 0, 1, 1))
    ax.set_axis_off()
    ax.set(xlim=(left, right), ylim=(bottom, top), aspect="equal")
    box = ax.get_window_extent()
    points = min(box.width / width, box.height / height) * 72 / ax.get_figure(root=True).dpi  # type: ignore[union-attr]
    _draw_edges(ax, schema, drawing, points)
    _draw_nodes(ax, schema, drawing, points)
    return ax


def save_schema_figure(schema: Schema, path: Path | str) -> None:
    """Draw a schema into a file, which is replaced in one step.

    Args:
        schema: What to draw.
        path: A name that ends in ``.png``, ``.svg`` or ``.pdf``. Text in SVG and PDF stays text,
            and the same schema gives the same file.

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


# -- drawing --------------------------------------------------------------------------------------


def _draw_edges(ax: Axes, schema: Schema, drawing: Arrangement, points: float) -> None:
    from matplotlib.patches import FancyArrowPatch
    from matplotlib.path import Path as Line

    for (_, effect), line in drawing.edges.items():
        inert = effect in schema.inert
        ax.add_patch(
            FancyArrowPatch(
                path=Line(line),
                arrowstyle="-|>,head_width=0.2,head_length=0.4",
                mutation_scale=0.32 * points,
                linewidth=0.028 * points,
                linestyle=(0, (4, 2.5)) if inert else "-",
                color="0.35" if inert else "black",
                shrinkA=0,
                shrinkB=0,
                joinstyle="miter",
                zorder=1,
            )
        )
    for edge, at in drawing.labels.items():
        ax.text(
            at[0],
            at[1],
            f"{schema.graph.edges[edge]['strength']:.2g}",
            fontsize=0.19 * points,
            ha="center",
            va="center",
            zorder=2,
            bbox={"boxstyle": "square,pad=0.08", "facecolor": "white", "edgecolor": "none"},
        )


def _draw_nodes(ax: Axes, schema: Schema, drawing: Arrangement, points: float) -> None:
    from matplotlib.patches import FancyBboxPatch, Polygon

    for node, half in drawing.half_width.items():
        x, y = drawing.centre[node]
        inert = node in schema.inert
        style: Any = {
            "edgecolor": "0.35" if inert else "black",
            "linewidth": 0.032 * points,
            "linestyle": (0, (3, 2)) if inert else "-",
            "zorder": 3,
        }
        if node == DOOR:
            corner, side = (x - RADIUS, y - RADIUS), 2 * RADIUS
            box = f"round,pad=0,rounding_size={0.25 * RADIUS}"
            ax.add_patch(
                FancyBboxPatch(corner, side, side, boxstyle=box, facecolor="0.88", **style)
            )
        else:
            # A circle, pulled apart in the middle where the name is long.
            angle = np.linspace(0, 2 * np.pi, 121)
            outline = RADIUS * np.stack([np.cos(angle), np.sin(angle)], axis=1)
            outline[:, 0] += np.sign(outline[:, 0].round(9)) * (half - RADIUS)
            outline += drawing.centre[node]
            ax.add_patch(Polygon(outline, facecolor="white", **style))
        gate = _gate_mark(schema, node)
        text: Any = {"ha": "center", "zorder": 4, "color": "0.35" if inert else "black"}
        size = (0.235 if node == DOOR else 0.28) * points
        # Set by the baseline, so that names with and without descenders are level.
        ax.text(x, y - 0.095 + (0.09 if gate else 0), node, fontsize=size, va="baseline", **text)
        if gate:
            style = {"fontsize": 0.185 * points, "style": "italic", "va": "baseline"}
            ax.text(x, y - 0.235, gate, **style, **text)


def _gate_mark(schema: Schema, node: str) -> str:
    gate = schema.gate(node)
    return {"any": "", "all": "all"}.get(gate.kind, f"≥{gate.k}")


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
    order = [node for node in nx.lexicographical_topological_sort(
        schema.graph, key=[*schema.levers, DOOR].index) if node != DOOR]  # fmt: skip
    lines = [heading(schema), ""]
    effects = {
        node: sorted(schema.graph.successors(node), key=[*schema.levers, DOOR].index)
        for node in order
    }
    width = max(len(node) for node in [*order, DOOR])
    arrows = {node: f"──► {', '.join(effects[node])}" if effects[node] else "" for node in order}
    reach = max(len(arrow) for arrow in arrows.values())
    for node in order:
        inert = " (inert)" if node in schema.inert else ""
        says = f"moves {_condition(schema, node)}{inert}"
        lines.append(f"  {node:{width}} {arrows[node]:{reach}}  {says}")
    lines.append(f"  {DOOR:{width}} {'':{reach}}  unlocks {_condition(schema, DOOR)}")
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
