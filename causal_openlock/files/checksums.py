"""Files that carry a checksum of themselves.

A checksum beside a file can be lost, or be of the file before: a process killed between the two
leaves a pair that does not fit. So ours stands inside. The file is made with 64 zeros where the
checksum belongs, the SHA-256 of all of that is taken, and its digits take the place of the zeros.
Reading does the same the other way round, so no bit of the file, those of the checksum among them,
can change without being noticed. Against somebody who means to deceive it does nothing.

A Parquet file has it in its metadata, JSON under its last key; other programs read both as ever.
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

if TYPE_CHECKING:
    import pyarrow as pa

KEY = b"causal_openlock.sha256"
BLANK = b"0" * 64
IN_PARQUET = KEY + b"\x18\x40"
"""What stands before the digits: the key, and (in Thrift's words) that 64 bytes of text follow."""
IN_JSON = b'"sha256": "'


class ChecksumError(OpenLockError):
    """A file that is not what was written; says what is wrong with it in a few words."""


def fill_in(content: bytes, before: bytes) -> bytes:
    """Fill a checksum in.

    Args:
        content: A file with :data:`BLANK` where it belongs.
        before: What stands before it: :data:`IN_PARQUET` or :data:`IN_JSON`.
    """
    place = content.rindex(before + BLANK) + len(before)
    digits = hashlib.sha256(content).hexdigest().encode()
    return content[:place] + digits + content[place + len(BLANK) :]


def check(content: bytes, before: bytes) -> None:
    """Make sure that a file is what was written.

    Raises:
        ChecksumError: If it is not, or has no checksum.
    """
    place = content.rfind(before)
    if place < 0:
        raise ChecksumError("it has no checksum, as files of earlier versions have none")
    place += len(before)
    end = place + len(BLANK)
    whole = hashlib.sha256(memoryview(content)[:place])
    whole.update(BLANK)
    whole.update(memoryview(content)[end:])
    if whole.hexdigest().encode() != content[place:end]:
        raise ChecksumError("its checksum says that it is not what was written")


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

    Args:
        content: The file.
        columns: Those to read; by default all.

    Raises:
        ChecksumError: If it is not what was written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    check(content, IN_PARQUET)
    try:
        file = pq.ParquetFile(pa.BufferReader(content))
        kept = {k: v for k, v in (file.schema_arrow.metadata or {}).items() if k != KEY}
        return file.read(columns).replace_schema_metadata(kept)
    # It is whole, but who made it is not known: reading it can fail in any way.
    except Exception as error:
        raise ChecksumError(_said(error)) from None


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
        data = json.loads(content)
        del data["sha256"]
    except (ValueError, TypeError, KeyError, RecursionError):
        raise ChecksumError("it is no JSON, or holds something else") from None
    return data


def _said(error: Exception) -> str:
    """What is wrong with a file, in a line, without what was called and with whole words."""
    line = re.sub(
        r"^Could not open Parquet input source '[^']*': ", "", " ".join(str(error).split())
    )
    return textwrap.shorten(line, 200, placeholder=" …").rstrip(".") or type(error).__name__
