"""Pages: sections in, one HTML file out, which holds everything that it shows.

What has a page of its own (a report, a comparison of two) has a template of its own; all extend
``templates/page.html.j2``, which brings the looks, on a screen, on a phone and in print.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.prose import environment
from causal_openlock.analysis.results.summary import write_table
from causal_openlock.analysis.section import Section, SectionPlot, SectionTable
from causal_openlock.files.atomic import write_text

_LATEX = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    **{"\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}"},
    **{"<": r"\textless{}", ">": r"\textgreater{}", "…": r"\dots{}", "–": "--", "—": "---"},
    **{"−": "$-$", "±": r"$\pm$", "×": r"$\times$", "·": r"$\cdot$", "→": r"$\to$"},
    **{"≤": r"$\le$", "≥": r"$\ge$", "≠": r"$\ne$", "≈": r"$\approx$"},
    **{"√": r"$\surd$", "∞": r"$\infty$", "²": r"$^2$"},
    **{"α": r"$\alpha$", "β": r"$\beta$", "ε": r"$\varepsilon$", "η": r"$\eta$"},
    **{"π": r"$\pi$", "σ": r"$\sigma$"},
    **{"’": "'", "“": "``", "”": "''", "\u00a0": "~", "\n": " "},
}
_SPECIAL = re.compile("|".join(map(re.escape, _LATEX)))


class Written:
    """The files beside a page, in ``figures/`` and ``tables/``, as paths within its folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.files: list[str] = []

    def plot(self, plot: SectionPlot) -> dict[str, Any]:
        """Write a plot; returns what the template shows of it."""
        svg = style.save(plot.figure, self.folder / "figures" / plot.name)
        self.files += [f"figures/{plot.name}.{kind}" for kind in (*style.KINDS, "svg")]
        return inline(plot, svg)

    def section(self, section: Section) -> dict[str, Any]:
        """Write the tables and plots of a section; returns what the template shows of it.

        On the page and in LaTeX numbers are printed as the table asks for; the CSV file has them as
        they were computed, to six significant digits.
        """
        for table in section.tables:
            stem = f"tables/{table.name}"
            write_table(table.frame, self.folder / f"{stem}.csv")
            write_text(self.folder / f"{stem}.tex", latex(table))
            self.files += [f"{stem}.csv", f"{stem}.tex"]
        return {**vars(section), "figures": [self.plot(plot) for plot in section.plots]}


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


def latex(table: SectionTable) -> str:
    """The table in LaTeX, with the rules of the package booktabs."""
    form = "".join("r" if number else "l" for number in table.numeric)
    caption = " ".join(filter(None, [f"{table.title.rstrip('.')}.", table.caption]))
    head, *body = (" & ".join(map(escaped, cells)) + r" \\" for cells in (table.heads, *table.rows))
    lines = [
        r"\begin{table}",
        r"\centering",
        rf"\caption{{{escaped(caption)}}}",
        rf"\label{{tab:{table.name}}}",
        rf"\begin{{tabular}}{{{form}}}",
        r"\toprule",
        head,
        r"\midrule",
        *body,
        r"\bottomrule",
        r"\end{tabular}",
        r"\end{table}",
    ]
    return "\n".join(lines) + "\n"


def escaped(text: str) -> str:
    """Any text, for LaTeX."""
    return _SPECIAL.sub(lambda found: _LATEX[found[0]], text)
