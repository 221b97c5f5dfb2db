"""Attempts to solve and counts of categories, against hand-worked examples and plain loops."""

from __future__ import annotations

import itertools
import math
from collections import Counter, defaultdict
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.analysis.measures import (
    SOLUTIONS,
    attempts_to_solve,
    by_subject,
    category_counts,
    mean_by_trial,
    ordered,
)
from causal_openlock.analysis.results.summary import SUMMARY_COLUMNS, headline_table, summary_table
from causal_openlock.errors import StoreError
from causal_openlock.experiment.record import CATEGORIES
from support.counted_work import calls
from support.fabricated_records import big_record, random_cells, table, trial_rows

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def random_record() -> pa.Table:
    return pa.concat_tables(random_cells(7))


# -- attempts to solve ----------------------------------------------------------------------------


def test_attempts_of_three_trials_worked_by_hand() -> None:
    record = table(
        trial_rows([0, 1, 2, 3], trial=1)  # solved by the fourth attempt
        + trial_rows([1, 1, 2, 2, 2], trial=2)  # never solved: its five attempts
        + trial_rows([1, 2, 2], solutions=2, trial=3, layout="trial9")  # solved, then goes on
    )
    trials = attempts_to_solve(record)
    assert trials["first_solution"].tolist() == [2, 1, 1]
    nan = pytest.approx(np.nan, nan_ok=True)
    assert trials[[*SOLUTIONS]].to_numpy().tolist() == [[2, 1, 1], [1, 2, nan], [1, 1, nan]]
    nothing_found = attempts_to_solve(table(trial_rows([0, 0, 0])))
    assert nothing_found["first_solution"].tolist() == [3]
    assert nothing_found[[*SOLUTIONS]].to_numpy().tolist() == [[nan, nan, nan]]
    assert trials["attempts"].tolist() == [4, 5, 2]
    assert trials["last_attempt"].tolist() == [4, 5, 3]
    assert trials["solved"].tolist() == [True, False, True]
    assert trials["solutions_found"].tolist() == [3, 2, 2]
    assert trials["solutions"].tolist() == [3, 3, 2]
    assert trials["layout"].tolist() == ["trial1", "trial1", "trial9"]
    assert trials["trial"].tolist() == [1, 2, 3]


def test_attempts_agree_with_plain_loops(random_record: pa.Table) -> None:
    attempts: dict[tuple[Any, ...], int] = {}
    solved: dict[tuple[Any, ...], bool] = defaultdict(bool)
    names = ("learner", "condition", "protocol", "subject", "phase", "loop", "trial")
    for row in random_record.to_pylist():
        key = tuple(row[name] for name in names)
        if not solved[key]:
            attempts[key] = row["attempt"]
            solved[key] = row["solutions_found"] == row["solutions"]
    trials = attempts_to_solve(random_record)
    assert len(trials) == len(attempts)
    for row in trials.to_dict("records"):
        key = tuple(row[name] for name in names)
        assert (row["attempts"], row["solved"]) == (attempts[key], solved[key])


@settings(max_examples=15, deadline=None)
@given(st.randoms(use_true_random=False))
def test_order_of_rows_and_cells_makes_no_difference(shuffle: Any) -> None:
    cells = random_cells(3, subjects=2)
    record = pa.concat_tables(cells)
    shuffle.shuffle(cells)
    rows = list(range(record.num_rows))
    shuffle.shuffle(rows)
    for other in (pa.concat_tables(cells), record.take(rows)):
        pd.testing.assert_frame_equal(attempts_to_solve(record), attempts_to_solve(other))
        pd.testing.assert_frame_equal(category_counts(record), category_counts(other))


def test_tables_follow_the_papers_order_and_time() -> None:
    trials = attempts_to_solve(pa.concat_tables(random_cells(1)))
    assert list(dict.fromkeys(trials["condition"])) == ["CE4", "CC3-CC4", "own"]
    one = trials[(trials["condition"] == "CC3-CC4") & (trials["protocol"] == "loops")].head(8)
    visits = list(zip(one["phase"], one["loop"], one["trial"], strict=True))
    assert visits == [
        *itertools.product(["train"], [1, 2], [1, 2, 3]),
        ("test", 1, 1),
        ("test", 2, 1),
    ]
    assert ordered({"z", "CE3-CE4", "b", "CC4"}) == ("CC4", "CE3-CE4", "b", "z")


def test_text_columns_need_not_be_dictionaries(random_record: pa.Table) -> None:
    plain = pa.table(
        {
            name: column.cast(pa.string()) if pa.types.is_dictionary(column.type) else column
            for name, column in zip(random_record.column_names, random_record.columns, strict=True)
        }
    )
    pd.testing.assert_frame_equal(attempts_to_solve(plain), attempts_to_solve(random_record))
    pd.testing.assert_frame_equal(category_counts(plain), category_counts(random_record))


