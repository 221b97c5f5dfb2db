"""Section of a report that an analysis makes: text, tables and plots, as data.

The report lays sections out and knows nothing of what is in them. Their sentences stand beside the
numbers that they tell, as f-strings in the topic's own module; their tables
(:mod:`~causal_openlock.analysis.table`) become HTML on the page, and CSV and LaTeX on request
(:mod:`~causal_openlock.analysis.report.page`).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from causal_openlock.analysis.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SectionPlot:
    """A figure that is shown; its files, where they are wanted, are called ``name``.

    The caption says what is seen and what the error bars are; the call is the line of Python that
    makes it again. One that is ``folded`` is closed on the page until it is opened; the page opens
    with the one that is ``opening``.
    """

    name: str
    title: str
    caption: str
    figure: Figure
    call: str = ""
    folded: bool = False
    opening: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the report: paragraphs that say what was found, then tables, then plots.

    Its name is its anchor within the page. The ``answer`` is its sentence on the first screen. A
    section is closed on the page until it is opened, unless it ``is_open``.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    plots: tuple[SectionPlot, ...] = ()
    answer: str = ""
    is_open: bool = False


def sentences(*parts: str) -> str:
    """Join sentences, or captions, that are not empty, into a paragraph.

    >>> sentences("Means over subjects.", "" if True else "Bands: intervals.", "n = 3.")
    'Means over subjects. n = 3.'
    """
    return " ".join(filter(None, parts))


def drawn(
    name: str,
    function: Callable[..., Any],
    data: Any,
    title: str,
    caption: str,
    call: str | None = None,
    **options: Any,
) -> SectionPlot:
    """Draw a figure for a section, by a function that takes the data and an empty figure as ``ax``.

    The ``call``, which makes the figure again, is by default that of ``results.plot``.
    """
    from matplotlib.figure import Figure

    figure = Figure()
    function(data, **options, ax=figure)
    if call is None:
        given = ", ".join(f"{key}={value!r}" for key, value in options.items())
        call = f"results.plot.{function.__name__.removeprefix('plot_')}({given})"
    return SectionPlot(name, title, caption, figure, call)
