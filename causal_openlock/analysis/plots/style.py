"""What the figures have in common: colours, panels, and how they are saved.

A colour means the same thing in every figure: orange is common cause, dark blue common effect, and
purple, from light to dark, how close an attempt came to the last solution. Each pair also differs
in lightness, so that figures survive colour blindness and a black-and-white printer.
"""

from __future__ import annotations

import io
import math
import textwrap
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_pdf import FigureCanvasPdf
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from causal_openlock.experiment.record import CATEGORIES
from causal_openlock.files.atomic import write_bytes

COMMON_CAUSE, COMMON_EFFECT = "#E69F00", "#00427A"
OTHER = ("#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
CATEGORY_COLOURS = dict(
    zip(CATEGORIES, ("#E2E2E2", "#D3C5EA", "#AB8FD3", "#7F55B3", "#4C2483"), strict=True)
)
CATEGORY_NAMES = dict(
    zip(CATEGORIES, ("else", "unlock", "open 1", "open 2", "open 3"), strict=True)
)

IDEAL = "ideal observer (schema known)"
"""What figures call the bound of :mod:`~causal_openlock.analysis.results.bounds`, a line in
them."""

WIDTH = 7.2
"""Width of a full figure in inches: two columns of a printed page."""

KINDS = ("png", "pdf")
"""What a figure is written as, beside SVG."""

_SETTINGS: Any = {
    "font.family": "DejaVu Sans",  # comes with matplotlib
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.linewidth": 0.8,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "legend.fontsize": 8.5,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "hatch.linewidth": 0.6,
    "figure.facecolor": "white",
    "svg.fonttype": "path",  # looks the same wherever it is opened
    "pdf.fonttype": 42,  # text that journals accept and readers can search
    "svg.hashsalt": "causal-openlock",  # equal figures are equal files
}
_IDEAL_LOOK: Any = {"color": "#333333", "lw": 1.0, "ls": (0, (4, 2)), "dash_capstyle": "butt"}
_NO_PDF_METADATA: dict[str, Any] = dict.fromkeys(("CreationDate", "Creator", "Producer"))
_NO_METADATA: dict[str, Any] = dict.fromkeys(("Date", "Creator", "Format", "Type"))


@dataclass(frozen=True)
class Plot:
    """A figure, and what a caption needs to know about it.

    Attributes:
        kind: What it shows, such as ``attempts_by_trial``; the report has a title and a caption
            for each kind.
        figure: The figure.
        name: For files: lower-case letters, digits and underscores; by default ``kind``.
        facts: What its caption depends on.
    """

    kind: str
    figure: Figure
    name: str = ""
    facts: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "name", self.name or self.kind)


@contextmanager
def settings() -> Iterator[None]:
    """Draw, and save, with the settings that all figures share."""
    with mpl.rc_context():
        mpl.rcdefaults()
        mpl.rcParams.update(_SETTINGS)
        yield


def panels(count: int, columns: int, height: float) -> tuple[Figure, list[Axes]]:
    """A figure of so many panels with a common y axis, wrapped over rows of at most ``columns``.

    A panel has a height in inches; only the first of a row has labels on its y axis.
    """
    rows = math.ceil(count / columns)
    columns = math.ceil(count / rows)  # four panels are two and two, not three and one
    width = WIDTH if columns > 1 else 0.62 * WIDTH
    figure = Figure(figsize=(width, rows * height + 0.5), layout="constrained")
    grid = figure.subplots(rows, columns, sharey=True, squeeze=False).ravel().tolist()
    for unused in grid[count:]:
        unused.remove()
    for axes in grid[:count]:
        axes.tick_params(axis="x", length=0)
    return figure, grid[:count]


def small_multiples(
    shown: Sequence[tuple[str, str, Any]],
    draw: Callable[[Axes, Any], None],
    layout: tuple[int, float, str],
    keys: Sequence[Any],
) -> Figure:
    """A figure of titled panels that are drawn alike, with one legend.

    Args:
        shown: Of each panel its title, a detail in small type, and the data that ``draw`` draws.
        draw: Draws such data into a panel.
        layout: The most panels in a row, their height in inches, and the label of the y axis.
        keys: Entries of the legend.
    """
    columns, height, label = layout
    with settings():
        figure, grid = panels(len(shown), columns, height)
        for axes, (name, detail, data) in zip(grid, shown, strict=True):
            draw(axes, data)
            panel_title(axes, name, detail)
            if axes.get_subplotspec().is_first_col():  # type: ignore[union-attr]
                axes.set_ylabel(label)
        legend(figure, keys)
    return figure


