"""The text of a file of data, perhaps compressed."""

from __future__ import annotations

import gzip
import zlib
from codecs import BOM_UTF8
from pathlib import Path
from typing import BinaryIO

from causal_openlock.errors import OpenLockError

MOST_BYTES, MOST_LINES = 128 << 20, 1_000_000
"""Limits of an unpacked file, which is held in memory: a few hundred bytes for each line."""


def read_text(path: Path) -> str:
    """The text of a file, perhaps compressed by gzip.

    Raises:
        OpenLockError: If it cannot be read, or is not a text.
    """
    try:
        with _opened(path) as file:
            content = file.read(MOST_BYTES + 1)
        if len(content) > MOST_BYTES or content.count(b"\n") > MOST_LINES:
            raise OpenLockError(
                f"{path} has more than {MOST_BYTES >> 20} MB or {MOST_LINES:,} lines; import it in "
                "parts, and read the results together"
            )
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise OpenLockError(f"{path} is not UTF-8; save it as UTF-8") from None
    except (OSError, EOFError, zlib.error) as error:
        why = getattr(error, "strerror", None) or "it is not a whole gzip file"
        raise OpenLockError(f"{path} cannot be read ({why}); give a file of CSV or JSON") from None


def is_json(path: Path) -> bool:
    """Whether a file is to be read as JSON: it is called so, or its text begins so.

    Servers call what they have collected as they like; JATOS says ``.txt``.
    """
    try:
        with _opened(path) as file:
            begins = file.read(1024)
    except (OSError, EOFError, zlib.error):
        begins = b""  # whoever reads it says what is wrong
    return path.suffix.lower() == ".json" or begins.removeprefix(BOM_UTF8).lstrip()[:1] in (
        b"[",
        b"{",
    )


def _opened(path: Path) -> BinaryIO | gzip.GzipFile:
    return gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb")
