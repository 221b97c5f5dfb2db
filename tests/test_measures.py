"""Measures, statistics and summary, against hand-worked examples and plain loops."""

from __future__ import annotations

import itertools
import math
import time
import warnings
from collections import Counter, defaultdict
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from causal_openlock.analysis.measures import (
    attempts_to_solve,
    by_subject,
    category_counts,
    mean_by_trial,
    number_visits,
    ordered,
)
from causal_openlock.analysis.statistics import mean_interval, mean_intervals
from causal_openlock.analysis.summary import (
    SUMMARY_COLUMNS,
    headline_table,
    people,
    summary_table,
    write_summary,
)
from causal_openlock.errors import StoreError
from causal_openlock.record import CATEGORIES, categorise, record_schema

Row = dict[str, Any]


def trial_rows(found: list[int], solutions: int = 3, **values: Any) -> list[Row]:
    """The attempts of one trial, by how many solutions are found after each of them."""
    rows = []
    for number, (before, after) in enumerate(itertools.pairwise([0, *found]), 1):
        new = after > before
        category = f"open{min(after, 3)}" if new else values.get("otherwise", "else")
        rows.append(
            {
                "experiment": "fabricated",
                "learner": "a",
                "condition": "CC4",
                "protocol": "human",
                "subject": 0,
                "seed": 1,
                "phase": "train",
                "loop": 1,
                "trial": 1,
                "schema": "CC4",
                "layout": "trial1",
                "actions": [0, 1, 14],
                "moved": [True, True, new],
                "reward": 0.0,
                "wall_time": 0.1 * number,
                **{name: value for name, value in values.items() if name != "otherwise"},
                "attempt": number,
                "unlocked": category != "else",
                "opened": category.startswith("open"),
                "solution": after - 1 if new else -1,
                "new_solution": new,
                "solutions_found": after,
                "solutions": solutions,
                "category": category,
            }
        )
    return rows


def table(rows: list[Row]) -> pa.Table:
    """Rows as a record."""
    columns = {}
    for field in record_schema():
        kind = field.type.value_type if pa.types.is_dictionary(field.type) else field.type
        column = pa.array([row[field.name] for row in rows], kind)
        columns[field.name] = (
            column.dictionary_encode() if pa.types.is_dictionary(field.type) else column
        )
    return pa.table(columns, schema=record_schema())


def random_cells(
    seed: int,
    *,
    learners: tuple[str, ...] = ("b", "a"),
    conditions: tuple[str, ...] = ("CE4", "CC3-CC4", "own"),
    protocols: tuple[str, ...] = ("human", "loops"),
    subjects: int = 3,
    limit: int = 6,
) -> list[pa.Table]:
    """Cells of random attempts; under ``loops`` trials go on after they are solved."""
    rng = np.random.default_rng(seed)
    cells = []
    for learner, condition, protocol in itertools.product(learners, conditions, protocols):
        rows: list[Row] = []
        loops = 1 if protocol == "human" else 2
        visits = [("train", loop, trial) for loop in range(1, loops + 1) for trial in (1, 2, 3)]
        if "-" in condition:
            visits += [("test", loop, 1) for loop in range(1, loops + 1)]
        for subject, (phase, loop, trial) in itertools.product(range(subjects), visits):
            found: list[int] = []
            while len(found) < limit and not (protocol == "human" and found[-1:] == [3]):
                step = int(rng.random() < 0.4)
                found.append(min(3, (found[-1] if found else 0) + step))
            rows += trial_rows(
                found,
                learner=learner,
                condition=condition,
                protocol=protocol,
                subject=subject,
                phase=phase,
                loop=loop,
                trial=trial,
                layout=f"layout{rng.integers(3)}",
                otherwise=str(rng.choice(["else", "unlock", "open1"])),
            )
        cells.append(table(rows))
    return cells


@pytest.fixture(scope="module")
def random_record() -> pa.Table:
    return pa.concat_tables(random_cells(7))


