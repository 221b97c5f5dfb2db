"""A room opened in the browser from a notebook or a script, where an event loop may run already."""

from __future__ import annotations

import asyncio
import os
import subprocess
import sys
import urllib.error
from pathlib import Path

import pytest

import causal_openlock as ol
from causal_openlock.play.background import OpenedRoom
from causal_openlock.storage.store import Store
from support.play_clients import asked, play_one_lever


def test_a_schema_is_played_while_a_loop_runs_and_until_it_is_closed(tmp_path: Path) -> None:
    async def in_a_notebook() -> OpenedRoom:
        opened: OpenedRoom = ol.schema("A -> door").play(browser=False, out=tmp_path / "mine")
        return opened

    opened = asyncio.run(in_a_notebook())
    assert repr(opened) == f"<OpenedRoom at {opened.url}>"
    play_one_lever(opened.url)
    opened.close()
    opened.close()
    assert repr(opened) == "<OpenedRoom, closed>"
    with pytest.raises(urllib.error.URLError):
        asked(opened.url, "brief")
    assert Store(tmp_path / "mine").record()[0].num_rows == 1


def test_a_temporary_folder_is_gone_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    pages: list[str] = []
    monkeypatch.setattr("webbrowser.open", pages.append)
    with ol.play_room("CC3") as opened:
        assert opened.folder.is_dir()
        assert asked(opened.url, "brief")["positions"] == 7
    assert not opened.folder.exists()
    assert pages == [opened.url]


AT_THE_END = """
import sys
import causal_openlock as ol
from support.play_clients import play_one_lever
one, other = "A -> door", ol.schema("CC3")
play_one_lever(ol.play_room(one, browser=False, out=sys.argv[1]).url)
print(other.play(browser=False).folder)
"""


def test_it_is_closed_when_python_ends(tmp_path: Path) -> None:
    command = [sys.executable, "-c", AT_THE_END, str(tmp_path / "mine")]
    tests = str(Path(__file__).parents[1])
    paths = os.pathsep.join(filter(None, [tests, os.environ.get("PYTHONPATH")]))
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env={**os.environ, "PYTHONPATH": paths},
    )
    assert done.stderr == ""
    assert not Path(done.stdout.strip()).exists()
    assert Store(tmp_path / "mine").record()[0].num_rows == 1
