"""What a folder keeps of a fit: its plan and what is done, in one file that is replaced whole."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_text

T = TypeVar("T")


def keep_fit(path: Path, plan: Mapping[str, Any], **done: Any) -> None:
    """Write a plan and what is done of it, as plain data."""
    write_text(path, json.dumps({"plan": plan, **done}, indent=1) + "\n")


def kept_fit(
    path: Path,
    read: Callable[[dict[str, Any]], T],
    remedy: str = "choose another folder with --out",
) -> tuple[Any, T]:
    """The plan that a file keeps, and what ``read`` makes of the whole.

    Raises:
        StoreError: If the file is no fit: it cannot be read, or ``read`` raises what is raised of
            data of another form.
    """
    try:
        kept = json.loads(path.read_bytes())
        return kept["plan"], read(kept)
    except (ValueError, OSError, TypeError, LookupError, RecursionError):
        raise StoreError(f"{path}: this is no fit; {remedy}") from None


def fit_of(
    path: Path,
    plan: Mapping[str, Any],
    read: Callable[[dict[str, Any]], T],
    what: str,
    parts: str,
) -> T | None:
    """What is done of a plan, or None if nothing is.

    Args:
        path: Where it is kept.
        plan: The plan; it must be the one that is kept.
        read: What makes something of the whole file.
        what: What kind of fit it is, in words.
        parts: What may differ, in words.

    Raises:
        StoreError: If the file is no fit, or that of another plan.
    """
    if not path.exists():
        return None
    kept, done = kept_fit(path, read)
    if kept != json.loads(json.dumps(plan, default=str)):
        raise StoreError(
            f"{path.parent} holds another {what} ({parts} or version differ); choose another "
            "folder with --out"
        )
    return done
