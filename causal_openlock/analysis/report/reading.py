"""Reading a results folder for analysis: the columns that are needed, as small as they can be.

A record of ten million attempts has more than a gigabyte as the store keeps it in memory, most of
it what an analysis never looks at, and names spelled out by four bytes where one would do. Here a
cell is read at a time, without the columns that nobody asked for, and its names and small numbers
are narrowed before the next one is read.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from causal_openlock.analysis.people.beside import merged_versions
from causal_openlock.errors import StoreError
from causal_openlock.record import record_schema
from causal_openlock.store import VERSIONS, Store

if TYPE_CHECKING:
    from pathlib import Path

    import pyarrow as pa

UNREAD = ("actions", "moved", "reward", "wall_time")
"""What is not read unless it is asked for: half of a record, and of no use to most analyses."""


def read_results(store: Store, columns: Sequence[str] = ()) -> tuple[pa.Table, dict[str, Any]]:
    """The records of all cells as one, and what they are the record of.

    Args:
        store: The results folder.
        columns: Columns wanted besides all that are not in :data:`UNREAD`.

    Returns:
        The record, in the order of the cells, with columns as in
        :func:`causal_openlock.record.record_schema` (those wanted, names coded by as few bytes as
        they need); and what :meth:`~causal_openlock.store.Store.record` gives beside it.

    Raises:
        StoreError: If there is no cell, or one is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    description = store.description()
    there, missing = cell_files(store)
    del description["identity"], description["cells"]
    wanted = [name for name in record_schema().names if name in columns or name not in UNREAD]
    tables, versions = [], []
    for path in there:
        try:
            file = pq.ParquetFile(path, memory_map=False, page_checksum_verification=True)
            table = file.read(wanted)
            held = file.schema_arrow
        except (OSError, pa.ArrowException, ValueError):
            store.read(path)  # says in a sentence what is wrong
            raise
        if held.names != record_schema().names:
            store.read(path)
        versions.append(json.loads((held.metadata or {}).get(VERSIONS, b"{}")))
        tables.append(_narrowed(table.replace_schema_metadata(None)))
    if missing:
        description["missing_cells"] = [path.stem for path in missing]
    description["versions"] = merged_versions(versions)
    return pa.concat_tables(tables), description


def cell_files(store: Store) -> tuple[list[Path], list[Path]]:
    """The files of the cells that are there, in order, and of those that are not.

    Raises:
        StoreError: If the folder holds no results, or no cell.
    """
    paths = [store.cells / name for name in store.description()["cells"]]
    there = [path for path in paths if path.exists()]
    if not there:
        raise StoreError(f"{store.folder} holds no cell yet; run compare to the end first")
    return there, [path for path in paths if path not in set(there)]


def made_with(cells: Sequence[Path]) -> dict[str, Any]:
    """Versions of the packages that cells were made with; a list where they differ.

    Args:
        cells: Their files.

    Raises:
        StoreError: If one of them is damaged.
    """
    import pyarrow as pa
    import pyarrow.parquet as pq

    held = []
    for path in cells:
        try:
            held.append(pq.read_schema(path).metadata or {})
        except (OSError, pa.ArrowException, ValueError):
            Store.read(path)  # says in a sentence what is wrong
            raise
    return merged_versions([json.loads(one.get(VERSIONS, b"{}")) for one in held])


def _narrowed(table: pa.Table) -> pa.Table:
    """The same values, the codes of names in as few bytes as they need."""
    import pyarrow as pa

    columns = []
    for column in table.columns:
        if pa.types.is_dictionary(column.type):
            column = pa.chunked_array(
                [_coded(chunk) for chunk in column.chunks] or [_coded(column.combine_chunks())]
            )
        columns.append(column)
    return pa.table(columns, names=table.column_names)


def _coded(names: pa.DictionaryArray) -> pa.DictionaryArray:
    import pyarrow as pa

    # A cell has few names in each column; layouts drawn at random may be many.
    many = len(names.dictionary)
    kind = pa.int8() if many < 1 << 7 else pa.int16() if many < 1 << 15 else pa.int32()
    codes = names.indices.cast(kind)
    return pa.DictionaryArray.from_arrays(codes, names.dictionary)


__all__ = ["UNREAD", "cell_files", "made_with", "read_results"]
