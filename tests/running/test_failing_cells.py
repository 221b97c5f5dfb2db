"""Cells that fail, however they do: they are named, and all others are played."""

from __future__ import annotations

import csv
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.analysis.report.writing import write_report
from causal_openlock.analysis.results.reading import read_results
from causal_openlock.errors import CellsFailed, OpenLockError, StoreError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.running import runner
from causal_openlock.running.progress import RunProgress
from causal_openlock.running.workers import how_ended
from causal_openlock.storage.store import Store
from support.command import at_once, modules_of
from support.html_page import Page
from support.processes import prepared, start_prepared

pytestmark = pytest.mark.slow

LETHAL = """\
import os, signal, sys, time
from causal_openlock import OneSubjectLearner

class Fine(OneSubjectLearner):
    def act(self, observation):
        return int(self.generator.integers(15))

class Raises(Fine):
    def act(self, observation):
        raise ZeroDivisionError("the learner [/broke]")

class Silent(Exception):
    def __str__(self):
        raise ValueError

class Mute(Fine):
    def act(self, observation):
        raise Silent

class Stray(Fine):
    def act(self, observation):
        return 99

class Nonsense(Fine):
    def act(self, observation):
        return float("nan")

class Exits(Fine):
    def act(self, observation):
        sys.exit(0)

class Stops(Fine):
    def act(self, observation):
        raise KeyboardInterrupt

class Dies(Fine):
    def act(self, observation):
        os._exit(9)

class Segfaults(Fine):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGSEGV)

class Killed(Fine):
    def act(self, observation):
        os.kill(os.getpid(), signal.SIGKILL)

class Hangs(Fine):
    def act(self, observation):
        time.sleep(1000)
"""
BY_ITSELF = {
    "Raises": "failed: ZeroDivisionError: the learner [/broke]",
    "Mute": "failed: Silent",
    "Stray": "failed: action 99 is outside",
    "Nonsense": "failed: Nonsense has to answer with the index of an action",
    "Exits": "failed: SystemExit: 0",
    "Stops": "failed: KeyboardInterrupt",
}
LETHAL_LINES = {
    name: LETHAL[: LETHAL.index(line)].count("\n") + 1
    for name, line in [("Raises", "raise Zero"), ("Exits", "sys.exit(0)"), ("Mute", "raise Silent")]
}
WITH_ITS_PROCESS = {
    "Dies": "ended its process (exit status 9)",
    "Segfaults": "ended its process (killed by SIGSEGV)",
    "Killed": "ended its process (killed by SIGKILL, perhaps for lack of memory)",
}


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    (tmp_path / "lethal.py").write_text(LETHAL, encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setattr(runner, "LOOK_EVERY", 0.1)
    start_prepared(monkeypatch)
    with modules_of(tmp_path):
        yield tmp_path


def declared(folder: Path, *learners: str, conditions: str = "[CC3]") -> Experiment:
    path = folder / "experiment.yaml"
    names = ", ".join(f"'lethal:{name}'" for name in learners)
    path.write_text(
        f"name: e\nsubjects: 4\ncell_size: 2\nconditions: {conditions}\n"
        f"protocols: {{short: {{attempt_limit: 3, baseline_trials: 1}}}}\nprotocol: short\n"
        f"learners: [{names}]\n",
        encoding="utf-8",
    )
    return read_experiment(path)


def fails(experiment: Experiment, folder: Path, **options: object) -> CellsFailed:
    with pytest.raises(CellsFailed) as caught:
        runner.run(experiment, folder, **options)  # type: ignore[arg-type]
    return caught.value


@pytest.mark.parametrize("kind", ["threads", "ours"])
def test_cells_that_fail_are_named_and_the_others_are_played(folder: Path, kind: str) -> None:
    experiment = declared(folder, *BY_ITSELF, "Fine")
    told: list[str] = []

    def failed(cell: object, why: str) -> None:
        told.append(why)

    if kind == "threads":
        with ThreadPoolExecutor(2) as executor:
            error = fails(experiment, folder / "out", executor=executor, failed=failed)
    else:
        error = fails(experiment, folder / "out", workers=2, failed=failed)
    assert error.status == 1
    assert sorted(error.reasons) == sorted(told)
    expected = [
        f"the learner {name} in CC3, subjects {numbers}, {why}"
        for name, why in BY_ITSELF.items()
        for numbers in ("0-1", "2-3")
    ]
    assert len(error.reasons) == len(expected)
    for reason, begins in zip(error.reasons, expected, strict=True):
        assert reason.startswith(begins)
        line = LETHAL_LINES.get(reason.split()[2])
        assert line is None or reason.partition("; see ")[0].endswith(f" (lethal.py:{line})")
        path = Path(reason.partition("; see ")[2])
        said, trace = path.read_text(encoding="utf-8").split("\n\n", 1)
        assert reason == f"{said}; see {path}"
        assert "Traceback" in trace or "Silent" in trace
    assert str(error).endswith(error.summary)
    store = Store(folder / "out")
    assert {path.name[:5] for path in store.files()[0]} == {"Fine_"}
    assert not [path for path in store.cells.iterdir() if path.suffix != ".parquet"]


def test_a_learner_that_kills_its_process_takes_no_other_cell_with_it(folder: Path) -> None:
    experiment = declared(folder, *WITH_ITS_PROCESS, "Fine", "Raises")
    seen: list[RunProgress] = []
    error = fails(experiment, folder / "out", workers=2, progress=seen.append)
    for name, why in WITH_ITS_PROCESS.items():
        mine = [reason for reason in error.reasons if f"learner {name} in" in reason]
        assert len(mine) == 2
        assert all(why in reason for reason in mine)
        assert all(Path(one.partition("; see ")[2]).exists() for one in mine)
    assert len(Store(folder / "out").files()[0]) == 2
    last = seen[-1]
    assert (last.cells, last.done, last.failed, last.playing) == (10, 2, 8, ())
    assert last.share == 1
    assert seen[0].done == seen[0].failed == 0


def test_a_given_executor_that_breaks_is_one_sentence(folder: Path) -> None:
    experiment = declared(folder, "Dies", "Fine")
    with (
        ProcessPoolExecutor(1, mp_context=prepared()) as executor,
        pytest.raises(OpenLockError, match="a worker of the executor ended without a message"),
    ):
        runner.run(experiment, folder / "out", executor=executor)


def test_a_cell_that_hangs_is_named_and_ended_at_its_time_limit(folder: Path) -> None:
    experiment = declared(folder, "Hangs", "Fine")
    seen: list[RunProgress] = []
    error = fails(
        experiment, folder / "out", workers=2, time_limit=np.int64(1), progress=seen.append
    )
    # On a machine that has much else to do, the others may take too long as well.
    assert [one.partition("; see")[0] for one in error.reasons if " Hangs " in one] == [
        f"the learner Hangs in CC3, subjects {numbers}, was ended after 1 s"
        for numbers in ("0-1", "2-3")
    ]
    assert seen[-1].done + seen[-1].failed == 4
    still = [one.still for standing in seen for one in standing.playing]
    assert max(still) > 0.5
    runner.run(declared(folder, "Fine"), folder / "out", workers=1)
    warnings: list[str] = []
    with ThreadPoolExecutor(1) as executor:
        runner.run(
            declared(folder, "Fine"),
            folder / "given",
            executor=executor,
            time_limit=1,
            warn=warnings.append,
        )
    assert "is ignored" in warnings[0]


def test_a_mended_learner_alone_is_played_again_and_one_taken_out_leaves_the_rest(
    folder: Path,
) -> None:
    out = folder / "out"
    with ThreadPoolExecutor(2) as executor:
        fails(declared(folder, "Fine", "Raises"), out, executor=executor)
        store = Store(out)
        _, description = read_results(store)
        assert len(description.missing) == len(description.failures) == 2
        first = store.read(store.files()[0][0])
        # Taken out: what is there is whole.
        without = declared(folder, "Fine")
        runner.run(without, out, executor=executor)
        assert not read_results(store)[1].missing
        assert not list((out / "errors").iterdir())
        # Put back as it was: it is tried again, and it alone.
        played: list[str] = []
        error = fails(
            declared(folder, "Fine", "Raises"),
            out,
            executor=executor,
            done=lambda cell, before: None if before else played.append(cell.name),
        )
        assert played == []
        assert len(error.reasons) == 2
        # Mended: its source is another one, and so are its cells.
        broken = declared(folder, "Fine", "Raises")
        fine, raises = broken.learners
        mended = replace(broken, learners=(fine, replace(raises, learner="lethal:Fine")))
        runner.run(
            mended,
            out,
            executor=executor,
            done=lambda cell, before: None if before else played.append(cell.name),
        )
    assert sorted(played) == ["Raises_CC3_0-1", "Raises_CC3_2-3"]
    assert not read_results(store)[1].missing
    assert store.read(store.files()[0][0]).equals(first)
    assert not list((out / "errors").iterdir())


def test_the_only_learner_of_an_experiment_may_be_mended(folder: Path) -> None:
    broken = LETHAL.replace("return 99", "return 0 if self.brief.trials == 1 else 99")
    (folder / "lethal.py").write_text(broken, encoding="utf-8")
    declared(folder, "Stray", conditions="[CC3, CC3-CC4]")

    def compare() -> set[str]:
        sys.modules.pop("lethal", None)  # so that it is read anew
        with modules_of(folder), ThreadPoolExecutor(1) as pool:
            runner.run(read_experiment(folder / "experiment.yaml"), folder / "out", executor=pool)
        return played()

    def played() -> set[str]:
        return {path.name for path in (folder / "out" / "cells").glob("*.parquet")}

    with pytest.raises(CellsFailed, match="action 99 is outside"):
        compare()
    first = played()
    assert len(first) == 2
    (folder / "lethal.py").write_text(broken.replace("99", "1"), encoding="utf-8")
    assert compare() - first == {path.name for path in Store(folder / "out").files()[0]}, (
        "its source is another one, so all of its cells are played, and the old ones are kept"
    )


def test_compare_says_what_is_missing_and_exits_with_1(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    declared(folder, "Fine", "Raises", "Dies", conditions="[CC3]")
    monkeypatch.setenv("COLUMNS", "80")
    words = ("compare", "experiment.yaml", "--out", "out", "--workers", 2)
    done = at_once(*words, workers=True)
    assert done.status == 1, done.stdout + done.stderr
    assert done.stderr == (
        "error: 4 of 6 cells failed, and all others are done; fix or remove the failing learners "
        "and run the same command again; only missing cells are played\n"
    )
    lines = [
        f"the learner {name} in {condition}, subjects {numbers}, {why}"
        for name, why in (
            ("Raises", f"{BY_ITSELF['Raises']} (lethal.py:{LETHAL_LINES['Raises']})"),
            ("Dies", WITH_ITS_PROCESS["Dies"]),
        )
        for condition in ("CC3",)
        for numbers in ("0-1", "2-3")
    ]
    report = at_once("report", "out")
    assert report.status == 0
    page = Page((folder / "out" / "report.html").read_text(encoding="utf-8")).text
    for said in (done.stdout, report.stdout):
        assert "unfinished: 4 of its cells are missing" in said
        assert all(f"  {line}\n" in said for line in lines)
    assert "4 of its cells are missing" in page
    assert "4 of them failed" in page
    assert all(line in page for line in lines)
    with (folder / "out" / "summary.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert {row["missing"] for row in rows if row["learner"] == "Fine"} == {"0"}
    missing = {(row["learner"], row["condition"]): row for row in rows if row["missing"] != "0"}
    assert len(missing) == 2
    assert missing["Dies", "CC3"]["subjects"] == "0"
    assert missing["Dies", "CC3"]["missing"] == "4"
    assert "exit status 9" in missing["Dies", "CC3"]["why"]


def test_where_every_cell_fails_there_is_no_report_and_the_reasons_are_told(folder: Path) -> None:
    declared(folder, "Raises")
    words = ("compare", "experiment.yaml", "--out", "out", "--workers", 1)
    done = at_once(*words, workers=True)
    assert done.status == 1
    assert "Traceback" not in done.stderr
    assert done.stderr.count("ZeroDivisionError") == 2
    assert "every cell failed" in done.stderr
    with pytest.raises(StoreError, match="holds no cell yet"):
        Store(folder / "out").record()


def test_half_a_group_missing_is_counted_in_its_rows(folder: Path, tmp_path: Path) -> None:
    with ThreadPoolExecutor(2) as executor:
        store = runner.run(declared(folder, "Fine"), folder / "out", executor=executor)
    whole = write_report(*_with_path(store, tmp_path / "whole"), topics=())
    store.files()[0][1].unlink()
    half = write_report(*_with_path(store, tmp_path / "half"), topics=())
    head, row = (half.parent / "summary.csv").read_text(encoding="utf-8").splitlines()[:2]
    assert head.endswith(",missing,why")
    assert row.endswith(',2,"Fine in CC3, subjects 2-3: not played yet"')
    assert "missing" not in (whole.parent / "summary.csv").read_text(encoding="utf-8")


def _with_path(store: Store, out: Path) -> tuple[object, Path, object]:
    record, description = store.record()
    return record, out, description


@pytest.mark.parametrize(
    ("code", "words"),
    [(0, "exit status 0"), (-15, "killed by SIGTERM"), (-99, "killed by signal 99"), (None, "how")],
)
def test_how_a_process_ended_is_told_in_words(code: int | None, words: str) -> None:
    assert words in how_ended(code)
