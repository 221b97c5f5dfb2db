"""Figures of reports in tests: an empty picture of each, unless a test looks at what is drawn.

To draw them takes more than half of the time of a report.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style
from causal_openlock.files.atomic import write_text

KINDS = style.KINDS
"""The kinds of file in which the program draws figures, besides SVG."""

EMPTY = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 432 216"></svg>'

_save = style.save


def save_empty(figure: Figure, stem: Path) -> str:
    """Write the files that :func:`causal_openlock.analysis.plots.style.save` writes, empty."""
    for kind in (*style.KINDS, "svg"):
        write_text(stem.with_name(f"{stem.name}.{kind}"), EMPTY)
    return EMPTY


@contextmanager
def drawn(*kinds: str) -> Iterator[None]:
    """Draw figures, as SVG and as files of other kinds."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "save", _save)
        patch.setattr(style, "KINDS", kinds)
        yield
