"""Untrusted text made harmless: escape sequences in a terminal, formulas in a spreadsheet."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import pandas as pd

_CONTROL = re.compile(
    "[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f"  # all but tabs and ends of lines
    "\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069"  # changes of the direction of writing
    "\\ud800-\\udfff]"  # unpaired surrogates, which no encoding has
)


def printable(text: object) -> str:
    r"""Text for a terminal: control characters are spelled out.

    >>> printable("\x1b[31mred")
    '\\x1b[31mred'
    """
    text = str(text).replace("\r\n", "\n")
    return _CONTROL.sub(lambda control: ascii(control[0])[1:-1], text)


def cell(text: str) -> str:
    """Text for a cell of a CSV file: formulas get an apostrophe in front (as OWASP recommends).

    >>> cell("=1+1"), cell("-0.5"), cell("CC3-CC4")
    ("'=1+1", '-0.5', 'CC3-CC4')
    """
    text = re.sub("\r\n?", "\n", text)  # Python's csv leaves it unquoted, and it would end the row
    is_number = re.fullmatch(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?|[+-](inf|nan)", text)
    return f"'{text}" if text.startswith(tuple("=+-@\t\n＝＋－＠")) and not is_number else text


def csv_of(table: pd.DataFrame) -> str:
    """A table as CSV, its texts escaped by :func:`cell`."""
    escaped = table.map(lambda value: cell(value) if isinstance(value, str) else value)
    escaped = escaped.rename(columns=lambda name: cell(str(name)))
    return escaped.to_csv(index=False, lineterminator="\n")
