"""Common parts of the figures: their style, their names for things, and how they are saved.

A colour means the same thing in every figure: orange is common cause, dark blue common effect, and
purple, from light to dark, how close an attempt was to the last solution. Each pair also differs
in lightness, so that figures survive colour blindness and a black-and-white printer. All of that is
in a :class:`PlotStyle`, which :func:`plot_style` changes.
"""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import matplotlib.style
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backend_bases import get_registered_canvas_class
from matplotlib.colors import to_rgba_array
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.validation import check_arguments

WIDTH = 7.2  #: width of a full figure in inches: two columns of a printed page

_RC: Any = {
    "font.size": 8.5,
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "axes.titley": 1.0,  # where it is, and need not be searched for
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.grid.axis": "y",
    "axes.axisbelow": True,
    "grid.color": "#E4E4E4",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "xtick.labelsize": 8,
    "ytick.labelsize": 8,
    "hatch.linewidth": 0.6,
    "pdf.fonttype": 42,  # text that journals accept and readers can search
    "svg.hashsalt": "causal-openlock",  # equal figures are equal files
}


@dataclass(frozen=True)
class PlotStyle:
    """How figures look."""

    common_cause: str = "#E69F00"  #: colour of what trains common cause (CC3, CC4)
    common_effect: str = "#00427A"  #: colour of what trains common effect (CE3, CE4)
    others: tuple[str, ...] = ("#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#000000")
    """Colours of other conditions, or of learners in one panel, in turn."""
    categories: tuple[str, ...] = ("#E2E2E2", "#D3C5EA", "#AB8FD3", "#7F55B3", "#4C2483")
    """Colours of the five categories of attempts, from ``else`` to ``open 3``."""
    labels: Mapping[str, str] = field(default_factory=dict)
    """Names to print for learners and conditions, by their own."""
    colors: Mapping[str, str] = field(default_factory=dict)
    """Colours of learners and conditions, and of the titles of learners' own panels, by name."""
    rc: Mapping[str, Any] = field(default_factory=lambda: dict(_RC))
    """Settings of matplotlib (``rcParams``) for figures that are made here: fonts, sizes, line
    widths, grids. Axes that were given keep those that they were made with."""

    def __post_init__(self) -> None:
        """Let matplotlib refuse what is no colour or setting before anything is drawn."""
        own = self.common_cause, self.common_effect, *self.others, *self.categories
        to_rgba_array([*own, *self.colors.values()])
        mpl.RcParams(self.rc)

    def trained(self, condition: str) -> str:
        """Colour of a condition of the paper, by what it trains."""
        usual = self.common_cause if condition.startswith("CC") else self.common_effect
        return self.colors.get(condition, usual)

    def other(self, number: int) -> str:
        """One of the other colours, from the first again after the last."""
        return self.others[number % len(self.others)]

    def line(self, number: int, name: str = "") -> dict[str, Any]:
        """Colour and dashes of one line among many; no two of the first fifteen are alike."""
        dashes = number // len(self.others)
        return {
            "color": self.colors.get(name, self.other(number)),
            "ls": ("-", (0, (4, 1.2)), (0, (1, 1.2)))[dashes % 3],
        }


_style = [PlotStyle()]


def current() -> PlotStyle:
    """The style that figures are drawn in."""
    return _style[-1]


class plot_style:  # noqa: N801 - it is called as a function is
    """Change the style of all figures from now on, or within ``with`` only.

    >>> with plot_style(common_cause="#117733", rc={"font.size": 11}) as style:
    ...     style.common_cause, style.rc["font.size"]
    ('#117733', 11)
    >>> current() == PlotStyle()
    True

    Args:
        style: The style to begin with; by default the one in use. ``PlotStyle()`` is the default.
        changes: Attributes of :class:`PlotStyle` to change; ``rc`` is added to what there is.

    Raises:
        OpenLockError: If there is no such attribute.
        ValueError: If matplotlib has no such colour; KeyError if it has no such setting.
    """

    def __init__(self, style: PlotStyle | None = None, **changes: Any) -> None:
        check_arguments(changes, PlotStyle.__init__, "plot_style")
        self._before = current()
        style = style or self._before
        changes["rc"] = {**style.rc, **changes.get("rc", {})}
        _style[-1] = replace(style, **changes)

    def __enter__(self) -> PlotStyle:
        return current()

    def __exit__(self, *_: object) -> None:
        _style[-1] = self._before


