"""Mappings in JSON: refusing doubled keys, and leaving out what is None."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any


def each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An ``object_pairs_hook`` for :mod:`json`; raises ValueError if a key is there twice."""
    counts = Counter(name for name, _ in pairs)
    if len(counts) < len(pairs):
        raise ValueError(f"the key {counts.most_common(1)[0][0]!r} is there twice")
    return dict(pairs)


def present(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping without what is None.

    >>> present({"name": "a", "license": None})
    {'name': 'a'}
    """
    return {name: value for name, value in values.items() if value is not None}
