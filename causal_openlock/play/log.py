"""The log of a play: what people did, a line each, and all that is needed to go on.

A line is JSON, a tab and a checksum. It is in the hands of the operating system before the click it
tells of is answered, so a server that is killed loses nothing; and it is on the disk a second later
(:meth:`Log.sync`), so a machine that loses its power loses at most that. A last line that was cut
short was never answered, and is dropped; damage anywhere else is an error, since what follows would
be replayed in the wrong state.
"""

from __future__ import annotations

import json
import os
import threading
import zlib
from pathlib import Path
from typing import Any

from causal_openlock.errors import StoreError

Entry = dict[str, Any]


class Log:
    """An append-only file of entries.

    Args:
        path: The file; made if it is not there.

    Attributes:
        entries: What it held when it was opened.

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
            self.entries, self._size = self._read(content)
            if self._size < len(content):
                os.ftruncate(self._file, self._size)
        except OSError as error:
            raise StoreError(
                f"{path} cannot be opened ({error.strerror}); check its permissions"
            ) from None

    def _read(self, content: bytes) -> tuple[list[Entry], int]:
        """The entries, and how many bytes of the file are whole lines."""
        entries: list[Entry] = []
        size = 0
        lines = content.splitlines(keepends=True)
        for number, line in enumerate(lines, start=1):
            entry = _parse(line)
            if entry is None:
                if number == len(lines):
                    break
                raise StoreError(
                    f"{self.path}:{number}: this line is damaged; restore the file, or choose "
                    "another folder"
                )
            entries.append(entry)
            size += len(line)
        return entries, size

    def append(self, entry: Entry) -> None:
        """Add an entry; it outlives this process from here on.

        Raises:
            StoreError: If it cannot be written; nothing of it is in the file then.
        """
        text = json.dumps(entry, separators=(",", ":")).encode()
        line = b"%b\t%08x\n" % (text, zlib.crc32(text))
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

    def sync(self) -> None:
        """See to it that everything is on the disk."""
        if self._unsynced:
            self._unsynced = False
            os.fsync(self._file)

    def close(self) -> None:
        """Sync and close the file."""
        with self._lock:
            self.sync()
            os.close(self._file)


def _parse(line: bytes) -> Entry | None:
    text, tab, check = line.rpartition(b"\t")
    if not tab or check != b"%08x\n" % zlib.crc32(text):
        return None
    entry: Entry = json.loads(text)
    return entry
