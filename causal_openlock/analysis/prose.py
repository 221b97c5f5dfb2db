"""The sentences of a report, each in one place: templates in plain text.

A module ``NAME.py`` that writes has a template ``NAME.txt.j2`` next to it, of macros. ``title``
is its heading and ``text`` what it says; ``X_table`` and ``X_plot`` give the title and the caption
of a table or plot X. A pilcrow (¶) starts a paragraph; line breaks and indentation mean nothing.
Python passes what was found, as numbers and names; filters print these (:data:`FILTERS`).
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from importlib.resources import files
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import pandas as pd

from causal_openlock.analysis.section import Section, SectionPlot, drawn
from causal_openlock.analysis.table import Table, percent, printed
from causal_openlock.wording import counted, joined, some

if TYPE_CHECKING:
    from jinja2 import Environment

LONG = 24
"""Tables of more rows than this are closed until they are opened; in print they are open."""

_PAGE = "causal_openlock.analysis.report"  # where the templates of the page are


class Prose:
    """The sentences of one module, from the template next to it.

    >>> REPORT = "causal_openlock.analysis.report"
    >>> Prose(f"{REPORT}.difference_page").sentence("changes", things=["seed"])
    '1 thing differs in what was run: seed.'

    Args:
        module: Its full name, ``__name__``.
    """

    def __init__(self, module: str) -> None:
        package, _, self.name = module.rpartition(".")
        self._template = f"{package}/{self.name}.txt.j2"

    def paragraphs(self, macro: str, **findings: Any) -> tuple[str, ...]:
        """The paragraphs of a macro, filled in."""
        made = environment().get_template(self._template).module
        if not hasattr(made, macro):
            raise AttributeError(f"{self._template} has no macro {macro!r}")
        parts = getattr(made, macro)(**findings).split("¶")
        return tuple(text for part in parts if (text := re.sub(r"\s+", " ", part).strip()))

    def sentence(self, macro: str, **findings: Any) -> str:
        """The same, as one paragraph."""
        return " ".join(self.paragraphs(macro, **findings))

    def section(
        self,
        name: str,
        tables: Sequence[Table] = (),
        plots: Sequence[SectionPlot] = (),
        answer: str = "",
        is_open: bool = False,
        **findings: Any,
    ) -> Section:
        """A section of which ``title`` and ``text`` are filled in."""
        text = self.paragraphs("text", **findings)
        title = self.sentence("title")
        return Section(name, title, text, tuple(tables), tuple(plots), answer, is_open)

    def table(
        self,
        kind: str,
        frame: pd.DataFrame,
        formats: Mapping[str, str],
        name: str = "",
        **findings: Any,
    ) -> Table:
        """A table with the title and caption of the macro ``KIND_table``.

        Formats say how to print its columns, and perhaps others; its file is called ``name``, or
        else ``kind``.
        """
        title, *caption = self.paragraphs(f"{kind}_table", **findings)
        own = {column: form for column, form in formats.items() if column in frame}
        return Table(name or kind, title, frame, own, " ".join(caption))

    def plot(
        self,
        kind: str,
        function: Callable[..., Any],
        data: Any,
        options: Mapping[str, Any] = MappingProxyType({}),
        name: str = "",
        call: str | None = None,
        **findings: Any,
    ) -> SectionPlot:
        """A plot with the title and caption of the macro ``KIND_plot``.

        The rest is as in :func:`~causal_openlock.analysis.section.drawn`.
        """
        title, *caption = self.paragraphs(f"{kind}_plot", **findings)
        return drawn(name or kind, function, data, title, " ".join(caption), call, **options)


@lru_cache(maxsize=1)
def environment() -> Environment:
    """The templates of all packages, such as ``my_package/pay.txt.j2``.

    Those of HTML escape what they are given; those of the page are named without their package.
    """
    from jinja2 import Environment, FunctionLoader, StrictUndefined

    def load(name: str) -> str:
        package, _, file = name.rpartition("/")
        return (files(package or _PAGE) / file).read_text(encoding="utf-8")

    made = Environment(
        loader=FunctionLoader(load),
        autoescape=lambda name: name is not None and ".html" in name,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
    )
    made.filters.update(FILTERS)
    made.globals["LONG"] = LONG
    return made


FILTERS: dict[str, Callable[..., Any]] = {
    "counted": counted,
    "joined": lambda names: joined(list(names)),
    "number": printed,
    "percent": percent,
    "some": some,
}
"""``3 | counted("attempt")``, ``names | joined`` (a, b and c), ``names | some`` (cut off if long),
``0.5 | number(".0%")``, ``0.5 | percent``."""