def big_record(attempts: int) -> pa.Table:
    """A record of about so many attempts, made with NumPy: 8 cells, 300 attempts a trial."""
    rng = np.random.default_rng(0)
    trials = attempts // 8 // 300
    rows = trials * 300
    attempt = np.tile(np.arange(1, 301, dtype=np.int32), trials)
    visit = np.repeat(np.arange(trials), 300)
    chance = rng.random((trials, 300)) < 0.01
    found = np.minimum(np.cumsum(chance, axis=1), 3).ravel()
    new = np.diff(found.reshape(trials, 300), axis=1, prepend=0).ravel() > 0
    category = categorise(rng.random(rows) < 0.3, new, new, found)

    def name(text: str) -> pa.Array:
        return pa.DictionaryArray.from_arrays(np.zeros(rows, np.int32), [text])

    cells = []
    for condition, learner in itertools.product(("CC4", "CE4"), "abcd"):
        columns = {
            "experiment": name("e"),
            "learner": name(learner),
            "condition": name(condition),
            "protocol": name("rl"),
            "phase": name("train"),
            "schema": name(condition),
            "layout": name("trial1"),
            "category": pa.DictionaryArray.from_arrays(category.astype(np.int32), list(CATEGORIES)),
            "subject": visit // 50,
            "loop": visit % 50 // 5 + 1,
            "trial": visit % 5 + 1,
            "attempt": attempt,
            "solutions_found": found,
            "solutions": np.full(rows, 3),
            "new_solution": new,
        }
        fields = [field for field in record_schema() if field.name in columns]
        cells.append(
            pa.table(
                [pa.array(columns[field.name]).cast(field.type) for field in fields],
                schema=pa.schema(fields),
            ).append_column("seed", pa.array(np.ones(rows, np.int64)))
        )
    return pa.concat_tables(cells)


# -- attempts to solve --------------------------------------------------------------------------


def test_attempts_of_three_trials_worked_by_hand() -> None:
    record = table(
        trial_rows([0, 1, 2, 3], trial=1)  # solved by the fourth attempt
        + trial_rows([1, 1, 2, 2, 2], trial=2)  # never solved: its five attempts
        + trial_rows([1, 2, 2], solutions=2, trial=3, layout="trial9")  # solved, then goes on
    )
    trials = attempts_to_solve(record)
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
    assert number_visits(one).tolist() == list(range(1, 9))
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
    with pytest.raises(StoreError, match=r"missing or twice in 1 trials.*6 rows for 3 attempts"):
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
    assert summary_table(record).columns.tolist() == list(SUMMARY_COLUMNS)
    assert headline_table(record).empty


# -- categories ---------------------------------------------------------------------------------


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


# -- means and intervals ------------------------------------------------------------------------


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


def test_bootstrap_interval_covers_what_it_should() -> None:
    rng = np.random.default_rng(1)
    samples = rng.normal(10, 2, size=(300, 40))
    low, high = mean_interval(samples, np.random.default_rng(2), resamples=500)
    assert 0.89 < ((low < 10) & (high > 10)).mean() < 0.98
    assert np.median(high - low) == pytest.approx(2 * 1.96 * 2 / math.sqrt(40), rel=0.1)


def test_intervals_without_spread_or_company() -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        low, high = mean_interval(np.full((2, 7), 0.1), np.random.default_rng(0))
        assert (low == 0.1).all()
        assert (high == 0.1).all()
        for shape in ((3, 1), (3, 0), (0, 5)):
            low, high = mean_interval(np.zeros(shape), np.random.default_rng(0))
            assert low.shape == high.shape == shape[:1]
            assert np.isnan([*low, *high]).all()


def test_a_groups_interval_does_not_depend_on_the_others() -> None:
    rng = np.random.default_rng(5)
    frame = pd.DataFrame({"group": np.repeat([*"abcd"], [10, 10, 10, 4]), "x": rng.random(34)})
    together = mean_intervals(frame, ["group"], "x").set_index("group")
    for name in "abcd":
        alone = mean_intervals(frame[frame["group"] == name], ["group"], "x").set_index("group")
        assert alone.loc[name].tolist() == pytest.approx(together.loc[name].tolist(), rel=1e-12)


# -- summary and headline -----------------------------------------------------------------------


def test_people_are_the_published_means() -> None:
    table = people().set_index(["condition", "phase", "trial"])
    assert len(table) == 14
    assert table.loc[("CC4", "train", 1)].tolist() == [19.375, 1.509]
    assert table.loc[("CE4", "train", 5)].tolist() == [9.425, 1.074]
    assert table.loc[("CC3-CE4", "test", 1)].tolist() == [13.75, 1.162]


def test_summary_beside_people_worked_by_hand() -> None:
    rows = []
    for subject, length in enumerate([4, 6]):
        rows += trial_rows([0] * (length - 3) + [1, 2, 3], subject=subject)
        rows += trial_rows([1] * 30, subject=subject, trial=2)
        for phase in ("train", "test"):
            rows += trial_rows([1, 2, 3], subject=subject, condition="CE3-CC4", phase=phase)
        rows += trial_rows([1, 2, 3], subject=subject, protocol="rl")
        rows += trial_rows([1, 2, 3], subject=subject, condition="mine")
    summary = summary_table(table(rows)).set_index(["condition", "protocol", "phase", "trial"])
    assert len(summary) == 6
    first = summary.loc[("CC4", "human", "train", 1)]
    assert (first["attempts"], first["se"]) == (5.0, pytest.approx(1 / math.sqrt(2)))
    assert (first["ci_low"], first["ci_high"], first["share_solved"]) == (4.0, 6.0, 1.0)
    assert (first["human_attempts"], first["human_se"]) == (19.375, 1.509)
    assert first["difference"] == -14.375
    second = summary.loc[("CC4", "human", "train", 2)]
    assert (second["attempts"], second["share_solved"]) == (30.0, 0.0)
    assert summary.loc[("CE3-CC4", "human", "test", 1), "human_attempts"] == 8.175
    for incomparable in (
        ("CE3-CC4", "human", "train", 1),
        ("CC4", "rl", "train", 1),
        ("mine", "human", "train", 1),
    ):
        assert summary.loc[[incomparable], ["human_attempts", "difference"]].isna().all(axis=None)


