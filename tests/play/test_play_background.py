"""A room opened in the browser from a notebook or a script, where an event loop may run already."""

from __future__ import annotations

import asyncio
import json
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path
from typing import Any

import pytest

import causal_openlock as ol
from causal_openlock.experiment.store import Store
from causal_openlock.play.background import OpenedRoom


def asked(opened: OpenedRoom, path: str, **sent: Any) -> Any:
    """What the server answers."""
    who = sent.pop("id", None)
    body = json.dumps(sent).encode() if sent or path == "join" else None
    headers = {"Authorization": f"Bearer {who}"} if who else {}
    request = urllib.request.Request(opened.url + path, body, headers)
    with urllib.request.urlopen(request, timeout=20) as answer:
        return json.load(answer)


def test_a_schema_is_played_while_a_loop_runs_and_until_it_is_closed(tmp_path: Path) -> None:
    async def in_a_notebook() -> OpenedRoom:
        opened: OpenedRoom = ol.schema("A -> door").play(browser=False, out=tmp_path / "mine")
        return opened

    opened = asyncio.run(in_a_notebook())
    assert repr(opened) == f"<OpenedRoom at {opened.url}>"
    me = asked(opened, "join")["id"]
    room = asked(opened, "state", id=me)
    assert (room["stage"], room["room"]["solutions_left"]) == ("room", 1)
    grey = room["room"]["observation"].index(1, 7) - 7
    for turn, action in enumerate((grey, 14)):
        after = asked(opened, "act", id=me, turn=turn, action=action, reaction=None)
    assert after["new_solution"]
    opened.close()
    opened.close()
    assert repr(opened) == "<OpenedRoom, closed>"
    with pytest.raises(urllib.error.URLError):
        asked(opened, "brief")
    assert Store(tmp_path / "mine").record()[0].num_rows == 1


def test_a_temporary_folder_is_gone_afterwards(monkeypatch: pytest.MonkeyPatch) -> None:
    pages: list[str] = []
    monkeypatch.setattr("webbrowser.open", pages.append)
    with ol.play_room("CC3") as opened:
        assert opened.folder.is_dir()
        assert asked(opened, "brief")["positions"] == 7
    assert not opened.folder.exists()
    assert pages == [opened.url]


AT_THE_END = """
import causal_openlock as ol
print(ol.schema("CC3").play(browser=False).folder)
"""


def test_it_is_closed_when_python_ends() -> None:
    done = subprocess.run(
        [sys.executable, "-c", AT_THE_END], capture_output=True, text=True, timeout=60, check=True
    )
    assert done.stderr == ""
    assert not Path(done.stdout.strip()).exists()
