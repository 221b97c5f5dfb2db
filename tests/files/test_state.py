"""States in files: texts that are none."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.files.state import StateError, open_archive


@pytest.mark.parametrize("point", [0xD800, 0xDFFF, 0x110000, 0x7FFFFFFF])
@pytest.mark.parametrize("order", ["<", ">"])
def test_a_text_that_is_not_unicode_is_refused(tmp_path: Path, point: int, order: str) -> None:
    """NumPy makes a text of any number, and a validator written in Rust ends at it."""
    letters = np.array([ord("a"), point], np.dtype("u4").newbyteorder(order))
    file = io.BytesIO()
    np.save(file, letters.view(np.dtype("U2").newbyteorder(order)).reshape(()))
    with zipfile.ZipFile(tmp_path / "one.npz", "w") as packed:
        packed.writestr("about.npy", file.getvalue())
    with (
        pytest.raises(StateError, match="not Unicode"),
        open_archive(tmp_path / "one.npz") as archive,
    ):
        archive.read("about")


def test_other_texts_are_read(tmp_path: Path) -> None:
    np.savez(tmp_path / "one.npz", about=np.array("é 🙂 \U0010ffff"))
    with open_archive(tmp_path / "one.npz") as archive:
        assert str(archive.read("about")) == "é 🙂 \U0010ffff"
