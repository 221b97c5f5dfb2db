"""The trials of a record and the categories of its attempts, counted in little memory.

Both are counted a few cells at a time, since a trial lies within one cell. A record whose trials
are cut apart, because its rows are in another order, is counted as a whole.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import pandas as pd
from pandas.api.types import union_categoricals

from causal_openlock.analysis.measures import (
    CELL,
    SUBJECT,
    VISIT,
    ordered,
    trials_and_categories,
)
from causal_openlock.errors import StoreError
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.experiment.record import CATEGORIES, PHASES

if TYPE_CHECKING:
    import pyarrow as pa

AT_ONCE = 1_000_000
"""Attempts that are counted at once, or those of one cell where it has more."""

_FIRST = {
    "condition": PAPER_CONDITIONS,
    "protocol": ("human",),
    "phase": PHASES,
    "category": CATEGORIES,
}
_BLOCK = [*CELL, "phase", "block", "category"]


@dataclass(frozen=True)
class Counts:
    """What was counted in a record.

    Attributes:
        trials: As :func:`~causal_openlock.analysis.measures.attempts_to_solve` gives them.
        blocks: As :func:`~causal_openlock.analysis.measures.category_counts` gives them, in five
            blocks.
    """

    trials: pd.DataFrame
    blocks: pd.DataFrame


def count(record: pa.Table, at_once: int = AT_ONCE) -> Counts:
    """Count a record.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        at_once: How many attempts to count at once, roughly.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    pieces = list(_pieces(record, at_once))
    if len(pieces) > 1:
        try:
            trial_tables, block_tables = zip(*map(trials_and_categories, pieces), strict=True)
        except StoreError:
            # A trial lies in several pieces: one that does not begin it has attempts missing.
            pass
        else:
            trials = _joined(trial_tables, [*CELL, *SUBJECT, *VISIT])
            # Blocks are shares of a subject's phase, which must not be cut apart either.
            if _phases(trials) == sum(map(_phases, trial_tables)):
                return Counts(trials, _added(block_tables))
    return Counts(*trials_and_categories(record))


def _pieces(record: pa.Table, at_once: int) -> Iterator[pa.Table]:
    """The record in whole chunks, which are cells as a results folder gives them."""
    start = length = 0
    for chunk in record["attempt"].chunks:
        length += len(chunk)
        if length >= at_once:
            yield record.slice(start, length)
            start, length = start + length, 0
    if length or not start:
        yield record.slice(start)


def _phases(trials: pd.DataFrame) -> int:
    """How many phases of subjects there are."""
    return int(trials.groupby([*CELL, *SUBJECT, "phase"], observed=True).ngroups)


def _joined(tables: Sequence[pd.DataFrame], by: list[str]) -> pd.DataFrame:
    """Tables under one another, sorted, with the names of all of them as categories."""
    columns = {}
    for name in tables[0].columns:
        parts = [table[name] for table in tables]
        if isinstance(parts[0].dtype, pd.CategoricalDtype):
            joined = union_categoricals(parts)
            names = list(ordered(joined.categories, _FIRST.get(name, ())))
            columns[name] = joined.reorder_categories(names)
        else:
            columns[name] = pd.concat(parts, ignore_index=True)
    return pd.DataFrame(columns).sort_values(by, kind="stable", ignore_index=True)


def _added(tables: Sequence[pd.DataFrame]) -> pd.DataFrame:
    """Counts of different subjects, added up; where a block ends is averaged over subjects."""
    joined = _joined(tables, _BLOCK)
    joined["until"] *= joined["subjects"]
    sums = joined.groupby(_BLOCK, observed=True, sort=True)[["count", "subjects", "until"]].sum()
    sums["until"] /= sums["subjects"]
    return sums.reset_index()[list(tables[0].columns)]