def trained_colour(condition: str) -> str:
    """Colour of a condition of the paper, by what it trains: common cause or common effect."""
    return COMMON_CAUSE if condition.startswith("CC") else COMMON_EFFECT


def sizes(rows: pd.DataFrame) -> str:
    """How many subjects rows of means are of: ``n = 40``, or ``n = 20 to 40`` if they differ."""
    low, high = int(rows["subjects"].min()), int(rows["subjects"].max())
    return f"n = {low}" if low == high else f"n = {low} to {high}"


def label(name: str, most: int = 200) -> str:
    """A name for a figure: without its middle if it is long; ``$`` is no mathematics here."""
    if len(name) > most:
        name = f"{name[: most // 2]}…{name[len(name) + 1 - most + most // 2 :]}"
    return name.replace("$", r"\$")


def panel_title(axes: Axes, name: str, detail: str = "") -> None:
    """Name a panel; long names are wrapped, and ``$`` is no mathematics here."""
    lines = textwrap.wrap(name, 26, max_lines=2, placeholder="…") or [name]
    axes.set_title(label("\n".join(lines)), loc="left", pad=16 if detail else 6)
    if detail:
        axes.annotate(
            label(detail), (0, 1), xytext=(0, 4), xycoords="axes fraction",
            textcoords="offset points", color="#444444", fontsize=8,
        )  # fmt: skip


def ideal_line(axes: Axes, attempts: float, start: float, end: float) -> None:
    """Draw the ideal observer's mean attempts from one place of the x axis to another.

    Thin, dashed and dark grey, so that no one takes it for data; the gaps are white, which keeps it
    visible on dark bars. It is over bars and under error bars and points.
    """
    axes.add_line(Line2D([start, end], [attempts] * 2, **_IDEAL_LOOK, gapcolor="white", zorder=1.5))


def ideal_key() -> Line2D:
    """The entry of the ideal observer in a legend."""
    return Line2D([], [], **_IDEAL_LOOK, label=IDEAL)


def legend(figure: Figure, handles: Sequence[Any], columns: int | None = None) -> None:
    """A legend above all panels."""
    figure.legend(
        handles=list(handles),
        loc="outside upper left",
        ncols=columns or len(handles),
        handlelength=1.6,
        columnspacing=1.4,
    )


def save(figure: Figure, stem: Path) -> str:
    """Write ``stem.png`` (200 dots per inch), ``.svg`` and ``.pdf``; equal figures, equal bytes.

    Returns:
        The SVG.

    Raises:
        OpenLockError: If they cannot be written.
    """
    _settle(figure)
    for kind in KINDS:
        write_bytes(stem.with_name(f"{stem.name}.{kind}"), image(figure, kind))
    svg = image(figure, "svg")
    write_bytes(stem.with_name(f"{stem.name}.svg"), svg)
    return svg.decode()


def _settle(figure: Figure) -> None:
    """Lay the figure out once for all.

    The solver of the layout ends within rounding of the same places, and not always on the same
    side of it: rounding its result is what makes equal figures equal byte for byte.
    """
    with settings():
        figure.draw_without_rendering()
    figure.set_layout_engine("none")
    for axes in figure.axes:
        left, bottom, width, height = (round(edge, 6) for edge in axes.get_position().bounds)
        axes.set_position((left, bottom, width, height))


def image(figure: Figure, kind: str) -> bytes:
    """The figure as ``svg``, ``png`` (200 dots per inch) or ``pdf``, without a date.

    It is drawn once; ``savefig`` would do it twice, in case the layout changes.
    """
    content = io.BytesIO()
    canvas: Any
    with settings():
        if kind == "png":
            figure.set_dpi(200)
            canvas = FigureCanvasAgg(figure)
            canvas.print_png(content, metadata={"Software": None})
        elif kind == "pdf":
            canvas = FigureCanvasPdf(figure)
            canvas.print_pdf(content, metadata=_NO_PDF_METADATA)
        else:
            canvas = FigureCanvasSVG(figure)
            canvas.print_svg(content, metadata=_NO_METADATA)
    return content.getvalue()
