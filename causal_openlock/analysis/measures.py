"""Counts of a record: attempts to solve each trial, and attempts in each category.

A record has a row for every attempt, perhaps millions; a trial is a run of such rows. The first
step finds the runs with NumPy, in one pass over the columns, and everything after it works on a
table with one row for each trial. Rows are sorted by their values (phase, loop, trial, attempt), so
the order in which cells are read makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from pandas.api.types import is_numeric_dtype, union_categoricals

from causal_openlock.errors import StoreError
from causal_openlock.experiment.declare import PAPER_CONDITIONS
from causal_openlock.experiment.record import CATEGORIES, PHASES, played
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.wording import counted

if TYPE_CHECKING:
    import pyarrow as pa

BASELINES, TRANSFERS = PAPER_CONDITIONS[:2], PAPER_CONDITIONS[2:]
"""The paper's six conditions; tables and figures show them in this order, before any others."""

CELL = ["learner", "condition", "protocol"]
"""Columns that a group of subjects has in common."""

SUBJECT = ["experiment", "seed", "subject"]
"""Columns that identify a subject within its group."""

VISIT = ["phase", "loop", "trial"]
"""Columns that identify a trial of a subject, in the order of time."""

SOLUTIONS = ("first", "second", "third")
"""Columns with what each solution cost, in the order in which solutions were found."""

START = 10
"""The first tenth of a trial's attempts, and at least one attempt, are its start."""

AT_ONCE = 1_000_000
"""Attempts that :func:`count` counts at once, or those of one cell where it has more."""

_FIRST = {
    "condition": PAPER_CONDITIONS,
    "protocol": ("human",),
    "phase": PHASES,
    "category": CATEGORIES,
}
_NEVER = np.iinfo(np.int32).max


