"""Counts of a record: attempts to solve each trial, and attempts in each category.

A record has a row for every attempt, perhaps millions, and a trial is a group of such rows. What
comes after this module works on a table with one row for each trial. Rows are sorted by their
values (phase, loop, trial, attempt), so the order in which cells are read makes no difference.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa

from causal_openlock.errors import StoreError
from causal_openlock.experiment.condition import PAPER_CONDITIONS
from causal_openlock.experiment.record import CATEGORIES, PHASES, played
from causal_openlock.schemas.fsm import FloatArray, IntArray
from causal_openlock.wording import counted

BASELINES, TRANSFERS = PAPER_CONDITIONS[:2], PAPER_CONDITIONS[2:]
"""The paper's six conditions; tables and figures show them in this order, before any others."""

CELL = ["learner", "condition", "protocol"]  #: columns that a group of subjects has in common
SUBJECT = ["experiment", "seed", "subject"]  #: columns that identify a subject within its group
VISIT = ["phase", "loop", "trial"]  #: columns that identify a trial of a subject, in order of time
PHASE = [*CELL, *SUBJECT, "phase"]  #: columns that identify a phase of a subject
TRIAL = [*CELL, *SUBJECT, *VISIT, "schema", "layout"]  #: columns that identify a trial and its room
NAMES = [*CELL, "experiment", "phase", "schema", "layout", "category"]  #: columns of names
SOLUTIONS = ("first", "second", "third")  #: attempts for each solution, in the order of finding
OUTCOMES = ("neither", *CATEGORIES[1:])  #: columns; ``else`` is a keyword of Python
START = 10  #: the first tenth of a trial's attempts, and at least one attempt, are its start
BLOCKS = 5  #: shares of a phase in which categories are counted, as in the paper's Figure 6
AT_ONCE = 1_000_000  #: attempts counted at once, or those of one subject number if it has more

_FIRST = {"condition": PAPER_CONDITIONS, "protocol": ("human",), "phase": PHASES}
COLUMNS = [
    *(*TRIAL, "attempts", *SOLUTIONS, "first_solution", "last_attempt", "solved"),
    *("solutions_found", "solutions", *OUTCOMES, "opened_at_start"),
]  #: columns of :func:`attempts_to_solve`


