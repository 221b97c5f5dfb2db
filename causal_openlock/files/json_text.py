"""JSON as it is read here: an object that has a key twice is refused.

Python keeps the last of two, other readers the first; a person who wrote both meant one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import Any


class DoubledKeyError(ValueError):
    """A key that is twice in one object; the message names it."""


def each_once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """An ``object_pairs_hook`` for :mod:`json` that refuses doubled keys.

    Raises:
        DoubledKeyError: If a key is there twice.
    """
    found = dict(pairs)
    if len(found) < len(pairs):
        ((twice, _),) = Counter(name for name, _ in pairs).most_common(1)
        raise DoubledKeyError(f"the key {twice!r} is there twice")
    return found


def present(values: Mapping[str, Any]) -> dict[str, Any]:
    """Return a mapping without what is None.

    >>> present({"name": "a", "license": None})
    {'name': 'a'}
    """
    return {name: value for name, value in values.items() if value is not None}