def test_summary_agrees_with_plain_loops(random_record: pa.Table) -> None:
    visits: dict[tuple[Any, ...], dict[int, dict[int, int]]] = defaultdict(
        lambda: defaultdict(dict)
    )
    for row in random_record.to_pylist():
        key = (row["learner"], row["condition"], row["protocol"], row["phase"], row["trial"])
        loops = visits[key][row["subject"]]
        if row["new_solution"] or row["solutions_found"] < row["solutions"]:
            loops[row["loop"]] = max(loops.get(row["loop"], 0), row["attempt"])
    summary = summary_table(random_record)
    assert len(summary) == len(visits)
    for row in summary.to_dict("records"):
        key = tuple(row[name] for name in ("learner", "condition", "protocol", "phase", "trial"))
        means = [sum(loops.values()) / len(loops) for loops in visits[key].values()]
        assert row["attempts"] == pytest.approx(sum(means) / len(means))
        assert row["subjects"] == len(means)
        assert row["ci_low"] <= row["attempts"] <= row["ci_high"]


def test_headline_takes_the_last_trial_or_the_test() -> None:
    rows = []
    for loop, trial in itertools.product([1, 2], [1, 2]):
        found = [0] * (2 * loop + trial) + [1, 2, 3]
        rows += trial_rows(found, loop=loop, trial=trial, protocol="rl", condition="CE4")
        rows += trial_rows(found, loop=loop, trial=trial, protocol="rl", condition="CC3-CC4")
    for loop, length in ((1, 3), (2, 4)):
        found = [0] * (length - 3) + [1, 2, 3]
        rows += trial_rows(
            found, loop=loop, phase="test", trial=1, protocol="rl", condition="CC3-CC4"
        )
    rows += trial_rows([1, 2, 3], trial=1, condition="CE4")
    rows += trial_rows([0, 1, 2, 3], trial=2, condition="CE4")
    headline = headline_table(table(rows))
    values = headline[["protocol", "condition", "measured", "attempts"]].to_numpy().tolist()
    assert values == [
        ["human", "CE4", "trial 2", 4.0],
        ["rl", "CE4", "trial 2", 9.0],
        ["rl", "CC3-CC4", "test", 3.5],
    ]
    assert headline["human_attempts"].iloc[0] == 14.875
    assert headline["human_attempts"].iloc[1:].isna().all()


def test_summary_files_of_equal_data_are_equal(tmp_path: Any) -> None:
    cells = random_cells(11)
    record = pa.concat_tables(cells)
    later = pa.array(np.random.default_rng(0).random(record.num_rows), pa.float32())
    index = record.schema.get_field_index("wall_time")
    rows = np.random.default_rng(1).permutation(record.num_rows)
    variants = {
        "record": record,
        "reversed": pa.concat_tables(cells[::-1]),
        "shuffled": record.take(rows),
        "rechunked": record.unify_dictionaries().combine_chunks(),
        "slower": record.set_column(index, record.schema.field(index), later),
    }
    for name, variant in variants.items():
        write_summary(variant, tmp_path / name)
    first = (tmp_path / "record").read_bytes()
    assert all((tmp_path / name).read_bytes() == first for name in variants)
    lines = first.decode().splitlines()
    assert lines[0] == ",".join(SUMMARY_COLUMNS)
    assert len(lines) == 1 + len(summary_table(record))
    assert b"\r" not in first
    assert b"nan" not in first
    other = pa.concat_tables(random_cells(12))
    write_summary(other, tmp_path / "other")
    assert (tmp_path / "other").read_bytes() != first


def test_two_million_attempts_take_seconds() -> None:
    record = big_record(2_000_000)
    start = time.perf_counter()
    trials = attempts_to_solve(record)
    counts = category_counts(record)
    elapsed = time.perf_counter() - start
    assert counts["count"].sum() == record.num_rows
    assert trials["last_attempt"].sum() == record.num_rows
    assert elapsed < 10
