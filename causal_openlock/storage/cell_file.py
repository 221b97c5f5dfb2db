"""The file of a cell: its record as Parquet, with the cell's identity and versions as metadata."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from causal_openlock.experiment.declare import Cell
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes
from causal_openlock.files.validation import adapter
from causal_openlock.storage.versions import Versions, versions

if TYPE_CHECKING:
    import pyarrow as pa

IDENTITY = b"causal_openlock.cell"
VERSIONS = b"causal_openlock.versions"
WARNINGS = b"causal_openlock.warnings"


def read_cell_file(
    path: Path, identity: str | None = None, columns: Sequence[str] | None = None
) -> tuple[pa.Table, Versions]:
    """The record in a cell's file, and the versions of packages that it was made with.

    Args:
        path: Its file.
        identity: The cell's identity; by default that in the file's name.
        columns: The columns to read and to check; by default all.

    Raises:
        OSError: If it cannot be read.
        ChecksumError: If it is damaged, or belongs to another cell.
    """
    import pyarrow as pa

    from causal_openlock.experiment.record import record_schema

    table = read_table(path.read_bytes(), columns)
    metadata = table.schema.metadata or {}
    stored = metadata.get(IDENTITY, b"").decode(errors="replace")
    if not stored or not stored.startswith(identity or path.stem.rpartition("_")[2]):
        raise ChecksumError("it holds another cell")
    schema = record_schema()
    if columns is not None:
        schema = pa.schema([schema.field(name) for name in columns])
    try:
        made_with = adapter(Versions).validate_json(metadata.get(VERSIONS, b"{}"))
        # Other programs may encode names differently.
        table = table.replace_schema_metadata(None).cast(schema)
        table.validate(full=True)
        if any(column.null_count for column in table.columns):
            raise ValueError("values are missing")
    except (pa.ArrowException, ValueError):
        raise ChecksumError("its columns or versions are not those of a record") from None
    return table, made_with


def warnings_in(path: Path) -> list[str]:
    """Warnings of how the record in a cell's file came about; none if they cannot be read."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    try:
        metadata = pq.read_metadata(path).metadata or {}
        return [str(one) for one in json.loads(metadata.get(WARNINGS, b"[]"))]
    except (OSError, pa.ArrowException, ValueError, TypeError):
        return []


def write_cell_file(path: Path, cell: Cell, record: pa.Table, warnings: Sequence[str]) -> None:
    """Write a cell's record, with warnings of how it came about, completely or not at all.

    Raises:
        OpenLockError: If it cannot be written.
    """
    metadata = {IDENTITY: cell.identity.encode(), VERSIONS: json.dumps(versions()).encode()}
    if warnings:
        metadata[WARNINGS] = json.dumps(warnings).encode()
    write_bytes(path, table_bytes(record, metadata))
