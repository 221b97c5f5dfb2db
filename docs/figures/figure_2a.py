"""The room of the paper's Figure 2a beside ours: ``python docs/figures/figure_2a.py``.

Left is the paper's room, redrawn with plain patches from what was measured in the published figure
(the numbers below), right the frame that ``render()`` gives of the same room in the same posture.
The two share no code and no numbers; ``tests/test_figure_2a.py`` lays one over the other.
"""

from __future__ import annotations

import math
from itertools import pairwise
from pathlib import Path
from typing import Any

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Polygon, Rectangle

# Measured in the published figure, in arm links of 187.45 pixels; the arm's base is at (0, 0).
LEVERS = {
    "UPPERRIGHT": (2.2, 2.2),
    "UPPER": (0.0, 3.0),
    "UPPERLEFT": (-2.2, 2.2),
    "LEFT": (-3.0, 0.0),
    "LOWERLEFT": (-2.2, -2.2),
    "LOWER": (0.0, -3.0),
    "LOWERRIGHT": (2.2, -2.2),
}
ACTIVE = ("UPPER", "LEFT", "LOWER")
BAR_LENGTH, WIDTH, TRACK_OUTSIDE = 2.0, 0.2, 0.4
JOINTS = [(0.0, 0.0), (-1.0, 0.0), (-1.0, -1.0), (0.0, -1.0), (1.0, -1.0), (1.0, 0.0)]
HINGE, LOCK = (3.6, 1.0), (3.6, -1.0)
BUTTON, BUTTON_SIDE = (4.2, 1.6), 0.61
GREY, LIGHT, GREEN, RED = "#999999", "#e5e5e5", "#50eb6f", "#ff0000"
# Not measured: how thick the dots and the outlines are.
DOT, HINGE_DOT, TIP, LOCK_DOT, LINE = 0.1, 0.12, 0.13, 0.15, 0.025

LAYOUT = "trial2"
"""The layout whose active levers are those of the figure."""
CALL_OUT = {"fontsize": 8.5, "fontweight": "bold"}


def redraw(axes: Axes, view: tuple[float, float, float, float]) -> None:
    """The measured room.

    Args:
        axes: What to draw into.
        view: What part of the plane is shown: left, right, bottom, top.
    """
    left, right, bottom, top = view
    axes.set_xlim(left, right)
    axes.set_ylim(bottom, top)
    axes.set_aspect("equal")
    axes.axis("off")
    # Lines are as thick as they are in the room, whatever the size of the figure.
    points = axes.get_window_extent().width / axes.figure.dpi * 72 / (right - left)
    style: dict[str, Any] = {"edgecolor": "black", "linewidth": LINE * points}
    axes.add_patch(
        Rectangle(
            (BUTTON[0] - BUTTON_SIDE / 2, BUTTON[1] - BUTTON_SIDE / 2),
            BUTTON_SIDE,
            BUTTON_SIDE,
            facecolor=GREEN,
            **style,
        )
    )
    for name, (x, y) in LEVERS.items():
        fill = GREY if name in ACTIVE else LIGHT
        out = x / math.hypot(x, y), y / math.hypot(x, y)
        across = -out[1], out[0]
        # The track shows outside the bar and is parted in the middle of the way.
        inner, outer = -WIDTH / 2 + LINE, WIDTH / 2 + TRACK_OUTSIDE
        middle = (-WIDTH / 2 + outer) / 2
        for low, high in ((inner, middle), (middle, outer)):
            corners = _corners((x, y), out, across, low, high, WIDTH / 2)
            axes.add_patch(Polygon(corners, facecolor=fill, **style))
        corners = _corners((x, y), out, across, -WIDTH / 2, WIDTH / 2, BAR_LENGTH / 2)
        axes.add_patch(Polygon(corners, facecolor=fill, **style))
    axes.add_patch(
        Rectangle(
            (LOCK[0] - WIDTH / 2, LOCK[1]), WIDTH, HINGE[1] - LOCK[1], facecolor=GREY, **style
        )
    )
    thin = {**style, "linewidth": style["linewidth"] / 2}
    axes.add_patch(Circle(HINGE, HINGE_DOT, facecolor=RED, **thin))
    axes.add_patch(Circle(LOCK, LOCK_DOT, facecolor="black", linewidth=0))
    for start, end in pairwise(JOINTS):
        axes.add_patch(Polygon(_link(start, end), facecolor=GREY, **style))
    for joint in JOINTS[:-1]:
        axes.add_patch(Circle(joint, DOT, facecolor=RED, **thin))
    axes.add_patch(Circle(JOINTS[-1], TIP, facecolor=GREY, **style))