def attempts_to_solve(record: pa.Table) -> pd.DataFrame:
    """Number of attempts that every trial took, and their outcomes.

    >>> from causal_openlock import PROTOCOLS, Session, create, find_condition
    >>> session = Session(find_condition("CC4"), PROTOCOLS["human"], 2)
    >>> trials = attempts_to_solve(session.play(create("oracle")))
    >>> trials[["subject", "trial", "attempts", "solved"]].head(2).values.tolist()
    [[0, 1, 3, True], [0, 2, 3, True]]

    Rows of the record may be in any order.

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
        - for each of :data:`OUTCOMES`, how many attempts.
        - ``opened_at_start``: how many attempts opened the door at its :data:`START`.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    return _trials(_attempts(_named(played(record))))[0]


def count(record: pa.Table, at_once: int = AT_ONCE) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Count the trials of a record and the categories of its attempts, in little memory.

    Some subjects are counted at a time, which have roughly ``at_once`` attempts.

    Returns:
        Trials as :func:`attempts_to_solve` has them, and outcomes of attempts over the course of a
        phase (the paper's Figures 6 and 7). Every subject's attempts in a phase are cut, in the
        order of time, into :data:`BLOCKS` equal shares (equal up to one attempt). A row for each
        ``learner``, ``condition``, ``protocol``, ``phase``, ``block`` (from 1) and ``category``:
        their ``count`` over all ``subjects``, and ``until``, a subject's mean attempts up to the
        block's last.

    Raises:
        StoreError: If a trial has attempts missing or twice.
    """
    record = _named(played(record))
    piece = record["subject"].to_numpy() % max(-(-record.num_rows // at_once), 1)
    counts = [_count(record.filter(piece == one)) for one in np.unique(piece).tolist() or [0]]
    trials = pd.concat([one for one, _ in counts], ignore_index=True)
    trials = trials.sort_values([*CELL, *SUBJECT, *VISIT], kind="stable", ignore_index=True)
    by = [*CELL, "phase"]
    blocks = pd.concat([one for _, one in counts]).groupby(by, observed=True).sum()
    every = pd.MultiIndex.from_product(
        [range(1, BLOCKS + 1), pd.CategoricalIndex(CATEGORIES, CATEGORIES)],
        names=["block", "category"],
    )
    blocks = blocks.reindex(columns=every).fillna(0).astype(np.int64)
    table = blocks.stack(["block", "category"]).rename("count").reset_index()
    lengths = trials.groupby(PHASE, observed=True)["last_attempt"].sum().groupby(by, observed=True)
    about = lengths.agg(subjects="size", until="mean").reset_index()
    table = table.merge(about, on=by)
    return trials, table.assign(until=table["until"] * table["block"] / BLOCKS)


def _named(record: pa.Table) -> pa.Table:
    """What is counted of a record; its columns of text are codes, the same in every chunk."""
    record = record.select([*TRIAL, "attempt", "category", "solutions_found", "solutions"])
    for name in NAMES:
        place = record.schema.get_field_index(name)
        record = record.set_column(place, name, record[name].dictionary_encode())
    return record.unify_dictionaries()


def _attempts(record: pa.Table) -> pd.DataFrame:
    """A row for each attempt; names are categories, the paper's first."""
    frame = record.to_pandas()
    for name in NAMES:
        held = frame[name].cat.categories
        known = CATEGORIES if name == "category" else ordered(held, _FIRST.get(name, ()))
        if unknown := {*held}.difference(known):
            raise StoreError(
                f"the record's column {name} holds {min(unknown)!r}, which is not one of "
                f"{', '.join(known)}; was it written by another version?"
            )
        frame[name] = frame[name].cat.set_categories(list(known))
    return frame


def _trials(frame: pd.DataFrame) -> tuple[pd.DataFrame, IntArray]:
    """The trials of attempts, sorted, and ``[N]`` the trial of each attempt."""
    attempt, found = frame["attempt"], frame["solutions_found"]
    reached = {"solved_at": attempt.where(found >= frame["solutions"])}
    reached |= {name: attempt.where(found >= many) for many, name in enumerate(SOLUTIONS, 1)}
    grouped = frame.assign(**reached).groupby(TRIAL, observed=True, sort=True)
    trial = grouped.ngroup().to_numpy()
    trials = grouped.agg(
        last_attempt=("attempt", "max"),
        rows=("attempt", "size"),
        solutions_found=("solutions_found", "max"),
        solutions=("solutions", "max"),
        **{name: (name, "min") for name in reached},
    ).reset_index()
    _check_complete(trials)
    last, size = trials["last_attempt"], len(CATEGORIES)
    codes = frame["category"].cat.codes.to_numpy().astype(np.int64)
    counts = np.bincount(trial * size + codes, minlength=len(trials) * size).reshape(-1, size)
    at_start = attempt.to_numpy() <= np.maximum(last // START, 1).to_numpy()[trial]
    opened = trial[at_start & (codes >= CATEGORIES.index("open1"))]
    trials = trials.assign(
        attempts=trials["solved_at"].fillna(last),
        first_solution=trials["first"].fillna(last),
        second=trials["second"] - trials["first"],
        third=trials["third"] - trials["second"],
        solved=trials["solved_at"].notna(),
        **dict(zip(OUTCOMES, counts.T, strict=True)),
        opened_at_start=np.bincount(opened, minlength=len(trials)),
    )
    whole = ["attempts", "first_solution", *trials.select_dtypes("integer")]
    return trials.astype(dict.fromkeys(whole, np.int64))[COLUMNS], trial


def _check_complete(trials: pd.DataFrame) -> None:
    wrong = trials[trials["rows"] != trials["last_attempt"]]
    if len(wrong):
        trial = wrong.iloc[0]
        where = ", ".join(f"{column} {trial[column]}" for column in [*CELL, "subject", *VISIT])
        raise StoreError(
            f"the record has attempts missing or twice in {counted(len(wrong), 'trial')}, "
            f"first in {where}: "
            f"{trial['rows']} rows for {trial['last_attempt']} attempts; read every cell once"
        )


def _count(record: pa.Table) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Trials, and ``[C, B]`` how many attempts of each category the blocks of a phase have."""
    frame = _attempts(record)
    trials, trial = _trials(frame)
    lengths = trials.groupby(PHASE, observed=True, sort=False)["last_attempt"]
    before = (lengths.cumsum() - trials["last_attempt"]).to_numpy()[trial]
    total = lengths.transform("sum").to_numpy()[trial]
    # In the order of time, attempt i of n is in block floor(i * BLOCKS / n).
    block = (before + frame["attempt"].to_numpy() - 1) * BLOCKS // total + 1
    by = [*CELL, "phase", "block", "category"]
    outcomes = frame.assign(block=block).groupby(by, observed=True).size()
    return trials, outcomes.unstack(["block", "category"])


def by_subject(trials: pd.DataFrame, by: Sequence[str]) -> pd.DataFrame:
    """Average each subject's trials, so that every subject counts once however often it looped.

    >>> trials = pd.DataFrame(
    ...     {"learner": "a", "condition": "CC4", "protocol": "rl", "experiment": "e", "seed": 1,
    ...      "subject": [0, 0, 1], "attempts": [3, 5, 8], "solved": [True, True, False]}
    ... )
    >>> by_subject(trials, [])[["subject", "attempts", "visits"]].values.tolist()
    [[0.0, 4.0, 2.0], [1.0, 8.0, 1.0]]

    Kept apart within a subject is what ``by`` names, such as ``["phase", "trial"]``.

    Returns:
        One row for each subject and value of ``by``: the columns of :data:`CELL`, ``by`` and
        :data:`SUBJECT`, with the means ``attempts`` and ``solved`` (a share) and ``visits``, the
        number of trials averaged.
    """
    grouped = trials.groupby([*CELL, *by, *SUBJECT], observed=True, sort=True)
    means = grouped.agg(
        attempts=("attempts", "mean"), solved=("solved", "mean"), visits=("attempts", "size")
    )
    return means.reset_index()


def at_places(
    each: pd.DataFrame, by: Sequence[str] = ("phase", "trial"), value: str = "attempts"
) -> tuple[FloatArray, list[tuple[Any, ...]]]:
    """``[n, P]`` a value of n subjects of one group at each of P places, and the places.

    ``each`` has a row for each subject and place; it is NaN where a subject was not at a place.
    """
    table = each.set_index([*SUBJECT, *by])[value].unstack([*by])
    places = table.columns.to_frame().itertuples(index=False, name=None)
    return np.ascontiguousarray(table.to_numpy(float)), [*places]


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
