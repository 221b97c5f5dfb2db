"""Section of a report that an analysis makes: text, tables and plots, as data.

The report lays sections out and knows nothing of what is in them. Their sentences come from a
template (:mod:`~causal_openlock.analysis.prose`); their tables
(:mod:`~causal_openlock.analysis.table`) become HTML on the page, and CSV and LaTeX on request
(:mod:`~causal_openlock.analysis.report.page`).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from causal_openlock.analysis.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class SectionPlot:
    """A figure that is shown; its files, where they are wanted, are called ``name``.

    Its name is of lower-case letters, digits and underscores; the caption says what is seen, and
    what the error bars are; the call is the line of Python that makes it again, if there is one.
    One that is ``folded`` is closed on the page until it is opened, and is not printed; ``opening``
    is the figure that the page opens with, if there is one.
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

    Its name is its anchor within the page: letters, digits and underscores. The ``answer`` is the
    sentence of the first screen that it has, if any. A section is closed on the page until it is
    opened, unless it ``is_open``.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[Table, ...] = ()
    plots: tuple[SectionPlot, ...] = ()
    answer: str = ""
    is_open: bool = False
