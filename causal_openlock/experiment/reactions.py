"""Reaction times: a table with a row for every action of a person, next to the record.

The record has a row for every attempt and is the same for people and learners; how long a person
took over an action is stored in a file of its own, in ``reactions/`` next to ``cells/``, of the
same name. Once the server has stopped, it also holds the attempts of a trial that is not over yet,
which a record does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from causal_openlock.errors import StoreError
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes

if TYPE_CHECKING:
    import pyarrow as pa

FOLDER = "reactions"


def reactions_schema() -> pa.Schema:
    """The columns of a table of reaction times, each with its meaning."""
    import pyarrow as pa

    columns: list[tuple[str, Any, str]] = [
        ("condition", pa.string(), "name of the condition, as in the record"),
        ("subject", pa.int32(), "number of the person in this condition, as in the record"),
        ("visit", pa.int32(), "number of the trial in the whole condition, from 1"),
        ("attempt", pa.int32(), "number of the attempt within the trial, from 1"),
        ("moment", pa.int32(), "number of the action within the attempt, from 1"),
        ("action", pa.uint8(), "what was done, by action index"),
        ("moved", pa.bool_(), "whether it moved something"),
        ("reaction", pa.float64(), "seconds from when the person could act to the click"),
        ("time", pa.float64(), "seconds since the person joined, by the server's clock"),
    ]
    return pa.schema(
        [pa.field(name, kind, metadata={"meaning": text}) for name, kind, text in columns]
    )


def reactions_table(condition: str, subject: int, done: Sequence[Any]) -> pa.Table:
    """Table of a person's actions, each a :class:`~causal_openlock.play.game.PlayedAction`."""
    import pyarrow as pa

    rows, moment = [], 0
    for one in done:
        moment += 1
        rows.append({"condition": condition, "subject": subject, "moment": moment, **vars(one)})
        moment *= not one.attempt_over
    return pa.Table.from_pylist(rows, schema=reactions_schema())


def write_reactions(path: Path, table: pa.Table) -> None:
    """Store a person's reaction times."""
    write_bytes(path, table_bytes(table))


def rows_kept(path: Path) -> int:
    """Number of actions in a person's file; 0 if it is missing or damaged."""
    try:
        rows: int = read_table(path.read_bytes()).num_rows
    except (OSError, ChecksumError):
        rows = 0
    return rows


def read_reactions(folder: Path | str) -> pa.Table:
    """The reaction times of all people in a results folder, in the order of their numbers.

    Raises:
        StoreError: If the folder has none, or a file cannot be read.
    """
    import pyarrow as pa

    paths = sorted((Path(folder) / FOLDER).glob("*.parquet"))
    if not paths:
        raise StoreError(f"{folder} holds no reaction times; give the folder that play wrote to")
    schema, tables = reactions_schema(), []
    for path in paths:
        try:
            tables.append(read_table(path.read_bytes()).cast(schema))
        except (OSError, ChecksumError, pa.ArrowException, ValueError) as error:
            raise StoreError(
                f"{path} is damaged ({' '.join(str(error).split())[:120]}); start play with this "
                "folder and stop it: it is made again from the log"
            ) from None
    order = [(name, "ascending") for name in ("condition", "subject", "time")]
    return pa.concat_tables(tables).sort_by(order)
