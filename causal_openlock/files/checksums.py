"""Files in which damage is found: Parquet by the checksums of its pages, JSON by its last key.

JSON is written with 64 zeros in place of its SHA-256, whose digits then replace them. None of this
protects against deliberate forgery, and other programs read both kinds as usual.

>>> read_json(json_bytes({"answer": 42}))
{'answer': 42}
"""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import OpenLockError, in_short

if TYPE_CHECKING:
    import pyarrow as pa

ZEROS = b"0" * 64


class ChecksumError(OpenLockError):
    """A file is not what was written; the message gives the reason."""


def digest(content: bytes | str) -> str:
    """A short hash: 16 hexadecimal digits of the SHA-256 of a content; a text is taken as UTF-8.

    >>> digest("the same"), digest(b"the same")
    ('fa0487f2dc91544a', 'fa0487f2dc91544a')
    """
    whole = content if isinstance(content, bytes) else content.encode()
    return hashlib.sha256(whole).hexdigest()[:16]


def table_bytes(table: pa.Table, metadata: Mapping[bytes, bytes] | None = None) -> bytes:
    """A table as a Parquet file with checksums."""
    import pyarrow.parquet as pq

    file = io.BytesIO()
    table = table.replace_schema_metadata(metadata)
    pq.write_table(table, file, compression="zstd", write_page_checksum=True)
    return file.getvalue()


def read_table(content: bytes, columns: Sequence[str] | None = None) -> pa.Table:
    """The table of a Parquet file, with the metadata of its schema.

    ChecksumError if a page of these columns is not what was written.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        file = pq.ParquetFile(pa.BufferReader(content), page_checksum_verification=True)
        # A thread of pyarrow may release the bytes after the table is returned, and aborts a Python
        # that is ending by then (https://github.com/apache/arrow/issues/34314).
        return file.read(columns, use_threads=False)
    except Exception as error:  # it may be from anybody: reading it can raise anything
        raise ChecksumError(in_short(error) or type(error).__name__) from None


def json_bytes(data: Mapping[str, Any]) -> bytes:
    """Plain data as a JSON file with its checksum, under the key ``sha256``."""
    content = (json.dumps({**data, "sha256": ZEROS.decode()}, indent=1) + "\n").encode()
    before, _, after = content.rpartition(ZEROS)
    return before + hashlib.sha256(content).hexdigest().encode() + after


def read_json(content: bytes) -> dict[str, Any]:
    """The data of a JSON file that :func:`json_bytes` made; ChecksumError if it was changed."""
    try:
        data: dict[str, Any] = json.loads(content)
        digits = data.pop("sha256").encode()
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError):
        raise ChecksumError("it is not JSON with a checksum") from None
    if hashlib.sha256(ZEROS.join(content.rsplit(digits, 1))).hexdigest().encode() != digits:
        raise ChecksumError("its checksum does not match, so it is not what was written")
    return data
