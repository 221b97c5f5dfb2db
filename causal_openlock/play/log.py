"""The log of a play: one line for everything people do, and all that is needed to continue.

A line is JSON, a tab and a checksum. The operating system has it before the click is answered, so a
server that is killed loses nothing; it is on the disk a second later (:meth:`Log.sync`), so a power
cut loses at most that second. A last line that was cut short was never answered and is dropped;
damage anywhere else is an error, since what follows would be replayed in the wrong state.
"""

from __future__ import annotations

import json
import os
import re
import threading
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_bytes

Entry = dict[str, Any]


class Log:
    """An append-only file of entries.

    Args:
        path: The file; made if it is not there.

    Attributes:
        entries: The entries that it held when it was opened.

    Raises:
        StoreError: If it cannot be opened or is damaged.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._lock = threading.Lock()
        self._unsynced = False
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
            content = path.read_bytes()
            self.entries, self._size = self._parsed(content)
            if self._size < len(content):
                os.ftruncate(self._file, self._size)
        except OSError as error:
            raise StoreError(
                f"{path} cannot be opened ({error.strerror}); check its permissions"
            ) from None
        except StoreError:
            os.close(self._file)
            raise

    def read(self) -> tuple[list[Entry], int]:
        """The entries that are in the file now, and how many bytes they have."""
        return self._parsed(self.path.read_bytes())

    def _parsed(self, content: bytes) -> tuple[list[Entry], int]:
        """The entries, and how many bytes of the file are whole lines."""
        entries: list[Entry] = []
        size = 0
        lines = content.splitlines(keepends=True)
        for number, line in enumerate(lines, start=1):
            text = _checked(line)
            if text is None and number == len(lines):
                break
            entry = None if text is None else _parse(text)
            if entry is None:
                raise self.fault(number, "this line is damaged")
            entries.append(entry)
            size += len(line)
        return entries, size

    def fault(self, line: int, what: str) -> StoreError:
        """An error that names the file and the line."""
        return StoreError(f"{self.path}:{line}: {what}; restore the file, or choose another folder")

    def append(self, entry: Entry) -> None:
        """Add an entry, which from then on outlives this process.

        Raises:
            StoreError: If it cannot be written; nothing of it is in the file then.
        """
        line = _line(entry)
        with self._lock:
            written, why = 0, "the disk is full"
            try:
                written = os.write(self._file, line)
            except OSError as error:
                why = str(error.strerror)
            if written < len(line):
                os.ftruncate(self._file, self._size)
                raise StoreError(f"{self.path} cannot be written ({why}); free some space")
            self._size += written
            self._unsynced = True

    def rewrite(self, entries: Iterable[Entry]) -> None:
        """Replace everything in the file, at once or not at all; another one is opened for it.

        Raises:
            StoreError: If it cannot be written.
        """
        with self._lock:
            write_bytes(self.path, b"".join(map(_line, entries)))
            os.close(self._file)
            self._file = os.open(self.path, os.O_RDWR | os.O_APPEND, 0o600)
            self.path.chmod(0o600)
            self._size = self.path.stat().st_size

    def sync(self) -> None:
        """Flush everything to the disk."""
        if self._unsynced:
            self._unsynced = False
            os.fsync(self._file)

    def close(self) -> None:
        """Sync and close the file."""
        with self._lock:
            self.sync()
            os.close(self._file)


def _line(entry: Entry) -> bytes:
    text = json.dumps(entry, separators=(",", ":")).encode()
    return b"%b\t%08x\n" % (text, zlib.crc32(text))


def _checked(line: bytes) -> bytes | None:
    """The JSON of a line, if its checksum is right."""
    text, tab, check = line.rpartition(b"\t")
    return text if tab and check == b"%08x\n" % zlib.crc32(text) else None


def _parse(text: bytes) -> Entry | None:
    try:
        entry = json.loads(text)
    except (ValueError, RecursionError):
        return None
    return entry if isinstance(entry, dict) else None


def is_join(entry: Entry) -> bool:
    """Whether an entry is that of a person who joined.

    It may say that they are ``asked`` about rooms, and to which ``consent`` they agreed.
    """
    return (
        entry.keys() - {"ask", "consent"} == {"join", "key", "at", "practice"}
        and isinstance(entry.get("ask", False), bool)
        and _is_number(entry["join"])
        and _is_session(entry)
        and isinstance(entry["practice"], bool)
    )


def is_return(entry: Entry) -> bool:
    """Whether an entry gives a person who has joined before a further session."""
    return (
        entry.keys() - {"consent"} == {"of", "key", "at"}
        and _is_number(entry["of"])
        and _is_session(entry)
    )


def is_forgotten(entry: Entry) -> bool:
    """Whether an entry stands for a person whose data were deleted."""
    return entry.keys() == {"join", "forgotten"} and _is_number(entry["join"])


def is_name(entry: Entry) -> bool:
    """Whether an entry has the identifiers that a recruiting service gives a person who joined."""
    identifiers = [value for key, value in entry.items() if key != "join"]
    return _is_number(entry.get("join")) and all(isinstance(one, str) for one in identifiers)


def is_turn(entry: Entry) -> bool:
    """Whether an entry is that of a turn.

    That is an action, an answer about a room, or that the practice room was left.
    """
    answered = entry.keys() == {"of", "turn", "at", "edges"}
    if answered and not isinstance(entry["edges"], list):
        return False
    acted = entry.keys() == {"of", "turn", "at", "action", "reaction"}
    return (
        (acted or answered or entry.keys() == {"of", "turn", "at"})
        and all(_is_number(entry[key]) for key in ("of", "turn"))
        and _is_time(entry["at"])
        and (not acted or _is_number(entry["action"]))
        and (not acted or entry["reaction"] is None or _is_number(entry["reaction"]))
    )


def _is_session(entry: Entry) -> bool:
    """Whether key, time and consent of a session are what they have to be."""
    return (
        re.fullmatch("[0-9a-f]{16}|", str(entry.get("consent", ""))) is not None
        and isinstance(entry["key"], str)
        and re.fullmatch("[0-9a-f]{64}", entry["key"]) is not None
        and _is_time(entry["at"])
    )


def _is_number(value: Any) -> bool:
    return type(value) is int and 0 <= value < 1 << 53


def _is_time(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < 1e12  # thirty thousand years; NaN is not
