"""CSV: this project's own, a row for each attempt, or any table with a row for each action.

Which it is, its header says: the own form has the columns of a record
(:func:`~causal_openlock.experiment.record.record_schema`), in which ``actions`` are several; a
table of actions has a column ``action``. Columns that mean nothing here are passed over.
"""

from __future__ import annotations

import csv
import gzip
import io
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.record import record_schema
from causal_openlock.importing.actions import (
    ActionEntry,
    Place,
    action_entry,
    seconds,
    text,
    truth,
    whole,
)

MOST_BYTES, MOST_LINES = 128 << 20, 1_000_000
"""Of a file, unpacked: what is read is held in memory, a few hundred bytes for each line."""
NEEDED = ("subject", "condition", "trial", "attempt", "action")
"""The columns that a table of actions has to have."""
_NUMBERS = ("solution", "solutions_found", "solutions")
_TRUTHS = ("unlocked", "opened", "new_solution")


def read_text(path: Path) -> str:
    """The text of a file, perhaps compressed by gzip.

    Raises:
        OpenLockError: If it cannot be read, or is no text.
    """
    try:
        with gzip.open(path) if path.suffix == ".gz" else path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES or content.count(b"\n") > MOST_LINES:
            raise OpenLockError(
                f"{path} has more than {MOST_BYTES >> 20} MB or {MOST_LINES:,} lines; import it in "
                "parts, and read the results together"
            )
        return content.decode("utf-8-sig")
    except (OSError, EOFError, zlib.error, UnicodeDecodeError) as error:
        why = getattr(error, "strerror", None) or "it is no text in UTF-8"
        raise OpenLockError(f"{path} cannot be read ({why}); give a file of CSV or JSON") from None


def table_actions(path: Path) -> Iterator[ActionEntry]:
    """The actions in a CSV file, in its order.

    Raises:
        OpenLockError: If it is none of the two forms, or a row is none.
    """
    content = read_text(path)
    first = content.partition("\n")[0]
    for sign, called in ((";", "';'"), ("\t", "tabs")):
        if sign in first and "," not in first:
            raise Place(path, 1).fault(
                f"the columns are separated by {called}; save it with commas"
            )
    reader = csv.reader(io.StringIO(content, newline=""), strict=True)
    try:
        header = [name.strip() for name in next(reader, [])]
        own = {*record_schema().names} <= {*header}
        if twice := {name for name in header if name and header.count(name) > 1}:
            raise Place(path, 1).fault(f"the column {min(twice)} is there twice; remove one")
        if not own and (missing := [name for name in NEEDED if name not in header]):
            found = f"found: {', '.join(header)}; rename the column" if header else "it is empty"
            raise Place(path, 1).fault(
                f"there is no column {missing[0]}; {found}: a table of actions has "
                f"{', '.join(NEEDED)}, and an export of this project the columns of a record"
            )
        for row in reader:
            place = Place(path, reader.line_num)
            if not row:
                continue
            if len(row) != len(header):
                raise place.fault(
                    f"there are {len(row)} cells and {len(header)} columns; is the file whole?"
                )
            values = dict(zip(header, map(str.strip, row), strict=True))
            if own:
                yield from _attempt(place, values)
            else:
                yield action_entry(place, values)
    except csv.Error as error:
        raise Place(path, reader.line_num).fault(f"this is no CSV ({error})") from None


def experiment_of(path: Path) -> tuple[str, int] | None:
    """The experiment's name and seed in the first row of an own CSV; None of another file.

    Raises:
        OpenLockError: If it cannot be read, or is no CSV.
    """
    reader = csv.DictReader(io.StringIO(read_text(path), newline=""))
    try:
        row = next(reader, {})
    except csv.Error as error:
        raise Place(path, reader.line_num or 1).fault(f"this is no CSV ({error})") from None
    if not {*record_schema().names} <= row.keys():
        return None
    place = Place(path, reader.line_num)
    return text(place, "experiment", row["experiment"]), whole(place, "seed", row["seed"], 0)


def _attempt(place: Place, row: Mapping[str, str]) -> Iterator[ActionEntry]:
    """The actions of an attempt; what came of it stands with its last one."""
    actions, moved = row["actions"].split(), row["moved"].split()
    if not actions or len(actions) != len(moved):
        raise place.fault("actions and moved must be as many, and at least one")
    stated: dict[str, Any] = {name: truth(place, name, row[name]) for name in _TRUTHS}
    # -1 is no solution.
    stated |= {name: whole(place, name, row[name].removeprefix("-"), 0) for name in _NUMBERS}
    stated["solution"] *= -1 if row["solution"].startswith("-") else 1
    stated |= {name: row[name] for name in ("phase", "schema", "layout", "category")}
    stated["loop"] = whole(place, "loop", row["loop"])
    try:
        stated["reward"] = float(row["reward"])
    except ValueError:
        raise place.fault(f"reward must be a number, and this is {row['reward']!r}") from None
    trial, attempt = (whole(place, name, row[name]) for name in ("trial", "attempt"))
    last = len(actions) - 1
    for number, (action, flag) in enumerate(zip(actions, moved, strict=True)):
        yield ActionEntry(
            place,
            text(place, "subject", row["subject"]),
            text(place, "condition", row["condition"]),
            trial,
            attempt,
            whole(place, "actions", action, 0),
            row["learner"],
            row["protocol"],
            row["layout"],
            claims={"moved": truth(place, "moved", flag)},
            of_attempt=stated,
            time=seconds(place, "wall_time", row["wall_time"]) if number == last else None,
        )
