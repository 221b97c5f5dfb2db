"""The identifiers that a recruiting service gives people, apart from the log of what they do."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path

from causal_openlock.play.log import Log, is_name

RECRUITED = "recruited.jsonl"
"""Identifiers of people, by the number of joining."""


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

    def number(self, given: Mapping[str, str]) -> int | None:
        """The number of the person who has joined with the first of these identifiers."""
        return self._numbers.get(given.get(self.keys[0], "")) if self.keys else None

    def add(self, number: int, given: Mapping[str, str]) -> None:
        """Keep the identifiers of a person who has joined.

        Raises:
            StoreError: If they cannot be written.
        """
        if self._log is not None:
            kept = {key: value for key, value in given.items() if key in self.keys}
            self._log.append({"join": number, **kept})
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
