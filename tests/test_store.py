"""Running an experiment and keeping its results: nothing is lost, nothing is done twice."""

from __future__ import annotations

import dataclasses
import os
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pyarrow as pa
import pytest

from causal_openlock import runner, store
from causal_openlock.analysis.summary import write_summary
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment import Experiment
from causal_openlock.experiment_file import read_experiment
from causal_openlock.store import Store

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


def play(experiment: Experiment, folder: Path, **options: object) -> Store:
    with ThreadPoolExecutor(2) as executor:
        return runner.run(experiment, folder, executor=executor, **options)  # type: ignore[arg-type]


def contents(kept: Store, experiment: Experiment) -> pa.Table:
    return kept.record(experiment).drop_columns(["wall_time"])


def test_any_executor_gives_the_same_record(experiment: Experiment, tmp_path: Path) -> None:
    threads = play(experiment, tmp_path / "threads")
    with ProcessPoolExecutor(2, mp_context=get_context("spawn")) as executor:
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
    [damage_cut, damage_flip, lambda content: b"", lambda content: b"no parquet at all"],
    ids=["cut short", "one byte flipped", "emptied", "replaced"],
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
    with pytest.raises(StoreError, match="holds another experiment"):
        play(dataclasses.replace(experiment, seed=4), tmp_path / "out")
    assert {path: path.read_bytes() for path in files} == files


def test_a_folder_that_holds_something_else_is_refused(
    experiment: Experiment, tmp_path: Path
) -> None:
    (tmp_path / "thesis.tex").write_text("years of work", encoding="utf-8")
    with pytest.raises(StoreError, match="is not empty and holds no results"):
        play(experiment, tmp_path)
    assert not (tmp_path / "cells").exists()
    with pytest.raises(StoreError, match="is a file"):
        play(experiment, tmp_path / "thesis.tex")
    with pytest.raises(StoreError, match="cannot be written"):
        play(experiment, tmp_path / "thesis.tex" / "below")


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
    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(store.os, "fsync", full)
    with pytest.raises(StoreError, match="No space left on device") as caught:
        play(experiment, tmp_path / "out")
    assert "\n" not in str(caught.value)
    assert list((tmp_path / "out" / "cells").iterdir()) == []
    monkeypatch.undo()
    kept = play(experiment, tmp_path / "out")
    assert all(kept.check(cell) is None for cell in experiment.cells())


@pytest.mark.skipif(os.geteuid() == 0, reason="a read-only folder does not stop root")
def test_a_read_only_folder_is_one_sentence(experiment: Experiment, tmp_path: Path) -> None:
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o500)
    with pytest.raises(StoreError, match="cannot be written"):
        play(experiment, folder / "out")


def test_a_failing_learner_is_named_and_what_was_done_stays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "brittle.py").write_text(
        "from causal_openlock import OneSubjectLearner\n"
        "class Brittle(OneSubjectLearner):\n"
        "    def act(self, observation):\n"
        "        raise ZeroDivisionError('the learner broke')\n"
        "class Stray(OneSubjectLearner):\n"
        "    def act(self, observation):\n"
        "        return 99\n",
        encoding="utf-8",
    )
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "experiment.yaml"
    text = "name: e\nsubjects: 2\nconditions: [CC3]\nlearners: [random, 'brittle:Brittle']\n"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(LearnerError, match="the learner broke") as caught:
        play(read_experiment(path), tmp_path / "out")
    kept = tmp_path / "out" / "errors" / "Brittle_CC3_0-1.txt"
    assert str(kept) in str(caught.value)
    assert "ZeroDivisionError" in kept.read_text(encoding="utf-8")
    path.write_text(text.replace("Brittle", "Stray"), encoding="utf-8")
    with pytest.raises(LearnerError, match="Stray in CC3: action 99 is outside"):
        play(read_experiment(path), tmp_path / "out2")


def test_the_summary_does_not_depend_on_the_order_of_the_cells(
    experiment: Experiment, tmp_path: Path
) -> None:
    kept = play(experiment, tmp_path / "out")
    tables = [
        kept.read(kept.path(cell)).replace_schema_metadata(None) for cell in experiment.cells()
    ]
    write_summary(pa.concat_tables(tables), tmp_path / "forwards.csv")
    write_summary(pa.concat_tables(tables[::-1]), tmp_path / "backwards.csv")
    assert (tmp_path / "forwards.csv").read_bytes() == (tmp_path / "backwards.csv").read_bytes()
