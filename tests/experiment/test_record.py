"""The record: categories, the log that grows, and the table it becomes."""

from __future__ import annotations

import tracemalloc
from dataclasses import replace
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.record import (
    CATEGORIES,
    AttemptLog,
    assemble,
    categorise,
    compact,
    record_schema,
)
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema

TEXTS = ("experiment", "learner", "condition", "protocol")


def append(log: AttemptLog, subjects: list[int], **values: Any) -> None:
    """Add attempts of these subjects in which nothing happened, but for what is said."""
    many, limit = len(subjects), log.action_limit
    log.append(
        **{
            "subject": np.array(subjects),
            "visit": np.zeros(many, int),
            "attempt": np.ones(many, int),
            "used": np.full(many, limit),
            "actions": np.zeros((many, limit), int),
            "moved": np.zeros((many, limit), bool),
            "unlocked": np.zeros(many, bool),
            "opened": np.zeros(many, bool),
            "solution": np.full(many, -1),
            "new_solution": np.zeros(many, bool),
            "solutions_found": np.zeros(many, int),
            "reward": np.zeros(many),
            "wall_time": 0.0,
            **values,
        }
    )


def visits(subjects: int, trials: int = 1) -> dict[str, np.ndarray]:
    shape = (subjects, trials)
    trial = np.tile(np.arange(1, trials + 1), (subjects, 1))
    return {
        "phase": np.full(shape, "train", dtype=object),
        "loop": np.ones(shape, np.int32),
        "trial": trial,
        "schema": np.array([[f"S{t % 2}" for t in row] for row in trial], dtype=object),
        "layout": np.array([[f"trial{t}" for t in row] for row in trial], dtype=object),
        "solutions": np.full(shape, 2, np.int16),
    }


def constants(subjects: list[int]) -> dict[str, Any]:
    texts = {name: f"my {name}" for name in TEXTS}
    return {**texts, "seed": 5, "subjects": np.array(subjects)}


# -- categories -----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unlocked", "opened", "new", "found", "category"),
    [
        (False, False, False, 0, "else"),
        (False, False, False, 2, "else"),
        (True, False, False, 0, "unlock"),
        (True, False, False, 3, "unlock"),
        (True, True, True, 1, "open1"),
        (True, True, True, 2, "open2"),
        (True, True, True, 3, "open3"),
        (True, True, True, 5, "open3"),
        (True, True, False, 0, "open1"),  # opened in a way that is no solution
        (True, True, False, 1, "open1"),  # a repeated solution
        (True, True, False, 3, "open1"),
    ],
)
def test_a_category_is_an_event(
    unlocked: bool, opened: bool, new: bool, found: int, category: str
) -> None:
    index = categorise(np.array([unlocked]), np.array([opened]), np.array([new]), np.array([found]))
    assert [CATEGORIES[i] for i in index] == [category]


# -- the log --------------------------------------------------------------------------------------


def test_what_was_logged_stays_as_it_was_while_the_log_grows() -> None:
    log, generator = AttemptLog(4), np.random.default_rng(0)
    rows: dict[str, list[Any]] = {"subject": [], "actions": [], "reward": [], "unlocked": []}
    for size in (1, 0, 7, 1500, 3, 1024, 5000, 2):
        values = {
            "actions": generator.integers(15, size=(size, 4)),
            "reward": generator.random(size),
            "unlocked": generator.random(size) < 0.5,
        }
        subjects = generator.integers(9, size=size).tolist()
        append(log, subjects, **values)
        rows["subject"] += subjects
        for name, value in values.items():
            rows[name] += value.tolist()
        assert log.rows == len(rows["subject"])
    for name, expected in rows.items():
        np.testing.assert_array_equal(log.columns()[name], expected)


def test_the_log_takes_memory_for_its_rows_and_a_half_more_at_most() -> None:
    log = AttemptLog(3)
    for _ in range(200):
        append(log, list(range(100)))
        bytes_of_a_row = log.row_type.itemsize
        assert bytes_of_a_row <= 50
        taken = sum(column.nbytes for column in log._columns.values())
        assert taken <= bytes_of_a_row * max(1.5 * log.rows + 1, 1024)


def test_a_column_that_is_left_out_is_an_error() -> None:
    with pytest.raises(KeyError):
        AttemptLog(3).append(subject=np.zeros(2, int))


# -- the table ------------------------------------------------------------------------------------


def test_a_record_is_sorted_by_subject_and_then_by_time() -> None:
    log = AttemptLog(3)
    moments = [([2, 0, 1], 0.1), ([1], 0.2), ([0, 2], 0.3), ([1, 2], 0.4)]
    for subjects, moment in moments:
        append(log, subjects, wall_time=moment)
    table = assemble(log, visits(3), constants([7, 8, 9]))
    assert table["subject"].to_pylist() == [7, 7, 8, 8, 8, 9, 9, 9]
    times = np.round(table["wall_time"].to_pylist(), 3).tolist()
    assert times == [0.1, 0.3, 0.1, 0.2, 0.4, 0.1, 0.3, 0.4]


