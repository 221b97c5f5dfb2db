"""The JSON that jsPsych saves: a list of what happened on each of its screens.

An entry that has an ``action`` describes one, as a row of a table does; all other entries
(instructions, consent) are passed over. An experiment adds them as ``data`` of its screens, or with
``jsPsych.data.addProperties``. jsPsych's own ``rt`` and ``time_elapsed``, in milliseconds, are when
the action was taken. A file without any ``subject`` is one subject's, named after the file. Lists
in a list, or one in each line, as servers join them, are read as well.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from causal_openlock.importing.actions import ActionEntry, Place, action_entry, seconds
from causal_openlock.importing.tables import read_text

_BETWEEN = re.compile(r"[\s,]*")
_MILLISECONDS = {"rt": "reaction", "time_elapsed": "time"}


def jspsych_actions(path: Path) -> Iterator[ActionEntry]:
    """The actions in a file of jsPsych, in its order.

    Raises:
        OpenLockError: If it is no JSON, not whole, or an entry is none.
    """
    for place, entry in _entries(path):
        if entry.get("action") is None:
            within = [
                key for key, held in entry.items() if isinstance(held, dict) and "action" in held
            ]
            if within:
                raise place.fault(
                    f"the action stands within {within[0]!r}; write what is in it next to the "
                    "other values of the screen"
                )
            continue
        row = {"subject": path.stem, **entry}
        for name, meaning in _MILLISECONDS.items():
            if entry.get(name) is not None:
                row.setdefault(meaning, seconds(place, name, entry[name], 1e-3))
        yield replace(action_entry(place, row), named="subject" in entry)


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
            raise place.fault("this is no list of entries, as jsPsych saves it")
        try:
            entry, at = decoder.raw_decode(text, at)
        except (ValueError, RecursionError):
            raise place.fault("this is no JSON; is the file whole?") from None
        entries += 1
        yield place, entry
    if depth or not entries:
        raise Place(path, line).fault("the list has no entry, or does not end; is the file whole?")
