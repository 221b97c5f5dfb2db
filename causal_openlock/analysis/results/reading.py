"""Reading a results folder for analysis: the columns that are needed, as small as they can be.

A record of ten million attempts has more than a gigabyte as the store keeps it in memory, most of
it what an analysis never looks at, and names spelled out by four bytes where one would do. Here a
cell is read at a time, without the columns that nobody asked for, and its names and small numbers
are narrowed before the next one is read.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from causal_openlock.experiment.record import record_schema
from causal_openlock.experiment.store import Store, merged_versions, versions_of

if TYPE_CHECKING:
    from pathlib import Path

    import pyarrow as pa

    from causal_openlock.experiment.stored import StoredExperiment

UNREAD = ("actions", "moved", "reward", "wall_time")
"""What is not read unless it is asked for: half of a record, and of no use to most analyses."""


def read_results(store: Store, columns: Sequence[str] = ()) -> tuple[pa.Table, StoredExperiment]:
    """The records of all cells as one, and what they are the record of.

    Args:
        store: The results folder.
        columns: Columns wanted besides all that are not in :data:`UNREAD`.

    Returns:
        The record, in the order of the cells, with columns as in
        :func:`causal_openlock.experiment.record.record_schema` (those wanted, names coded by as few
        bytes as they need); and what :meth:`~causal_openlock.experiment.store.Store.record` gives
        beside it.

    Raises:
        StoreError: If there is no cell, or one is damaged.
    """
    wanted = [name for name in record_schema().names if name in columns or name not in UNREAD]
    return store.record(wanted, small=True)


def made_with(cells: Sequence[Path]) -> dict[str, Any]:
    """Versions of the packages that cells were made with; a list where they differ.

    Args:
        cells: Their files.

    Raises:
        StoreError: If one of them is damaged.
    """
    return merged_versions(
        [versions_of(Store(path.parent.parent).read(path, columns=[]), path) for path in cells]
    )
