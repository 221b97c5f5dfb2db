"""Scores as a table: a row for each action and each learner that predicts it, and its file.

Everything that is said of scores is derived from this table, so that a file is the one truth. Each
row carries a digest of what its subject did and met, and one of who predicts, by which it is known
of which actions the scores are.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from causal_openlock.errors import StoreError, in_short
from causal_openlock.files.atomic import write_bytes
from causal_openlock.files.checksums import ChecksumError, read_table, table_bytes

if TYPE_CHECKING:
    import pyarrow as pa

GROUP = ["learner", "condition", "protocol", "experiment", "seed"]
"""Columns that identify subjects who can be replayed in one session."""
PLAYED = "played"
_COUNTS = ["subject", "trial", "attempt", "action", "action_index"]
COLUMNS = [
    *("scored", *GROUP, *_COUNTS, "log_probability", "standard_error"),
    *("entropy", "highest", "impossible", "at_limit", "price", PLAYED, "setting"),
]


class OutdatedError(StoreError):
    """Scores of an earlier version, which do not say of what actions they are."""


def score_schema() -> pa.Schema:
    """The columns of a stored table of scores."""
    import pyarrow as pa

    texts = ["scored", "learner", "condition", "protocol", "experiment", PLAYED, "setting"]
    counts = ["seed", *_COUNTS]
    kinds = {**dict.fromkeys(texts, pa.string()), **dict.fromkeys(counts, pa.int64())}
    kinds |= dict.fromkeys(["impossible", "at_limit"], pa.bool_())
    return pa.schema([(name, kinds.get(name, pa.float64())) for name in COLUMNS])


def write_scores(path: Path, actions: pd.DataFrame) -> None:
    """Write scores with their checksum.

    Raises:
        OSError: If they cannot be written.
    """
    import pyarrow as pa

    table = pa.Table.from_pandas(actions[COLUMNS], score_schema(), preserve_index=False)
    write_bytes(path, table_bytes(table))


def read_scores(path: Path) -> pd.DataFrame:
    """Read scores that :func:`write_scores` wrote.

    Raises:
        OutdatedError: If an earlier version wrote them.
        StoreError: If they are damaged.
        FileNotFoundError: If there are none.
    """
    try:
        table = read_table(path.read_bytes())
        if missing := [name for name in COLUMNS if name not in table.column_names]:
            raise OutdatedError(
                f"{path} was made by an earlier version (it has no column {missing[0]}), so it is "
                "not known of which actions it is; score the subjects again"
            )
        table = table.select(COLUMNS).replace_schema_metadata(None)
        if not table.schema.equals(score_schema()):
            raise ValueError("its columns are of other types")
        return _checked(table)
    except (FileNotFoundError, OutdatedError):
        raise
    except (OSError, ValueError, TypeError, LookupError, ChecksumError) as error:
        raise StoreError(
            f"{path} cannot be read ({in_short(error)}); remove it, and score the subjects again"
        ) from None


def _checked(table: pa.Table) -> pd.DataFrame:
    """The rows of a table; raises ValueError if they cannot be scores."""
    numbers = ["log_probability", "standard_error", "price"]
    known = ["entropy", "highest"]  # NaN where there are no probabilities
    if not table.num_rows or any(table[name].null_count for name in COLUMNS if name not in known):
        raise ValueError("it has no actions, or gaps")
    actions = table.to_pandas()
    if actions[numbers].isna().any(axis=None) or np.isinf(actions[numbers[1:]]).any(axis=None):
        raise ValueError("numbers are missing")
    if (actions["log_probability"] > 1e-9).any() or (actions["standard_error"] < 0).any():
        raise ValueError("a probability is above 1, or an error below 0")
    if (actions[_COUNTS] < [0, 1, 1, 1, 0]).any(axis=None):
        raise ValueError("a number is below the first")
    if actions.duplicated(["scored", *GROUP, "subject", "trial", "attempt", "action"]).any():
        raise ValueError("an action is there twice")
    return actions
