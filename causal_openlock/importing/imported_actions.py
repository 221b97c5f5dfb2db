"""One action that a file says was taken, and how its values are read."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from causal_openlock.errors import OpenLockError
from causal_openlock.files.validation import described

COLUMNS = ("phase", "loop", "learner", "protocol", "layout", "reaction", "time")
"""Columns that a row may have, besides who took which action when."""
CLAIMS = ("moved", "unlocked", "opened", "new_solution")
"""Columns in which a row may give the result of its action."""
MOST = 2**31 - 1
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)(e[+-]?\d+)?", re.ASCII | re.IGNORECASE)


class ImportFault(OpenLockError):  # noqa: N818 - a fault of a file
    """A row that is not valid, or could not have happened; the message names file and line.

    Attributes:
        place: Where it stands.
    """

    def __init__(self, place: Place, what: str) -> None:
        super().__init__(f"{place}: {what}")
        self.place = place


@dataclass(frozen=True)
class Place:
    """Place of a row: a file and a line, and the entry where lines say little.

    >>> str(Place(Path("data.csv"), 3))
    'data.csv:3'
    """

    file: Path
    line: int
    entry: int | None = None

    def __str__(self) -> str:
        """``FILE:LINE``."""
        number = "" if self.entry is None else f" (entry {self.entry})"
        return f"{self.file}:{self.line}{number}"

    def fault(self, what: str) -> ImportFault:
        """An error that names this place."""
        return ImportFault(self, what)


@dataclass(frozen=True)
class ActionEntry:
    """An action, as a file describes it.

    Attributes:
        place: The row.
        subject: The subject who took it, by its name in the file.
        condition: The name of the condition.
        trial: Number of the trial, from 1: in the whole condition, or in its ``phase`` and ``loop``
            if these are given.
        attempt: Number of the attempt in the trial, from 1.
        action: Its index or its name.
        learner: Label of the learner; empty for the default.
        protocol: Name of the protocol; empty for the default.
        layout: Name of the room's layout, or the positions of its levers; empty if it is the one
            that is drawn.
        claims: What came of the action, by :data:`CLAIMS`.
        of_attempt: What is said of its attempt, by columns of a record.
        reaction: Seconds that it took, if known.
        time: Seconds since the subject began, if known.
        named: Whether the file says who it is; if not, ``subject`` is the name of the file.
    """

    place: Place
    subject: str
    condition: str
    trial: int
    attempt: int
    action: int | str
    learner: str = ""
    protocol: str = ""
    layout: str = ""
    claims: Mapping[str, bool] = field(default_factory=dict)
    of_attempt: Mapping[str, Any] = field(default_factory=dict)
    reaction: float | None = None
    time: float | None = None
    named: bool = True


def action_entry(place: Place, row: Mapping[str, Any]) -> ActionEntry:
    """A row of a table, or an entry of a list, that describes one action.

    Args:
        place: Where it stands.
        row: Values by column; what is empty counts as not given.

    Raises:
        ImportFault: If a value is missing, or is not what it has to be.
    """
    given = {name: value for name, value in row.items() if value not in (None, "")}
    for name in ("subject", "condition", "trial", "attempt", "action"):
        if name not in given:
            raise place.fault(f"{name} is missing; add it")
    action = given["action"]
    if not isinstance(action, str) or action.isdecimal():
        action = whole(place, "action", action, 0)
    return ActionEntry(
        place,
        text(place, "subject", given["subject"]),
        text(place, "condition", given["condition"]),
        whole(place, "trial", given["trial"]),
        whole(place, "attempt", given["attempt"]),
        action,
        learner=text(place, "learner", given.get("learner", "")),
        protocol=text(place, "protocol", given.get("protocol", "")),
        layout=text(place, "layout", given.get("layout", "")),
        claims={name: truth(place, name, given[name]) for name in CLAIMS if name in given},
        of_attempt={
            "phase": text(place, "phase", given["phase"]),
            "loop": whole(place, "loop", given.get("loop", 1)),
        }
        if "phase" in given
        else {},
        reaction=seconds(place, "reaction", given.get("reaction")),
        time=seconds(place, "time", given.get("time")),
    )


def in_order(entries: Iterable[ActionEntry]) -> Iterator[ActionEntry]:
    """The same actions, unless the time of a subject runs backwards.

    Raises:
        ImportFault: If it does.
    """
    before: dict[str, float] = {}
    for one in entries:
        if one.time is not None:
            if one.time < before.get(one.subject, 0.0):
                raise one.place.fault(
                    f"time is {one.time:g}, and was {before[one.subject]:g} before; it is seconds "
                    "since the subject began, and rows are in the order of time"
                )
            before[one.subject] = one.time
        yield one


def text(place: Place, name: str, value: Any) -> str:
    """A name; a number counts as its digits."""
    if isinstance(value, bool) or not isinstance(value, str | int) or len(str(value)) > 200:
        raise place.fault(f"{name} must be a short text, and this is {described(value)}")
    return str(value)


def whole(place: Place, name: str, value: Any, least: int = 1) -> int:
    """A whole number."""
    digits = value if isinstance(value, str) else None
    if digits is not None and digits.isascii() and digits.isdecimal() and len(digits) < 11:
        value = int(digits)
    if type(value) is not int or not least <= value <= MOST:
        raise place.fault(
            f"{name} must be a whole number of at least {least}, and this is {described(value)}"
        )
    return value


def truth(place: Place, name: str, value: Any) -> bool:
    """0 or 1, false or true."""
    known = {"0": False, "false": False, "1": True, "true": True}
    if (found := known.get(str(value).lower())) is None:
        raise place.fault(f"{name} must be 0 or 1, and this is {described(value)}")
    return found


def number(place: Place, name: str, value: Any) -> float:
    """A number, or its usual digits; ``1_0``, which Python's ``float`` takes, is none."""
    if isinstance(value, str) and _NUMBER.fullmatch(value):
        value = float(value)
    if not isinstance(value, int | float) or isinstance(value, bool) or not abs(value) < MOST:
        raise place.fault(f"{name} must be a number, and this is {described(value)}")
    return float(value)


def seconds(place: Place, name: str, value: Any, unit: float = 1.0) -> float | None:
    """A time in seconds, given in units of ``unit`` seconds; None if it is not given."""
    if value is None:
        return None
    found = number(place, name, value) * unit
    if found < 0:
        raise place.fault(f"{name} must be a number of at least 0, and this is {described(value)}")
    return found
