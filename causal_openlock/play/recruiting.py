"""The identifiers that a recruiting service gives people, apart from the log of what they do.

They come with the address of the page. The first of them identifies the person.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import cell
from causal_openlock.play.game import Refused

RECRUITED = "recruited.csv"
"""A row for each person: the number of joining, and their identifiers."""
LONGEST = 300
"""The most characters of an identifier; a signed one or an e-mail address has fewer."""
PLACEHOLDER = re.compile(r"\{.+\}|\$\{.+\}|\[?%\w+%\]?|<.+>")
"""What services replace by an identifier."""


def read_identifiers(folder: Path) -> dict[int, dict[str, str]]:
    """The identifiers of the people in a folder, by number of joining; none without a file.

    Raises:
        StoreError: If the file is damaged.
    """
    path, people = folder / RECRUITED, {}
    try:
        text = path.read_text("utf-8") if path.exists() else ""
        for row in csv.DictReader(io.StringIO(text), strict=True):
            given = {key: _without_apostrophe(value) for key, value in row.items() if value}
            people[int(given.pop("join"))] = given
    except (OSError, ValueError, LookupError, AttributeError, csv.Error):
        raise StoreError(f"{path} is damaged; restore the file, or choose another folder") from None
    return people


def write_identifiers(folder: Path, people: Mapping[int, Mapping[str, str]]) -> None:
    """Replace the identifiers in a folder, for nobody else to read."""
    names = dict.fromkeys(name for given in people.values() for name in given)
    text = io.StringIO()
    rows = csv.DictWriter(text, ["join", *names], lineterminator="\n")
    rows.writeheader()
    for number, given in people.items():
        rows.writerow({"join": number, **{name: cell(value) for name, value in given.items()}})
    write_text(folder / RECRUITED, text.getvalue())
    (folder / RECRUITED).chmod(0o600)


def _without_apostrophe(value: str) -> str:
    """A value as it was before :func:`~causal_openlock.files.escaping.cell`."""
    return value[1:] if value.startswith("'") and cell(value[1:]) == value else value


def identified(given: Mapping[str, str], names: Sequence[str]) -> dict[str, str]:
    """The identifiers that are asked for, without spaces around them.

    Raises:
        Refused: If the first is missing, or one cannot be an identifier.
    """
    values = {name: given[name].strip() for name in names if given.get(name, "").strip()}
    faults = [f"{name} {fault}" for name, value in values.items() if (fault := fault_of(value))]
    if names and names[0] not in values:
        faults = [f"{names[0]} is missing"]
    if faults:
        raise Refused(
            400,
            "You cannot begin by this address",
            f"The study does not know who you are: in the address of this page, {faults[0]}. "
            "Please open it again from the page where you found it. If you then see this "
            "again, please tell the person who invited you, and send them these words.",
            f"a person could not join: in the address of the page, {faults[0]}; check the "
            "address that the service has",
        )
    return values


def fault_of(value: str) -> str:
    """Fault of an identifier, as the end of a sentence; empty if there is none."""
    if len(value) > LONGEST:
        return f"is longer than {LONGEST} characters"
    if not value.isprintable():
        return "has characters that cannot be seen"
    if value.startswith("'"):  # with which recruited.csv keeps formulas from spreadsheets
        return "begins with an apostrophe"
    if PLACEHOLDER.fullmatch(value):
        return f"is {value}, which stands for an identifier that was not filled in"
    return ""
