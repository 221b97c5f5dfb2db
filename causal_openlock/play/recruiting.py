"""The identifiers that a recruiting service gives people, apart from the log of what they do."""

from __future__ import annotations

import re
from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from causal_openlock.play.log import Log, is_name
from causal_openlock.play.refusals import NotIdentified

RECRUITED = "recruited.jsonl"
"""Identifiers of people, by the number of joining."""
LONGEST = 300
"""The most characters of an identifier; a signed one or an e-mail address has fewer."""
PLACEHOLDER = re.compile(
    r"\{\{.*\}\}|\{%.*%\}|\{[A-Za-z_]+\}|\$\{.*\}|\[?%\w+%\]?|<.*>|ASSIGNMENT_ID_NOT_AVAILABLE"
)
"""Placeholders that services replace by an identifier, and Mechanical Turk's for a preview."""


class Recruited:
    """The identifiers of the people in a folder; the first one identifies the person.

    Args:
        folder: The folder.
        keys: Names of identifiers, as they are in the address; empty if no service is used.

    Raises:
        StoreError: If the file cannot be opened or is damaged.
    """

    def __init__(self, folder: Path, keys: Sequence[str]) -> None:
        self.keys = tuple(keys)
        path = folder / RECRUITED
        self._log = Log(path) if keys or path.exists() else None
        self._numbers: dict[str, int] = {}

    def identifiers(self, given: Mapping[str, str]) -> dict[str, str]:
        """The identifiers that are asked for, without spaces around them.

        Raises:
            NotIdentified: If the first is missing, or one cannot be an identifier.
        """
        kept = {key: given[key].strip() for key in self.keys if given.get(key, "").strip()}
        for key, value in kept.items():
            if fault := _fault(key, value):
                raise NotIdentified(f"{key} in the address of the page {fault}")
        if self.keys and self.keys[0] not in kept:
            raise NotIdentified(f"the address of the page has no {self.keys[0]}")
        return kept

    def number(self, identifier: str) -> int | None:
        """The number of the person who has joined with this first identifier."""
        return self._numbers.get(identifier)

    def add(self, number: int, given: Mapping[str, str]) -> None:
        """Keep the :meth:`identifiers` of a person who has joined.

        Raises:
            StoreError: If they cannot be written.
        """
        if self._log is not None:
            self._log.append({"join": number, **given})
        self._name(number, given)

    def _name(self, number: int, given: Mapping[str, str]) -> None:
        if self.keys and (first := given.get(self.keys[0])):
            self._numbers[first] = number

    def resume(self, there: Collection[int]) -> None:
        """Read the file; those who are not in the log, or were forgotten, are dropped.

        Raises:
            StoreError: If a line is malformed, or the file cannot be written.
        """
        if self._log is None:
            return
        for line, one in enumerate(self._log.entries, start=1):
            if not is_name(one):
                raise self._log.fault(line, "this line names nobody who plays")
        kept = [one for one in self._log.entries if one["join"] in there]
        if len(kept) < len(self._log.entries):
            self._log.rewrite(kept)
        for one in reversed(kept):  # of two of one name, the first to join is meant
            self._name(one["join"], one)
        self._log.entries = []

    def forget(self, number: int) -> None:
        """Delete the identifiers of one person.

        Raises:
            StoreError: If the file cannot be written.
        """
        self._numbers = {name: one for name, one in self._numbers.items() if one != number}
        if self._log is not None:
            entries, _ = self._log.read()
            self._log.rewrite(one for one in entries if one["join"] != number)

    def close(self) -> None:
        """Close the file."""
        if self._log is not None:
            self._log.close()


def _fault(key: str, value: str) -> str:
    """Fault of an identifier, as the end of a sentence; empty if there is none."""
    if len(value) > LONGEST:
        return f"is longer than {LONGEST} characters"
    if not value.isprintable():
        return "has characters that cannot be seen"
    if PLACEHOLDER.fullmatch(value) or _letters(value) == _letters(key):
        return f"is {value}, which stands for an identifier that was not filled in"
    return ""


def _letters(text: str) -> str:
    return re.sub(r"[\W_]", "", text).lower()
