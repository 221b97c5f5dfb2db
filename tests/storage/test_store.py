"""Which folders take which experiments, and what their files say.

What may happen to a folder while it is used is tested in ``test_folder_machine.py``.
"""

import dataclasses
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from causal_openlock.analysis.results.reading import read_results
from causal_openlock.comparison.results import open_results
from causal_openlock.errors import StoreError
from causal_openlock.experiment.making import read_experiment
from causal_openlock.files.checksums import json_bytes, read_json, read_table, table_bytes
from causal_openlock.running import runner
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions
from causal_openlock.version import RESULTS_VERSION
from support.processes import prepared

pytestmark = pytest.mark.slow

TEXT = """\
name: small
seed: 3
subjects: 3
cell_size: 2
protocol: short
protocols: {short: {attempt_limit: 2, baseline_trials: 1}}
conditions: [CC3, noisy_CC3]
learners: [random, oracle]
"""


@pytest.fixture
def experiment(tmp_path):
    path = tmp_path / "experiment.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return read_experiment(path)


def play(experiment, folder, **options):
    return runner.run(experiment, folder, workers=0, **options)


def files(folder):
    """When each cell's file was written."""
    return {path: path.stat().st_mtime_ns for path in (folder / "cells").glob("*.parquet")}


def contents(store):
    return store.record()[0].drop_columns(["wall_time"])


def test_any_executor_gives_the_same_record(experiment, tmp_path, monkeypatch):
    """Also if its workers are in another directory, and the folder's path is relative."""
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    expected = contents(play(experiment, "here"))
    with ThreadPoolExecutor(2) as executor:
        threads = runner.run(experiment, "threads", executor=executor)
    with ProcessPoolExecutor(
        2, mp_context=prepared(), initializer=os.chdir, initargs=(tmp_path / "elsewhere",)
    ) as executor:
        processes = runner.run(experiment, "processes", executor=executor)
    for store in (threads, processes):
        assert contents(store).equals(expected)
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_folder_is_reused_for_another_form_of_its_experiment(experiment, tmp_path):
    more = [dataclasses.replace(spec, subjects=7) for spec in experiment.learners]
    again = dataclasses.replace(experiment.learners[0], name="again")
    forms = [
        {"learners": experiment.learners[1:]},
        {"conditions": experiment.conditions[:1]},
        {"learners": (*more,)},
        {"cell_size": 3},
        {"learners": (*experiment.learners, again)},
        {},
    ]
    first = play(experiment, tmp_path / "out")
    kept = {path: path.read_bytes() for path in first.cells.iterdir()}
    known = {cell.identity for cell in experiment.cells()}
    for number, form in enumerate(forms):
        changed, there = dataclasses.replace(experiment, **form), files(tmp_path / "out")
        store = play(changed, tmp_path / "out")
        played = files(tmp_path / "out").items() - there.items()
        assert len(played) == len({cell.identity for cell in changed.cells()} - known), form
        known |= {cell.identity for cell in changed.cells()}
        fresh = play(changed, tmp_path / str(number))
        assert contents(store).equals(contents(fresh)), form
        assert store.experiment() == fresh.experiment(), form
    assert {path: path.read_bytes() for path in kept} == kept


def test_where_nothing_is_done_yet_another_experiment_may_begin(experiment, tmp_path):
    folder = tmp_path / "out"
    folder.mkdir()
    for left in (".lock", ".experiment.json.abc.partial", ".DS_Store", ".nfs0001", "Thumbs.db"):
        (folder / left).write_bytes(b"{")
    begun = Store(folder)
    begun.open(experiment)
    begun.close()
    store = play(dataclasses.replace(experiment, seed=4), folder)
    assert store.experiment().seed == 4
    assert not list(folder.glob(".*.partial"))
    saved = tmp_path / "saved"
    saved.mkdir()
    (saved / ".DS_Store").touch()
    assert open_results(open_results(folder).save(saved)).experiment.seed == 4


