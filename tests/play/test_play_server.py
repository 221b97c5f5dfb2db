"""The server: what it answers, what it refuses, what it never tells, and that it can be killed."""

import asyncio
import json
import os
import re
import subprocess
import sys
import threading
import urllib.error
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.experiment.beside_record import read_answers, read_reactions
from causal_openlock.play.server import MOST_BYTES, PlayServer
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.storage.store import Store
from causal_openlock.world.facts import room_facts
from support.command import at_once
from support.play_clients import (
    Caller,
    asked,
    people,
    play_one_lever,
    serving,
    solving,
    walk_through,
)
from support.waiting import until

pytestmark = pytest.mark.slow


@contextmanager
def in_a_thread(server):
    """A server that serves during the block, in this process."""
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.people.close()


@pytest.fixture
def server(tmp_path):
    with in_a_thread(PlayServer(people(tmp_path / "out", "CC3-CC4", practice=False))) as made:
        yield made


@pytest.fixture
def caller(server):
    return Caller(server.port)


def log(server):
    return (server.people.store.folder / "log.jsonl").read_bytes()


# -- what is answered -----------------------------------------------------------------------------


def test_nothing_latent_is_in_any_answer(server, caller):
    name = caller.join()
    for path in ("/", "/play.js", "/room.js", "/play.css", "/figure.svg", "/brief"):
        assert caller.call(path)[0] == 200
    random = np.random.default_rng(0)
    while (state := caller.call("/state", name=name)[1])["stage"] == "room":
        chosen = [random.integers(15, size=3).tolist(), *solving(server.people, name)]
        for action in [action for actions in chosen for action in actions]:
            call = {"turn": state["turn"], "action": int(action), "reaction": 5}
            state = caller.call("/turn", call, name)[1].get("next") or state
            caller.call("/turn", {**call, "turn": 0}, name)  # refused, and answered too
    text = "\n".join(caller.answers)
    latent = [*bundled_schemas(), *room_facts()["layouts"], "schema", "layout", "condition"]
    latent += ["L0", "L1", "L2", "L3", "common", "effect", "cause", "transfer"]
    assert not [word for word in latent if re.search(rf"\b{word}", text, re.IGNORECASE)]
    # The search would find them: they are on file.
    stored = (server.people.store.folder / "experiment.json").read_text(encoding="utf-8")
    assert all(word in stored for word in ("CC3", "L0", "schema"))
    # And nothing but these names is ever told of a room.
    assert set(state) == {"stage", "turn", "positions", "trials", "ended"}
    rooms = [json.loads(a.rpartition("\n")[2]) for a in caller.answers if '"room":' in a]
    told = {key for said in rooms for key in (said.get("next") or said.get("now") or said)["room"]}
    left = {"solutions_left", "attempts_left", "actions_left"}
    assert told == {"over", "observation", "trial", "attempt", "action_limit", *left}


def test_the_page_loads_nothing_from_elsewhere_and_says_so(caller):
    for path in ("/", "/play.js", "/room.js", "/play.css", "/figure.svg"):
        text = caller.call(path)[1]
        assert not set(re.findall(r"https?://[\w.]+", text)) - {"http://www.w3.org"}
        assert not re.search(r"(src|href)=\"(?!/\w|#)", text)
        headers = caller.headers
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert "Server" not in headers
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy


def test_a_study_has_consent_questions_and_a_link_at_the_end(tmp_path):
    home = people(tmp_path, consent="*Yes* <script>", practice=False, ask=True, recruiting=["PID"])
    link, counts = "https://app.prolific.com/submissions/complete?cc=C0DE&who=%PID%", []
    made = PlayServer(
        home, completion=link, changed=lambda: counts.append((home.number, home.finished))
    )
    with in_a_thread(made) as server:
        caller = Caller(server.port)
        _, brief = caller.call("/brief")
        assert brief["consent"] == "<p><em>Yes</em> &lt;script&gt;</p>\n"
        assert brief["recruiting"] == ["PID"]
        mark = brief["consent_mark"]
        for sent, status in (
            ({"agreed": ""}, 403),
            ({"agreed": "0" * 16}, 403),  # another text, such as before a restart
            ({"agreed": True}, 400),
            ({"agreed": mark, "recruited": {"PID": "<b>"}}, 400),
        ):
            assert caller.call("/join", sent, "A" * 32)[0] == status
        join = {"agreed": mark, "recruited": {"PID": "5f&<b>"}}
        me, again = "B" * 32, "C" * 32
        for _ in range(2):  # the answer to the first call was lost
            assert caller.call("/join", join, me)[1]["stage"] == "room"
        until(lambda: counts == [(1, 0)])
        while (now := caller.call("/state", name=me)[1])["stage"] != "end":
            assert "C0DE" not in str([brief, now])
            walk_through(home, me, 1)
            now = caller.call("/state", name=me)[1]
            edges = [[now["levers"][0], 7]]
            _, now = caller.call("/turn", {"turn": now["turn"], "edges": edges}, me)
        assert now["completion"] == link.replace("%PID%", "5f%26%3Cb%3E")
        assert caller.call("/state", name=me)[1] == now
        until(lambda: counts == [(1, 0), (1, 1)])
        assert caller.call("/join", join, again)[1] == now  # as in another browser
    *_, last = (pair for pair in read_answers(tmp_path).to_pylist() if pair["enables"])
    assert [last["cause"], last["effect"]] == edges[0]


