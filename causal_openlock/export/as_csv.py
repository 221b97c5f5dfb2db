"""The record as a CSV file, for whatever does not read Parquet.

One line for each attempt, with the columns of
:func:`causal_openlock.experiment.record.record_schema`. What an attempt has several of, its actions
and whether each moved something, is in one cell, separated by spaces: ``0 1 14`` and ``1 1 0``.
A name that a spreadsheet would take for a formula has an apostrophe in front. The file is written
cell by cell, so that a long record needs no more memory than a short one.
"""

from __future__ import annotations

import gzip
from pathlib import Path
from typing import Any

import pyarrow as pa

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.record import played, record_schema
from causal_openlock.files.atomic import replacing
from causal_openlock.files.escaping import cell
from causal_openlock.storage.store import Store


def write_csv(store: Store, path: Path | str) -> int:
    """Write the record of a results folder as CSV.

    Args:
        store: The results folder.
        path: The file to write; one that ends in ``.gz`` is compressed.

    Returns:
        Number of attempts that subjects played; those that they were shown are written too, and
        not counted.

    Raises:
        StoreError: If there is no cell, or one is damaged.
        OpenLockError: If the name ends as that of another format, or the file cannot be written;
            one that was there stays as it was.
    """
    from pyarrow import csv

    if Path(path).suffix.lower() not in ("", ".csv", ".gz"):
        raise OpenLockError(f"{path} would hold CSV: let its name end in .csv or .csv.gz")
    cells, _ = store.files()
    count = 0
    with replacing(path) as file:
        sink: Any = gzip.GzipFile("", "wb", 6, file, 0) if Path(path).suffix == ".gz" else file
        for number, cell in enumerate(cells):
            record = store.read(cell)
            csv.write_csv(flat(record), sink, csv.WriteOptions(include_header=number == 0))
            count += played(record).num_rows
        if sink is not file:
            sink.close()
    return count


def flat(record: pa.Table) -> pa.Table:
    """A record in text and numbers only: no names coded by numbers, no lists, no truth values."""
    import pyarrow.compute as pc

    columns = []
    for field in record_schema():
        column = record[field.name].combine_chunks()
        if pa.types.is_list(field.type):
            texts = pc.cast(pc.cast(column.flatten(), pa.uint8()), pa.string())
            offsets = pc.subtract(column.offsets, column.offsets[0])
            column = pc.binary_join(pa.ListArray.from_arrays(offsets, texts), " ")
        elif pa.types.is_dictionary(field.type):
            names = pa.array(map(cell, column.dictionary.to_pylist()), pa.string())
            column = names.take(column.indices)
        elif pa.types.is_boolean(field.type):
            column = pc.cast(column, pa.uint8())
        columns.append(column)
    return pa.table(columns, names=record_schema().names)
