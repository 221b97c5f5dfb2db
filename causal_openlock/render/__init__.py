"""Pictures of schemas and rooms, and films of trials.

================ ==================================================================================
``graph``        A schema as a figure or as text.
``scene``        What a picture of a room shows; ``paint`` makes pixels, SVG or text of it.
``words``        What people see, in words.
``film``         A film of a trial, played now or recorded, as a GIF or MP4.
``watch``        A trial moment by moment, with what the learner believes.
================ ==================================================================================
"""

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
