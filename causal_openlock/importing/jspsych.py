"""Files of jsPsych: a list, or a table, of what happened on each of its screens.

A screen that has an ``action`` describes one, as a row of a table does; all others (instructions,
consent) are passed over. An experiment adds its values as ``data`` of its screens, or with
``jsPsych.data.addProperties``. jsPsych's own ``rt`` and ``time_elapsed``, in milliseconds, are when
the action was taken; after a page was loaded again, ``time_elapsed`` begins anew, and the time
continues. A JSON file without any ``subject`` is one subject's, named after the file.
Lists in a list, or one in each line, as servers join them, are read as well.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from causal_openlock.importing.imported_actions import (
    ActionEntry,
    Place,
    action_entry,
    in_order,
    seconds,
)
from causal_openlock.importing.text import read_text

OWN = frozenset({"trial_type", "time_elapsed"})
"""Columns that jsPsych gives every screen; a table with one of them is jsPsych's own."""
_BETWEEN = re.compile(r"[\s,]*")
_DEPTH = 3


def jspsych_actions(path: Path) -> Iterator[ActionEntry]:
    """The actions in a JSON file of jsPsych, in its order.

    Raises:
        OpenLockError: If it is not JSON, not whole, or an entry is none.
    """
    return in_order(screen_actions(_entries(path), path.stem))


def screen_actions(
    screens: Iterator[tuple[Place, Mapping[str, Any]]], unnamed: str
) -> Iterator[ActionEntry]:
    """The actions on jsPsych's screens, with their times.

    Args:
        screens: What is said of each screen, and where.
        unnamed: The subject of screens that name none.

    Raises:
        ImportFault: If a screen has values that cannot be, or all actions are hidden in others.
    """
    before: dict[str, tuple[float, float]] = {}  # of time_elapsed, and the time when it began
    hidden: tuple[Place, str] | None = None
    acts = False
    for place, screen in screens:
        # Its tables say "null" of what is null.
        given = {name: value for name, value in screen.items() if value not in (None, "", "null")}
        if "action" not in given:
            if not hidden and (within := _within(given)):
                hidden = place, within
            continue
        row = {"subject": unnamed, **given}
        row.setdefault("reaction", seconds(place, "rt", given.get("rt"), 1e-3))
        elapsed = seconds(place, "time_elapsed", given.get("time_elapsed"), 1e-3)
        if elapsed is not None:
            last, began = before.get(str(row["subject"]), (0.0, 0.0))
            began += last if elapsed < last else 0.0
            before[str(row["subject"])] = elapsed, began
            row.setdefault("time", elapsed + began)
        one = replace(action_entry(place, row), named="subject" in given)
        acts = True
        yield one
    if hidden and not acts:
        place, within = hidden
        raise place.fault(
            f"the action stands within {within!r}; write what is in it next to the other values of "
            "the screen"
        )


def _within(value: Any, depth: int = 0) -> str | None:
    """Path to an action within a screen's values, such as ``response.answers``."""
    parts = value.items() if isinstance(value, Mapping) else enumerate(value)
    for key, held in parts:
        if isinstance(held, str):
            found = "" if held.lstrip()[:1] in ("{", "[") and '"action"' in held else None
        elif not isinstance(held, Mapping | list) or depth == _DEPTH:
            found = None
        else:
            named = isinstance(held, Mapping) and held.get("action") is not None
            found = "" if named else _within(held, depth + 1)
        if found is not None:
            return f"{key}.{found}" if found else str(key)
    return None


def _entries(path: Path) -> Iterator[tuple[Place, dict[str, Any]]]:
    """The objects in a list, each with its place, which the standard reader does not give."""
    text, decoder = read_text(path), json.JSONDecoder()
    at = counted = depth = entries = 0
    line = 1
    while (at := _BETWEEN.match(text, at).end()) < len(text):  # type: ignore[union-attr]
        line += text.count("\n", counted, at)
        counted = at
        if text[at] in "[]":
            depth += 1 if text[at] == "[" else -1
            at += 1
            if 0 <= depth <= 2:
                continue
        place = Place(path, line, entries + 1)
        if not (depth in (1, 2) and text.startswith("{", at)):
            raise place.fault("this is not a list of entries, as jsPsych saves it")
        try:
            entry, at = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            raise place.fault("this is not JSON; is the file whole?") from None
        entries += 1
        yield place, entry
    if depth or not entries:
        raise Place(path, line).fault("the list has no entry, or does not end; is the file whole?")
