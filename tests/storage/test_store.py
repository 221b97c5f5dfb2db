"""Running an experiment and keeping its results: nothing is lost, nothing is done twice."""

from __future__ import annotations

import dataclasses
import json
import os
import runpy
import sys
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from causal_openlock.analysis.results.reading import read_results
from causal_openlock.analysis.results.summary import summary_table
from causal_openlock.analysis.table import write_table
from causal_openlock.errors import StoreError
from causal_openlock.experiment.experiment import Cell, Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.record import compact
from causal_openlock.files import atomic
from causal_openlock.files.checksums import json_bytes, read_json, read_table, table_bytes
from causal_openlock.running import runner
from causal_openlock.storage import cell_file
from causal_openlock.storage import store as store_module
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions
from causal_openlock.version import RESULTS_VERSION
from support.places import ROOT
from support.processes import prepared

pytestmark = pytest.mark.slow

flipped = runpy.run_path(str(ROOT / "benchmarks" / "bit_flips.py"))["flipped"]

TEXT = """\
name: small
seed: 3
subjects: 5
cell_size: 2
conditions: [CC3, noisy_CC3]
learners: [random, oracle]
"""


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    path = tmp_path / "experiment.yaml"
    path.write_text(TEXT, encoding="utf-8")
    return read_experiment(path)


@pytest.fixture
def quick(experiment: Experiment) -> Experiment:
    """The same with few subjects and attempts, for what is played again and again."""
    short = dataclasses.replace(
        experiment.learners[0].protocol, name="short", attempt_limit=2, baseline_trials=1
    )
    entries = [dataclasses.replace(one, subjects=3, protocol=short) for one in experiment.learners]
    return dataclasses.replace(experiment, learners=tuple(entries))


def play(experiment: Experiment, folder: Path, **options: object) -> Store:
    with ThreadPoolExecutor(2) as executor:
        return runner.run(experiment, folder, executor=executor, **options)  # type: ignore[arg-type]


def contents(kept: Store, experiment: Experiment) -> pa.Table:
    return kept.record()[0].drop_columns(["wall_time"])


def test_any_executor_gives_the_same_record(experiment: Experiment, tmp_path: Path) -> None:
    threads = play(experiment, tmp_path / "threads")
    with ProcessPoolExecutor(2, mp_context=prepared()) as executor:
        processes = runner.run(experiment, tmp_path / "processes", executor=executor)
    ours = runner.run(experiment, tmp_path / "ours", workers=1)
    assert contents(threads, experiment).equals(contents(processes, experiment))
    assert contents(threads, experiment).equals(contents(ours, experiment))


def test_what_is_done_is_not_done_again(experiment: Experiment, tmp_path: Path) -> None:
    first = play(experiment, tmp_path / "out")
    times = {path: path.stat().st_mtime_ns for path in first.cells.iterdir()}
    seen: list[bool] = []
    play(experiment, tmp_path / "out", done=lambda cell, before: seen.append(before))
    assert seen == [True] * len(list(experiment.cells()))
    assert {path: path.stat().st_mtime_ns for path in first.cells.iterdir()} == times


def test_long_cells_come_first_once_all_learners_have_some_subjects(
    quick: Experiment, tmp_path: Path
) -> None:
    first, last = quick.learners
    longer = dataclasses.replace(last.protocol, name="longer", attempt_limit=3)
    learners = (first, dataclasses.replace(last, protocol=longer))
    played: list[Cell] = []
    runner.run(
        dataclasses.replace(quick, learners=learners),
        tmp_path / "out",
        workers=0,
        done=lambda cell, _: played.append(cell),
    )
    order = [(cell.first_subject, cell.spec.name) for cell in played]
    assert (
        order
        == [(0, "oracle")] * 2 + [(0, "random")] * 2 + [(2, "oracle")] * 2 + [(2, "random")] * 2
    )


def test_a_missing_cell_alone_is_run(experiment: Experiment, tmp_path: Path) -> None:
    kept = play(experiment, tmp_path / "out")
    before = contents(kept, experiment)
    lost = list(experiment.cells())[4]
    kept.path(lost).unlink()
    run = []
    play(experiment, tmp_path / "out", done=lambda cell, known: run.append((cell, known)))
    assert [cell.name for cell, known in run if not known] == [lost.name]
    assert contents(kept, experiment).equals(before)


