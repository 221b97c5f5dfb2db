"""The lessons and the template: they run, show what they promise, and stay short.

Lessons are stored with what they put out, so that they can be read where they lie.
"""

from __future__ import annotations

import ast
import base64
import io
import json
import os
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pytest
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from PIL import Image

from causal_openlock.files.notebooks import without_outputs
from support.places import ROOT

sys.path.append(str(ROOT / "docs"))

from run_lessons import code_hash, same_each_time

pytestmark = pytest.mark.slow

FOLDER = ROOT / "notebooks"
LESSONS = sorted(FOLDER.glob("[0-9]*.ipynb"))
TEMPLATE = FOLDER / "template.ipynb"
NOTEBOOKS = [*LESSONS, TEMPLATE]
A_CELL = 240  # seconds
LINES_OF_A_CELL, LINES_OF_ALL = 8, 700
MOST_SUBJECTS, MOST_ATTEMPTS = 10, 2000
"""What a lesson may ask for, and what it may play here, with two subjects of each learner."""
SMALLER = {r"\bsubjects=\d+": "subjects=2", "loops = 10": "loops = 2", r"range\(6\)": "range(2)"}
"""Fewer subjects and the like: that cells run and draw does not depend on them."""
BEFORE = """\
def prepare():
    import sys
    import causal_openlock
    from causal_openlock.analysis.plots import style
    from causal_openlock.comparison import comparing
    known = get_ipython().user_ns
    for name in [name for name in known if name not in first_names and name != "first_names"]:
        del known[name]
    style.images = lambda figure, kinds: {"svg": b'<svg viewBox="0 0 432 216"></svg>'}
    played = sys.modules["played"] = type(sys)("played")
    played.attempts = 0
    def compare(*given, workers=0, **more):
        results = comparing.compare(*given, workers=workers, **more)
        played.attempts += results.record.num_rows
        return results
    causal_openlock.compare = compare
if "first_names" not in globals():
    first_names = {*get_ipython().user_ns}
prepare()
"""
"""Run before each notebook: nothing of the last one is left, and the kernel plays by itself.

Figures of a report are not drawn; others are.
"""
AFTER = "import played\nprint(played.attempts)"
PLAIN_FIGURES = """\
c = get_config()
c.InlineBackend.print_figure_kwargs = {"bbox_inches": None, "dpi": 30}
"""
"""How a kernel hands figures over: drawn once, not a second time for their margins, and small."""
SOLUTION = re.compile(r"```python\n(.*?)```", re.DOTALL)
MOST_BYTES, WIDEST = 300_000, 1000
ACCIDENTAL = re.compile(
    r"[\s'\"(>]/\w+/|[A-Z]:\\\\|\b0x[0-9a-f]{4}|\bin [\d.]+ ?(?:s|min|h)\b"
    r"|\b\d\d:\d\d\b|\b20\d\d-\d\d-\d\d\b|<progress|<svg|<iframe|widget"
)
"""What differs from run to run, such as folders, addresses and times, and what no forge shows."""
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
each_lesson = pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)


def read(path: Path) -> Any:
    return nbformat.read(path, as_version=4)


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def texts(notebook: Any) -> list[str]:
    return [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]


def solutions(text: str) -> list[str]:
    """The code in the folded parts of a text."""
    folded = re.findall(r"<details>(.*?)</details>", text, re.DOTALL)
    return [code for part in folded for code in SOLUTION.findall(part)]


def lines(source: str) -> int:
    """Lines of code: those that are neither blank nor a comment."""
    return sum(
        bool(line.strip()) and not line.strip().startswith("#") for line in source.split("\n")
    )


@pytest.fixture(scope="module")
def kernel(tmp_path_factory: pytest.TempPathFactory) -> Iterator[KernelManager]:
    """One kernel for all: importing everything takes longer than most lessons."""
    folder = tmp_path_factory.mktemp("kernel")
    profile = folder / "ipython" / "profile_default"
    profile.mkdir(parents=True)
    (profile / "ipython_kernel_config.py").write_text(PLAIN_FIGURES, encoding="utf-8")
    # What tests are told about pictures is not for the kernel, which hands them over.
    environment = {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}
    environment["IPYTHONDIR"] = str(profile.parent)
    manager = KernelManager(kernel_name="python3")
    manager.start_kernel(env=environment, cwd=str(folder))
    yield manager
    manager.shutdown_kernel(now=True)


