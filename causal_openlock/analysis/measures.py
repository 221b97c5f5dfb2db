"""What happened, counted: attempts to solve each trial, and attempts in each category.

A record has a row for every attempt, perhaps millions; a trial is a run of such rows. So the first
step finds the runs with NumPy, in one pass over the columns, and everything after it works on a
table with one row for each trial. Rows are put in their place by what they say (phase, loop, trial
and attempt), never by where they stand, so the order in which cells are read makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from causal_openlock.errors import StoreError
from causal_openlock.experiment.protocol import PAPER_CONDITIONS
from causal_openlock.experiment.record import CATEGORIES, PHASES
from causal_openlock.wording import counted
from causal_openlock.world.fsm import IntArray

if TYPE_CHECKING:
    import pyarrow as pa

BASELINES, TRANSFERS = PAPER_CONDITIONS[:2], PAPER_CONDITIONS[2:]
"""The paper's six conditions; tables and figures show them in this order, before any others."""

CELL = ["learner", "condition", "protocol"]
"""What is compared: columns that a group of subjects has in common."""

SUBJECT = ["experiment", "seed", "subject"]
"""What tells the subjects of such a group apart."""

VISIT = ["phase", "loop", "trial"]
"""What tells the trials of a subject apart, in the order of time."""

_FIRST = {"condition": PAPER_CONDITIONS, "protocol": ("human",), "phase": PHASES}
_NEVER = np.iinfo(np.int32).max


def attempts_to_solve(record: pa.Table) -> pd.DataFrame:
    """How many attempts every trial took.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.

    Returns:
        One row for each trial that a subject visited, sorted by the columns ``learner``,
        ``condition``, ``protocol``, ``experiment``, ``seed``, ``subject``, ``phase``, ``loop`` and
        ``trial`` (names are categorical, the paper's come first). Further columns:

        - ``schema``, ``layout``: of the room.
        - ``attempts``: number of the attempt that found the last solution; for a trial that was
          not solved the number of its last attempt, which is the limit.
        - ``last_attempt``: number of its last attempt; a trial may go on after it is solved.
        - ``solved``: whether every solution was found.
        - ``solutions_found``, ``solutions``: how many were found and how many there are.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    return _Trials.of(record).table


def attempts_to_find(record: pa.Table, most: int = 3) -> pd.DataFrame:
    """How many attempts the first solution of every trial took, and the second, and so on.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        most: How many solutions of a trial to tell of; those after them are left out.

    Returns:
        The rows and columns of :func:`attempts_to_solve`, each row once for every solution that
        the room has, up to ``most``, in order, with ``nth`` (from 1), ``found`` (whether so many
        were found) and ``attempts``: the number of the attempt that found it, or that of the
        trial's last attempt if it was not found.

    Raises:
        StoreError: If a trial has attempts missing or twice.
        ValueError: If ``most`` is not positive.
    """
    if most < 1:
        raise ValueError(f"most is {most}; it must be at least 1")
    trials = _Trials.of(record)
    new = np.flatnonzero(record["new_solution"].to_numpy())
    nth = record["solutions_found"].to_numpy()[new].astype(np.int64) - 1
    kept = nth < most
    new, nth = new[kept], nth[kept]
    reached = np.full((len(trials.table), most), _NEVER, np.int64)
    reached[trials.row_trial[new], nth] = record["attempt"].to_numpy()[new]

    solutions = np.minimum(trials.table["solutions"].to_numpy(), most)
    index = np.repeat(np.arange(len(trials.table)), solutions)
    number = np.arange(len(index)) - np.repeat(np.cumsum(solutions) - solutions, solutions)
    table = trials.table.iloc[index].reset_index(drop=True)
    attempts = reached[index, number]
    return table.assign(
        nth=number + 1,
        found=attempts != _NEVER,
        attempts=np.minimum(attempts, table["last_attempt"].to_numpy()),
    )


def solutions_per_attempt(record: pa.Table) -> pd.DataFrame:
    """How often an attempt came to a solution, in every trial.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.

    Returns:
        The rows and columns of :func:`attempts_to_solve` with two shares, from 0 to 1:

        - ``new_per_attempt``: new solutions for each attempt until the last of them was found, or
          until the trial ended if it was not solved.
        - ``opened_per_attempt``: attempts of the whole trial that opened the door, with a new
          solution or one that was known; the paper's share of attempts that are solutions.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    trials = _Trials.of(record)
    table = trials.table
    opened = np.bincount(trials.row_trial[record["opened"].to_numpy()], minlength=len(table))
    return table.assign(
        new_per_attempt=table["solutions_found"] / table["attempts"],
        opened_per_attempt=opened / table["last_attempt"],
    )


