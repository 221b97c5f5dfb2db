"""Pages: sections in, one HTML file out, which holds everything that it shows.

What has a page of its own (a report, a comparison of two) has a template of its own; all extend
``page.html.j2``, which brings the looks, on a screen, on a phone and in print.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.prose import environment
from causal_openlock.analysis.section import Section, SectionPlot
from causal_openlock.analysis.table import write_table
from causal_openlock.files.atomic import write_text


class Written:
    """The files of a page, in ``figures/`` and ``tables/``, as paths within its folder.

    ``begin`` is called with the name of each plot before it is drawn.
    """

    def __init__(self, folder: Path, begin: Callable[[str], None] = lambda _: None) -> None:
        self.folder = folder
        self.begin = begin
        self.files: list[str] = []

    def plot(self, plot: SectionPlot) -> dict[str, Any]:
        """Write a plot; returns what the template shows."""
        self.begin(plot.name)
        svg = style.save(plot.figure, self.folder / "figures" / plot.name)
        self.files += [f"figures/{plot.name}.{kind}" for kind in (*style.KINDS, "svg")]
        return inline(plot, svg)

    def section(self, section: Section) -> dict[str, Any]:
        """Write the tables and plots of a section; returns what the template shows.

        On the page and in LaTeX numbers are printed as the table asks for; the CSV file has them as
        they were computed, to six significant digits.
        """
        for table in section.tables:
            stem = f"tables/{table.name}"
            write_table(table.frame, self.folder / f"{stem}.csv")
            write_text(self.folder / f"{stem}.tex", table.latex())
            self.files += [f"{stem}.csv", f"{stem}.tex"]
        return {
            **vars(section),
            "figures": [self.plot(plot) for plot in section.plots if not plot.opening],
        }


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