# -- what is refused ------------------------------------------------------------------------------


NO_CALLS = [
    *(b"", b"{", b"[]", b"\xff", b"[" * (MOST_BYTES // 2), b" " * (MOST_BYTES + 1)),
    *({}, {"action": 1}, {"turn": "0", "action": 1}, {"turn": 0, "action": 1.0}),
    *({"turn": True, "action": True}, {"turn": 0, "action": -1}, {"turn": -1, "action": 1}),
    *({"turn": 0, "action": 1, "reaction": wrong} for wrong in ("fast", -5, 10**12)),
    *(b'{"turn": NaN, "action": 1}', b'{"turn": 0, "action": 1e999}'),
    b'{"turn": 0, "action": ' + b"9" * 900 + b"}",
]


def test_what_is_no_call_changes_nothing(server, caller, capfd):
    name = caller.join()
    before, held = caller.call("/state", name=name), log(server)
    for body in NO_CALLS:
        assert caller.call("/turn", body, name)[0] == 400, body
        caller.connection.close()  # nothing more is read from this one
    for path in ("/nothing", "/../log.jsonl", "/%2e%2e/log.jsonl", "/static/play.js"):
        assert caller.call(path, name=name)[0] == 404
        assert caller.call(path, {"turn": 0, "action": 1}, name)[0] in (404, 405)
    for wrong in (None, "", name[:-1], f"{name}A", f"{name[:-1]}é"):
        assert caller.call("/join", {}, wrong)[0] == 400
    assert server.people.number == 1
    for edges in ([[1]], [3], [[1, True]], [[-1, 7]], [[1, 7], [1, 7, 7]]):
        assert caller.call("/turn", {"turn": 0, "edges": edges}, name)[0] == 400
    assert (caller.call("/state", name=name), log(server)) == (before, held)
    assert capfd.readouterr().err == ""


def test_forged_replayed_and_early_calls_change_nothing(server, caller):
    name, other = caller.join(), caller.join()
    call = {"turn": 0, "action": 4, "reaction": 10}
    status, first = caller.call("/turn", call, name)
    assert status == 200
    state, held = first["next"], log(server)
    # Replayed, early, and an action that the room does not have.
    for wrong in (call, {**call, "turn": 2}, {**call, "turn": 1, "action": 15}):
        status, said = caller.call("/turn", wrong, name)
        assert (status, said["now"]) == (409, state)
    assert caller.call("/turn", {"turn": 1}, name)[0] == 409  # there is no practice to leave
    # Forged: no session, another's name with a letter changed, the hash that is on file.
    key = json.loads(held.splitlines()[1])["key"]
    for forged in (None, "", name[:-1] + ("A" if name[-1] != "A" else "B"), key, "ä"):
        assert caller.call("/turn", {**call, "turn": 1}, forged)[0] == 404
        assert caller.call("/state", name=forged)[0] == 404
    basic = {"Authorization": f"Basic {name}"}
    assert caller.call("/turn", {**call, "turn": 1}, None, basic)[0] == 404
    assert caller.call("/state", name=name)[1] == state
    assert caller.call("/state", name=other)[1]["turn"] == 0
    assert log(server) == held
    for path in server.people.store.folder.rglob("*"):  # session ids are not on file
        assert path.is_dir() or name.encode() not in path.read_bytes()


@pytest.mark.parametrize("address", ["", "https://Study.example.org"])
def test_calls_of_other_sites_are_refused(tmp_path, address):
    with in_a_thread(PlayServer(people(tmp_path), address=address)) as made:
        caller, here = Caller(made.port), f"127.0.0.1:{made.port}"
        # Proxies either pass on the host that was asked for, or put their own name for us.
        hosts = {here: 200, "localhost": 200, "evil.example": 400, "": 400}
        hosts["study.example.org"] = 200 if address else 400
        for number, (host, status) in enumerate(hosts.items()):
            name = f"{number:032}"
            assert caller.call("/join", {}, name, {"Host": host})[0] == status, host
            assert caller.call("/", None, None, {"Host": host})[0] == status
        assert made.people.number == [*hosts.values()].count(200)
        # A foreign page can call this machine by its own name, though not say which session it is.
        evil = {"Host": here, "Origin": "http://evil.example", "Content-Type": "text/plain"}
        assert caller.call("/join", {}, None, evil)[0] == 400
        caller.connection.request("OPTIONS", "/join", headers=evil)  # may it send Authorization?
        answer = caller.connection.getresponse()
        answer.read()
        assert answer.status == 405
        assert not [name for name in answer.headers if name.lower().startswith("access-control")]
        assert made.people.number == [*hosts.values()].count(200)


def test_without_its_packages_play_says_what_to_install(tmp_path, monkeypatch):
    for name in [*sys.modules]:
        if name.startswith(("causal_openlock.play.server", "causal_openlock.play.web", "uvicorn.")):
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    done = at_once("play", "--no-browser", cwd=tmp_path)
    assert done.status == 2
    assert "uvicorn" in done.stderr
    assert "pip install 'causal-openlock[play]'" in done.stderr
    assert not [*tmp_path.iterdir()]


# -- servers that are stopped, killed and started again -------------------------------------------


def test_a_server_that_is_killed_goes_on_where_it_was(tmp_path):
    folder = tmp_path / "out"
    acted, states = {}, {}

    def click(caller, names, many):
        for _ in range(many):
            for name in names:
                turn = states[name]["turn"] if name in states else 0
                action = (7 * turn + len(name) + names.index(name)) % 15
                status, said = caller.call("/turn", {"turn": turn, "action": action}, name)
                assert status == 200
                acted.setdefault(name, []).append(action)
                states[name] = said["next"]

    with serving(folder, "--condition", "CC4", "--no-practice") as server:
        caller = Caller(server.port)
        names = [caller.join() for _ in range(3)]
        click(caller, names, 95)
        server.kill()
    with serving(folder, "--condition", "CC4", "--no-practice") as server:
        caller = Caller(server.port)
        for name in names:
            assert caller.call("/state", name=name)[1] == states[name]
        click(caller, names, 4)
        assert server.stop() == ""
    rows = read_reactions(folder).to_pandas()
    by_person = [rows[rows["subject"] == k]["action"].tolist() for k in range(3)]
    assert by_person == [acted[name] for name in names]
    record = Store(folder).record()[0].to_pandas()
    assert record.groupby("subject").size().to_dict() == {0: 30, 1: 30, 2: 30}
    third = record[record["subject"] == 2]["actions"]
    assert [action for attempt in third for action in attempt] == acted[names[2]][:90]


def test_the_record_is_written_while_people_play(tmp_path, monkeypatch):
    monkeypatch.setattr("causal_openlock.play.web.KEEP_EVERY", 1.0)
    with in_a_thread(PlayServer(people(tmp_path, practice=False))) as server:
        caller = Caller(server.port)
        name = caller.join()
        for turn in range(90):
            caller.call("/turn", {"turn": turn, "action": 1}, name)
        until(lambda: list((tmp_path / "cells").glob("*.parquet")))
        until(lambda: json.loads((tmp_path / "experiment.json").read_text())["cells"])
        assert Store(tmp_path).record()[0].num_rows == 30


def test_a_room_is_opened_while_a_loop_runs_as_in_a_notebook(tmp_path, monkeypatch):
    pages = []
    monkeypatch.setattr("webbrowser.open", pages.append)

    async def in_a_notebook():
        return ol.schema("A -> door").play(browser=False, out=tmp_path / "mine")

    opened = asyncio.run(in_a_notebook())
    assert opened.url in repr(opened)
    play_one_lever(opened.url)
    for _ in range(2):
        opened.close()
    assert "closed" in repr(opened)
    with pytest.raises(urllib.error.URLError):
        asked(opened.url, "brief")
    assert Store(tmp_path / "mine").record()[0].num_rows == 1
    with ol.play_room("CC3") as opened:
        assert opened.folder.is_dir()
        assert asked(opened.url, "brief")["positions"] == 7
    assert not opened.folder.exists()  # a temporary one
    assert pages == [opened.url]


AT_THE_END = """
import sys
import causal_openlock as ol
from support.play_clients import play_one_lever
play_one_lever(ol.play_room("A -> door", browser=False, out=sys.argv[1]).url)
print(ol.schema("CC3").play(browser=False).folder)
"""


def test_a_room_is_closed_when_python_ends(tmp_path):
    tests = str(Path(__file__).parents[1])
    done = subprocess.run(
        [sys.executable, "-c", AT_THE_END, tmp_path / "mine"],
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join([tests, *sys.path[1:]])},
    )
    assert done.stderr == ""
    assert not Path(done.stdout.strip()).exists()
    assert Store(tmp_path / "mine").record()[0].num_rows == 1
