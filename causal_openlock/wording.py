"""Numbers, lists and names in sentences."""

from __future__ import annotations

import difflib
import re
from collections.abc import Iterable, Mapping, Sequence


def counted(number: int, one: str, many: str | None = None) -> str:
    """A number and its noun: ``1 attempt``, ``2,000 attempts``, ``3 people``."""
    return f"{number:,} {one if number == 1 else many or f'{one}s'}"


def joined(names: Sequence[str]) -> str:
    """``a, b and c``; empty for none."""
    return " and ".join(filter(None, [", ".join(names[:-1]), *names[-1:]]))


def some(names: Iterable[str] | Mapping[str, object], most: int = 8) -> str:
    """A list of names, or of names with values, that is cut off when it gets long.

    >>> some({"a": 1, "b": 2, "c": 3}, most=2)
    'a: 1; b: 2; and 1 more'
    """
    if isinstance(names, Mapping):
        names = [f"{name}: {value}" for name, value in names.items()]
    names = list(names)
    more = len(names) - most
    shown = "; ".join(names[:most])
    return f"{shown}; and {more} more" if more > 0 else shown


_ROLE = re.compile(r"(?::[\w:]+:)?`(?:~[\w.]*\.)?([^`]*?)(?: <[^`>]*>)?`_*")


def first_line(text: object, most: int = 120) -> str:
    """Return the first line of a docstring, without its marks and control characters.

    >>> first_line("Plays as :class:`~mine.Slow` (extra ``slow``).")
    'Plays as Slow (extra slow).'
    >>> first_line("Draws every action uniformly. " + 100 * "More. ", most=30)
    'Draws every action uniformly.…'
    """
    line = text.strip().partition("\n")[0] if isinstance(text, str) else ""
    line = _ROLE.sub(r"\1", line.replace("``", ""))
    line = "".join(filter(str.isprintable, " ".join(line.split())))
    return line if len(line) <= most else f"{line[: most - 1].rstrip()}…"


def file_names(names: Iterable[str]) -> dict[str, str]:
    """Names as parts of names of files, all different.

    >>> file_names(["Mine, new", "mine new"])
    {'Mine, new': 'mine_new', 'mine new': 'mine_new_2'}
    """
    parts: dict[str, str] = {}
    for name in names:
        part = re.sub(r"\W+", "_", name.lower(), flags=re.ASCII)
        while part in parts.values():
            part += "_2"
        parts[name] = part
    return parts


_PARTS = re.compile(r"(\d+)").split


def nearest(name: str, known: Iterable[str]) -> str:
    """A clause that suggests a name and lists all: ``did you mean CC4? known: CC3, CC4``."""
    # Numbers within names count as numbers, so that trial10 comes after trial2.
    names = sorted(known, key=lambda name: [int(x) if x.isdecimal() else x for x in _PARTS(name)])
    lowered = {known_name.lower(): known_name for known_name in names}
    close = difflib.get_close_matches(name.lower(), lowered, n=1, cutoff=0.5)
    meant = f"did you mean {lowered[close[0]]}? " if close else ""
    return f"{meant}known: {', '.join(names) or 'none'}"