def damage_cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def damage_flip(content: bytes) -> bytes:
    middle = len(content) // 3
    return content[:middle] + bytes([content[middle] ^ 0xFF]) + content[middle + 1 :]


@pytest.mark.parametrize(
    "damage",
    [damage_cut, damage_flip, lambda c: b"", lambda c: b"no parquet at all", lambda c: c + b"0"],
    ids=["cut short", "one byte flipped", "emptied", "replaced", "one byte more"],
)
def test_a_damaged_file_is_named_and_its_cell_run_again(
    experiment: Experiment, tmp_path: Path, damage: object
) -> None:
    kept = play(experiment, tmp_path / "out")
    before = contents(kept, experiment)
    path = kept.path(list(experiment.cells())[1])
    path.write_bytes(damage(path.read_bytes()))  # type: ignore[operator]
    warnings: list[str] = []
    run = []
    play(
        experiment,
        tmp_path / "out",
        warn=warnings.append,
        done=lambda cell, known: run.append(cell) if not known else None,
    )
    assert len(warnings) == 1
    assert str(path) in warnings[0]
    assert "run again" in warnings[0]
    assert [kept.path(cell) for cell in run] == [path]
    assert contents(kept, experiment).equals(before)


def test_a_file_of_another_cell_does_not_pass_for_this_one(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    first, second = list(experiment.cells())[:2]
    kept.path(second).write_bytes(kept.path(first).read_bytes())
    assert "another cell" in (kept.check(second) or "")


def test_a_folder_of_another_experiment_is_refused_and_left_alone(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    files = {path: path.read_bytes() for path in kept.folder.rglob("*") if path.is_file()}
    (condition, _), entries = experiment.conditions, experiment.learners
    long = dataclasses.replace(entries[0].protocol, attempt_limit=31)
    for other in (
        dataclasses.replace(experiment, seed=4),
        dataclasses.replace(experiment, name="other"),
        dataclasses.replace(experiment, conditions=(dataclasses.replace(condition, name="x"),)),
        dataclasses.replace(
            experiment, learners=tuple(dataclasses.replace(one, protocol=long) for one in entries)
        ),
    ):
        with pytest.raises(StoreError, match="holds another experiment"):
            play(other, tmp_path / "out")
    assert {path: path.read_bytes() for path in files} == files


def test_a_folder_is_reused_for_another_form_of_its_experiment(
    quick: Experiment, tmp_path: Path
) -> None:
    experiment = quick
    random, oracle = experiment.learners
    forms = {
        "a learner less": dataclasses.replace(experiment, learners=(oracle,)),
        "a condition less": dataclasses.replace(experiment, conditions=experiment.conditions[:1]),
        "more subjects": dataclasses.replace(
            experiment,
            learners=tuple(dataclasses.replace(one, subjects=7) for one in experiment.learners),
        ),
        "larger cells": dataclasses.replace(experiment, cell_size=3),
        "a learner more": dataclasses.replace(
            experiment, learners=(random, oracle, dataclasses.replace(random, name="again"))
        ),
        "as it was": experiment,
    }
    first = play(experiment, tmp_path / "out")
    kept = {path: path.read_bytes() for path in first.cells.iterdir()}
    known = {cell.identity for cell in experiment.cells()}
    for name, form in forms.items():
        new: list[str] = []
        store = play(
            form,
            tmp_path / "out",
            done=lambda cell, before, new=new: None if before else new.append(cell.identity),
        )
        assert set(new) == {cell.identity for cell in form.cells()} - known, name
        known |= set(new)
        fresh = play(form, tmp_path / name)
        assert contents(store, form).equals(contents(fresh, form)), name
        assert store.experiment() == fresh.experiment(), name
    assert {path: path.read_bytes() for path in kept} == kept


def nested(depth: int) -> list[Any]:
    """A list within a list, and so on."""
    found: list[Any] = []
    for _ in range(depth):
        found = [found]
    return found


def test_a_malformed_experiment_is_a_sentence_that_names_the_place(
    quick: Experiment, tmp_path: Path
) -> None:
    kept = play(quick, tmp_path / "out")
    path = kept.folder / "experiment.json"
    whole = read_json(path.read_bytes())
    whole["learners"][0]["protocol"]["attempt_limit"] = "3"
    path.write_bytes(json_bytes(whole))
    with pytest.raises(StoreError) as refused:
        kept.experiment()
    assert str(refused.value) == (
        f"{path} is damaged (learners.0.protocol.attempt_limit must be a valid integer, and this "
        "is the text '3'); run compare again, with the same command, to make it again"
    )


def test_a_damaged_description_is_healed_where_cells_are_of_the_experiment(
    quick: Experiment, tmp_path: Path
) -> None:
    experiment = quick
    kept = play(experiment, tmp_path / "out")
    path = kept.folder / "experiment.json"
    content = path.read_bytes()
    whole = read_json(content)
    learner = whole["learners"][0]
    protocol = learner["protocol"]
    odd = [
        content.replace(b'"seed": 3', b'"seed": 4'),
        content[:50],
        b"",
        content + b" ",
        json.dumps({**whole, "seed": "3"}).encode(),  # as of earlier versions
        json_bytes({**whole, "seed": "3"}),
        json_bytes({**whole, "learners": [7]}),
        json_bytes({**whole, "conditions": {}}),
        json_bytes({**whole, "cells": {}}),
        json_bytes({**whole, "learners": [{**whole["learners"][0], "protocol": {"name": []}}]}),
        json_bytes({**whole, "conditions": [{"name": "CC3", "train": [[]], "test": None}]}),
        json_bytes({**whole, "conditions": []}),
        json_bytes({**whole, "failures": 7}),
        json_bytes({**whole, "title": "a lone surrogate \ud800"}),
        json_bytes({**whole, "learners": [{**learner, "parameters": {"deep": nested(800)}}]}),
        json_bytes({**whole, "learners": [{**learner, "reward": {"name": "x", "terms": ["y"]}}]}),
        json_bytes({**whole, "learners": [{**learner, "protocol": {**protocol, "odd": 1}}]}),
        json_bytes(
            {**whole, "learners": [{**learner, "protocol": {**protocol, "attempt_limit": "3"}}]}
        ),
    ]
    for damaged in odd:
        path.write_bytes(damaged)
        for read in (kept.experiment, kept.record, kept.files, lambda: read_results(kept)):
            with pytest.raises(StoreError, match=r"experiment\.json is damaged \(.*\); run comp"):
                read()
        with pytest.raises(StoreError, match="is damaged"):
            play(dataclasses.replace(experiment, seed=4), tmp_path / "out")
        seen: list[bool] = []
        play(experiment, tmp_path / "out", done=lambda cell, before, seen=seen: seen.append(before))
        assert all(seen)
        assert path.read_bytes() == content


def test_no_flipped_bit_passes_for_what_was_written(experiment: Experiment, tmp_path: Path) -> None:
    kept = play(dataclasses.replace(experiment, cell_size=5), tmp_path / "out")
    rng = np.random.default_rng(7)
    files = [(path, lambda path=path: kept.read(path)) for path in kept.files()[0][:2]]
    files.append((kept.folder / "experiment.json", kept.experiment))
    for path, read in files:
        counts = flipped(path, read, 150, rng)
        assert counts == {"noticed": 150}, path
        content = path.read_bytes()
        # Where the checksum stands, too.
        place = content.rindex(b"sha256")
        for bit in range(8 * place, 8 * (place + 12 + 64), 5):
            changed = bytearray(content)
            changed[bit // 8] ^= 1 << bit % 8
            path.write_bytes(changed)
            with pytest.raises(StoreError, match="is damaged"):
                read()
        path.write_bytes(content)


def test_after_a_flipped_bit_that_cell_alone_is_played_again(
    quick: Experiment, tmp_path: Path
) -> None:
    experiment = quick
    kept = play(experiment, tmp_path / "out")
    write_table(summary_table(kept.record()[0]), tmp_path / "before.csv")
    rng = np.random.default_rng(3)
    for cell in list(experiment.cells())[::5]:
        path = kept.path(cell)
        content = bytearray(path.read_bytes())
        place = int(rng.integers(8 * len(content)))
        content[place // 8] ^= 1 << place % 8
        path.write_bytes(content)
        for read in (kept.record, lambda: read_results(kept), lambda: kept.record([])):
            with pytest.raises(StoreError) as told:
                read()
            assert str(told.value).startswith(f"{path} is damaged (")
        again: list[Path] = []
        play(
            experiment,
            tmp_path / "out",
            done=lambda one, before, again=again: None if before else again.append(kept.path(one)),
        )
        assert again == [path]
    write_table(summary_table(kept.record()[0]), tmp_path / "after.csv")
    assert (tmp_path / "after.csv").read_bytes() == (tmp_path / "before.csv").read_bytes()


def test_files_of_earlier_versions_are_made_anew_and_other_tables_refused(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    before = contents(kept, experiment)
    path = kept.path(experiment.cells()[0])
    table = kept.read(path)
    pq.write_table(table, path)
    assert "has no checksum" in (kept.check(experiment.cells()[0]) or "")
    for odd in (
        table.drop_columns(["layout"]),
        table.set_column(4, "subject", pa.array(["no number"] * table.num_rows)),
        table.set_column(4, "subject", pa.array([None] * table.num_rows, pa.int32())),
    ):
        path.write_bytes(table_bytes(odd, table.schema.metadata))
        for read in (kept.record, lambda: read_results(kept)):
            with pytest.raises(StoreError, match="columns are not those of a record"):
                read()
    play(experiment, tmp_path / "out")
    assert contents(kept, experiment).equals(before)
    # Names coded by fewer bytes are the same names.
    path.write_bytes(table_bytes(compact(table), table.schema.metadata))
    assert contents(kept, experiment).equals(before)


def test_a_file_is_released_before_its_table_is_returned() -> None:
    content = table_bytes(pa.table({"x": [1, 2], "y": [3, 4]}))
    before = sys.getrefcount(content)
    # A thread that releases it afterwards, in one of four reads, may abort a Python that is ending.
    for _ in range(100):
        read_table(content)
        assert sys.getrefcount(content) == before


def test_a_folder_that_holds_something_else_is_refused(
    experiment: Experiment, tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work", encoding="utf-8")
    with pytest.raises(StoreError, match="is not empty and holds no results"):
        play(experiment, tmp_path)
    assert not (tmp_path / "cells").exists()
    for place in (tmp_path / "thesis.tex", tmp_path / "thesis.tex" / "below"):
        with pytest.raises(StoreError, match=r"thesis\.tex is a file; choose a folder$"):
            play(experiment, place)


def test_what_a_killed_run_left_half_written_is_swept_away(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    partial = kept.cells / ".abc.partial"
    partial.write_bytes(b"half a file")
    play(experiment, tmp_path / "out")
    assert not partial.exists()


def test_a_full_disk_is_one_sentence_and_leaves_no_part_of_a_file(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun = play(experiment, tmp_path / "out")
    lost = [begun.path(cell) for cell in list(experiment.cells())[:3]]
    for path in lost:
        path.unlink()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(atomic.os, "fsync", full)
    with pytest.raises(StoreError, match="No space left on device") as caught:
        play(experiment, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert not any(path.exists() for path in lost)
    assert not list(begun.cells.glob(".*"))
    # Not even a start leaves anything behind that stands in the way.
    with pytest.raises(StoreError, match="No space left on device"):
        play(experiment, tmp_path / "new")
    monkeypatch.undo()
    for folder in ("out", "new"):
        kept = play(experiment, tmp_path / folder)
        assert all(kept.check(cell) is None for cell in experiment.cells())


@pytest.mark.skipif(os.geteuid() == 0, reason="a read-only folder does not stop root")
def test_a_read_only_folder_is_one_sentence(experiment: Experiment, tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    with pytest.raises(StoreError, match="cannot be written"):
        play(experiment, folder / "out")


def test_a_read_only_disk_is_one_sentence(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def read_only(*_: object, **__: object) -> None:
        raise OSError(30, "Read-only file system")

    monkeypatch.setattr(Path, "mkdir", read_only)
    with pytest.raises(StoreError, match=r"out cannot be written \(Read-only file system\); "):
        play(experiment, tmp_path / "out")


def test_a_start_cut_short_leaves_a_folder_that_can_be_used(
    experiment: Experiment, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / ".lock").touch()
    (folder / ".experiment.json.abc.partial").write_bytes(b"{")
    kept = play(experiment, folder)
    assert all(kept.check(cell) is None for cell in experiment.cells())
    assert not list(folder.glob("*.partial"))


def test_where_nothing_is_done_yet_another_experiment_may_begin(
    experiment: Experiment, tmp_path: Path
) -> None:
    begun = Store(tmp_path / "out")
    begun.open(experiment)
    begun.close()
    other = dataclasses.replace(experiment, seed=4)
    assert play(other, tmp_path / "out").experiment().seed == 4


def test_a_folder_in_use_is_refused_until_it_is_free(
    experiment: Experiment, tmp_path: Path
) -> None:
    first = Store(tmp_path / "out")
    first.open(experiment)
    with pytest.raises(StoreError, match="in use by another comparison"):
        play(experiment, tmp_path / "out")
    first.close()
    play(experiment, tmp_path / "out")


def test_workers_in_another_directory_keep_records_where_they_belong(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    with ProcessPoolExecutor(
        1,
        mp_context=prepared(),
        initializer=os.chdir,
        initargs=(tmp_path / "elsewhere",),
    ) as executor:
        kept = runner.run(experiment, "out", executor=executor)
    assert all(kept.check(cell) is None for cell in experiment.cells())
    assert not list((tmp_path / "elsewhere").iterdir())


def test_a_record_tells_which_cells_are_missing_and_what_the_others_were_made_with(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    _, description = kept.record()
    assert not description.missing
    assert description.versions["causal-openlock"] == RESULTS_VERSION
    lost = kept.path(list(experiment.cells())[2])
    lost.unlink()
    record, description = kept.record()
    assert description.missing == (lost.stem,)
    assert record.num_rows > 0


def test_what_was_begun_with_other_versions_is_completed_only_if_that_is_allowed(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And then says so; a folder whose description lacks them, or is damaged, is no exception."""
    here = dict(versions())
    kept = play(experiment, tmp_path / "out")
    declared = tmp_path / "out" / "experiment.json"
    assert kept.experiment().versions == here
    for module in (store_module, cell_file):
        monkeypatch.setattr(module, "versions", lambda: {**here, "numpy": "9.9"})
    play(experiment, tmp_path / "out")  # nothing is missing
    first = kept.path(experiment.cells()[0])
    first.unlink()
    refuses = pytest.raises(
        StoreError, match=f"was made with numpy {here['numpy']} .here it is 9.9.; .*--allow-version"
    )
    for damage in (None, b"{}"):
        if damage:
            declared.write_bytes(damage)
        with refuses:
            play(experiment, tmp_path / "out")
    assert not first.exists()
    runner.run(experiment, tmp_path / "out", workers=0, allow_version=True)
    assert kept.experiment().versions["numpy"] == [here["numpy"], "9.9"]
    assert kept.record()[1].versions["numpy"] == ["9.9", here["numpy"]]
    first.unlink()
    play(experiment, tmp_path / "out")  # it was allowed once


def test_files_can_be_read_by_others_as_the_system_is_set(
    experiment: Experiment, tmp_path: Path
) -> None:
    before = os.umask(0o022)
    try:
        kept = play(experiment, tmp_path / "out")
    finally:
        os.umask(before)
    modes = {path.stat().st_mode & 0o777 for path in kept.cells.iterdir()}
    assert modes == {0o644}


def test_the_summary_does_not_depend_on_the_order_of_the_cells(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    tables = [
        kept.read(kept.path(cell)).replace_schema_metadata(None) for cell in experiment.cells()
    ]
    write_table(summary_table(pa.concat_tables(tables)), tmp_path / "forwards.csv")
    write_table(summary_table(pa.concat_tables(tables[::-1])), tmp_path / "backwards.csv")
    assert (tmp_path / "forwards.csv").read_bytes() == (tmp_path / "backwards.csv").read_bytes()
