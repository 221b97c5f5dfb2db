"""What is inside a results folder, and what only claims to be.

A results folder is something people pass on. What its ``experiment.json`` says was written by
whoever made it, and an unpacked archive may hold links. So nothing that is read, written or bundled
is found by a path that leads out of the folder: names of files are plain names, and no link in the
folder points to what lies elsewhere. (The folder itself may be a link; its owner has made that.)
"""

from __future__ import annotations

import os
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from causal_openlock.errors import StoreError

CELL = re.compile(r"(?!\.)[^/\\:\x00-\x1f\x7f-\x9f]{1,240}\.parquet")
"""A file name, and nothing that any system takes for a path."""


def check_inside(folder: Path, cells: Sequence[Any] = ()) -> None:
    """Make sure that nothing in a results folder leads out of it.

    Args:
        folder: The folder; it need not be there.
        cells: What its ``experiment.json`` lists as the files of its cells.

    Raises:
        StoreError: If a cell's name is no name of a file, or a link leads elsewhere.
    """
    for name in cells:
        if not (isinstance(name, str) and CELL.fullmatch(name)):
            raise StoreError(
                f"{folder / 'experiment.json'} lists {str(name)[:80]!r} among the cells, which is "
                f"no file in {folder / 'cells'}; do not use this folder, somebody has changed it"
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
            elif not (path.is_file() or path.is_dir()):
                raise StoreError(f"{path} is neither a file nor a folder; remove it")
