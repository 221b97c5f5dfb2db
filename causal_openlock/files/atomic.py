"""Atomic writes: a file is complete or absent.

Content is written to a temporary file in the same folder, flushed to the disk and renamed, so that
a reader sees the old file or the new one. A killed process can leave a file whose name begins with
a dot and ends with ``.partial``; :func:`sweep` removes those.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO
from uuid import uuid4

from causal_openlock.errors import StoreError

LEFTOVERS = (".DS_Store", "._*", "Thumbs.db", "desktop.ini", ".nfs*", ".lock*", ".*.partial")
"""Names of what systems and killed runs leave in a folder."""


def folder_at(place: Path | str) -> Path:
    """A folder to write to, which need not exist; StoreError if there can be none."""
    if not isinstance(place, str | Path):
        raise StoreError(f"a folder is given by its path, not by {type(place).__name__}")
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+:/", str(place)):
        raise StoreError(
            f"{str(place).rpartition('@')[2]} is not a folder of this machine; write into a folder "
            "and copy it before and after, for S3 with: aws s3 sync s3://BUCKET/NAME results/NAME"
        )
    folder = Path(place)
    try:
        str(place).encode()  # results say it
        folder.resolve()  # fails at links in a circle, which exists() takes for nothing
        path = next(path for path in (folder, *folder.parents) if path.exists())
    except (OSError, RuntimeError, ValueError):
        raise StoreError(f"{str(place)[:80]!r} cannot be a folder; choose another") from None
    if not path.is_dir():
        raise StoreError(f"{path} is a file; choose a folder")
    return folder


def is_empty(folder: Path) -> bool:
    """Whether there is no folder, or only leftovers in one."""
    paths = folder.iterdir() if folder.exists() else ()
    return all(any(map(path.match, LEFTOVERS)) for path in paths)


def move_into(made: Path, folder: Path) -> None:
    """Put what is in a folder into one that is empty by :func:`is_empty`."""
    if not folder.exists():
        made.replace(folder)
    else:
        for path in made.iterdir():
            path.replace(folder / path.name)


def unwritable(path: Path, error: OSError) -> StoreError:
    """The error of a file or folder that cannot be written."""
    why, remedy = error.strerror or error, "free some space or choose another place"
    if isinstance(error, FileExistsError | IsADirectoryError | NotADirectoryError):
        path, remedy = error.filename2 or error.filename or path, "move what is there"
    return StoreError(f"{path}: cannot be written ({why}); {remedy}")


@contextmanager
def replacing(path: Path | str) -> Iterator[BinaryIO]:
    """A file to write to, which replaces ``path`` when the block ends without an error.

    StoreError if the folder cannot be written to or the disk is full; the old file stays.
    """
    path = Path(path)
    partial = path.parent / f".{path.name[:100]}.{uuid4().hex}.partial"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with partial.open("xb") as file:
            yield file
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    except OSError as error:
        raise unwritable(path, error) from None
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


def write_bytes(path: Path | str, content: bytes) -> None:
    """Write a file; see :func:`replacing`."""
    with replacing(path) as file:
        file.write(content)


def write_text(path: Path | str, text: str) -> None:
    """Write a file as UTF-8; see :func:`replacing`."""
    write_bytes(path, text.encode("utf-8"))


def sweep(folder: Path) -> None:
    """Remove the temporary files of killed processes."""
    for partial in folder.glob(".*.partial"):
        partial.unlink(missing_ok=True)
