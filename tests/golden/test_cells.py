"""What learners do: the contents of cells, without wall times, as digests in ``cells/*.txt``.

Cells are told by learner, condition and subjects; names of files, metadata and compression do not
count. A cell that differs says where: in what it was to play, in what was done, in what that led
to, or in what it paid.
"""

import hashlib
import json
from pathlib import Path

import pyarrow.parquet as pq
import pytest

import causal_openlock as ol
from support.command import modules_of

CELLS = Path(__file__).parent / "cells"
DIGESTS = {
    "plan": "experiment learner condition protocol subject seed phase loop trial schema layout",
    "done": "attempt actions",
    "led to": "moved unlocked opened solution new_solution solutions_found solutions category",
    "paid": "reward",
}


@pytest.mark.parametrize(
    ("name", "processor"),
    [
        ("learners", False),
        ("protocols", False),
        ("rewards", False),
        ("rooms", False),
        ("networks", True),  # last digits, and so what is done, depend on it
    ],
)
def test_cells_have_the_contents_that_are_stored(name, processor, tmp_path, golden):
    with modules_of(CELLS):
        ol.run(ol.read_experiment(CELLS / f"{name}.yaml"), tmp_path, workers=0)
    cells = sorted((tmp_path / "cells").glob("*.parquet"))
    golden(f"cells/{name}.txt", "\n".join(map(line_of, cells)), processor)


def line_of(cell):
    """Name, size and digests of a cell."""
    columns = pq.read_table(cell).drop_columns("wall_time").to_pydict()
    words = [f"{cell.stem.rpartition('_')[0]}:", f"{len(columns['attempt'])} attempts,"]
    words += [f"{sum(columns['new_solution'])} found,", f"reward {sum(columns['reward']):g};"]
    for what, names in DIGESTS.items():
        content = json.dumps([columns.pop(name) for name in names.split()])
        words += [what, hashlib.sha256(content.encode()).hexdigest()[:8]]
    assert not columns, f"columns without a digest: {list(columns)}"
    return " ".join(words)
