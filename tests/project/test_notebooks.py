"""The notebooks, run as they stand, each in a fresh kernel."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import tomllib
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

from support.places import ROOT

FOLDER = ROOT / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
A_CELL = 240  # seconds
PICTURES = ("image/png", "image/gif")
DRAWN = """\
from causal_openlock.analysis.plots import style
def save(figure, stem, save=style.save):
    shown = stem.name in ("baseline_attempts", "transfer_attempts")
    return save(figure, stem) if shown else '<svg viewBox="0 0 432 216"></svg>'
style.KINDS, style.save = ("png",), save
"""
"""Of a report's figures, those alone are drawn that the notebook shows."""
SMALLER = {
    "01": {"fps=12, speed=2, attempts=4": "fps=4, speed=4, attempts=2"},
    "02": {"40, seed=2018": "5, seed=2018"},
    "03": {
        "subjects: 12": "subjects: 3",
        "CC4, CE4, CC3-CC4, CE3-CC4, CC3-CE4, CE3-CE4": "CC4, CC3-CE4",
        "workers=2": "workers=1",
        "report = write_report": DRAWN + "report = write_report",
    },
    "04": {"SUBJECTS = 40": "SUBJECTS = 3"},
    "05": {
        "2018, 4": "2018, 2",
        "attempt_limit=120": "attempt_limit=20",
        "1800 - 120": "300 - 20",
        "baseline_loops=120": "baseline_loops=20",
        "MANY, ACTIONS = 200": "MANY, ACTIONS = 40",
    },
    "06": {'"curious:Curious", 300': '"curious:Curious", 50', "subjects: 40": "subjects: 5"},
    "07": {"range(12)": "range(6)", "HUMAN, 20, seed": "HUMAN, 3, seed"},
}
"""Numbers of subjects and the like, smaller: that cells run and draw does not depend on them."""
PLAIN_FIGURES = """\
c = get_config()
c.InlineBackend.print_figure_kwargs = {"bbox_inches": None, "dpi": 30}
"""
"""How a kernel hands figures over: drawn once, not a second time for their margins, and small."""
each = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


@each
def test_it_runs_from_top_to_bottom_and_shows_pictures(path: Path, tmp_path: Path) -> None:
    """Over ten seconds: a fresh kernel imports everything, and draws ten figures and more."""
    notebook = nbformat.read(path, as_version=4)
    for more, fewer in SMALLER[path.stem[:2]].items():
        cells = [cell for cell in code_cells(notebook) if more in cell.source]
        assert cells, f"{more} is no longer there"
        for cell in cells:
            cell.source = cell.source.replace(more, fewer)
    # What tests are told about pictures is not for the kernel, which hands them over.
    environment = {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}
    profile = tmp_path / "ipython" / "profile_default"
    profile.mkdir(parents=True)
    (profile / "ipython_kernel_config.py").write_text(PLAIN_FIGURES, encoding="utf-8")
    environment["IPYTHONDIR"] = str(profile.parent)
    client = NotebookClient(
        notebook, timeout=A_CELL, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute(env=environment)
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    warnings = [output.text for output in outputs if output.get("name") == "stderr"]
    assert warnings == []
    pictures = [output for output in outputs if is_picture(output)]
    printed = [output for output in outputs if output.get("name") == "stdout"]
    assert len(pictures) >= 5
    assert len(pictures) > len(printed)


def is_picture(output: Any) -> bool:
    data = output.get("data", {})
    return any(kind in data for kind in PICTURES) or "<svg" in data.get("text/html", "")


@each
def test_it_is_kept_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert cells
    assert [cell.outputs for cell in cells] == [[]] * len(cells)
    assert [cell.execution_count for cell in cells] == [None] * len(cells)
    assert [dict(cell.metadata) for cell in notebook.cells] == [{}] * len(notebook.cells)
    assert "widgets" not in notebook.metadata


@each
def test_its_cells_are_short(path: Path) -> None:
    cells = code_cells(nbformat.read(path, as_version=4))
    longest = max(cells, key=lambda cell: len(cell.source.splitlines()))
    assert len(longest.source.splitlines()) <= 25, longest.source


def test_they_are_numbered_in_the_order_in_which_they_are_read() -> None:
    numbers = [path.stem.partition("_")[0] for path in NOTEBOOKS]
    assert numbers == [f"{number:02}" for number in range(1, 8)]


@each
def test_it_begins_with_a_title_and_leads_nowhere_that_does_not_exist(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    texts = [cell.source for cell in notebook.cells if cell.cell_type == "markdown"]
    assert texts[0].startswith("# ")
    assert notebook.cells[0].cell_type == "markdown"
    for text in texts:
        for link in re.findall(r"\]\(([^)#]+)", text):
            assert link.startswith("https://") or (FOLDER / link).exists(), link
        for number in re.findall(r"notebook (\d+)", text):
            assert 1 <= int(number) <= len(NOTEBOOKS)


def test_jupyterlab_is_one_command_away_in_exact_versions() -> None:
    root = FOLDER.parent
    project = tomllib.loads((root / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [re.split("[>=]", one)[0] for one in project["optional-dependencies"]["notebooks"]]
    assert wanted == ["ipykernel", "jupyterlab"]
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