def smaller(source: str) -> str:
    for more, fewer in SMALLER.items():
        source = re.sub(more, fewer, source)
    return source


@each
def test_it_runs_from_top_to_bottom_and_shows_what_it_promises(
    path: Path, kernel: KernelManager
) -> None:
    """With the solutions of its exercises, each where it stands."""
    notebook, cells = read(path), []
    for cell in notebook.cells:
        cell.source = smaller(cell.source) if cell.cell_type == "code" else cell.source
        cells.append(cell)
        if cell.cell_type == "markdown":
            cells += map(nbformat.v4.new_code_cell, map(smaller, solutions(cell.source)))
    notebook.cells = [
        nbformat.v4.new_code_cell(BEFORE),
        *cells,
        nbformat.v4.new_code_cell(AFTER),
    ]
    client = NotebookClient(notebook, km=kernel, timeout=A_CELL)
    client.execute()
    client.kc.stop_channels()
    shown_as_promised([cell for cell in cells if cell.cell_type == "code"])
    attempts = int(notebook.cells[-1].outputs[0].text)
    assert 0 < attempts <= MOST_ATTEMPTS


def shown_as_promised(cells: list[Any]) -> None:
    """Cells that plot have a picture, others that end in a value show it, and none warns."""
    for cell in cells:
        last = ast.parse(cell.source.rstrip(";")).body[-1:]
        kinds = {kind for output in cell.outputs for kind in output.get("data", {})}
        warnings = [output.text for output in cell.outputs if output.get("name") == "stderr"]
        assert warnings == [], cell.source
        if "plot." in cell.source or "plot_trace(" in cell.source:
            assert "image/png" in kinds, cell.source
        elif last and isinstance(last[0], ast.Expr) and not cell.source.endswith(";"):
            quiet = ("learner.begin(", "people.close(")
            called = cell.source.split("\n")[-1]
            assert cell.outputs or called.startswith(quiet), cell.source


@each_lesson
def test_it_is_stored_with_what_its_code_put_out(path: Path) -> None:
    notebook = read(path)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    shown_as_promised(cells)
    assert notebook.metadata["code_hash"] == code_hash(notebook), (
        "changed since it ran: make lessons"
    )
    assert [cell.execution_count for cell in cells] == [*range(1, len(cells) + 1)]
    assert path.stat().st_size <= MOST_BYTES
    pictures = [
        output.data.pop("image/png")
        for cell in cells
        for output in cell.outputs
        if "image/png" in output.get("data", {})
    ]
    assert pictures
    for picture in pictures:
        with Image.open(io.BytesIO(base64.b64decode(picture))) as image:
            assert (image.format, image.info) == ("PNG", {})
            assert image.width <= WIDEST
    said = "\n".join(json.dumps(output) for cell in cells for output in cell.outputs)
    assert ACCIDENTAL.findall(said) == []


@pytest.mark.parametrize(
    "text", ["Ran 9 tests in 0.412s", "4 cells done, in 3 min", "PosixPath('/tmp/x/report.html')",
             "<Axes at 0x7f31>", "2026-11-26", "C:\\\\Users"],
)  # fmt: skip
def test_what_differs_from_run_to_run_would_be_noticed(text: str) -> None:
    assert ACCIDENTAL.search(text)


def test_times_and_folders_are_left_out_of_what_is_stored() -> None:
    said = "Ran 9 tests in 0.412s, PosixPath('/tmp/x-1/first/report.html'), 1/2, <b>and</b>"
    assert same_each_time(said) == "Ran 9 tests, PosixPath('report.html'), 1/2, <b>and</b>"


@each
def test_nothing_else_is_stored_with_it(path: Path) -> None:
    """No times of cells, no state of widgets; and the template as if it had never been run."""
    notebook = read(path)
    assert [dict(cell.metadata) for cell in notebook.cells] == [{}] * len(notebook.cells)
    assert {*notebook.metadata} - {"code_hash"} == {"kernelspec", "language_info"}
    text = TEMPLATE.read_text(encoding="utf-8")
    assert text == without_outputs(text)


