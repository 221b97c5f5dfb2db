"""Figures of reports in tests: an empty picture of each, unless a test looks at what is drawn.

To draw them takes more than half of the time of a report.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager

import pytest
from matplotlib.figure import Figure

from causal_openlock.analysis.plots import style

EMPTY = '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 432 216"></svg>'

_images = style.images


def empty(_: Figure, kinds: Sequence[str]) -> dict[str, bytes]:
    """Return an empty picture for each kind, in place of ``analysis.plots.style.images``."""
    return dict.fromkeys(kinds, EMPTY.encode())


@contextmanager
def drawn() -> Iterator[None]:
    """Draw figures."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(style, "images", _images)
        yield
