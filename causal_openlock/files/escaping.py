"""Escaping of untrusted text for terminals and spreadsheets.

A label, a title or the text of an exception can come from anybody's file or learner. A terminal
obeys escape sequences in it, and a spreadsheet takes a cell that begins with ``=`` for a formula.
Here these characters are made readable and harmless.
"""

from __future__ import annotations

import re
import sys
from typing import TYPE_CHECKING

from causal_openlock.errors import OpenLockError

if TYPE_CHECKING:
    import pandas as pd

_CONTROL = re.compile(
    "[\\x00-\\x08\\x0b-\\x1f\\x7f-\\x9f"  # all but tabs and ends of lines
    "\\u061c\\u200e\\u200f\\u2028-\\u202e\\u2066-\\u2069"  # changes of the direction of writing
    "\\ud800-\\udfff]"  # unpaired surrogates, which no encoding has
)
_RETURN = re.compile("\r\n?")
_FORMULA = re.compile(r"[=+\-@\t\n＝＋－＠]")


def printable(text: object) -> str:
    r"""Text for a terminal: control characters are spelled out.

    >>> printable("\x1b[31mred")
    '\\x1b[31mred'
    """

    def spelled(found: re.Match[str]) -> str:
        code = ord(found[0])
        return f"\\x{code:02x}" if code < 256 else f"\\u{code:04x}"

    return _CONTROL.sub(spelled, str(text).replace("\r\n", "\n"))


def cell(text: str) -> str:
    """Text for a cell of a CSV file: formulas get an apostrophe in front (as OWASP recommends).

    >>> cell("=1+1"), cell("-0.5"), cell("CC3-CC4")
    ("'=1+1", '-0.5', 'CC3-CC4')
    """
    text = _RETURN.sub("\n", text)  # Python's csv leaves it unquoted, and it would end the row
    return f"'{text}" if _FORMULA.match(text) and not _is_number(text) else text


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return text.strip() == text


def csv_of(table: pd.DataFrame) -> str:
    """A table as CSV, its texts escaped by :func:`cell`."""
    escaped = table.map(lambda value: cell(value) if isinstance(value, str) else value)
    return escaped.rename(columns=lambda name: cell(str(name))).to_csv(index=False)


def require_utf8(name: str) -> None:
    """Refuse a name that no file of results could say, before hours of work.

    Raises:
        OpenLockError: If a part of the name is not a character.
    """
    try:
        name.encode()
    except UnicodeEncodeError:
        encoding = sys.getfilesystemencoding().upper()
        remedy = "" if encoding == "UTF-8" else "set PYTHONUTF8=1, "
        raise OpenLockError(
            f"the name {printable(name)} is not valid {encoding}, so results could not say it; "
            f"{remedy}rename it, or give another"
        ) from None
