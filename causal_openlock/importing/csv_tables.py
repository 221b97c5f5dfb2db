"""CSV: this project's own, a row for each attempt, or any table with a row for each action.

Its header says which form it has: the own form has the columns of a record
(:func:`~causal_openlock.experiment.record.record_schema`), in which ``actions`` are several; a
table of actions has a column ``action``, and a table that jsPsych saves also has its own
columns. Columns that mean nothing here are passed over. Where a spreadsheet has saved it, columns
may be separated by ``;`` or tabs, and numbers have a decimal comma; the header says that as well.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from causal_openlock.experiment.record import record_schema
from causal_openlock.importing.imported_actions import (
    CLAIMS,
    COLUMNS,
    ActionEntry,
    Place,
    action_entry,
    in_order,
    number,
    seconds,
    text,
    truth,
    whole,
)
from causal_openlock.importing.jspsych import OWN, screen_actions
from causal_openlock.importing.text import read_text

NEEDED = ("subject", "condition", "trial", "attempt", "action")
"""The columns that a table of actions has to have."""
SEPARATORS = {",": "commas", ";": "semicolons", "\t": "tabs", "|": "strokes"}
_NUMBERS = ("solution", "solutions_found", "solutions")
_TRUTHS = ("unlocked", "opened", "new_solution")
_DECIMALS = ("reaction", "time", "wall_time", "reward", "rt", "time_elapsed")
_COMMA = re.compile(r"[+-]?\d+,\d+", re.ASCII)
_SAID = re.compile(r"\"?sep=([,;|\t])\"?(?:\r\n?|\n)", re.IGNORECASE)
"""The first line by which a spreadsheet is told what separates columns."""
_EMPTY = re.compile(r"(?:[^\S\n]*\n)*")


@dataclass(frozen=True)
class Table:
    """A table of text, of which no row has been read yet.

    Attributes:
        path: The file.
        separator: What separates columns.
        header: Names of columns.
        skipped: How many lines stand above the header.
        content: All lines from the header on.
    """

    path: Path
    separator: str
    header: tuple[str, ...]
    skipped: int
    content: str

    @classmethod
    def opened(cls, path: Path) -> Table:
        """The table in a file.

        Raises:
            OpenLockError: If it cannot be read.
        """
        content = read_text(path)
        said = _SAID.match(content)
        begin = _EMPTY.match(content, said.end() if said else 0).end()  # type: ignore[union-attr]
        skipped = len(content[:begin].splitlines())
        content = content[begin:]
        possible = (said[1],) if said else tuple(SEPARATORS)
        tables = [cls(path, one, _header(content, one), skipped, content) for one in possible]
        known = [one for one in tables if one.is_own or not one.missing]
        # Of a table that is none, the reading with most columns is the one to speak of.
        return known[0] if known else max(tables, key=lambda one: len(one.header))

    @property
    def is_own(self) -> bool:
        """Whether the table has the columns of a record."""
        return {*record_schema().names} <= {*self.header}

    @property
    def is_of_jspsych(self) -> bool:
        """Whether the table has columns of jsPsych's own."""
        return bool(OWN & {*self.header})

    @property
    def missing(self) -> list[str]:
        """The columns that a table of actions needs and lacks; jsPsych's may be one subject's."""
        return [name for name in NEEDED[self.is_of_jspsych :] if name not in self.header]

    def remarks(self) -> list[str]:
        """Remarks on how the table was read, for its writer, a sentence each."""
        said = []
        if self.separator != ",":
            said.append(
                f"columns are separated by {SEPARATORS[self.separator]}, and 0,5 is read as 0.5"
            )
        known = {*NEEDED, *COLUMNS, *CLAIMS}
        if not self.is_own and not self.is_of_jspsych:
            unknown = [name for name in self.header if name and name not in known]
            said += [f"passed over: {', '.join(unknown)}"] if unknown else []
        return [f"{self.path}: {one}" for one in said]

    def rows(self) -> Iterator[tuple[Place, dict[str, str]]]:
        """The table's rows by column, each with its place; empty rows are skipped.

        Raises:
            ImportFault: If it is not CSV, or a row has too few or too many cells.
        """
        reader = csv.reader(
            io.StringIO(self.content, newline=""), strict=True, delimiter=self.separator
        )
        try:
            next(reader, None)
            begins = reader.line_num + 1  # a cell may have several lines
            for row in reader:
                place = Place(self.path, begins + self.skipped)
                begins = reader.line_num + 1
                if not any(map(str.strip, row)):
                    continue
                if len(row) != len(self.header):
                    raise place.fault(
                        f"there are {len(row)} cells and {len(self.header)} columns; is the file "
                        "whole?"
                    )
                values = dict(zip(self.header, map(str.strip, row), strict=True))
                yield place, self._with_points(values)
        except csv.Error as error:
            place = Place(self.path, max(reader.line_num, 1) + self.skipped)
            raise place.fault(f"this is not CSV ({error})") from None

    def _with_points(self, values: dict[str, str]) -> dict[str, str]:
        """Values with decimal points, where a comma cannot be the end of a cell."""
        if self.separator == ",":
            return values
        return {
            name: value.replace(",", ".")
            if name in _DECIMALS and _COMMA.fullmatch(value)
            else value
            for name, value in values.items()
        }


