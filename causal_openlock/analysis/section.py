"""What an analysis hands to the report: a section of text, tables and plots, as data.

The report lays sections out and knows nothing of what is in them. Their sentences come from a
template (:mod:`~causal_openlock.analysis.prose`); their tables become HTML on the page, CSV
and LaTeX beside it (:mod:`~causal_openlock.analysis.report.page`).
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import pandas as pd

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def printed(value: Any, form: str | None) -> str:
    """A value as the page prints it.

    Args:
        value: Anything; ``None`` and NaN are no value.
        form: As for :func:`format`; by default as text.
    """
    if value is None or (isinstance(value, float) and value != value) or value is pd.NA:
        return "–"
    if isinstance(value, bool) or type(value).__name__ == "bool":  # NumPy has a bool of its own
        return "yes" if value else "no"
    if isinstance(value, int | float) or form:
        text = format(value + 0.0 if isinstance(value, float) else value, form or "")
        if form and re.fullmatch(r"-0*\.?0*%?", text):
            text = text[1:]  # a minus that nothing is left of
        return text.replace("-", "−", 1) if text.startswith("-") else text.replace("e-", "e−")
    return str(value)


@dataclass(frozen=True)
class SectionTable:
    """A table that is shown, and kept as a file.

    Attributes:
        name: File name without ending.
        title: What it is.
        frame: Its values as they were computed, unrounded; columns are headed by their names.
        formats: How to print a column (``.2f``, ``+.2f``, ``.1%``, ``,``); others as text.
        caption: What a reader needs to know, in whole sentences.
    """

    name: str
    title: str
    frame: pd.DataFrame
    formats: Mapping[str, str] = field(default_factory=dict)
    caption: str = ""

    @property
    def heads(self) -> list[str]:
        """What is over the columns: their names, in words."""
        return [str(name).replace("_", " ") for name in self.frame.columns]

    @property
    def numeric(self) -> list[bool]:
        """Which columns hold numbers, and are set to the right."""
        return [
            str(name) in self.formats
            or (pd.api.types.is_numeric_dtype(kind) and not pd.api.types.is_bool_dtype(kind))
            for name, kind in self.frame.dtypes.items()
        ]

    @cached_property
    def rows(self) -> list[list[str]]:
        """The values as they are printed, row by row."""
        columns = [
            [printed(value, self.formats.get(str(name))) for value in self.frame[name].tolist()]
            for name in self.frame.columns
        ]
        return [list(row) for row in zip(*columns, strict=True)]


@dataclass(frozen=True)
class SectionPlot:
    """A figure that is shown, and kept as files called ``name``.

    Its name is of lower-case letters, digits and underscores; the caption says what is seen, and
    what the error bars are; the call is the line of Python that makes it again, if there is one.
    One that is ``folded`` is closed on the page until it is opened, and is not printed.
    """

    name: str
    title: str
    caption: str
    figure: Figure
    call: str = ""
    folded: bool = False


@dataclass(frozen=True)
class Section:
    """A part of the report: paragraphs that say what was found, then tables, then plots.

    Its name is its anchor within the page: letters, digits and underscores.
    """

    name: str
    title: str
    text: tuple[str, ...] = ()
    tables: tuple[SectionTable, ...] = ()
    plots: tuple[SectionPlot, ...] = ()
