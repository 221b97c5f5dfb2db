"""Lists in sentences, and names of files."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence


def joined(names: Sequence[str]) -> str:
    """``a, b and c``; empty for none."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def file_names(names: Iterable[str]) -> dict[str, str]:
    """Names as parts of names of files: lower-case letters, digits and underscores, all different.

    Args:
        names: Different names, such as those of protocols.

    Returns:
        By name; those that differ in signs only are numbered.
    """
    found: dict[str, str] = {}
    for name in names:
        part = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII)
        while part in found.values():
            part += "_2"
        found[name] = part
    return found


__all__ = ["file_names", "joined"]
