"""Tables, styles and status lines on the terminal, by rich.

It takes a while to load, so commands import it when they run. Text is printed as it is: nothing in
it is markup (``[bold]``), an emoji's name or an escape sequence. A style is given with the text,
or with a :class:`rich.text.Text` that the program itself composes.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.console import Console as RichConsole
from rich.table import Table
from rich.text import Text

from causal_openlock.files.escaping import printable

if TYPE_CHECKING:
    import pandas as pd

MOST_COLUMNS = 1000  #: most characters of a table that is wider than the terminal


class Terminal(RichConsole):
    """A console that prints text as it is."""

    def __init__(self, **options: Any) -> None:
        super().__init__(markup=False, emoji=False, **options)

    def render_str(self, text: str, **options: Any) -> Text:
        """Text as it is shown, also in tables."""
        return super().render_str(printable(text), **options)

    def print_line(self, text: str, style: str | None = None) -> None:
        """Print a line, neither wrapped nor highlighted."""
        self.print(text, style=style, soft_wrap=True, highlight=False)

    def warn(self, sentence: str) -> None:
        """Print a warning."""
        self.print_line(f"warning: {sentence}", "yellow")

    def print_table(self, frame: pd.DataFrame, formats: Mapping[str, str]) -> None:
        """Print a table, as its values are printed in a report."""
        from causal_openlock.analysis.table import Table as Printed

        self.print_rows([*frame.columns], Printed("", "", frame, formats).rows)

    def print_rows(self, heads: Sequence[str], rows: Iterable[Sequence[str]]) -> None:
        """Print a table without lines; columns are aligned right, but for the first one."""
        table = Table(box=None, padding=(0, 2, 0, 0))
        for number, head in enumerate(heads):
            table.add_column(head, justify="right" if number else "left", no_wrap=True)
        for row in rows:
            table.add_row(*row)
        # A column that is cut off would be lost; a line that wraps is only ugly.
        wide = self.measure(table, options=self.options.update(max_width=MOST_COLUMNS))
        table.width = wide.maximum
        self.print(table, crop=False)


def print_leaderboard(
    ranked: pd.DataFrame, console: Terminal, answers: Mapping[str, Sequence[str]] | None = None
) -> None:
    """Print the table of each protocol, below its ``answers``, and what its numbers mean."""
    from causal_openlock.analysis.topics.leaderboard import leaderboard_tables

    for protocol, table in leaderboard_tables(ranked).items():
        console.print(f"\n{table.title}", style="bold")
        for sentence in (answers or {}).get(protocol, ()):
            console.print(sentence, highlight=False)
        rows = [[text.replace("\n", " ") for text in row] for row in table.rows]
        if table.looks:
            rows.insert(len(table.looks), [])  # below those who do not compete
        console.print_rows([head.replace(" than ", " than\n") for head in table.heads], rows)
        console.print(table.caption, style="dim", highlight=False)
