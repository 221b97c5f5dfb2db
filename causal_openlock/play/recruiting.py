"""The identifiers that a recruiting service gives people, apart from the log of what they do.

They come with the address of the page, and lead back to the service: its page of completion can
have them in its address.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from urllib.parse import SplitResult, quote, urlsplit

from causal_openlock.errors import OpenLockError, StoreError
from causal_openlock.files.atomic import write_text
from causal_openlock.files.escaping import cell
from causal_openlock.play.refusals import Refused

RECRUITED = "recruited.csv"
"""A row for each person: the number of joining, and their identifiers."""
LONGEST = 300
"""The most characters of an identifier; a signed one or an e-mail address has fewer."""
PLACEHOLDER = re.compile(r"\{.+\}|\$\{.+\}|\[?%\w+%\]?|<.+>")
"""What services replace by an identifier."""


class Recruited:
    """The identifiers of the people in a folder; the first one identifies the person.

    Args:
        folder: The folder.
        keys: Names of identifiers, as they are in the address; empty if no service is used.

    Raises:
        StoreError: If the file is damaged.
    """

    def __init__(self, folder: Path, keys: Sequence[str]) -> None:
        self.keys, self._path = tuple(keys), folder / RECRUITED
        self._given: dict[int, dict[str, str]] = {}  # by number of joining
        try:
            text = self._path.read_text("utf-8") if self._path.exists() else ""
            for row in csv.DictReader(io.StringIO(text), strict=True):
                plain = {key: _without_apostrophe(value) for key, value in row.items() if value}
                self._given[int(plain.pop("join"))] = plain
        except (OSError, ValueError, LookupError, AttributeError, csv.Error):
            raise StoreError(
                f"{self._path} is damaged; restore the file, or choose another folder"
            ) from None

    def identifiers(self, given: Mapping[str, str]) -> dict[str, str]:
        """The identifiers that are asked for, without spaces around them.

        Raises:
            Refused: If the first is missing, or one cannot be an identifier.
        """
        kept = {key: given[key].strip() for key in self.keys if given.get(key, "").strip()}
        faults = [f"{key} {fault}" for key, value in kept.items() if (fault := _fault(value))]
        if self.keys and self.keys[0] not in kept:
            faults = [f"{self.keys[0]} is missing"]
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
        return kept

    @property
    def numbers(self) -> set[int]:
        """Numbers of the people whose identifiers are kept."""
        return {*self._given}

    def number(self, identifiers: Mapping[str, str]) -> int | None:
        """The number of the person who has joined with the first of these identifiers."""
        if not self.keys:
            return None
        first, known = self.keys[0], self._given.items()
        numbers = (number for number, kept in known if kept.get(first) == identifiers[first])
        return next(numbers, None)

    def of(self, number: int) -> dict[str, str]:
        """The identifiers of one person, by the number of joining."""
        return self._given.get(number, {})

    def add(self, number: int, identifiers: Mapping[str, str]) -> None:
        """Keep the :meth:`identifiers` of a person who has joined, or comes again."""
        if self.keys and self.of(number) != identifiers:
            self._given[number] = {**self.of(number), **identifiers}
            self._write()

    def forget(self, number: int) -> None:
        """Delete the identifiers of one person."""
        if self._given.pop(number, None) is not None:
            self._write()

    def _write(self) -> None:
        keys = dict.fromkeys([*self.keys, *(key for kept in self._given.values() for key in kept)])
        text = io.StringIO()
        rows = csv.DictWriter(text, ["join", *keys], restval="", lineterminator="\n")
        rows.writeheader()
        for number, kept in self._given.items():
            rows.writerow({"join": number, **{key: cell(value) for key, value in kept.items()}})
        write_text(self._path, text.getvalue())
        self._path.chmod(0o600)


def _without_apostrophe(value: str) -> str:
    """A value as it was before :func:`~causal_openlock.files.escaping.cell`."""
    return value[1:] if value.startswith("'") and cell(value[1:]) == value else value


def _fault(value: str) -> str:
    """Fault of an identifier, as the end of a sentence; empty if there is none."""
    if len(value) > LONGEST:
        return f"is longer than {LONGEST} characters"
    if not value.isprintable():
        return "has characters that cannot be seen"
    if PLACEHOLDER.fullmatch(value):
        return f"is {value}, which stands for an identifier that was not filled in"
    return ""


def completion(address: str, keys: Sequence[str]) -> str:
    """The address of the page of completion, if it is one.

    Raises:
        OpenLockError: If it is not, or has a placeholder that no identifier fills in.
    """
    plain = filled(address, dict.fromkeys(keys, "x"))
    if address and not web_page(plain):
        raise OpenLockError(
            f"{address!r} is not an address of a page; give one such as "
            "https://app.prolific.com/submissions/complete?cc=C0DE"
        )
    if left := re.search(r"[{}<>]|%(?![0-9a-fA-F]{2})\w*%?", plain):
        raise OpenLockError(
            f"--completion {address} has {left[0]}, which nothing fills in; %NAME% is filled in "
            "with the identifier NAME of --recruiting, and a percent sign is written %25"
        )
    return address


def filled(address: str, identifiers: Mapping[str, str]) -> str:
    """An address with a person's identifiers in the place of their names.

    >>> filled("https://a.org/?code=%PID%", {"PID": "a&b"})
    'https://a.org/?code=a%26b'
    """
    for key, value in identifiers.items():
        address = address.replace(f"%{key}%", quote(value, safe=""))
    return address


def web_page(address: str) -> SplitResult | None:
    """The parts of an address of a page; None if it is not one."""
    try:
        parts = urlsplit(address)
        whole = parts.scheme in ("http", "https") and parts.hostname and parts.port != 0
    except ValueError:  # a bracket that is not closed, an invalid port
        return None
    return parts if whole else None