def _header(content: str, separator: str) -> tuple[str, ...]:
    """The first row's cells; empty where the text is not CSV."""
    try:
        row = next(csv.reader(io.StringIO(content, newline=""), delimiter=separator), [])
    except csv.Error:
        return ()
    return tuple(" ".join(cell.split()) for cell in row)


def table_actions(table: Table) -> Iterator[ActionEntry]:
    """The actions in a CSV file, in its order.

    Raises:
        OpenLockError: If it is none of the forms, or a row is none.
    """
    header, head = table.header, Place(table.path, 1 + table.skipped)
    if twice := [name for name, times in Counter(header).items() if name and times > 1]:
        raise head.fault(f"the column {twice[0]} is there twice; remove one")
    if table.is_own:
        for place, values in table.rows():
            yield from _attempt(place, values)
        return
    if missing := table.missing:
        next(table.rows(), None)  # says what is wrong with a header that is not CSV
        found = f"found: {', '.join(header)}; rename the column" if header else "it is empty"
        raise head.fault(
            f"there is no column {missing[0]}; {found}: a table of actions has "
            f"{', '.join(NEEDED)}, and an export of this project the columns of a record"
        )
    if table.is_of_jspsych:
        yield from in_order(screen_actions(table.rows(), table.path.stem))
    else:
        yield from in_order(action_entry(place, values) for place, values in table.rows())


def experiment_of(table: Table) -> tuple[str, int] | None:
    """The experiment's name and seed in the first row of an own CSV; None of another file.

    Raises:
        OpenLockError: If it is not CSV.
    """
    if not table.is_own:
        return None
    for place, row in table.rows():
        return text(place, "experiment", row["experiment"]), whole(place, "seed", row["seed"], 0)
    return None


def _attempt(place: Place, row: Mapping[str, str]) -> Iterator[ActionEntry]:
    """The actions of an attempt; its result is given with the last action."""
    actions, moved = row["actions"].split(), row["moved"].split()
    if not actions or len(actions) != len(moved):
        raise place.fault("actions and moved must have the same length, at least 1")
    stated: dict[str, Any] = {name: truth(place, name, row[name]) for name in _TRUTHS}
    # -1 is no solution.
    stated |= {name: whole(place, name, row[name].removeprefix("-"), 0) for name in _NUMBERS}
    stated["solution"] *= -1 if row["solution"].startswith("-") else 1
    stated |= {name: row[name] for name in ("phase", "schema", "layout", "category")}
    stated["loop"] = whole(place, "loop", row["loop"])
    stated["reward"] = number(place, "reward", row["reward"])
    trial, attempt = (whole(place, name, row[name]) for name in ("trial", "attempt"))
    last = len(actions) - 1
    for at, (action, flag) in enumerate(zip(actions, moved, strict=True)):
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
            time=seconds(place, "wall_time", row["wall_time"]) if at == last else None,
        )
