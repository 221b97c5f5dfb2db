"""The terminal: the one place where text leaves for it.

Labels, titles and what exceptions say may come from anybody. So a console prints text as it is:
nothing in it is markup (``[bold]``), an emoji's name or an escape sequence. What is to look
different gets a style, or is a :class:`rich.text.Text` of our own words. :func:`say` and
:func:`complain` are for whole lines without any look.
"""

from __future__ import annotations

import sys
from typing import Any

from rich.console import Console as RichConsole
from rich.table import Table
from rich.text import Text

from causal_openlock.files.escaping import printable

MOST_COLUMNS = 1000
"""How wide a table may become that is wider than the terminal."""


class Console(RichConsole):
    """A console that prints text as it is; see the module."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text as it is shown, also in tables."""
        return super().render_str(printable(text), **options)

    def print_whole(self, table: Table) -> None:
        """Print a table with all its columns, wider than the terminal if it must be."""
        # A column that is cut off would be lost; a line that wraps is only ugly.
        wide = self.measure(table, options=self.options.update(max_width=MOST_COLUMNS))
        usual = self.width
        self.width = max(usual, wide.maximum)
        self.print(table, crop=False)
        self.width = usual


def say(text: object = "", *, error: bool = False, end: str = "\n") -> None:
    """Print text on standard output, or on standard error."""
    print(printable(text), end=end, file=sys.stderr if error else sys.stdout)


def complain(message: str) -> None:
    """Say on standard error what is wrong, line by line."""
    for line in printable(message).split("\n"):
        say(f"error: {line}", error=True)
