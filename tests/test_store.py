"""Running an experiment and keeping its results: nothing is lost, nothing is done twice."""

from __future__ import annotations

import dataclasses
import os
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from pathlib import Path

import pyarrow as pa
import pytest

from causal_openlock import files, runner
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
    return kept.record()[0].drop_columns(["wall_time"])


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
    begun = play(experiment, tmp_path / "out")
    lost = [begun.path(cell) for cell in list(experiment.cells())[:3]]
    for path in lost:
        path.unlink()

    def full(descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(files.os, "fsync", full)
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


LETHAL = """\
import os, sys
from causal_openlock import OneSubjectLearner

class Exits(OneSubjectLearner):
    def act(self, observation):
        sys.exit(0)

class Dies(OneSubjectLearner):
    def act(self, observation):
        os._exit(9)
"""


@pytest.mark.parametrize(
    ("learner", "says"),
    [("Exits", "the learner Exits failed in CC3"), ("Dies", "a worker process ended")],
)
def test_a_learner_that_ends_its_process_is_an_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, learner: str, says: str
) -> None:
    (tmp_path / "lethal.py").write_text(LETHAL, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    path = tmp_path / "experiment.yaml"
    path.write_text(
        f"name: e\nsubjects: 1\nconditions: [CC3]\nlearners: ['lethal:{learner}']\n",
        encoding="utf-8",
    )
    with pytest.raises(LearnerError, match=says):
        runner.run(read_experiment(path), tmp_path / "out", workers=1)


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
    assert play(other, tmp_path / "out").description()["seed"] == 4


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
        mp_context=get_context("spawn"),
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
    assert "missing_cells" not in description
    assert description["versions"]["causal-openlock"] == "0.1.0"
    lost = kept.path(list(experiment.cells())[2])
    lost.unlink()
    record, description = kept.record()
    assert description["missing_cells"] == [lost.stem]
    assert record.num_rows > 0


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
    write_summary(pa.concat_tables(tables), tmp_path / "forwards.csv")
    write_summary(pa.concat_tables(tables[::-1]), tmp_path / "backwards.csv")
    assert (tmp_path / "forwards.csv").read_bytes() == (tmp_path / "backwards.csv").read_bytes()
