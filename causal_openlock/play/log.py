"""The log of a play: a line for everything people do, and all that is needed to continue.

A line is JSON, in one of the forms below. The operating system has it before the click is answered,
so a server that is killed loses nothing; it is on the disk a second later (:meth:`Log.sync`), so a
power cut loses at most that second. A last line that was cut short was never answered and is
dropped; damage anywhere else is an error, since what follows would be replayed in the wrong state.
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field, ValidationError

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.validation import StrictModel, adapter

Number = Annotated[int, Field(ge=0, lt=1 << 53)]
Milliseconds = Annotated[int, Field(ge=0, le=24 * 60 * 60 * 1000)]
Time = Annotated[float, Field(ge=0, lt=1e12)]
Key = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Consent = Annotated[str, Field(pattern="^([0-9a-f]{16})?$")]


class Began(StrictModel):
    """The first line: the identity of the experiment that people play."""

    identity: str


class Joined(StrictModel):
    """A person joins, in a session whose hash is ``key``."""

    join: Number
    key: Key
    at: Time
    practice: bool
    ask: bool = False
    consent: Consent = ""


class Returned(StrictModel):
    """A person who has joined continues in a further session, such as in another browser."""

    of: Number
    key: Key
    at: Time
    consent: Consent = ""


class Forgotten(StrictModel):
    """A person joined whose data have been deleted."""

    join: Number
    forgotten: Literal[True]


class Move(StrictModel):
    """A person acts, says which lever enables which, or, with neither, leaves the practice room."""

    turn: Number
    action: Number | None = None
    reaction: Milliseconds | None = None
    edges: list[tuple[Number, Number]] | None = None


class Turn(Move):
    """A move by a person."""

    of: Number
    at: Time


Line = Annotated[
    Turn | Joined | Returned | Forgotten | Began, Field(union_mode="left_to_right")
]  # no line has two forms


def read_log(path: Path) -> list[Line]:
    """The lines of a log, without a last one that was cut short; none without a file.

    Raises:
        StoreError: If a line is damaged, or the file cannot be read.
    """
    lines: list[Line] = []
    try:
        content = path.read_bytes() if path.exists() else b""
    except OSError as error:
        raise _inaccessible(path, error) from None
    for number, text in enumerate(content.split(b"\n")[:-1], start=1):
        try:
            # Until 0.2 a tab and a checksum followed the JSON.
            lines.append(adapter(Line).validate_json(text.partition(b"\t")[0]))
        except ValidationError:
            raise fault(path, number, "this line is damaged") from None
    return lines


def write_log(path: Path, lines: Iterable[Line]) -> None:
    """Replace a log, at once or not at all."""
    write_bytes(path, b"".join(map(_bytes, lines)))
    path.chmod(0o600)


def fault(path: Path, line: int, what: str) -> StoreError:
    """An error that names the file and the line."""
    return StoreError(f"{path}:{line}: {what}; restore the file, or choose another folder")


def _inaccessible(path: Path, error: OSError) -> StoreError:
    return StoreError(f"{path} cannot be opened ({error.strerror}); check its permissions")


def _bytes(line: Line) -> bytes:
    return f"{line.model_dump_json(exclude_defaults=True)}\n".encode()


class Log:
    """The file of a log, to which one thread at a time adds lines; made if it is not there.

    Raises:
        StoreError: If it cannot be opened.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        try:
            self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_APPEND, 0o600)
            whole = path.read_bytes().rfind(b"\n") + 1
            os.ftruncate(self._file, whole)  # a last line that was cut short
        except OSError as error:
            raise _inaccessible(path, error) from None

    def append(self, line: Line) -> None:
        """Add a line, which from then on outlives this process.

        Raises:
            StoreError: If it cannot be written; nothing of it is in the file then.
        """
        text, end = _bytes(line), os.fstat(self._file).st_size
        written, why = 0, "the disk is full"
        try:
            written = os.write(self._file, text)
        except OSError as error:
            why = str(error.strerror)
        if written < len(text):
            os.ftruncate(self._file, end)
            raise StoreError(f"{self.path} cannot be written ({why}); free some space")

    def sync(self) -> None:
        """Flush everything to the disk."""
        os.fsync(self._file)

    def close(self) -> None:
        """Sync and close the file."""
        self.sync()
        os.close(self._file)
