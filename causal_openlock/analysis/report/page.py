"""Pages: sections in, one HTML file out, which holds everything that it shows.

What has a page of its own (a report, a comparison of two) has a template of its own; all extend
``page.html.j2``, which brings the looks, on a screen, on a phone and in print.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.prose import environment
from causal_openlock.analysis.section import Section, SectionPlot
from causal_openlock.analysis.table import write_table
from causal_openlock.errors import OpenLockError
from causal_openlock.files.atomic import write_text
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pandas as pd

_FILES = re.compile(r'<meta name="files" content="([^"]*)">')
_FILE = re.compile(r"figures/\w[\w.-]*\.(png|svg|pdf)|tables/\w[\w.-]*\.(csv|tex)", re.ASCII)


class Written:
    """The plots and sections of a page, and, if wanted, the files of their own that they have.

    The page holds all of them. Files are in ``figures/`` and ``tables/``, and cost more time than
    the page.

    Args:
        path: The page.
        figures: Whether plots and tables are also written as files of their own.
        begin: Called with the name of each plot before it is drawn.

    Attributes:
        files: What was written, as paths within the page's folder.
        removed: A sentence on files of an earlier page that were removed; empty without any.
    """

    def __init__(
        self, path: Path, figures: bool = False, begin: Callable[[str], None] = lambda _: None
    ) -> None:
        self.path = path
        self.figures = figures
        self.begin = begin
        self.files: list[str] = []
        self.removed = ""

    def page(self, template: str, **values: Any) -> None:
        """Write the page, and remove the files of the earlier one that this one does not have.

        Raises:
            OpenLockError: If a file cannot be written or removed.
        """
        # A folder that is a link may be anybody's.
        left = {
            name
            for name in files_of(self.path) - {*self.files}
            if (file := self.path.parent / name).is_file() and not file.parent.is_symlink()
        }
        write_text(self.path, render(template, files=self.files, **{"record": "", **values}))
        try:
            for name in left:
                (self.path.parent / name).unlink(missing_ok=True)
        except OSError as error:
            raise OpenLockError(
                f"{self.path.parent}: the figures of an earlier report cannot be removed "
                f"({error.strerror}); remove them, or choose another folder"
            ) from None
        if left:
            files = counted(
                len(left), "file of the earlier page was", "files of the earlier page were"
            )
            again = (
                "" if self.figures else "; --figures writes files again (figures=True in Python)"
            )
            self.removed = f"{files} removed from figures/ and tables/{again}"

    def plot(self, plot: SectionPlot) -> dict[str, Any]:
        """Draw a plot; returns what the template shows."""
        self.begin(plot.name)
        svg = style.image(plot.figure, "svg").decode()
        if self.figures:
            style.save(plot.figure, self._file(f"figures/{plot.name}.pdf"))
        return inline(plot, svg)

    def table(self, name: str, frame: pd.DataFrame) -> None:
        """Write a table as CSV."""
        if self.figures:
            write_table(frame, self._file(f"tables/{name}.csv"))

    def section(self, section: Section) -> dict[str, Any]:
        """Draw the plots of a section; returns what the template shows.

        On the page and in LaTeX numbers are printed as the table asks for; the CSV file has them as
        they were computed, to six significant digits.
        """
        for table in section.tables:
            self.table(table.name, table.frame)
            if self.figures:
                write_text(self._file(f"tables/{table.name}.tex"), table.latex())
        return {
            **vars(section),
            "figures": [self.plot(plot) for plot in section.plots if not plot.opening],
        }

    def _file(self, name: str) -> Path:
        self.files.append(name)
        return self.path.parent / name


def files_of(path: Path) -> set[str]:
    """The figures and tables that belong to a page that is there already."""
    with suppress(OSError, ValueError), path.open(encoding="utf-8") as page:
        if listed := _FILES.search(page.read(100_000)):
            return {name for name in listed[1].split() if _FILE.fullmatch(name)}
    return set()


def render(template: str, **values: Any) -> str:
    """A page from its template."""
    return environment().get_template(template).render(**values)


def inline(plot: SectionPlot, svg: str) -> dict[str, Any]:
    """A figure for inside the page: sized by it, and with names of its own."""
    from markupsafe import Markup, escape

    svg = re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{plot.name}-', svg)
    svg = re.sub(r'((?:xlink:)?href="|url\()#', rf"\1#{plot.name}-", svg)
    box = re.search(r'viewBox="0 0 ([\d.]+) [\d.]+"', svg)
    assert box is not None
    wide = float(box[1]) / 12
    root = (
        f'<svg {box[0]} role="img" aria-label="{escape(plot.title)}" '
        f'style="min-width: {min(wide, 34):.1f}rem; max-width: {wide:.1f}rem">'
    )
    return {
        "name": plot.name,
        "title": plot.title,
        "caption": plot.caption,
        "call": plot.call,
        "folded": plot.folded,
        "svg": Markup(root + svg[svg.index(">") + 1 :]),  # matplotlib has escaped its text
    }
