"""Pages: data in, one HTML file out, which holds everything that it shows.

What has a page of its own (a report, a comparison of two) has a template of its own; all extend
``page.html.j2``, which brings the looks, on a screen, on a phone and in print.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.plots.style import Drawing
from causal_openlock.analysis.report import table_files
from causal_openlock.analysis.report.cautions import percent, some
from causal_openlock.analysis.report.section import Section

LONG = 24
"""Tables of more rows than this are closed until they are asked for; in print they are open."""


class Written:
    """What is kept beside a page, in ``figures/`` and ``tables/``.

    Args:
        folder: The folder of the page.
        files: Those that are written, as paths within the folder.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files: list[str] = []

    def drawing(self, drawing: Drawing) -> dict[str, Any]:
        """Keep a drawing; returns what the template shows of it."""
        svg = style.save(drawing.figure, self.folder / "figures" / drawing.name)
        self.files += [f"figures/{drawing.name}.{kind}" for kind in (*style.KINDS, "svg")]
        return inline(drawing, svg)

    def section(self, section: Section) -> dict[str, Any]:
        """Keep the tables and drawings of a section; returns what the template shows of it."""
        for table in section.tables:
            names = table_files.save(table, self.folder / "tables")
            self.files += [f"tables/{name}" for name in names]
        return {
            "name": section.name,
            "title": section.title,
            "text": section.text,
            "tables": [table_files.described(table) for table in section.tables],
            "figures": [self.drawing(drawing) for drawing in section.drawings],
        }


def render(template: str, **values: Any) -> str:
    """A page from its template."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    environment = Environment(
        loader=PackageLoader("causal_openlock.analysis.report", "."),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        decimals=_decimals,
        signed=_signed,
        percent=percent,
        interval=interval,
        plain=_plain,
        some=some,
    )
    environment.globals["LONG"] = LONG
    return environment.get_template(template).render(**values)


def inline(drawing: Drawing, svg: str) -> dict[str, Any]:
    """A figure for inside the page: sized by it, and with names of its own."""
    from markupsafe import Markup, escape

    svg = re.sub(r"<!--.*?-->", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    svg = re.sub(r'\bid="', f'id="{drawing.name}-', svg)
    svg = re.sub(r'((?:xlink:)?href="|url\()#', rf"\1#{drawing.name}-", svg)
    box = re.search(r'viewBox="0 0 ([\d.]+) [\d.]+"', svg)
    assert box is not None
    wide = float(box[1]) / 12
    root = (
        f'<svg {box[0]} role="img" aria-label="{escape(drawing.title)}" '
        f'style="min-width: {min(wide, 34):.1f}rem; max-width: {wide:.1f}rem">'
    )
    return {
        "name": drawing.name,
        "title": drawing.title,
        "caption": drawing.caption,
        "svg": Markup(root + svg[svg.index(">") + 1 :]),  # matplotlib has escaped its text
    }


def interval(row: Mapping[str, Any]) -> str:
    """The interval, or nothing where subjects do not differ or there is only one."""
    low = row["ci_low"]
    if low is None or math.isnan(low) or low == row["ci_high"]:
        return ""
    return f"{_decimals(low)}–{_decimals(row['ci_high'])}"


def _decimals(value: float) -> str:
    return f"{value + 0.0:.2f}"


def _signed(value: float) -> str:
    return f"{round(value, 2) + 0.0:+.2f}".replace("-", "−")


def _plain(values: Iterable[Any]) -> bool:
    return all(value is None or isinstance(value, str | int | float) for value in values)