def category_counts(record: pa.Table, blocks: int = 5) -> pd.DataFrame:
    """What attempts came to, over the course of a phase (the paper's Figures 6 and 7).

    Every subject's attempts in a phase are cut, in the order of time, into ``blocks`` equal
    shares (equal up to one attempt); the counts of the subjects are added up.

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.
        blocks: How many shares; 1 counts the whole phase.

    Returns:
        One row for each ``learner``, ``condition``, ``protocol``, ``phase``, ``block`` (from 1)
        and ``category`` (every one of :data:`~causal_openlock.experiment.record.CATEGORIES`), with

        - ``count``: attempts of all subjects, and ``subjects``: how many these are.
        - ``until``: attempts of one subject from the phase's first to the block's last, averaged
          over subjects.

    Raises:
        StoreError: If a trial has attempts missing or twice.
        ValueError: If ``blocks`` is not positive.
    """
    if blocks < 1:
        raise ValueError(f"blocks is {blocks}; it must be at least 1")
    trials = _Trials.of(record)
    table, row_trial = trials.table, trials.row_trial
    grouped = table.groupby([*CELL, "phase"], observed=True, sort=True)
    phase = grouped.ngroup().to_numpy()
    groups = grouped.size().reset_index()[[*CELL, "phase"]]
    subject_phase = _group_index(table, [*CELL, *SUBJECT, "phase"])

    length = table["last_attempt"].to_numpy()
    ends = np.cumsum(length)
    first = np.flatnonzero(np.diff(subject_phase, prepend=-1))
    total = np.diff(ends[first] - length[first], append=ends[-1:])  # of a subject in a phase
    before = ends - length - (ends[first] - length[first])[subject_phase]

    # In the order of time, attempt i of n lies in block floor(i * blocks / n).
    time = before[row_trial] + record["attempt"].to_numpy() - 1
    block = time * blocks // total[subject_phase][row_trial]
    category, names = _encode(record, "category", CATEGORIES)
    code = (phase[row_trial] * blocks + block) * len(names) + category
    counts = np.bincount(code, minlength=len(groups) * blocks * len(names))

    subjects = np.bincount(phase[first], minlength=len(groups))
    mean_total = np.bincount(phase[first], total, len(groups)) / np.maximum(subjects, 1)
    until = np.outer(mean_total, np.arange(1, blocks + 1) / blocks).ravel()
    category_codes = np.tile(np.arange(len(names)), len(groups) * blocks)
    counted = groups.loc[groups.index.repeat(blocks * len(names))].reset_index(drop=True)
    return counted.assign(
        block=np.tile(np.repeat(np.arange(1, blocks + 1), len(names)), len(groups)),
        category=pd.Categorical.from_codes(category_codes, list(names)),
        count=counts,
        subjects=np.repeat(subjects, blocks * len(names)),
        until=np.repeat(until, len(names)),
    )


