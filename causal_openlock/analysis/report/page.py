"""Pages: sections in, one HTML file out, which holds everything that it shows."""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import lru_cache
from operator import attrgetter
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined
from markupsafe import Markup, escape

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.table import write_table
from causal_openlock.analysis.topic import Section, SectionPlot
from causal_openlock.files.atomic import write_text
from causal_openlock.wording import counted

LONG = 24  #: tables of more rows than this are closed until they are opened


def write_page(
    path: Path,
    template: str,
    sections: Sequence[Section],
    figures: bool = False,
    record: str = "",
    **values: Any,
) -> None:
    """Write a page of some sections by a template, to which further ``values`` go.

    With ``figures``, its figures are also written as PDF, to ``figures/`` next to it, and tables
    that have a name as CSV and LaTeX, to ``tables/``: CSV has numbers as they were computed, to six
    significant digits. ``record`` is the digest of what the page is about.

    Raises:
        OpenLockError: If a file cannot be written.
    """
    text = _environment().get_template(template).render(sections=sections, record=record, **values)
    write_text(path, text)
    for section in sections if figures else ():
        for table in filter(attrgetter("name"), section.tables):
            write_table(table.frame, path.parent / "tables" / f"{table.name}.csv")
            write_text(path.parent / "tables" / f"{table.name}.tex", table.latex())
        for plot in section.plots:
            style.save(plot.figure, path.parent / "figures" / f"{plot.name}.pdf")


@lru_cache(maxsize=1)
def _environment() -> Environment:
    made = Environment(
        loader=PackageLoader("causal_openlock.analysis", "report"),
        autoescape=True,
        undefined=StrictUndefined,
    )
    made.filters.update(counted=counted, svg=_svg)
    made.globals["LONG"] = LONG
    return made


def _svg(plot: SectionPlot) -> Markup:
    """A figure for inside the page: sized by it, and with names of its own."""
    svg = style.image(plot.figure, "svg").decode()
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
    return Markup(root + svg[svg.index(">") + 1 :])  # matplotlib has escaped its text
