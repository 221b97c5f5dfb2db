"""The notebooks, run as they stand, each in a fresh kernel."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

FOLDER = Path(__file__).parent.parent / "notebooks"
NOTEBOOKS = sorted(FOLDER.glob("*.ipynb"))
A_CELL = 240  # seconds
assert NOTEBOOKS, "there is nothing to test"
pytestmark = pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)


def code_cells(notebook: Any) -> list[Any]:
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def test_it_runs_from_top_to_bottom_and_shows_pictures(path: Path, tmp_path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    # What tests are told about pictures is not for the kernel, which hands them over.
    environment = {key: value for key, value in os.environ.items() if key != "MPLBACKEND"}
    environment["IPYTHONDIR"] = str(tmp_path / "ipython")
    client = NotebookClient(
        notebook, timeout=A_CELL, resources={"metadata": {"path": str(tmp_path)}}
    )
    client.execute(env=environment)
    outputs = [output for cell in code_cells(notebook) for output in cell.outputs]
    warnings = [output.text for output in outputs if output.get("name") == "stderr"]
    assert warnings == []
    assert sum("image/png" in output.get("data", {}) for output in outputs) >= 5


def test_it_is_kept_without_outputs(path: Path) -> None:
    notebook = nbformat.read(path, as_version=4)
    nbformat.validate(notebook)
    cells = code_cells(notebook)
    assert cells
    assert [cell.outputs for cell in cells] == [[]] * len(cells)
    assert [cell.execution_count for cell in cells] == [None] * len(cells)
    assert [dict(cell.metadata) for cell in notebook.cells] == [{}] * len(notebook.cells)
    assert "widgets" not in notebook.metadata


def test_its_cells_are_short(path: Path) -> None:
    cells = code_cells(nbformat.read(path, as_version=4))
    longest = max(cells, key=lambda cell: len(cell.source.splitlines()))
    assert len(longest.source.splitlines()) <= 25, longest.source
