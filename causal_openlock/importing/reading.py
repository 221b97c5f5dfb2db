"""Actions in files: a table with a row for each, an export of this project, or jsPsych's screens.

The header of a table says which it is. An export has the columns of a record
(:func:`~causal_openlock.experiment.record.record_schema`) and a row for each attempt; jsPsych has
columns, or keys, of its own, and times in milliseconds. Columns that mean nothing here are passed
over. What R and pandas write of a missing value counts as empty.
"""

from __future__ import annotations

import csv
import gzip
import io
import json
import zlib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.protocol import MISSING
from causal_openlock.experiment.record import record_schema
from causal_openlock.files.validation import Part, part, read

NEEDED = ("subject", "condition", "trial", "attempt", "action")
"""The columns that a table of actions has to have."""
CLAIMS = ("moved", "unlocked", "opened", "new_solution")
"""Columns in which a row may give the result of its action."""
EMPTY = ("", *MISSING, None)
SECONDS = ("reaction", "time", "wall_time", "rt", "time_elapsed")
"""Columns in which a table saved by a spreadsheet may have decimal commas."""

Row = Mapping[str, Any]
Text = Annotated[str, Field(max_length=200, coerce_numbers_to_str=True)]
Number = Annotated[int, Field(ge=1, lt=2**31)]
Seconds = Annotated[float, Field(ge=0, lt=2**31, allow_inf_nan=False)]


def _index(action: Any) -> Any:
    if isinstance(action, str) and action.isdecimal() and action.isascii():
        return int(action)
    return str(action) if isinstance(action, bool) else action  # which is no index


@part(kw_only=True)
class Action(Part):
    """An action, as a file describes it."""

    place: str  #: its file and line, or entry
    subject: Text  #: who took it, as the file names them
    condition: Text
    trial: Number  #: in the whole condition, or in its phase and loop if these are given
    attempt: Number
    action: Annotated[int | str, BeforeValidator(_index)]  #: its index or its name
    phase: Text = ""
    loop: Number = 1
    learner: Text = ""  #: label of the learner; empty for the default
    protocol: Text = ""  #: empty for the default
    layout: Text = ""  #: name of the room's layout, or positions; empty if it is drawn
    moved: bool | None = None  #: whether it moved a lever or the door, as the next ones if known
    unlocked: bool | None = None
    opened: bool | None = None
    new_solution: bool | None = None
    reaction: Seconds | None = None  #: seconds that it took
    time: Seconds | None = None  #: seconds since the subject began
    experiment: Text = ""  #: of an export, as the seed
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0


def actions_in(path: Path) -> Iterator[Action]:
    """The actions in a file, in its order.

    Raises:
        OpenLockError: If the file cannot be read, or a row is not valid; the message names it.
    """
    text = _text(path)
    rows = _entries(text, path) if text.lstrip()[:1] in ("[", "{") else _table(text, path)
    last: dict[tuple[str, str, str], float] = {}
    for place, row in rows:
        known = [name for name in Action.__dataclass_fields__ if row.get(name) not in EMPTY]
        with fault_at(place):
            action: Action = read(Action, {**{name: row[name] for name in known}, "place": place})
            who = action.learner, action.condition, action.subject
            before = last.get(who, 0.0)
            last[who] = before if action.time is None else action.time
            if last[who] < before:
                raise OpenLockError(
                    f"time is {last[who]:g}, and was {before:g} before; it is seconds since the "
                    "subject began, and rows are in the order of time"
                )
        yield action


@contextmanager
def fault_at(place: str) -> Iterator[None]:
    """Name the place in the file of the first fault in a block."""
    try:
        yield
    except OpenLockError as error:
        raise OpenLockError(f"{place}: {error.parts[0]}") from None


def _text(path: Path) -> str:
    try:
        content = path.read_bytes()
        packed = path.suffix.lower() == ".gz"
        return (gzip.decompress(content) if packed else content).decode("utf-8-sig")
    except UnicodeDecodeError:
        raise OpenLockError(f"{path} is not UTF-8; save it as UTF-8") from None
    except (OSError, EOFError, zlib.error) as error:
        why = getattr(error, "strerror", None) or "it is not a whole gzip file"
        raise OpenLockError(f"{path} cannot be read ({why}); give a file of CSV or JSON") from None


