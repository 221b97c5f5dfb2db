"""A table, in every form in which it is shown or stored: HTML, text, Markdown, LaTeX, CSV.

Numbers stay numbers until they are printed, in one place (:func:`printed`): on a page and in LaTeX
as a column asks for, in a CSV file as they were computed. A cell of text may have further lines,
which a page sets in small type.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from markupsafe import Markup, escape

from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import csv_of

LONG_TEXT = 40  #: cells of more characters than this are wrapped
MANY_COLUMNS = 9  #: tables of more columns than this are set smaller


@dataclass(frozen=True)
class Table:
    """A table that is shown.

    >>> frame = pd.DataFrame({"learner": ["bayes"], "mean_attempts": [3.751]})
    >>> table = Table("attempts", "Attempts", frame)
    >>> table.heads, table.rows
    (['learner', 'mean attempts'], [['bayes', '3.75']])
    """

    name: str  #: of its files, without ending
    title: str
    frame: pd.DataFrame  #: its values as they were computed; columns are headed by their names
    formats: Mapping[str, str] = field(default_factory=dict)
    """How to print a column (``+.2f``, ``.1%``; ``s`` sets text to the right, as numbers are); by
    default numbers have two decimals, or none if they are whole."""
    caption: str = ""  #: what a reader needs to know, in whole sentences
    looks: Mapping[int, str] = field(default_factory=dict)  #: a row's class of the page's style
    verbatim: bool = False  #: whether columns are headed as they are, and not with spaces for ``_``

    @property
    def heads(self) -> list[str]:
        """Heads of the columns: their names, in words."""
        names = [str(name) for name in self.frame.columns]
        return names if self.verbatim else [name.replace("_", " ") for name in names]

    @cached_property
    def numeric(self) -> list[bool]:
        """Whether each column holds numbers, and is set to the right."""
        return [
            str(name) in self.formats
            or (pd.api.types.is_numeric_dtype(kind) and not pd.api.types.is_bool_dtype(kind))
            for name, kind in self.frame.dtypes.items()
        ]

    @cached_property
    def rows(self) -> list[list[str]]:
        """The values as they are printed, row by row."""
        columns = [
            [printed(value, self.formats.get(str(name))) for value in values.tolist()]
            for name, values in self.frame.items()  # names may be there twice
        ]
        return [list(row) for row in zip(*columns, strict=True)]

    def html(self, look: str = "data") -> Markup:
        """Return it as HTML, of a class of the page's style; names may break after a ``_``."""

        def entry(text: str, column: int, start: str = "td") -> str:
            kind = "" if self.numeric[column] else ' class="name"'
            if kind and start == "td" and len(text) > LONG_TEXT:
                kind = ' class="text"'
            first, *rest = str(escape(text)).replace("_", "_<wbr>").split("\n")
            small = "".join(f"<small>{line}</small>" for line in rest)
            return f"<{start}{kind}>{first}{small}</{start[:2]}>"

        heads = "".join(entry(text, at, 'th scope="col"') for at, text in enumerate(self.heads))
        lines = []
        for number, (name, *values) in enumerate(self.rows):
            mark = f' class="{self.looks[number]}"' if number in self.looks else ""
            cells = "".join(entry(text, at) for at, text in enumerate(values, start=1))
            head = entry(name, 0, 'th scope="row"')
            lines.append(f"<tr{mark}>{head}{cells}</tr>\n")
        wide = " wide" if len(self.heads) > MANY_COLUMNS else ""
        return Markup(
            f'<table class="{look}{wide}">\n<thead><tr>{heads}</tr></thead>\n'
            f"<tbody>\n{''.join(lines)}</tbody></table>"
        )

    def latex(self) -> str:
        """Return it as LaTeX, with the rules of the package booktabs."""
        rows = [[text.replace("\n", " ") for text in row] for row in self.rows]
        heads = [text.replace("\n", " ") for text in self.heads]
        caption = " ".join(filter(None, [f"{self.title.rstrip('.')}.", self.caption]))
        return pd.DataFrame(rows, columns=heads).to_latex(
            index=False,
            escape=True,
            column_format="".join("r" if number else "l" for number in self.numeric),
            caption=re.sub(r"[&%$#_{}]", r"\\\g<0>", caption),
            label=f"tab:{self.name}",
        )


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A Markdown table.

    >>> print(markdown(["a", "b"], [["1", "2"]]))
    | a | b |
    |---|---|
    | 1 | 2 |
    """

    def line(cells: Sequence[str]) -> str:
        texts = [re.sub(r"\s*\n\s*", " ", text).replace("|", "\\|") for text in cells]
        return f"| {' | '.join(texts)} |"

    return "\n".join([line(head), "|" + "---|" * len(head), *map(line, rows)])


def records(table: pd.DataFrame) -> list[dict[str, Any]]:
    """Rows as mappings, with None for what does not exist."""
    return table.astype(object).where(table.notna(), None).to_dict("records")


def write_table(table: pd.DataFrame, path: Path | str) -> None:
    """Write a table of results as CSV; equal data give equal bytes.

    Numbers have at most six significant digits and lines end in a line feed, so that two runs of an
    experiment can be compared byte for byte. A value that does not exist is left empty.

    Raises:
        OpenLockError: If it cannot be written; a file that was there stays as it was.
    """

    def stored(value: Any) -> Any:
        return f"{value + 0.0:.6g}" if isinstance(value, float) else value  # + 0.0: no minus zero

    write_text(path, csv_of(table.map(stored, na_action="ignore")))


def printed(value: Any, form: str | None) -> str:
    """A value as the page prints it, in a form of :func:`format`; None and NaN are a dash."""
    if value is None or (isinstance(value, float) and value != value) or value is pd.NA:
        return "–"
    if isinstance(value, bool | np.bool):
        return "yes" if value else "no"
    if isinstance(value, int | float) or form:
        form = form or (".2f" if isinstance(value, float) else ",")
        text = format(value + 0.0 if isinstance(value, float) else value, form)
        if re.fullmatch(r"-0*\.?0*%?", text):
            text = text[1:]  # a minus that nothing is left of
        return text.replace("-", "−", 1) if text.startswith("-") else text.replace("e-", "e−")
    return str(value)


def p_value(p: float) -> str:
    """A p as papers print it.

    >>> p_value(0.0312), p_value(0.0001), p_value(1.0)
    ('.031', '< .001', '1')
    """
    if np.isnan(p):
        return "–"
    return "< .001" if p < 0.001 else f"{p:.3f}".removeprefix("0").replace("1.000", "1")


def number(attempts: float) -> str:
    """Attempts as tables print them.

    >>> number(3.7512), number(150.2)
    ('3.75', '150')
    """
    return f"{attempts:.2f}" if attempts < 100 else f"{attempts:,.0f}"


def share(value: float) -> str:
    """A share as tables print it: 0% is none and 100% is all.

    >>> share(0.125), share(0.001), share(0.999), share(1.0)
    ('12%', '<1%', '>99%', '100%')
    """
    return "<1%" if 0 < value < 0.01 else ">99%" if 0.99 < value < 1 else f"{value:.0%}"