def test_a_damaged_description_is_named_and_made_again(experiment, tmp_path):
    store = play(experiment, tmp_path / "out")
    path = store.folder / "experiment.json"
    content = path.read_bytes()
    whole = read_json(content)
    learner = whole["learners"][0]
    deep = []
    for _ in range(800):
        deep = [deep]
    odd = {
        "checksum": content.replace(b'"seed": 3', b'"seed": 4'),
        "with a checksum": json.dumps({**whole, "seed": "3"}).encode(),
        "learners.0": json_bytes({**whole, "learners": [7]}),
        "Unicode": json_bytes({**whole, "title": "a lone surrogate \ud800"}),
        "deep": json_bytes({**whole, "learners": [{**learner, "parameters": {"deep": deep}}]}),
    }
    for named, damaged in odd.items():
        path.write_bytes(damaged)
        with pytest.raises(StoreError) as refused:
            read_results(store)
        assert f"{path} is damaged (" in str(refused.value)
        assert named in str(refused.value)
        with pytest.raises(StoreError, match="is damaged"):
            play(dataclasses.replace(experiment, seed=4), tmp_path / "out")
        there = files(tmp_path / "out")
        play(experiment, tmp_path / "out")
        assert files(tmp_path / "out") == there
        assert path.read_bytes() == content


def test_tables_of_another_form_are_named_and_their_cells_played_again(experiment, tmp_path):
    store = play(experiment, tmp_path / "out")
    before = contents(store)
    first, second = experiment.cells()[:2]
    path = store.path(first)
    table, metadata = store.read(path), pq.read_schema(path).metadata
    numbers = pa.array([None] * table.num_rows, pa.int32())
    odd = {
        "another cell": store.path(second).read_bytes(),
        "columns": table.drop_columns(["layout"]),
        "missing": table.set_column(4, "subject", numbers),
    }
    for named, content in odd.items():
        if isinstance(content, bytes):
            path.write_bytes(content)
        else:
            path.write_bytes(table_bytes(content, metadata))
        assert named in store.check(first)
        with pytest.raises(StoreError) as told:
            store.record()
        assert f"{path} is damaged (" in str(told.value)
        warnings, there = [], files(tmp_path / "out")
        play(experiment, tmp_path / "out", warn=warnings.append)
        assert [file for file, _ in files(tmp_path / "out").items() - there.items()] == [path]
        assert str(path) in warnings[0]
        assert len(warnings) == 1
        assert contents(store).equals(before)
    path.write_bytes(path.read_bytes()[:-200])
    with pytest.raises(StoreError, match="is damaged"):
        store.record(["learner"])
    path.write_bytes(table_bytes(table.slice(1), metadata))
    assert "trials are missing" in store.check(first)
    # Names coded by more bytes, as in results of 0.2, are the same names.
    codes = pa.dictionary(pa.int32(), pa.string())
    where = table.schema.get_field_index("learner")
    longer = table.set_column(where, "learner", table["learner"].cast(codes))
    path.write_bytes(table_bytes(longer, metadata))
    assert contents(store).equals(before)
    path.write_bytes(table_bytes(table, {**metadata, b"causal_openlock.versions": b"[]"}))
    with pytest.raises(StoreError, match="metadata are not those of a record"):
        store.record()


def test_a_file_is_released_before_its_table_is_returned():
    content = table_bytes(pa.table({"x": [1, 2], "y": [3, 4]}))
    before = sys.getrefcount(content)
    # A thread that releases it afterwards, in one of four reads, may abort a Python that is ending.
    for _ in range(100):
        read_table(content)
        assert sys.getrefcount(content) == before


def test_other_versions_complete_a_folder_only_if_that_is_allowed(experiment, tmp_path):
    """And then it says so, also if its description is damaged: its cells say it as well."""
    here = dict(versions())
    store = play(experiment, tmp_path / "out")
    assert store.experiment().versions == store.record()[1].versions == here
    assert here["causal-openlock"] == RESULTS_VERSION
    first, *others = (store.path(cell) for cell in experiment.cells())
    first.unlink()
    for path in others:
        table = read_table(path.read_bytes())
        made_with = json.dumps({**here, "numpy": "0.1"}).encode()
        metadata = {**table.schema.metadata, b"causal_openlock.versions": made_with}
        path.write_bytes(table_bytes(table, metadata))
    for damage in (None, b"{}"):
        if damage:
            (store.folder / "experiment.json").write_bytes(damage)
        with pytest.raises(
            StoreError,
            match=rf"made with numpy 0\.1 \(here it is {here['numpy']}\).*--allow-version",
        ):
            play(experiment, tmp_path / "out")
    assert not first.exists()
    play(experiment, tmp_path / "out", allow_version=True)
    assert sorted(store.record()[1].versions["numpy"]) == ["0.1", here["numpy"]]
    others[0].unlink()
    assert store.record()[1].missing == (others[0].stem,)
    play(experiment, tmp_path / "out")  # it was allowed once


def test_cells_can_be_read_by_others_as_the_system_is_set(experiment, tmp_path):
    before = os.umask(0o022)
    try:
        store = play(experiment, tmp_path / "out")
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in store.cells.iterdir()} == {0o644}