def _table(text: str, path: Path) -> Iterator[tuple[str, Row]]:
    """The actions in a table, each with its place."""
    separator = max(",;\t|", key=text.lstrip().partition("\n")[0].count)
    reader = csv.reader(io.StringIO(text, newline=""), delimiter=separator, strict=True)

    def lines() -> Iterator[tuple[str, list[str]]]:
        begins = 1  # a cell may have several lines
        try:
            for cells in reader:
                place, begins = f"{path}:{begins}", reader.line_num + 1
                if any(map(str.strip, cells)):
                    yield place, [cell.strip() for cell in cells]
        except csv.Error as error:
            raise OpenLockError(f"{path}:{begins}: this is not CSV ({error})") from None

    def rows() -> Iterator[tuple[str, Row]]:
        for place, cells in table:
            if len(cells) != len(header):
                raise OpenLockError(f"{place}: there are not {len(header)} cells; is it whole?")
            row = dict(zip(header, cells, strict=True))
            if separator != ",":
                row |= {name: row[name].replace(",", ".") for name in SECONDS if name in row}
            yield place, row

    table = lines()
    first, heads = next(table, (f"{path}:1", []))
    header = [" ".join(head.split()) for head in heads]
    if twice := [name for name in header if name and header.count(name) > 1]:
        raise OpenLockError(f"{first}: the column {twice[0]} is there twice")
    jspsych = "trial_type" in header or "time_elapsed" in header
    if {*record_schema().names} <= {*header}:
        yield from _of_attempts(rows())
    elif missing := [name for name in NEEDED[jspsych:] if name not in header]:
        raise OpenLockError(
            f"{first}: there is no column {missing[0]}; found: {', '.join(header)}; a table of "
            f"actions has {', '.join(NEEDED)}, and an export of this project the columns of a "
            "record"
        )
    else:
        yield from _screens(rows(), path) if jspsych else rows()


def _of_attempts(rows: Iterable[tuple[str, Row]]) -> Iterator[tuple[str, Row]]:
    """The actions of the attempts of an export; their time is that of the last one's end."""
    for place, row in rows:
        actions, moved = row["actions"].split(), row["moved"].split()
        if not actions or len(actions) != len(moved):
            raise OpenLockError(f"{place}: actions and moved must be of one length, at least 1")
        kept = {name: row[name] for name in row if name not in CLAIMS}
        for number, (action, flag) in enumerate(zip(actions, moved, strict=True), 1):
            ended = row["wall_time"] if number == len(actions) else ""
            yield place, {**kept, "action": action, "moved": flag, "time": ended}


def _screens(rows: Iterable[tuple[str, Row]], path: Path) -> Iterator[tuple[str, Row]]:
    """The actions on jsPsych's screens, with times in seconds; other screens are passed over.

    Where no subject is named, the file is one subject's. After a page was loaded again, its clock
    begins anew, and the time continues.
    """
    last, begun = dict[str, float](), dict[str, float]()
    for place, screen in rows:
        if screen.get("action") in EMPTY:
            continue
        row = {"subject": str(path)[-200:], **{k: v for k, v in screen.items() if v not in EMPTY}}
        if "rt" in row:
            row.setdefault("reaction", _in_seconds(row["rt"], "rt", place))
        if "time_elapsed" in row:
            who, elapsed = str(row["subject"]), _in_seconds(row["time_elapsed"], "time", place)
            if elapsed < last.get(who, 0.0):
                begun[who] = begun.get(who, 0.0) + last[who]
            last[who] = elapsed
            row.setdefault("time", elapsed + begun.get(who, 0.0))
        yield place, row


def _in_seconds(value: Any, name: str, place: str) -> float:
    try:
        return float(value) / 1000
    except (TypeError, ValueError, OverflowError):
        raise OpenLockError(f"{place}: {name} must be a number, and is {value!r:.40}") from None


def _entries(text: str, path: Path) -> Iterator[tuple[str, Row]]:
    """The actions in a list of entries; lists in a list, or one in each line, are one list."""
    parsed = partial(json.loads, parse_constant=str)  # NaN is empty, as in a table
    try:
        lists = parsed(text)
    except (ValueError, RecursionError) as error:
        try:
            lists = [parsed(line) for line in text.splitlines() if line.strip()]
        except (ValueError, RecursionError):
            line = getattr(error, "lineno", 1)
            raise OpenLockError(f"{path}:{line}: this is not JSON; is the file whole?") from None
    lists = lists if isinstance(lists, list) else [lists]
    flat = chain.from_iterable(one if isinstance(one, list) else [one] for one in lists)
    numbered = [(f"{path} (entry {number})", entry) for number, entry in enumerate(flat, 1)]
    for place, entry in numbered:
        if not isinstance(entry, Mapping):
            raise OpenLockError(f"{place}: this is not an entry of a list, as jsPsych saves it")
    yield from _screens(numbered, path)