@each
def test_its_cells_are_short(path: Path) -> None:
    notebook = read(path)
    sources = [cell.source for cell in code_cells(notebook)]
    sources += [code for text in texts(notebook) for code in solutions(text)]
    longest = max(sources, key=lines)
    assert lines(longest) <= LINES_OF_A_CELL, longest


def test_all_lessons_together_are_short() -> None:
    notebooks = [read(path) for path in LESSONS]
    code = [cell.source for notebook in notebooks for cell in code_cells(notebook)]
    code += [code for notebook in notebooks for text in texts(notebook) for code in solutions(text)]
    assert sum(map(lines, code)) <= LINES_OF_ALL


@each_lesson
def test_it_asks_lets_change_sets_an_exercise_and_leads_on(path: Path) -> None:
    notebook = read(path)
    said = texts(notebook)
    title = said[0].split("\n")[0]
    assert title.startswith("# ")
    assert title.endswith("?")
    code = "\n".join(cell.source for cell in code_cells(notebook))
    assert code.count("# change this") == 1
    exercises = [text for text in said if "\n## Exercise\n" in f"\n{text}"]
    assert len(exercises) == 1
    answers = [text for text in said[said.index(exercises[0]) :] if solutions(text)]
    assert len(answers) == 1
    assert "<summary>Solution</summary>" in answers[0]
    assert said[-1].startswith("## What to try next\n")
    asked = [int(number) for number in re.findall(r"\bsubjects=(\d+)", code + answers[0])]
    assert max([1, *asked]) <= MOST_SUBJECTS


@each
def test_it_needs_one_import(path: Path) -> None:
    allowed = {"causal_openlock", "numpy", "pandas", "matplotlib", *sys.stdlib_module_names}
    code = "\n".join(cell.source.rstrip(";") for cell in code_cells(read(path)))
    found = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.Import)]
    imported = [name for node in found for name in node.names]
    froms = [node for node in ast.walk(ast.parse(code)) if isinstance(node, ast.ImportFrom)]
    assert ("causal_openlock", "ol") in [(name.name, name.asname) for name in imported]
    assert {name.name.partition(".")[0] for name in imported} <= allowed
    assert {node.module for node in froms} <= sys.stdlib_module_names
    assert "pivot" not in code
    assert "set_xtick" not in code


def test_they_are_numbered_in_the_order_in_which_they_are_read() -> None:
    numbers = [path.stem.partition("_")[0] for path in LESSONS]
    assert numbers == [f"{number:02}" for number in range(1, 10)]


@each
def test_it_leads_nowhere_that_does_not_exist(path: Path) -> None:
    notebook = read(path)
    assert notebook.cells[0].cell_type == "markdown"
    for text in texts(notebook):
        for link in re.findall(r"\]\(([^)#]+)", text):
            assert link.startswith("https://") or (FOLDER / link).exists(), link


def test_the_template_is_a_few_cells() -> None:
    assert len(read(TEMPLATE).cells) == 8


def test_jupyterlab_is_one_command_away_in_exact_versions() -> None:
    root = FOLDER.parent
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [re.split("[>=]", one)[0] for one in project["optional-dependencies"]["notebooks"]]
    assert wanted == ["ipykernel", "ipywidgets", "jupyterlab"]
    pins = (root / "constraints.txt").read_text(encoding="utf-8").splitlines()
    pinned = dict(line.split("==") for line in pins if not line.startswith("#"))
    # JupyterLab, and the parts of it that change most.
    assert {*wanted, "jupyter_server", "jupyterlab_server", "nbconvert", "notebook_shim"} <= {
        *pinned
    }
    if shutil.which("make"):
        made = subprocess.run(
            ["make", "--no-print-directory", "-n", "notebooks"],
            cwd=root,
            env={name: value for name, value in os.environ.items() if "MAKE" not in name},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        assert "-m jupyterlab notebooks" in made.splitlines()[-1]
