"""Playing needs packages that comparing does not: without them, a sentence says what to install."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest

from support.command import at_once


@pytest.mark.parametrize("missing", ["uvicorn", "starlette"])
def test_without_its_packages_play_says_what_to_install(
    missing: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in [*sys.modules]:
        if name.startswith(("causal_openlock.play.server", f"{missing}.")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, missing, None)
    done = at_once("play", "--no-browser", cwd=tmp_path)
    assert done.status == 2
    assert f"playing needs the package {missing}" in done.stderr
    assert "pip install 'causal-openlock[play]'" in done.stderr
    assert not [*tmp_path.iterdir()]
