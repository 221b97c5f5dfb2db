"""The files of a report: which there are, and what becomes of earlier ones."""

from __future__ import annotations

import errno
import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest

from causal_openlock.analysis.plots import style
from causal_openlock.analysis.report.all_figures import figures_of
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.analysis.results.material import Material
from causal_openlock.errors import OpenLockError
from support.command import at_once
from support.fabricated_records import random_cells, table, trial_rows
from support.figures import drawn
from support.made_up_experiments import experiment_of

pytestmark = pytest.mark.slow


def written(record: pa.Table, folder: Path, figures: bool = False, **known: Any) -> Path:
    return write_report(record, folder, experiment_of(record, **known), figures=figures)


def test_the_page_alone_holds_everything(tmp_path: Path) -> None:
    record = random_cells(1, conditions=("CC4",), subjects=2)[0]
    alone = written(record, tmp_path / "alone").read_text("utf-8")
    assert sorted(path.name for path in (tmp_path / "alone").iterdir()) == [
        *("report.html", "summary.csv")
    ]
    whole = written(record, tmp_path / "whole", figures=True).read_text("utf-8")
    listed = re.compile(r'<meta name="files" content="([^"]*)">')
    assert '<meta name="files" content="">' in alone
    assert "tables/leaderboard.csv" in next(listed.finditer(whole))[1].split()
    assert listed.sub("", alone) == listed.sub("", whole)


def test_files_beside_the_page(tmp_path: Path) -> None:
    cells = random_cells(2, conditions=("CC4", "CC3-CC4"), subjects=2)
    report = written(pa.concat_tables(cells), tmp_path, title="whole", figures=True)
    names = {path.name for path in (report.parent / "figures").iterdir()}
    stems = {
        "cost_of_learning",
        "survival_human",
        "baseline_categories",
        "transfer_categories",
        "attempts_by_trial_human",
        "attempts_by_trial_loops",
        "learner_a",
        "learner_b",
    }
    assert names >= {f"{stem}.{kind}" for stem in stems for kind in ("png", "svg", "pdf")}
    tables = {path.name for path in (report.parent / "tables").iterdir()}
    assert tables >= {f"learner_{name}.{kind}" for name in "ab" for kind in ("csv", "tex")}
    assert (report.parent / "summary.csv").read_text().startswith("learner,condition,protocol,")


def test_writing_again_writes_the_same(tmp_path: Path) -> None:
    record = pa.concat_tables(random_cells(1, conditions=("CC4", "CC3-CC4"), subjects=2))
    rows = np.random.default_rng(0).permutation(record.num_rows)
    with drawn():
        report = written(record, tmp_path / "once", True, title="again")
        written(record.take(rows), tmp_path / "twice", True, title="again")
    files = sorted(path for path in report.parent.rglob("*.*"))
    assert sum(path.suffix == ".svg" for path in files) >= 6
    for path in files:
        again = tmp_path / "twice" / path.relative_to(report.parent)
        assert again.read_bytes() == path.read_bytes(), path


def test_a_figure_drawn_again_is_the_same_file_of_every_kind(tmp_path: Path) -> None:
    record = random_cells(1, conditions=("CC4",), subjects=2)[0]
    with drawn():
        for name in ("once", "twice"):
            (plot, *_) = figures_of(Material.of(record, experiment_of(record)))
            style.save(plot.figure, tmp_path / name)
    kinds = {path.suffix for path in tmp_path.glob("once.*")}
    assert kinds == {".svg", ".png", ".pdf"}
    for kind in kinds:
        once, twice = ((tmp_path / f"{name}{kind}").read_bytes() for name in ("once", "twice"))
        assert once == twice


def test_figures_of_an_earlier_report_are_removed_and_nothing_else(tmp_path: Path) -> None:
    rows = trial_rows([1, 2, 3])
    both = [*rows, *trial_rows([1, 2, 3], protocol="rl"), *trial_rows([1, 2, 3], condition="x-y")]
    written(table(both), tmp_path, figures=True)
    figures = tmp_path / "figures"
    (figures / "mine.png").write_text("")
    (figures / "baseline_attempts_mine.svg").write_text("")
    (figures / "attempts_by_trial_rl.txt").write_text("")
    assert (figures / "attempts_by_trial_rl.svg").exists()
    written(table(rows), tmp_path, figures=True)
    assert {path.name for path in figures.iterdir()} == {
        *(f"{stem}.{kind}"
          for stem in ("cost_of_learning", "survival_human", "attempts_by_trial_human", "learner_a")
          for kind in ("png", "svg", "pdf")),
        "mine.png",
        "baseline_attempts_mine.svg",
        "attempts_by_trial_rl.txt",
    }  # fmt: skip
    written(table(rows), tmp_path)
    assert {path.name for path in figures.iterdir()} == {
        *("mine.png", "baseline_attempts_mine.svg", "attempts_by_trial_rl.txt")
    }


def test_nothing_is_removed_behind_a_link(tmp_path: Path) -> None:
    folder, elsewhere = tmp_path / "report", tmp_path / "elsewhere"
    folder.mkdir()
    elsewhere.mkdir()
    (elsewhere / "photo.png").write_text("")
    (folder / "figures").symlink_to("../elsewhere")
    (folder / "report.html").write_text('<meta name="files" content="figures/photo.png">')
    written(table(trial_rows([1, 2, 3])), folder)
    assert (elsewhere / "photo.png").exists()


def test_a_report_says_what_it_removed(tmp_path: Path) -> None:
    done = [
        at_once("compare", "-c", "CC3", "-l", "oracle", "--subjects", 2, "-o", "a", cwd=tmp_path),
        *(
            at_once("report", "a", *more, cwd=tmp_path)
            for more in (["--figures"], [], [], ["a", "--figures"], ["a"])
        ),
    ]
    removed = [
        re.findall(r"(\d+ files? of the earlier page w\w+ removed from .*--figures)", one.stdout)
        for one in done
    ]
    assert [len(found) for found in removed] == [0, 0, 1, 0, 0, 1]
    assert not [path for path in tmp_path.rglob("*") if path.suffix in (".svg", ".tex")]


def test_a_folder_that_cannot_be_written_to_is_told_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "figures").write_text("in the way")
    with pytest.raises(OpenLockError, match=r"figures.*cannot be written"):
        written(table(trial_rows([1, 2, 3])), tmp_path, figures=True)
    (tmp_path / "figures").unlink()
    (tmp_path / "report.html").mkdir()
    with pytest.raises(OpenLockError, match=r"report.html.*cannot be written"):
        written(table(trial_rows([1, 2, 3])), tmp_path)


def test_a_full_disk_leaves_the_earlier_report_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written(table(trial_rows([1, 2, 3])), tmp_path, title="earlier")
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}

    def full(*_: Any) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(Path, "replace", full)
    with pytest.raises(OpenLockError, match="No space left on device"):
        written(table(trial_rows([0, 1, 2, 3])), tmp_path, title="later")
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