def by_subject(trials: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Average each subject's trials, so that every subject counts once however often it looped.

    Args:
        trials: From :func:`attempts_to_solve`.
        by: What to keep apart within a subject, such as ``["phase", "trial"]``.

    Returns:
        One row for each subject and value of ``by``: the columns of :data:`CELL`, ``by`` and
        :data:`SUBJECT`, with the means ``attempts`` and ``solved`` (a share) and ``visits``, the
        number of trials averaged.
    """
    frame = trials.assign(solved=trials["solved"].astype(float))
    grouped = frame.groupby([*CELL, *by, *SUBJECT], observed=True, sort=True)
    return grouped.agg(
        attempts=("attempts", "mean"), solved=("solved", "mean"), visits=("attempts", "size")
    ).reset_index()


def mean_by_trial(trials: pd.DataFrame, by: Sequence[str] = ("phase", "trial")) -> pd.DataFrame:
    """Mean attempts over subjects, each subject's loops averaged first.

    Args:
        trials: From :func:`attempts_to_solve`.
        by: What to keep apart besides :data:`CELL`.

    Returns:
        One row for each group: :data:`CELL`, ``by``, ``subjects``, ``visits`` (the most that a
        subject made), ``mean``, ``se`` (population SD / √n, the paper's error bar) and
        ``share_solved``.
    """
    grouped = by_subject(trials, by).groupby([*CELL, *by], observed=True, sort=True)
    means = grouped.agg(
        subjects=("attempts", "size"),
        visits=("visits", "max"),
        mean=("attempts", "mean"),
        se=("attempts", lambda attempts: attempts.std(ddof=0) / np.sqrt(len(attempts))),
        share_solved=("solved", "mean"),
    )
    return means.reset_index()


def number_visits(trials: pd.DataFrame) -> IntArray:
    """``[T]`` the place of every trial in its subject's session, from 1."""
    subject = _group_index(trials, [*CELL, *SUBJECT])
    first = np.flatnonzero(np.diff(subject, prepend=-1))
    return np.arange(len(trials)) - first[subject] + 1


@dataclass(frozen=True)
class _Trials:
    """The trials of a record, and which of them every row belongs to."""

    table: pd.DataFrame
    row_trial: IntArray

    @classmethod
    def of(cls, record: pa.Table) -> _Trials:
        key: dict[str, NDArray[Any]] = {}
        names: dict[str, tuple[str, ...]] = {}
        for column in [*CELL, *SUBJECT, *VISIT, "schema", "layout"]:
            if column in {"seed", "subject", "loop", "trial"}:
                key[column] = record[column].to_numpy()
            else:
                key[column], names[column] = _encode(record, column)
        attempt = record["attempt"].to_numpy()
        found = record["solutions_found"].to_numpy()
        solutions = record["solutions"].to_numpy()

        # Runs of equal rows are whole trials where the record is sorted, which it mostly is;
        # only the runs need sorting, and runs of one trial that lay apart are joined.
        identity = [key[column] for column in [*CELL, *SUBJECT, *VISIT]]
        starts = _starts(identity)
        order = np.lexsort([column[starts] for column in reversed(identity)])
        sorted_key = {column: values[starts][order] for column, values in key.items()}
        joins = _starts([sorted_key[column] for column in [*CELL, *SUBJECT, *VISIT]])

        def reduce(how: np.ufunc, values: NDArray[Any]) -> NDArray[Any]:
            if not len(starts):
                return values[:0]
            reduced: NDArray[Any] = how.reduceat(how.reduceat(values, starts)[order], joins)
            return reduced

        last = reduce(np.maximum, attempt)
        solved_at = reduce(np.minimum, np.where(found >= solutions, attempt, _NEVER))
        length = np.diff(starts, append=len(attempt))
        rows = np.add.reduceat(length[order], joins) if len(starts) else length
        table = pd.DataFrame(
            {
                **{
                    column: pd.Categorical.from_codes(values[joins], list(names[column]))
                    if column in names
                    else values[joins].astype(np.int64)
                    for column, values in sorted_key.items()
                },
                "attempts": np.minimum(solved_at, last).astype(np.int64),
                "last_attempt": last.astype(np.int64),
                "solved": solved_at != _NEVER,
                "solutions_found": reduce(np.maximum, found).astype(np.int64),
                "solutions": reduce(np.maximum, solutions).astype(np.int64),
            }
        )
        _check_complete(table, rows)

        run_trial = np.empty(len(starts), np.int64)
        run_trial[order] = np.repeat(np.arange(len(joins)), np.diff(joins, append=len(starts)))
        return cls(table, np.repeat(run_trial, length))


def _check_complete(table: pd.DataFrame, rows: IntArray) -> None:
    wrong = np.flatnonzero(rows != table["last_attempt"].to_numpy())
    if len(wrong):
        trial = table.iloc[wrong[0]]
        where = ", ".join(f"{column} {trial[column]}" for column in [*CELL, "subject", *VISIT])
        raise StoreError(
            f"the record has attempts missing or twice in {counted(len(wrong), 'trial')}, "
            f"first in {where}: "
            f"{rows[wrong[0]]} rows for {trial['last_attempt']} attempts; read every cell once"
        )


def _encode(
    record: pa.Table, column: str, known: tuple[str, ...] = ()
) -> tuple[IntArray, tuple[str, ...]]:
    """``[N]`` codes of a text column, and the names they stand for, in a fixed order."""
    import pyarrow as pa

    chunks = record[column].chunks
    if not pa.types.is_dictionary(record[column].type):
        chunks = [chunk.dictionary_encode() for chunk in chunks]
    dictionaries = [chunk.dictionary.to_pylist() for chunk in chunks]
    found = {name for dictionary in dictionaries for name in dictionary}
    names = known or ordered(found, _FIRST.get(column, ()))
    if not found.issubset(names):
        raise StoreError(
            f"the record's column {column} holds {min(found.difference(names))!r}, which is not "
            f"one of {', '.join(names)}; was it written by another version?"
        )
    place = {name: code for code, name in enumerate(names)}
    kind = np.min_scalar_type(len(names))  # ten million codes of eight bytes would be felt
    codes = [
        np.array([place[name] for name in dictionary], kind)[chunk.indices.to_numpy()]
        for chunk, dictionary in zip(chunks, dictionaries, strict=True)
        if len(chunk)
    ]
    return np.concatenate([np.zeros(0, kind), *codes]), names


def ordered(names: Iterable[str], first: Sequence[str] = PAPER_CONDITIONS) -> tuple[str, ...]:
    """Names in the order of tables and figures: those in ``first``, then the rest by alphabet."""
    have = set(names)
    return (*(name for name in first if name in have), *sorted(have.difference(first)))


def _starts(columns: Iterable[NDArray[Any]]) -> IntArray:
    """Where a row differs from the one before it in any of the columns."""
    changed: Any = None
    for column in columns:
        if changed is None:
            changed = np.zeros(len(column), dtype=bool)
            changed[:1] = True
        changed[1:] |= column[1:] != column[:-1]
    return np.flatnonzero(changed)


def _group_index(table: pd.DataFrame, by: Sequence[str]) -> IntArray:
    """``[T]`` the number of each row's group, from 0; equal rows must be neighbours."""
    columns = [
        table[column].cat.codes.to_numpy()
        if isinstance(table[column].dtype, pd.CategoricalDtype)
        else table[column].to_numpy()
        for column in by
    ]
    index = np.zeros(len(table), np.int64)
    index[_starts(columns)] = 1
    return np.cumsum(index) - 1