_IDEAL_LOOK: Any = {"color": "#333333", "lw": 1.0, "ls": (0, (4, 2)), "dash_capstyle": "butt"}
_NO_METADATA: dict[str, dict[str, Any]] = {
    "svg": dict.fromkeys(("Date", "Creator", "Format", "Type")),
    "pdf": {"CreationDate": None},
}


@contextmanager
def settings() -> Iterator[None]:
    """Draw, and save, with the settings that all figures share."""
    with mpl.style.context(dict(current().rc), after_reset=True):
        yield
        interactive = mpl.is_interactive()
    mpl.interactive(interactive)  # a notebook's first figure turns it on, for those that follow


MOST_BANDS = 4  #: most learners whose bands are drawn; those of more would cover each other


def label(name: str, most: int = 200) -> str:
    """A name for a figure: without its middle if it is long; ``$`` does not begin mathematics."""
    name = current().labels.get(name, name)
    if len(name) > most:
        name = f"{name[: most // 2]}…{name[len(name) + 1 - most + most // 2 :]}"
    return name.replace("$", r"\$")


def name_places(axes: Axes, places: Sequence[float], names: Sequence[str]) -> None:
    """Name places of the x axis, slanted where names would touch: a letter is 5.2 points wide."""
    axes.get_xlim()  # limits up to date
    x = axes.transData.transform([(place, 0) for place in places])[:, 0] * 72 / axes.figure.dpi
    crowded = (np.diff(x) < 5.2 * max(map(len, names))).any()
    slanted: Any = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"} if crowded else {}
    axes.set_xticks(places, names, **slanted)


def name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Give a panel a row for each name, the first at the top, and lines for its x axis."""
    axes.set_yticks(range(len(names)), [label(name, 28) for name in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    for name, tick in zip(names, axes.get_yticklabels(), strict=False):  # inner panels show none
        tick.set_color(current().colors.get(name, "black"))
    axes.tick_params(axis="y", length=0)
    axes.grid(True, axis="x")


def panel_title(axes: Axes, name: str, detail: str = "") -> None:
    """Name a panel; long names are wrapped, and ``$`` does not begin mathematics."""
    lines = textwrap.wrap(label(name), 26, max_lines=2, placeholder="…") or [name]
    axes.set_title(
        "\n".join(lines), loc="left", pad=6 + 10 * len(detail.splitlines()),
        color=current().colors.get(name, "black"),
    )  # fmt: skip
    if detail:
        axes.annotate(
            label(detail), (0, 1), xytext=(0, 4), xycoords="axes fraction",
            textcoords="offset points", color="#444444", fontsize="medium", annotation_clip=False,
        )  # fmt: skip


def ideal_line(axes: Axes, attempts: float, start: float, end: float) -> None:
    """Draw the ideal observer's mean attempts from one place of the x axis to another.

    Thin, dashed and dark grey, so that no one takes it for data; the gaps are white, which keeps it
    visible on dark bars. It is over bars and under error bars and points.
    """
    axes.add_line(Line2D([start, end], [attempts] * 2, **_IDEAL_LOOK, gapcolor="white", zorder=1.5))


def ideal_key() -> Line2D:
    """The entry of the ideal observer in a legend."""
    return Line2D([], [], **_IDEAL_LOOK, label="ideal observer (schema known)")


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG, PNG or PDF, by the suffix.

    Raises:
        OpenLockError: If it cannot be written.
    """
    write_bytes(path, image(figure, path.suffix.lower()[1:]))


def image(figure: Figure, kind: str, dots: int = 200) -> bytes:
    """The figure as ``svg``, ``png`` (``dots`` per inch) or ``pdf``; equal ones are equal bytes."""
    content = io.BytesIO()
    with settings():
        if kind == "png":
            figure.set_dpi(dots)
        if engine := figure.get_layout_engine():
            engine.execute(figure)
            figure.set_layout_engine("none")
            for axes in figure.axes:  # the solver's last digits are not always the same
                left, low, width, height = (round(edge, 6) for edge in axes.get_position().bounds)
                axes.set_position((left, low, width, height))
        canvas: Any = get_registered_canvas_class(kind)(figure)  # savefig draws it twice
        getattr(canvas, f"print_{kind}")(content, metadata=_NO_METADATA.get(kind))
    return content.getvalue()