def test_subjects_keep_their_numbers_whatever_these_are() -> None:
    log = AttemptLog(3)
    append(log, [0, 1, 2], reward=np.array([0.0, 1.0, 2.0]))
    table = assemble(log, visits(3), constants([40, 3, 17]))
    assert table["subject"].to_pylist() == [3, 17, 40]
    assert table["reward"].to_pylist() == [1, 2, 0]


def test_a_record_has_the_columns_of_the_contract_each_with_its_meaning() -> None:
    log = AttemptLog(3)
    append(log, [0])
    table = assemble(log, visits(1), constants([0]))
    assert table.schema.equals(record_schema(), check_metadata=True)
    assert all(field.metadata[b"meaning"] for field in table.schema)
    assert table.column_names == [
        "experiment",
        "learner",
        "condition",
        "protocol",
        "subject",
        "seed",
        "phase",
        "loop",
        "trial",
        "schema",
        "layout",
        "attempt",
        "actions",
        "moved",
        "unlocked",
        "opened",
        "solution",
        "new_solution",
        "solutions_found",
        "solutions",
        "reward",
        "category",
        "wall_time",
    ]
    assert not any(column.null_count for column in table.columns)


def test_each_attempt_takes_what_it_says_of_its_trial_from_its_own_trial() -> None:
    log = AttemptLog(3)
    for visit in ([0, 0], [1, 0], [2, 1]):
        append(log, [0, 1], visit=np.array(visit))
    table = assemble(log, visits(2, trials=3), constants([0, 1])).to_pandas()
    assert table.trial.tolist() == [1, 2, 3, 1, 1, 2]
    assert table.schema.tolist() == ["S1", "S0", "S1", "S1", "S1", "S0"]
    assert table.layout.tolist() == ["trial1", "trial2", "trial3", "trial1", "trial1", "trial2"]
    for name in TEXTS:
        assert set(table[name]) == {f"my {name}"}
    assert set(table.seed) == {5}


def test_lists_hold_the_actions_that_were_used_and_no_more() -> None:
    log = AttemptLog(4)
    append(
        log,
        [1, 0, 1],
        used=np.array([2, 4, 3]),
        actions=np.array([[1, 14, 9, 9], [1, 2, 3, 4], [5, 6, 14, 9]]),
        moved=np.array([[1, 1, 1, 1], [0, 0, 1, 0], [1, 0, 1, 1]], dtype=bool),
    )
    table = assemble(log, visits(2), constants([0, 1]))
    assert table["actions"].to_pylist() == [[1, 2, 3, 4], [1, 14], [5, 6, 14]]
    assert table["moved"].to_pylist() == [
        [False, False, True, False],
        [True, True],
        [True, False, True],
    ]


def test_a_record_without_attempts_is_an_empty_table() -> None:
    table = assemble(AttemptLog(3), visits(2), constants([0, 1]))
    assert isinstance(table, pa.Table)
    assert table.num_rows == 0
    assert table.schema.equals(record_schema())


# -- memory ---------------------------------------------------------------------------------------


def test_a_session_takes_memory_for_its_record_and_for_nothing_else() -> None:
    protocol = replace(PROTOCOLS["rl"], baseline_loops=8)
    session = Session(Condition.named("CC4", find_schema), protocol, 50)
    generator = np.random.default_rng(0)

    def play(steps: int) -> None:
        for _ in range(steps):
            session.step(generator.integers(15, size=50))

    play(300)
    tracemalloc.start()
    try:
        before = session._log.rows
        play(3000)
        grown, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert session._log.rows - before == 50 * 1000
    log = sum(column.nbytes for column in session._log._columns.values())
    assert grown < log + 100_000


# -- compact --------------------------------------------------------------------------------------


@settings(max_examples=20, deadline=None)
@given(st.lists(st.integers(0, 400), min_size=1, max_size=4), st.integers(0, 400))
def test_compact_records_of_any_cells_can_be_put_together(sizes: list[int], apart: int) -> None:
    cells = []
    for cell, many in enumerate(sizes):
        log = AttemptLog(3)
        shape = (max(many, 1), 1)
        append(log, list(range(many)))
        layouts = [[f"layout{apart * cell + n}"] for n in range(shape[0])]
        schemas = [[f"S{cell}_{n % 200}"] for n in range(shape[0])]
        visited = {
            **visits(*shape),
            "layout": np.array(layouts, dtype=object),
            "schema": np.array(schemas, dtype=object),
        }
        told = {**constants(list(range(shape[0]))), "learner": f"learner{cell}"}
        cells.append(assemble(log, visited, told))
    together = pa.concat_tables([compact(cell) for cell in cells])
    whole = pa.concat_tables(cells)
    assert together.to_pylist() == whole.to_pylist()
    # Names are counted as one: where every cell has some, all of them may be many.
    for name in ("layout", "schema", "learner", "category"):
        found = together[name].combine_chunks().dictionary.to_pylist() if sum(sizes) else []
        assert set(whole[name].to_pylist()) <= set(found)
    assert compact(cells[0].slice(0, 0)).schema == together.schema