def call_out(axes: Axes) -> None:
    """The figure's call-outs: boxes around a lever, the arm and the door, and the button's name."""
    boxes = [
        ("Lever", "#00246b", (-1.18, 2.72), 2.36, 1.0, (-1.3, 3.45), "right"),
        ("Arm", "#b00000", (-1.32, -1.32), 2.64, 1.64, (0.0, 0.45), "center"),
        ("Door", "#00703c", (3.37, -1.32), 0.46, 2.54, (3.6, -1.72), "center"),
    ]
    for text, ink, corner, wide, high, at, side in boxes:
        style: dict[str, Any] = {"edgecolor": ink, "linestyle": (0, (4, 2)), "linewidth": 1.3}
        axes.add_patch(Rectangle(corner, wide, high, fill=False, **style))
        axes.text(*at, text, color=ink, ha=side, **CALL_OUT)
    axes.text(4.2, 2.08, "Door button", color="black", ha="center", **CALL_OUT)


def _corners(
    at: tuple[float, float],
    out: tuple[float, float],
    across: tuple[float, float],
    low: float,
    high: float,
    half: float,
) -> list[tuple[float, float]]:
    places = [(low, -half), (high, -half), (high, half), (low, half)]
    return [
        (at[0] + u * out[0] + v * across[0], at[1] + u * out[1] + v * across[1]) for u, v in places
    ]


def _link(start: tuple[float, float], end: tuple[float, float]) -> list[tuple[float, float]]:
    """A bar with round ends."""
    heading = math.atan2(end[1] - start[1], end[0] - start[0])
    points = []
    for (x, y), turn in ((end, -math.pi / 2), (start, math.pi / 2)):
        for step in range(19):
            angle = heading + turn + math.pi * step / 18
            points.append((x + WIDTH / 2 * math.cos(angle), y + WIDTH / 2 * math.sin(angle)))
    return points


def our_frame(size: int) -> tuple[Any, tuple[float, float, float, float]]:
    """Our picture of the same room and posture.

    Args:
        size: Its height in pixels.

    Returns:
        ``[size, width, 3]`` red, green, blue, and what part of the plane it shows.
    """
    import gymnasium

    import causal_openlock
    from causal_openlock.render.scene import frame

    env = gymnasium.make(
        causal_openlock.ENV_ID,
        schema="CC3",
        layout=LAYOUT,
        physics=True,
        render_mode="rgb_array",
        render_size=size,
    )
    env.reset(seed=0)
    shown = frame(7, size)
    right, bottom = shown.left + shown.width / shown.scale, shown.top - size / shown.scale
    return env.render(), (shown.left, right, bottom, shown.top)


def side_by_side(size: int = 1000) -> Figure:
    """Both, as a figure.

    Args:
        size: Height of our frame in pixels.
    """
    picture, view = our_frame(size)
    wide = (view[1] - view[0]) / (view[3] - view[2])
    high = 3.1
    figure = Figure(figsize=(2 * wide * high + 0.3, high + 0.35), dpi=200)
    FigureCanvasAgg(figure)
    part = wide * high / (2 * wide * high + 0.3)
    titles = ("Figure 2a, redrawn from measurements", "causal_openlock, the frame of render()")
    for left, title in zip((0.0, 1 - part), titles, strict=True):
        axes = figure.add_axes((left, 0, part, high / (high + 0.35)))
        axes.set_title(title, fontsize=9, pad=4)
        if left:
            axes.imshow(picture, extent=view, interpolation="lanczos")
            axes.axis("off")
        else:
            redraw(axes, view)
            call_out(axes)
    return figure


def main() -> None:
    """Write the figure, as SVG and PNG."""
    import matplotlib as mpl

    folder = Path(__file__).parent
    with mpl.rc_context({"svg.hashsalt": "figure_2a", "svg.fonttype": "none"}):
        side_by_side(900).savefig(folder / "figure_2a_beside_ours.svg", metadata={"Date": None})
    side_by_side().savefig(folder / "figure_2a_beside_ours.png")


if __name__ == "__main__":
    main()
