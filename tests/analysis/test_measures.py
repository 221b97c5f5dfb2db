"""Attempts to solve and counts of categories, by hand, by plain loops, and in pieces."""

import itertools
import math
from collections import Counter, defaultdict
from cProfile import Profile

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock.analysis.measures import (
    SOLUTIONS,
    attempts_to_solve,
    by_subject,
    count,
    mean_by_trial,
    ordered,
)
from causal_openlock.errors import StoreError
from support.fabricated_courses import course
from support.fabricated_records import random_cells, table, trial_rows
from support.made_up_experiments import headline_table, summary_table

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def random_record():
    return pa.concat_tables(random_cells(7))


def test_attempts_of_trials_worked_by_hand():
    record = table(
        trial_rows([0, 1, 2, 3], trial=1)  # solved by the fourth attempt
        + trial_rows([1, 1, 2, 2, 2], trial=2)  # never solved: its five attempts
        + trial_rows([1, 2, 2], solutions=2, trial=3, layout="trial9")  # solved, then goes on
        + trial_rows([0, 0, 0], trial=4)
    )
    trials = attempts_to_solve(record)
    assert trials["first_solution"].tolist() == [2, 1, 1, 3]
    nan = pytest.approx(np.nan, nan_ok=True)
    since = [[2, 1, 1], [1, 2, nan], [1, 1, nan], [nan, nan, nan]]
    assert trials[[*SOLUTIONS]].to_numpy().tolist() == since
    assert trials["attempts"].tolist() == [4, 5, 2, 3]
    assert trials["last_attempt"].tolist() == [4, 5, 3, 3]
    assert trials["solved"].tolist() == [True, False, True, False]
    assert trials["solutions_found"].tolist() == [3, 2, 2, 0]
    assert trials["solutions"].tolist() == [3, 3, 2, 3]
    assert trials["layout"].tolist() == ["trial1", "trial1", "trial9", "trial1"]
    assert trials["trial"].tolist() == [1, 2, 3, 4]


def test_tables_follow_the_papers_order_and_time():
    trials = attempts_to_solve(pa.concat_tables(random_cells(1)))
    assert list(dict.fromkeys(trials["condition"])) == ["CE4", "CC3-CC4", "own"]
    one = trials[(trials["condition"] == "CC3-CC4") & (trials["protocol"] == "loops")].head(8)
    visits = list(zip(one["phase"], one["loop"], one["trial"], strict=True))
    train = itertools.product(["train"], [1, 2], [1, 2, 3])
    assert visits == [*train, ("test", 1, 1), ("test", 2, 1)]
    assert ordered({"z", "CE3-CE4", "b", "CC4"}) == ("CC4", "CE3-CE4", "b", "z")


def test_subjects_of_different_seeds_are_different_subjects():
    record = table(trial_rows([1, 2, 3], seed=1) + trial_rows([0, 0, 1, 2, 3], seed=2))
    assert summary_table(record)["subjects"].tolist() == [2]
    assert summary_table(record)["attempts"].tolist() == [4.0]


def test_broken_records_are_refused_whole_and_in_pieces():
    cell = table(trial_rows([1, 2, 3]))
    with pytest.raises(StoreError, match=r"twice in 1 trial,.*6 rows for 3 attempts"):
        attempts_to_solve(pa.concat_tables([cell, cell]))
    other = table(trial_rows([1, 2, 3], subject=1)[1:])
    with pytest.raises(StoreError, match="missing or twice in 1 trial"):
        count(pa.concat_tables([cell, other]), 1)
    rows = trial_rows([1, 2, 3])
    rows[0]["category"] = "open9"
    with pytest.raises(StoreError, match="'open9', which is not one of else, unlock"):
        count(table(rows))


def test_an_empty_record_has_empty_tables():
    record = table([])
    tables = (attempts_to_solve, lambda of: count(of)[1], summary_table, headline_table)
    for made in tables:
        assert made(record).empty
        assert len(made(record).columns) == len(made(table(trial_rows([1]))).columns)


def test_loops_are_averaged_within_a_subject_first():
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


def test_counts_agree_with_plain_loops(random_record):
    sequence, expected = defaultdict(list), Counter()
    for row in random_record.to_pylist():
        key = (row["learner"], row["condition"], row["protocol"], row["phase"], row["subject"])
        sequence[key].append((row["loop"], row["trial"], row["attempt"], row["category"]))
    for key, attempts in sequence.items():
        for index, attempt in enumerate(sorted(attempts)):
            block = 1 + index * 5 // len(attempts)
            expected[*key[:4], block, attempt[-1]] += 1
    _, counts = count(random_record)
    names = ["learner", "condition", "protocol", "phase", "block", "category"]
    found = {tuple(row[name] for name in names): row["count"] for row in counts.to_dict("records")}
    assert {key: many for key, many in found.items() if many} == dict(expected)
    assert counts["count"].sum() == random_record.num_rows


def same_as_whole(record, at_once):
    for ours, whole in zip(count(record, at_once), count(record, record.num_rows), strict=True):
        pd.testing.assert_frame_equal(ours, whole, check_column_type=False)


@pytest.mark.parametrize("at_once", [1, 50, 10_000])
def test_pieces_come_to_the_same_as_the_whole(at_once):
    same_as_whole(pa.concat_tables(random_cells(5, subjects=4)), at_once)


def test_pieces_that_cut_trials_or_subjects_apart_come_to_the_same():
    record = pa.concat_tables(random_cells(6, conditions=("CC4",), protocols=("loops",)))
    shuffled = record.take(np.random.default_rng(0).permutation(record.num_rows))
    cut = [shuffled.slice(i, 7) for i in range(0, record.num_rows, 7)]
    same_as_whole(pa.concat_tables(cut), 1)
    # Whole trials, but those of a subject in different pieces: blocks are shares of a phase.
    by_trial = record.sort_by([("trial", "ascending"), ("loop", "ascending")])
    trials = by_trial["trial"].to_numpy()
    pieces = [by_trial.filter(pa.array(trials == one)) for one in (1, 2, 3)]
    same_as_whole(pa.concat_tables(pieces), 1)


def test_many_times_as_many_attempts_are_as_many_calls():
    """What depends on the number of attempts is done in arrays, so that millions take seconds."""
    calls = {}
    for subjects in (2, 40):
        cells = [course(np.zeros((subjects, 10)), attempts=300, learner=name) for name in "abcd"]
        record = pa.concat_tables(cells)

        def measured(record=record):
            trials, counts = count(record, record.num_rows)
            assert counts["count"].sum() == record.num_rows
            assert trials["last_attempt"].sum() == record.num_rows

        measured()  # what is imported on the way is no work
        profile = Profile()
        profile.runcall(measured)
        calls[subjects] = sum(entry.callcount for entry in profile.getstats())
    assert calls[40] < 1.2 * calls[2]
