"""Formats in which pictures can be saved, by the suffix of their file."""

from __future__ import annotations

from pathlib import Path

from causal_openlock.errors import OpenLockError
from causal_openlock.wording import nearest

FIGURES = (".pdf", ".png", ".svg")
STILLS = (".png", ".svg")


def path_of_picture(
    path: Path | str, suffixes: tuple[str, ...] = FIGURES, what: str = "a figure"
) -> Path:
    """The path, if a picture can be saved in it.

    Raises:
        OpenLockError: If its suffix is none of ``suffixes``.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    if suffix not in suffixes:
        raise OpenLockError(
            f"{path}: {what} cannot be saved as {suffix!r}; {nearest(suffix, suffixes)}"
        )
    return path