def attempts_to_solve(record: pa.Table) -> pd.DataFrame:
    """Number of attempts that every trial took, and their outcomes.

    >>> from causal_openlock import PROTOCOLS, Session, create, find_condition
    >>> session = Session(find_condition("CC4"), PROTOCOLS["human"], 2)
    >>> trials = attempts_to_solve(session.play(create("oracle")))
    >>> trials[["subject", "trial", "attempts", "solved"]].head(2).values.tolist()
    [[0, 1, 3, True], [0, 2, 3, True]]

    Args:
        record: Columns as in :func:`causal_openlock.experiment.record.record_schema`, rows in any
            order.

    Returns:
        One row for each trial that a subject played, sorted by :data:`CELL`, :data:`SUBJECT` and
        :data:`VISIT` (names are categorical, the paper's come first), with these columns and:

        - ``schema``, ``layout``: of the room.
        - ``attempts``: number of the attempt that found the last solution; for a trial that was
          not solved the number of its last attempt, which is the limit.
        - ``first``, ``second``, ``third``: attempts for that solution since the one before; NaN
          where it was not found, or the room has fewer.
        - ``first_solution``: ``first``, or of a trial in which none was found its last attempt.
        - ``last_attempt``: number of its last attempt; a trial may continue after it is solved.
        - ``solved``: whether every solution was found.
        - ``solutions_found``, ``solutions``: how many were found and how many there are.
        - for each of :data:`~causal_openlock.experiment.record.CATEGORIES`, how many attempts.
        - ``opened_at_start``: how many attempts opened the door at its :data:`START`.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    return _Trials.of(played(record)).table


def category_counts(record: pa.Table, blocks: int = 5) -> pd.DataFrame:
    """Outcomes of attempts over the course of a phase (the paper's Figures 6 and 7).

    Every subject's attempts in a phase are cut, in the order of time, into ``blocks`` equal
    shares (equal up to one attempt); the counts of the subjects are added up.

    Args:
        record: As in :func:`attempts_to_solve`.
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
    return trials_and_categories(record, blocks)[1]


def trials_and_categories(record: pa.Table, blocks: int = 5) -> tuple[pd.DataFrame, pd.DataFrame]:
    """:func:`attempts_to_solve` and :func:`category_counts` in one go."""
    if blocks < 1:
        raise ValueError(f"blocks is {blocks}; it must be at least 1")
    record = played(record)
    trials = _Trials.of(record)
    table, row_trial = trials.table, trials.row_trial
    phases = table.groupby([*CELL, "phase"], observed=True, sort=True)
    groups = phases.size().reset_index()[[*CELL, "phase"]]
    phase = phases.ngroup().to_numpy()
    by_subject = table.groupby([*CELL, *SUBJECT, "phase"], observed=True, sort=False)
    lengths = by_subject["last_attempt"]
    before = (lengths.cumsum() - table["last_attempt"]).to_numpy()
    total = lengths.transform("sum").to_numpy()  # attempts of a subject in a phase
    first = np.flatnonzero(by_subject.cumcount() == 0)

    # In the order of time, attempt i of n is in block floor(i * blocks / n).
    time = before[row_trial] + record["attempt"].to_numpy() - 1
    block = time * blocks // total[row_trial]
    code = (phase[row_trial] * blocks + block) * len(CATEGORIES) + trials.category
    counts = np.bincount(code, minlength=len(groups) * blocks * len(CATEGORIES))

    subjects = np.bincount(phase[first], minlength=len(groups))
    mean_total = np.bincount(phase[first], total[first], len(groups)) / np.maximum(subjects, 1)
    until = np.outer(mean_total, np.arange(1, blocks + 1) / blocks).ravel()
    category_codes = np.tile(np.arange(len(CATEGORIES)), len(groups) * blocks)
    each = groups.loc[groups.index.repeat(blocks * len(CATEGORIES))].reset_index(drop=True)
    return table, each.assign(
        block=np.tile(np.repeat(np.arange(1, blocks + 1), len(CATEGORIES)), len(groups)),
        category=pd.Categorical.from_codes(category_codes, list(CATEGORIES)),
        count=counts,
        subjects=np.repeat(subjects, blocks * len(CATEGORIES)),
        until=np.repeat(until, len(CATEGORIES)),
    )


class Counts(NamedTuple):
    """Counts of a record: :func:`attempts_to_solve` and :func:`category_counts`."""

    trials: pd.DataFrame
    blocks: pd.DataFrame


def count(record: pa.Table, at_once: int = AT_ONCE) -> Counts:
    """Count the trials of a record and the categories of its attempts, in little memory.

    A few cells are counted at a time, roughly ``at_once`` attempts, since a trial is within one
    cell. A record whose trials are cut apart, because its rows are in another order, is counted as
    a whole.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    pieces = list(_pieces(record, at_once))
    if len(pieces) > 1:
        try:
            trial_tables, block_tables = zip(*map(trials_and_categories, pieces), strict=True)
        except StoreError:
            # A trial is in several pieces: one that does not begin it has attempts missing.
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
    by = [*CELL, "phase", "block", "category"]
    joined = _joined(tables, by)
    joined["until"] *= joined["subjects"]
    sums = joined.groupby(by, observed=True, sort=True)[["count", "subjects", "until"]].sum()
    sums["until"] /= sums["subjects"]
    return sums.reset_index()[list(tables[0].columns)]


def by_subject(trials: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Average each subject's trials, so that every subject counts once however often it looped.

    >>> trials = pd.DataFrame(
    ...     {"learner": "a", "condition": "CC4", "protocol": "rl", "experiment": "e", "seed": 1,
    ...      "subject": [0, 0, 1], "attempts": [3, 5, 8], "solved": [True, True, False]}
    ... )
    >>> by_subject(trials, [])[["subject", "attempts", "visits"]].values.tolist()
    [[0.0, 4.0, 2.0], [1.0, 8.0, 1.0]]

    Args:
        trials: From :func:`attempts_to_solve`.
        by: What to keep apart within a subject, such as ``["phase", "trial"]``.

    Returns:
        One row for each subject and value of ``by``: the columns of :data:`CELL`, ``by`` and
        :data:`SUBJECT`, with the means ``attempts`` and ``solved`` (a share) and ``visits``, the
        number of trials averaged.
    """
    names = [*CELL, *by, *SUBJECT]
    first, group = numbered(trials, names)
    visits = np.bincount(group, minlength=len(first))
    means = {
        name: np.bincount(group, trials[name].to_numpy(float), len(first)) / visits
        for name in ("attempts", "solved")
    }
    return trials[names].iloc[first].reset_index(drop=True).assign(**means, visits=visits)


def at_places(
    each: pd.DataFrame, by: Sequence[str] = ("phase", "trial"), value: str = "attempts"
) -> tuple[FloatArray, list[tuple[Any, ...]]]:
    """``[n, P]`` a value of n subjects of one group at each of P places, and the places.

    Args:
        each: A row for each subject and place, such as from :func:`by_subject`.
        by: What makes up a place.
        value: The column; NaN where a subject was not at a place.
    """
    subjects, subject = numbered(each, SUBJECT)
    places, place = numbered(each, by)
    found = np.full((len(subjects), len(places)), np.nan)
    found[subject, place] = each[value].to_numpy(float)
    return found, [*zip(*(each[name].iloc[places] for name in by), strict=True)]


def numbered(frame: pd.DataFrame, names: Sequence[str]) -> tuple[IntArray, IntArray]:
    """The first row of each group of equal values, in their order, and each row's group."""
    codes = [_sortable(frame[name]) for name in names]
    order = np.lexsort(codes[::-1])
    starts = _starts([column[order] for column in codes])
    group = np.empty(len(order), np.int64)
    group[order] = np.repeat(np.arange(len(starts)), np.diff(starts, append=len(order)))
    return order[starts], group


def _sortable(column: pd.Series) -> NDArray[Any]:
    """The column as numbers in the order of its values, of names in that of their categories."""
    if isinstance(column.dtype, pd.CategoricalDtype):
        return column.cat.codes.to_numpy()
    return column.to_numpy() if is_numeric_dtype(column) else pd.factorize(column, sort=True)[0]


def mean_by_trial(trials: pd.DataFrame, by: Sequence[str] = ("phase", "trial")) -> pd.DataFrame:
    """Mean attempts over subjects, each subject's loops averaged first.

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


def judged(trials: pd.DataFrame) -> pd.DataFrame:
    """The trials that a condition is judged by; those of the test all get number 1.

    A condition with a test phase is judged by its test (the mean of a subject's test trials, in the
    human protocol a single one); one without, by the last trial of its last loop.
    """
    is_test = trials["phase"] == "test"
    tested = is_test.groupby([trials[name] for name in CELL], observed=True).transform("any")
    last_loop = trials["loop"] == trials.groupby(CELL, observed=True)["loop"].transform("max")
    chosen = trials[is_test | (~tested & last_loop)]
    last = chosen["trial"] == chosen.groupby(CELL, observed=True)["trial"].transform("max")
    chosen = chosen[last | (chosen["phase"] == "test")]
    # People's test is one trial, number 1; a baseline is compared trial by trial.
    return chosen.assign(trial=np.where(chosen["phase"] == "test", 1, chosen["trial"]))


def measured(table: pd.DataFrame) -> list[str]:
    """Trials that a condition was judged by, in words: ``test``, or such as ``trial 5``."""
    return [
        "test" if phase == "test" else f"trial {trial}"
        for phase, trial in zip(table["phase"], table["trial"], strict=True)
    ]


@dataclass(frozen=True)
class _Trials:
    """The trials of a record, and of each row the number of its trial and its category."""

    table: pd.DataFrame
    row_trial: IntArray
    category: IntArray

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
            """Reduce values of each trial: first within its runs, then over its runs in order."""
            if not len(starts):
                return values[:0]
            reduced: NDArray[Any] = how.reduceat(how.reduceat(values, starts)[order], joins)
            return reduced

        last = reduce(np.maximum, attempt)
        solved_at = reduce(np.minimum, np.where(found >= solutions, attempt, _NEVER))
        found_at = [
            reduce(np.minimum, np.where(found > number, attempt, _NEVER))
            for number in range(len(SOLUTIONS))
        ]
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
                **{
                    name: np.where(now == _NEVER, np.nan, now - before)
                    for name, now, before in zip(SOLUTIONS, found_at, [0, *found_at], strict=False)
                },
                "first_solution": np.minimum(found_at[0], last).astype(np.int64),
                "last_attempt": last.astype(np.int64),
                "solved": solved_at != _NEVER,
                "solutions_found": reduce(np.maximum, found).astype(np.int64),
                "solutions": reduce(np.maximum, solutions).astype(np.int64),
            }
        )
        _check_complete(table, rows)

        run_trial = np.empty(len(starts), np.int64)
        run_trial[order] = np.repeat(np.arange(len(joins)), np.diff(joins, append=len(starts)))
        row_trial = np.repeat(run_trial, length)
        category, _ = _encode(record, "category", CATEGORIES)
        size = len(CATEGORIES)
        counts = np.bincount(row_trial * size + category, minlength=len(table) * size)
        start = np.maximum(last // START, 1)[row_trial]
        opened = category >= CATEGORIES.index("open1")
        early = row_trial[opened & (attempt <= start)]
        counted = dict(zip(CATEGORIES, counts.reshape(-1, size).T, strict=True))
        counted["opened_at_start"] = np.bincount(early, minlength=len(table))
        return cls(table.assign(**counted), row_trial, category)


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
    """``[N]`` codes of a text column, and their names, in a fixed order."""
    import pyarrow as pa

    values = record[column]
    if not pa.types.is_dictionary(values.type):
        values = values.dictionary_encode()
    held = values.unify_dictionaries().to_pandas().cat
    names = known or ordered(held.categories, _FIRST.get(column, ()))
    if unknown := set(held.categories).difference(names):
        raise StoreError(
            f"the record's column {column} holds {min(unknown)!r}, which is not "
            f"one of {', '.join(names)}; was it written by another version?"
        )
    return held.set_categories(list(names)).cat.codes.to_numpy(), names


def ordered(names: Iterable[str], first: Sequence[str] = PAPER_CONDITIONS) -> tuple[str, ...]:
    """Names in the order of tables and figures: those in ``first``, then the rest by alphabet.

    >>> ordered({"mine", "CE4", "CC4"})
    ('CC4', 'CE4', 'mine')
    """
    have = set(names)
    return (
        *(name for name in dict.fromkeys(first) if name in have),
        *sorted(have.difference(first)),
    )


def _starts(columns: Iterable[NDArray[Any]]) -> IntArray:
    """Rows that differ from the row before in any of the columns."""
    changed: Any = None
    for column in columns:
        if changed is None:
            changed = np.zeros(len(column), dtype=bool)
            changed[:1] = True
        changed[1:] |= column[1:] != column[:-1]
    return np.flatnonzero(changed)
