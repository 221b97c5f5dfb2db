"""Counting a record in pieces, and reading it small: nothing may come of it but time and memory."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pandas as pd
import pyarrow as pa
import pytest

from causal_openlock.analysis.measures import attempts_to_solve, category_counts, count
from causal_openlock.analysis.results import reading
from causal_openlock.analysis.results.reading import read_results
from causal_openlock.errors import StoreError
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.file import find_experiment, read_experiment
from causal_openlock.running.runner import run
from causal_openlock.storage.store import Store
from support.fabricated_records import random_cells, table, trial_rows


def same(record: pa.Table, at_once: int) -> None:
    counts = count(record, at_once)
    for ours, whole in (
        (counts.trials, attempts_to_solve(record)),
        (counts.blocks, category_counts(record)),
    ):
        pd.testing.assert_frame_equal(ours, whole, check_column_type=False)


@pytest.mark.parametrize("at_once", [1, 50, 10_000])
def test_pieces_come_to_the_same_as_the_whole(at_once: int) -> None:
    same(pa.concat_tables(random_cells(5, subjects=4)), at_once)


def test_pieces_that_cut_trials_or_subjects_apart_come_to_the_same() -> None:
    record = pa.concat_tables(random_cells(6, conditions=("CC4",), protocols=("loops",)))
    rows = np.random.default_rng(0).permutation(record.num_rows)
    shuffled = record.take(rows)
    cut = [shuffled.slice(i, 7) for i in range(0, record.num_rows, 7)]
    same(pa.concat_tables(cut), 1)
    # Whole trials, but those of a subject in different pieces: blocks are shares of a phase.
    by_trial = record.sort_by([("trial", "ascending"), ("loop", "ascending")])
    trials = by_trial["trial"].to_numpy()
    pieces = [by_trial.filter(pa.array(trials == one)) for one in (1, 2, 3)]
    same(pa.concat_tables(pieces), 1)


def test_a_broken_record_is_refused_in_pieces_too() -> None:
    good, bad = table(trial_rows([1, 2, 3])), table(trial_rows([1, 2, 3], subject=1)[1:])
    with pytest.raises(StoreError, match="attempts missing or twice in 1 trial"):
        count(pa.concat_tables([good, bad]), 1)


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Store:
    changes = Changes(["CC4", "CC3-CE4"], ["random", "oracle"], None, 3)
    experiment = read_experiment(find_experiment("default"), changes)
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(1) as pool:
        return run(experiment, tmp_path_factory.mktemp("results") / "r", executor=pool)


def test_reading_small_leaves_out_columns_and_changes_no_value(store: Store) -> None:
    whole, told = store.record()
    small, description = read_results(store)
    assert description == told
    assert set(whole.column_names) - set(small.column_names) == set(reading.UNREAD)
    for name in small.column_names:
        assert small[name].to_pylist() == whole[name].to_pylist(), name
    assert small.nbytes < 0.6 * whole.nbytes
    assert "reward" in read_results(store, ["reward"])[0].column_names
    same(small, 1)


def test_a_damaged_cell_is_told_in_a_sentence(store: Store, tmp_path: Path) -> None:
    import shutil

    copy = Store(shutil.copytree(store.folder, tmp_path / "copy"))
    cell = next(copy.cells.glob("*.parquet"))
    cell.write_bytes(cell.read_bytes()[:-200])
    with pytest.raises(StoreError, match=r"is damaged"):
        read_results(copy)
    cell.unlink()
    assert read_results(copy)[1].missing == (cell.stem,)


def test_a_cell_of_a_few_bytes_is_one_whole_sentence_however_it_is_read(
    store: Store, tmp_path: Path
) -> None:
    import shutil

    copy = Store(shutil.copytree(store.folder, tmp_path / "copy"))
    cell = next(copy.cells.glob("*.parquet"))
    cell.write_bytes(b"junk\n")
    for read in (lambda: read_results(copy), lambda: copy.record([]), copy.record):
        with pytest.raises(StoreError) as told:
            read()
        said = str(told.value)
        assert said.startswith(f"{cell} is damaged (")
        assert said.endswith("); run compare again, with the same command, to make it again")
        assert "it has no checksum" in said
