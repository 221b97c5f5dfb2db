"""Tables of a section in the three forms that they have: on the page, as CSV and as LaTeX.

On the page and in LaTeX numbers are printed as the table asks for; the CSV file has them as they
were computed, to six significant digits.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pandas as pd

from causal_openlock.analysis.report.section import SectionTable
from causal_openlock.analysis.results.summary import write_table
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


def heading(column: Any) -> str:
    """What stands over a column: its name, in words."""
    return str(column).replace("_", " ")


def printed(value: Any, form: str | None) -> str:
    """A value as the page prints it.

    Args:
        value: Anything; ``None`` and NaN are no value.
        form: As for :func:`format`; by default as text.
    """
    if value is None or (isinstance(value, float) and value != value) or value is pd.NA:
        return "–"
    if isinstance(value, bool) or type(value).__name__ == "bool":  # NumPy has a bool of its own
        return "yes" if value else "no"
    if isinstance(value, int | float) or form:
        text = format(value + 0.0 if isinstance(value, float) else value, form or "")
        if form and re.fullmatch(r"-0*\.?0*%?", text):
            text = text[1:]  # a minus that nothing is left of
        return text.replace("-", "−", 1) if text.startswith("-") else text.replace("e-", "e−")
    return str(value)


def rows(table: SectionTable) -> list[list[str]]:
    """The values of a table as they are printed, row by row."""
    columns = [
        [printed(value, table.formats.get(str(name))) for value in table.frame[name].tolist()]
        for name in table.frame.columns
    ]
    return [list(row) for row in zip(*columns, strict=True)]


def numeric(table: SectionTable) -> list[bool]:
    """Which columns hold numbers, and are set to the right."""
    return [
        str(name) in table.formats
        or (pd.api.types.is_numeric_dtype(kind) and not pd.api.types.is_bool_dtype(kind))
        for name, kind in table.frame.dtypes.items()
    ]


def latex(table: SectionTable) -> str:
    """The table in LaTeX, with the rules of the package booktabs."""
    form = "".join("r" if number else "l" for number in numeric(table))
    caption = " ".join(filter(None, [f"{table.title.rstrip('.')}.", table.caption]))
    head, *body = (
        " & ".join(map(escaped, cells)) + r" \\"
        for cells in (map(heading, table.frame.columns), *rows(table))
    )
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


def save(table: SectionTable, folder: Path) -> list[str]:
    """Write ``NAME.csv`` and ``NAME.tex``; returns the names of the files.

    Raises:
        OpenLockError: If they cannot be written.
    """
    write_table(table.frame, folder / f"{table.name}.csv")
    write_text(folder / f"{table.name}.tex", latex(table))
    return [f"{table.name}.csv", f"{table.name}.tex"]


def described(table: SectionTable) -> dict[str, Any]:
    """A table for the template: its heads, which columns are numbers, and its printed rows."""
    return {
        "name": table.name,
        "title": table.title,
        "caption": table.caption,
        "heads": [heading(name) for name in table.frame.columns],
        "numeric": numeric(table),
        "rows": rows(table),
    }
