"""``causal-openlock notebook``: the template or a lesson becomes a notebook of one's own."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from support.command import at_once
from support.places import ROOT

LESSONS = sorted((ROOT / "notebooks").glob("0*.ipynb"))


def begun(folder: Path, *words: object) -> str:
    done = at_once("notebook", *words, cwd=folder)
    assert (done.status, done.stderr) == (0, "")
    return done.stdout


def refused(folder: Path, *words: object) -> str:
    done = at_once("notebook", *words, cwd=folder)
    assert (done.status, done.stdout) == (2, "")
    assert len(done.stderr.splitlines()) == 1
    return done.stderr


def test_a_notebook_begins_as_the_template_and_one_line_says_how_to_open_it(tmp_path: Path) -> None:
    said = begun(tmp_path, "my vault")
    assert said == (
        "my vault.ipynb written; open it in an editor, or with: jupyter lab 'my vault.ipynb'\n"
    )
    written = tmp_path / "my vault.ipynb"
    assert written.read_bytes() == (ROOT / "notebooks" / "template.ipynb").read_bytes()
    nbformat.validate(nbformat.read(written, as_version=4))


@pytest.mark.parametrize("number", [1, len(LESSONS)])
def test_it_may_begin_as_a_lesson_that_was_never_run(number: int, tmp_path: Path) -> None:
    begun(tmp_path, "mine.ipynb", "--lesson", number)
    mine = nbformat.read(tmp_path / "mine.ipynb", as_version=4)
    lesson = nbformat.read(LESSONS[number - 1], as_version=4)
    assert [cell.source for cell in mine.cells] == [cell.source for cell in lesson.cells]
    code = [cell for cell in mine.cells if cell.cell_type == "code"]
    assert [(cell.outputs, cell.execution_count) for cell in code] == [([], None)] * len(code)
    assert "code_hash" not in mine.metadata


def test_no_file_is_overwritten(tmp_path: Path) -> None:
    (tmp_path / "mine.ipynb").write_text("work of a week")
    assert "mine.ipynb exists already; choose another name" in refused(tmp_path, "mine")
    assert (tmp_path / "mine.ipynb").read_text() == "work of a week"


@pytest.mark.parametrize("number", [0, len(LESSONS) + 1])
def test_a_lesson_that_there_is_not_is_answered_with_those_that_there_are(
    number: int, tmp_path: Path
) -> None:
    said = refused(tmp_path, "mine", "--lesson", number)
    assert f"there is no lesson {number}; there are lessons 1 to {len(LESSONS)}" in said
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_cannot_be_written_to_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    assert "cannot be written" in refused(tmp_path, "file/mine")


def test_it_starts_without_what_plays_and_draws(tmp_path: Path) -> None:
    program = (
        "import sys\n"
        "from causal_openlock.cli import main\n"
        "sys.argv = ['causal-openlock', 'notebook', 'mine', '--lesson', '1']\n"
        "try:\n"
        "    main()\n"
        "except SystemExit as ended:\n"
        "    assert not ended.code, ended.code\n"
        "heavy = {'torch', 'pgmpy', 'matplotlib', 'pandas', 'scipy', 'pyarrow', 'IPython'}\n"
        "assert not heavy & {*sys.modules}, heavy & {*sys.modules}\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