def test_subjects_of_different_seeds_are_different_subjects() -> None:
    record = table(trial_rows([1, 2, 3], seed=1) + trial_rows([0, 0, 1, 2, 3], seed=2))
    assert summary_table(record)["subjects"].tolist() == [2]
    assert summary_table(record)["attempts"].tolist() == [4.0]


def test_a_cell_read_twice_is_an_error() -> None:
    cell = table(trial_rows([1, 2, 3]))
    with pytest.raises(StoreError, match=r"missing or twice in 1 trial,.*6 rows for 3 attempts"):
        attempts_to_solve(pa.concat_tables([cell, cell]))
    with pytest.raises(StoreError, match="missing or twice"):
        attempts_to_solve(cell.slice(1))


def test_unknown_category_is_an_error() -> None:
    rows = trial_rows([1, 2, 3])
    rows[0]["category"] = "open9"
    with pytest.raises(StoreError, match="'open9', which is not one of else, unlock"):
        category_counts(table(rows))


def test_an_empty_record_has_empty_tables() -> None:
    record = table([])
    assert attempts_to_solve(record).empty
    assert category_counts(record).empty
    columns = summary_table(record).columns.tolist()
    assert columns[: len(SUMMARY_COLUMNS)] == [*SUMMARY_COLUMNS]
    assert headline_table(record).empty


def test_loops_are_averaged_within_a_subject_first() -> None:
    rows = []
    for subject, lengths in enumerate([[3, 5], [4, 8], [6]]):  # the last made one loop only
        for loop, length in enumerate(lengths, 1):
            found = [0] * (length - 3) + [1, 2, 3]
            rows += trial_rows(found, subject=subject, loop=loop, protocol="loops")
    trials = attempts_to_solve(table(rows))
    assert by_subject(trials, ["phase", "trial"])["attempts"].tolist() == [4, 6, 6]
    (means,) = mean_by_trial(trials).to_dict("records")
    assert means["mean"] == pytest.approx(16 / 3)
    assert means["se"] == pytest.approx(math.sqrt(8 / 9) / math.sqrt(3))  # population SD
    assert (means["subjects"], means["visits"], means["share_solved"]) == (3, 2, 1.0)


# -- categories -----------------------------------------------------------------------------------


def test_counts_of_ten_attempts_in_blocks_worked_by_hand() -> None:
    record = table(
        trial_rows([0, 1, 1, 2], trial=1)  # else open1 | else open2
        + trial_rows([1, 1, 1, 1, 1, 1], trial=2, otherwise="unlock")  # open1 unlock | ...
    )
    counts = category_counts(record, blocks=5)
    assert counts["block"].tolist() == [block for block in range(1, 6) for _ in CATEGORIES]
    assert counts["count"].to_numpy().reshape(5, 5).tolist() == [
        [1, 0, 1, 0, 0],
        [1, 0, 0, 1, 0],
        [0, 1, 1, 0, 0],
        [0, 2, 0, 0, 0],
        [0, 2, 0, 0, 0],
    ]
    assert counts["until"].to_numpy()[::5].tolist() == [2, 4, 6, 8, 10]
    assert set(counts["subjects"]) == {1}


@pytest.mark.parametrize("blocks", [1, 3, 5])
def test_counts_agree_with_plain_loops(random_record: pa.Table, blocks: int) -> None:
    sequence: dict[tuple[Any, ...], list[tuple[Any, ...]]] = defaultdict(list)
    for row in random_record.to_pylist():
        key = (row["learner"], row["condition"], row["protocol"], row["phase"], row["subject"])
        sequence[key].append((row["loop"], row["trial"], row["attempt"], row["category"]))
    expected: Counter[tuple[Any, ...]] = Counter()
    for key, attempts in sequence.items():
        for index, attempt in enumerate(sorted(attempts)):
            block = 1 + math.floor(index * blocks / len(attempts) + 1e-9)
            expected[*key[:4], block, attempt[-1]] += 1
    counts = category_counts(random_record, blocks)
    names = ["learner", "condition", "protocol", "phase", "block", "category"]
    found = {tuple(row[name] for name in names): row["count"] for row in counts.to_dict("records")}
    assert {key: count for key, count in found.items() if count} == dict(expected)
    assert counts["count"].sum() == random_record.num_rows


def test_blocks_must_be_positive(random_record: pa.Table) -> None:
    with pytest.raises(ValueError, match="at least 1"):
        category_counts(random_record, 0)


# -- size -----------------------------------------------------------------------------------------


def test_a_hundred_times_as_many_attempts_are_as_many_calls() -> None:
    """What depends on the number of attempts is done in arrays, so that millions take seconds."""
    work = {}
    for attempts in (2_400 * 4, 960_000):
        record = big_record(attempts)

        def measured(record: pa.Table = record) -> None:
            trials, counts = attempts_to_solve(record), category_counts(record)
            assert counts["count"].sum() == record.num_rows
            assert trials["last_attempt"].sum() == record.num_rows

        measured()  # what is imported on the way is no work
        work[attempts] = calls(measured)
    few, many = work.values()
    assert many < 1.2 * few
