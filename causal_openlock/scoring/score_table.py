"""Scores as a table: a row for each action and each learner that predicts it, and its file.

Everything that is said of scores is derived from this table. Its file carries a digest of the
record that was scored, so that scores of subjects who have been played again are not taken for
theirs.
"""

from __future__ import annotations

from pathlib import Path

import pandas as pd

from causal_openlock.errors import StoreError, in_short
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes

GROUP = ["learner", "condition", "protocol", "experiment", "seed"]
"""Columns that identify subjects who can be replayed in one session."""
COLUMNS = {
    "scored": "string",
    **dict.fromkeys(GROUP[:-1], "string"),
    **dict.fromkeys(("seed", "subject", "trial", "attempt", "action", "action_index"), "int64"),
    **dict.fromkeys(("log_probability", "standard_error", "entropy", "highest"), "double"),
    **dict.fromkeys(("impossible", "at_limit"), "bool"),
    "price": "double",
}
"""Columns of scores, with their types."""
RECORD = b"causal_openlock.record"


def write_scores(path: Path, actions: pd.DataFrame, record: str) -> None:
    """Write scores with their checksum and the digest of their record.

    Raises:
        OSError: If they cannot be written.
    """
    import pyarrow as pa

    schema = pa.schema([(name, pa.type_for_alias(kind)) for name, kind in COLUMNS.items()])
    table = pa.Table.from_pandas(actions[[*COLUMNS]], schema, preserve_index=False)
    write_bytes(path, table_bytes(table, {RECORD: record.encode()}))


def read_scores(path: Path) -> tuple[pd.DataFrame, str]:
    """Read scores that :func:`write_scores` wrote, and the digest of their record.

    Raises:
        StoreError: If they are damaged, or another version wrote them.
        FileNotFoundError: If there are none.
    """
    try:
        table = read_table(path.read_bytes())
    except FileNotFoundError:
        raise
    except (OSError, ChecksumError) as error:
        raise StoreError(
            f"{path} cannot be read ({in_short(error)}); remove it, and score the subjects again"
        ) from None
    known = {field.name: str(field.type) for field in table.schema}
    record = (table.schema.metadata or {}).get(RECORD, b"").decode(errors="replace")
    # Of learners that give no probabilities neither entropy nor the highest is known.
    whole = table.drop_columns([name for name in ("entropy", "highest") if name in known])
    gaps = any(column.null_count for column in whole.columns)
    if known != COLUMNS or not record or not table.num_rows or gaps:
        raise StoreError(f"{path} was not made by this version; score the subjects again")
    return table.replace_schema_metadata(None).to_pandas(), record
