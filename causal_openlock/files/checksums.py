"""Files that contain their own checksum.

A checksum in a second file can be lost, or belong to an earlier version if a process is killed
between the two writes. So it stands inside: the file is made with 64 zeros in its place, the
SHA-256 of that is taken, and its digits replace the zeros. Reading reverses this, so any changed
bit is detected. It does not protect against deliberate forgery.

In a Parquet file it is metadata, in JSON the last key; other programs read both as usual.

>>> content = json_bytes({"answer": 42})
>>> read_json(content)
{'answer': 42}
"""

from __future__ import annotations

import hashlib
import io
import json
import re
import textwrap
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import OpenLockError
from causal_openlock.files.json_text import each_once

if TYPE_CHECKING:
    import pyarrow as pa
    from pyarrow.parquet import ParquetFile

KEY = b"causal_openlock.sha256"
BLANK = b"0" * 64
IN_PARQUET = KEY + b"\x18\x40"
"""The bytes before the digits: the key, and Thrift's header of a text of 64 bytes."""
MOST_VALUES = 50_000_000
"""Values of a table: a cell has at most a few million."""
IN_JSON = b'"sha256": "'


class ChecksumError(OpenLockError):
    """A file is not what was written; the message gives the reason."""


def fill_in(content: bytes, before: bytes) -> bytes:
    """Fill in the checksum after ``before``: :data:`IN_PARQUET` or :data:`IN_JSON`."""
    place = content.rindex(before + BLANK) + len(before)
    digits = hashlib.sha256(content).hexdigest().encode()
    return content[:place] + digits + content[place + len(BLANK) :]


def check(content: bytes, before: bytes) -> None:
    """Verify that a file is what was written.

    Raises:
        ChecksumError: If it is not, or has no checksum.
    """
    place = content.rfind(before)
    if place < 0:
        raise ChecksumError("it has no checksum, as files of earlier versions")
    place += len(before)
    end = place + len(BLANK)
    whole = hashlib.sha256(memoryview(content)[:place])
    whole.update(BLANK)
    whole.update(memoryview(content)[end:])
    if whole.hexdigest().encode() != content[place:end]:
        raise ChecksumError("its checksum does not match, so it is not what was written")


def table_bytes(table: pa.Table, metadata: Mapping[bytes, bytes] | None = None) -> bytes:
    """A table as a Parquet file with its checksum."""
    import pyarrow.parquet as pq

    file = io.BytesIO()
    pq.write_table(
        table.replace_schema_metadata({**(metadata or {}), KEY: BLANK}),
        file,
        compression="zstd",
        write_page_checksum=True,
    )
    return fill_in(file.getvalue(), IN_PARQUET)


def read_table(content: bytes, columns: Sequence[str] | None = None) -> pa.Table:
    """The table of a Parquet file that :func:`table_bytes` made, with the metadata of its schema.

    Raises:
        ChecksumError: If it is not what was written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    check(content, IN_PARQUET)
    try:
        file = pq.ParquetFile(pa.BufferReader(content))
        values = _values(file)
        if values > MOST_VALUES:  # a small file can hold very many equal ones
            raise ChecksumError(f"it holds {values:,} values, more than {MOST_VALUES:,}")
        kept = {k: v for k, v in (file.schema_arrow.metadata or {}).items() if k != KEY}
        # A thread of pyarrow may release the bytes after the table is returned, and aborts a Python
        # that is ending by then (https://github.com/apache/arrow/issues/34314).
        return file.read(columns, use_threads=False).replace_schema_metadata(kept)
    except ChecksumError:
        raise
    # It is complete, but from an unknown source: reading it can raise anything.
    except Exception as error:
        line = " ".join(str(error).split())
        line = re.sub(r"^Could not open Parquet input source '[^']*': ", "", line)
        line = textwrap.shorten(line, 200, placeholder=" …").rstrip(".")
        raise ChecksumError(line or type(error).__name__) from None


def _values(file: ParquetFile) -> int:
    """Number of values in a file, those within lists counted."""
    about, columns = file.metadata, range(len(file.schema))
    lists = [one for one in columns if file.schema.column(one).max_repetition_level]
    if not lists or not about.num_rows:
        return int(about.num_rows * len(columns))
    # Only then may metadata of columns be looked at: where they are malformed, scanning raises, and
    # looking ends the process.
    file.scan_contents([file.schema.column(one).path for one in lists])
    groups = [about.row_group(one) for one in range(about.num_row_groups)]
    within = sum(group.column(one).num_values for group in groups for one in lists)
    return int(within + about.num_rows * (len(columns) - len(lists)))


def json_bytes(data: Mapping[str, Any]) -> bytes:
    """Plain data as a JSON file with its checksum, under the key ``sha256``."""
    text = json.dumps({**data, "sha256": BLANK.decode()}, indent=1) + "\n"
    return fill_in(text.encode("utf-8"), IN_JSON)


def read_json(content: bytes) -> dict[str, Any]:
    """The data of a JSON file that :func:`json_bytes` made.

    Raises:
        ChecksumError: If it is not what was written.
    """
    check(content, IN_JSON)
    try:
        data = json.loads(content, object_pairs_hook=each_once)
        del data["sha256"]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ChecksumError("it is not JSON, or holds something else") from None
    return data
