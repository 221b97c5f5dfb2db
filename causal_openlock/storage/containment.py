"""Check that no path or link in a results folder points outside it, since folders are shared."""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from causal_openlock.errors import StoreError

_CELL = re.compile(r"(?!\.)[^/\\:\x00-\x1f\x7f-\x9f]{1,240}\.parquet")
"""A file name that is not a path on any system."""


def check_inside(folder: Path, cells: Sequence[Any] = ()) -> None:
    """Make sure that no link or path in a results folder points outside it.

    Others may have written ``experiment.json``, and an unpacked archive may hold links. (The
    folder itself may be a link; its owner has made that.)

    Args:
        folder: The folder; it need not exist.
        cells: The files of cells listed in its ``experiment.json``.

    Raises:
        StoreError: If a cell's name is not a file name, or a link leads elsewhere.
    """
    for name in cells:
        if not (isinstance(name, str) and _CELL.fullmatch(name)):
            raise StoreError(
                f"{folder / 'experiment.json'} lists {str(name)[:80]!r} among the cells, which is "
                f"not a file in {folder / 'cells'}; do not use this folder, it has been changed"
            )
    home = folder.resolve()
    for place, folders, files in os.walk(folder):  # which does not follow links to folders
        for path in (Path(place, name) for name in (*folders, *files)):
            if path.is_symlink():
                if not path.resolve().is_relative_to(home):
                    raise StoreError(
                        f"{path} is a link that leads out of {folder}; put what it points to in "
                        "its place, if you know where it comes from"
                    )
            elif not (path.is_file() or path.is_dir()) and path.exists():  # others may work in it
                raise StoreError(f"{path} is neither a file nor a folder; remove it")
