"""The lessons and the template: they run, show what they promise, and are stored with outputs."""

import ast
import io
import json
import os
import re
from base64 import b64decode
from importlib import import_module

import nbformat
import pytest
from jupyter_client.manager import KernelManager
from nbclient import NotebookClient
from PIL import Image

from support.places import ROOT

pytestmark = pytest.mark.slow

FOLDER = ROOT / "notebooks"
LESSONS = sorted(FOLDER.glob("[0-9]*.ipynb"))
NOTEBOOKS = [*LESSONS, FOLDER / "template.ipynb"]
SMALLER = {
    r"\bsubjects=\d+": "subjects=2",
    "loops = 10": "loops = 2",
    r"range\(6\)": "range(2)",
    r"\bol\.compare\(": "compare_here(",
    r'\["ideal", "bayes"\]': '["ideal", "random"]',  # in rooms of six levers, for seconds each
}
"""Fewer subjects, all played by the kernel: that cells run and draw does not depend on it."""
BEFORE = """\
%reset_selective -f ^(?!_)
import functools, gc, causal_openlock
gc.set_threshold(50_000, 20, 50)
compare_here = functools.partial(causal_openlock.compare, workers=0)
"""
SOLUTION = re.compile(r"```python\n(.*?)```", re.DOTALL)
MOST_BYTES = 300_000
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
each_lesson = pytest.mark.parametrize("path", LESSONS, ids=lambda path: path.stem)


def read(path):
    return nbformat.read(path, as_version=4)


def code_cells(notebook):
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def solutions(text):
    """The code in the folded parts of a text."""
    folded = re.findall(r"<details>(.*?)</details>", text, re.DOTALL)
    return [code for part in folded for code in SOLUTION.findall(part)]


def smaller(source):
    for more, fewer in SMALLER.items():
        source = re.sub(more, fewer, source)
    return source


@pytest.fixture(scope="module")
def kernel(tmp_path_factory):
    """One kernel for all: importing everything takes longer than most lessons."""
    # What tests are told about pictures is not for the kernel, which hands them over.
    environment = {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}
    manager = KernelManager(kernel_name="python3")
    manager.start_kernel(env=environment, cwd=str(tmp_path_factory.mktemp("kernel")))
    yield manager
    manager.shutdown_kernel(now=True)


@each
def test_it_runs_from_top_to_bottom_and_shows_what_it_promises(path, kernel):
    """With the solutions of its exercises, each where it stands."""
    notebook, cells = read(path), []
    for cell in notebook.cells:
        cell.source = smaller(cell.source) if cell.cell_type == "code" else cell.source
        cells.append(cell)
        if cell.cell_type == "markdown":
            cells += map(nbformat.v4.new_code_cell, map(smaller, solutions(cell.source)))
    notebook.cells = [nbformat.v4.new_code_cell(BEFORE), *cells]
    client = NotebookClient(notebook, km=kernel, timeout=240)
    client.execute()
    client.kc.stop_channels()
    shown_as_promised([cell for cell in cells if cell.cell_type == "code"])


def shown_as_promised(cells):
    """Cells that plot have a picture, others that end in a value show it, and none warns."""
    for cell in cells:
        last = ast.parse(cell.source.rstrip(";")).body[-1:]
        kinds = {kind for output in cell.outputs for kind in output.get("data", {})}
        assert not [output for output in cell.outputs if output.get("name") == "stderr"], cell
        if "plot." in cell.source or "plot_trace(" in cell.source:
            assert "image/png" in kinds, cell.source
        elif last and isinstance(last[0], ast.Expr) and not cell.source.endswith(";"):
            quiet = ("learner.begin(", "people.close(")
            called = cell.source.split("\n")[-1]
            untold = "remove-output" in cell.metadata.get("tags", ())
            assert cell.outputs or untold or called.startswith(quiet), cell.source


@each_lesson
def test_it_is_stored_with_what_its_code_put_out(path):
    notebook = read(path)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    shown_as_promised(cells)
    assert [cell.execution_count for cell in cells] == [*range(1, len(cells) + 1)]
    assert path.stat().st_size <= MOST_BYTES
    outputs = [output for cell in cells for output in cell.outputs]
    pictures = [one.data["image/png"] for one in outputs if "image/png" in one.get("data", {})]
    assert pictures
    for picture in pictures:
        Image.open(io.BytesIO(b64decode(picture))).verify()
    assert not re.search(r"Traceback|\b0x[0-9a-f]{6}|<iframe|<progress", json.dumps(outputs))


@each
def test_it_leads_nowhere_that_does_not_exist(path):
    for cell in read(path).cells:
        if cell.cell_type == "markdown":
            for link in re.findall(r"\]\(([^)#]+)", cell.source):
                assert link.startswith("https://") or (FOLDER / link).exists(), link


@pytest.mark.parametrize(
    "line", (ROOT / "causal_openlock" / "moved.txt").read_text(encoding="utf-8").splitlines()
)
def test_a_name_that_has_moved_says_where_it_stands(line):
    import causal_openlock as ol

    name, module, now = line.split()
    with pytest.warns(DeprecationWarning, match=f"from {module} import {now}$"):
        assert getattr(ol, name) is getattr(import_module(module), now)
