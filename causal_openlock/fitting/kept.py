"""Stored state of a fit: its plan and the finished parts, in one file that is replaced whole.

The file contains its checksum, and one fit at a time works in a folder.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.files.atomic import sweep, unwritable, write_bytes
from causal_openlock.files.checksums import ChecksumError, json_bytes, read_json
from causal_openlock.storage.folder_lock import locked

T = TypeVar("T")


@contextmanager
def fitting_in(folder: Path) -> Iterator[None]:
    """A block in which no other fit works in a folder; files of killed fits are removed.

    Raises:
        StoreError: If another fit works there, or the folder cannot be written to.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise unwritable(folder, error) from None
    with locked(folder, "fit"):
        sweep(folder)
        yield


def keep_fit(path: Path, plan: Mapping[str, Any], **done: Any) -> None:
    """Write a plan and its finished parts, as plain data."""
    write_bytes(path, json_bytes({"plan": plan, **done}))


def kept_fit(
    path: Path,
    read: Callable[[dict[str, Any]], T],
    remedy: str = "choose another folder with --out",
) -> T:
    """Read a file with ``read``.

    Raises:
        StoreError: If the file is not a fit: it cannot be read, is not what was written, or
            ``read`` raises what is raised of data of another form.
    """
    try:
        return read(read_json(path.read_bytes()))
    except ChecksumError as error:
        raise StoreError(f"{path}: this is not a fit ({error}); {remedy}") from None
    except OpenLockError:
        raise
    except (ValueError, OSError, TypeError, LookupError, ArithmeticError, RecursionError):
        raise StoreError(f"{path}: this is not a fit; {remedy}") from None


SEEDS = 3
"""Seeds of a fit to means: of the search, of the best candidates, and of what is reported."""


def seeds_of(path: Path) -> range:
    """Return the seeds that a stored fit to means played with.

    Raises:
        StoreError: If the file is not a fit.
    """
    first = kept_fit(path, lambda kept: int(kept["plan"]["seed"]), "make the fit again")
    return range(first, first + SEEDS)


def fit_of(
    path: Path,
    plan: Mapping[str, Any],
    read: Callable[[dict[str, Any]], T],
    what: str,
    parts: str,
) -> T | None:
    """The finished parts of a plan, or None if there are none.

    Args:
        path: Where it is kept.
        plan: The plan; it must be the one that is kept.
        read: What makes something of the whole file, if it is of this plan.
        what: What kind of fit it is, in words.
        parts: What may differ, in words.

    Raises:
        StoreError: If the file is not a fit, or that of another plan.
    """
    if not path.exists():
        return None

    def read_own(kept: dict[str, Any]) -> T:
        if kept["plan"] != json.loads(json.dumps(plan, default=str)):
            raise StoreError(
                f"{path.parent} holds another {what} ({parts} or version differ); choose another "
                "folder with --out, or delete this one"
            )
        return read(kept)

    return kept_fit(path, read_own)
