"""The server: what it answers, what it refuses, what it never tells, and that it can be killed."""

from __future__ import annotations

import json
import re
import socket
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from causal_openlock.errors import OpenLockError
from causal_openlock.experiment.reactions import read_reactions
from causal_openlock.play.server import MOST_BYTES, PlayServer
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.storage.store import Store
from causal_openlock.world.facts import room_facts
from support.command import at_once
from support.play_clients import Caller, people, serving, solving
from support.waiting import HANGS, until

pytestmark = pytest.mark.slow


@contextmanager
def in_a_thread(server: PlayServer) -> Iterator[PlayServer]:
    """A server that serves during the block, in this process."""
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    try:
        yield server
    finally:
        server.shutdown()
        thread.join()
        server.finish()


@pytest.fixture
def server(tmp_path: Path) -> Iterator[PlayServer]:
    with in_a_thread(PlayServer(people(tmp_path / "out", "CC3-CC4", practice=False))) as made:
        yield made


def exchange(server: PlayServer, sent: bytes) -> bytes:
    """Everything that is answered until the server closes the connection."""
    with socket.create_connection(("127.0.0.1", server.port), timeout=HANGS) as connection:
        connection.sendall(sent.replace(b"PORT", b"%d" % server.port))
        return b"".join(iter(lambda: connection.recv(4096), b""))


@pytest.fixture
def caller(server: PlayServer) -> Caller:
    return Caller(server.port)


def log(server: PlayServer) -> bytes:
    return (server.people.store.folder / "log.jsonl").read_bytes()


def test_a_click_is_answered_with_what_is_seen(server: PlayServer, caller: Caller) -> None:
    name = caller.join()
    _, state = caller.call("/state", name=name)
    bits = state["room"]["observation"]
    assert (state["turn"], state["trials"], len(bits), bits[14:]) == (0, 7, 16, [1, 0])
    first, second, door = solving(server.people, name)[0]
    for turn, action in enumerate((first, second)):
        call = {"turn": turn, "action": action, "reaction": 800}
        status, said = caller.call("/act", call, name)
        assert (status, said["moved"], said["attempt_over"]) == (200, True, False)
    assert said["outcome"][14] == 0
    _, said = caller.call("/act", {"turn": 2, "action": door, "reaction": 800}, name)
    assert (said["outcome"][15], said["new_solution"], said["attempt_over"]) == (1, True, True)
    assert said["next"]["room"]["observation"] == bits  # the room has gone back
    assert said["next"]["room"]["solutions_left"] == state["room"]["solutions_left"] - 1


NO_CALLS: list[Any] = [
    b"",
    b"{",
    b"[]",
    b"\xff",
    b"[" * (MOST_BYTES // 2),
    {},
    {"turn": 0},
    {"turn": "0", "action": 1},
    {"turn": 0, "action": 1.0},
    {"turn": True, "action": True},
    {"turn": 0, "action": -1},
    {"turn": 0, "action": 1, "reaction": "fast"},
    {"turn": 0, "action": 1, "reaction": -5},
    {"turn": 0, "action": 1, "reaction": 10**12},
]


def test_what_is_no_call_changes_nothing(server: PlayServer, caller: Caller) -> None:
    name = caller.join()
    before, held = caller.call("/state", name=name), log(server)
    for body in NO_CALLS:
        assert caller.call("/act", body, name)[0] == 400, body
    assert caller.call("/act", b" " * (MOST_BYTES + 1), name)[0] == 400
    caller.connection.close()
    for path in ("/nothing", "/../log.jsonl", "/%2e%2e/log.jsonl", "/static/play.js"):
        assert caller.call(path, name=name)[0] == 404
        assert caller.call(path, {"turn": 0, "action": 1}, name)[0] == 404
    for size in (0, 6, 13, 99):
        assert caller.call(f"/geometry/{size}")[0] == 400
    assert (caller.call("/state", name=name), log(server)) == (before, held)


def test_forged_replayed_and_early_calls_change_nothing(server: PlayServer, caller: Caller) -> None:
    name, other = caller.join(), caller.join()
    call = {"turn": 0, "action": 4, "reaction": 10}
    status, first = caller.call("/act", call, name)
    assert status == 200
    state, held = first["next"], log(server)
    # Replayed, early, and an action that the room does not have.
    for wrong in (call, {**call, "turn": 2}, {**call, "turn": 1, "action": 15}):
        status, said = caller.call("/act", wrong, name)
        assert (status, said["now"]) == (409, state)
    assert caller.call("/proceed", {"turn": 1}, name)[0] == 409  # there is no practice to leave
    # Forged: no session, another's name with a letter changed, the hash that is on file.
    key = json.loads(held.splitlines()[1].rpartition(b"\t")[0])["key"]
    for forged in (None, "", name[:-1] + ("A" if name[-1] != "A" else "B"), key, "ä"):
        assert caller.call("/act", {**call, "turn": 1}, forged)[0] == 404
        assert caller.call("/state", name=forged)[0] == 404
    in_the_address = {"Authorization": f"Basic {name}"}
    assert caller.call("/act", {**call, "turn": 1}, None, in_the_address)[0] == 404
    assert caller.call("/state", name=name)[1] == state
    assert caller.call("/state", name=other)[1]["turn"] == 0
    assert log(server) == held


def test_calls_of_other_sites_are_refused(server: PlayServer, caller: Caller) -> None:
    name = caller.join()
    call, held = {"turn": 0, "action": 4}, log(server)
    for foreign in (
        {"Host": "evil.example"},
        {"Host": f"evil.example:{server.port}"},
        {"Origin": "http://evil.example"},
        {"Origin": "null"},
    ):
        assert caller.call("/act", call, name, foreign)[0] == 403
        assert caller.call("/join", {}, None, foreign)[0] == 403
        assert caller.call("/", None, None, foreign)[0] == 403
    assert log(server) == held
    own = {"Origin": f"http://127.0.0.1:{server.port}"}
    assert caller.call("/act", call, name, own)[0] == 200
    assert caller.call("/", None, None, {"Host": f"localhost:{server.port}"})[0] == 200


@pytest.mark.parametrize("host", ["study.example.org", "127.0.0.1"])
def test_behind_a_proxy_the_address_that_people_use_is_ours_and_no_other(
    tmp_path: Path, host: str
) -> None:
    # Proxies either pass on the host that the browser asked for, or put their own name for us.
    with in_a_thread(PlayServer(people(tmp_path), address="https://Study.example.org")) as made:
        caller = Caller(made.port)
        passed_on = host if host != "127.0.0.1" else f"{host}:{made.port}"
        ours = {"Host": passed_on, "Origin": "https://study.example.org"}
        assert caller.call("/join", {}, None, ours)[0] == 200
        for wrong in (
            {"Host": passed_on, "Origin": "https://evil.example"},
            {"Host": passed_on, "Origin": "null"},
            {"Host": "evil.example", "Origin": "https://study.example.org"},
            {"Host": "evil.example", "Origin": "https://evil.example"},
        ):
            assert caller.call("/join", {}, None, wrong)[0] == 403
        assert made.people.number == 1


@pytest.mark.parametrize(
    "address",
    [
        *("study.example.org", "ftp://a.org", "https://a.org/rooms", "https://me@a.org", "://"),
        *("https://[", "https://a.org:x", "https://a.org:99999"),
    ],
)
def test_an_address_that_nobody_can_type_is_refused(tmp_path: Path, address: str) -> None:
    home = people(tmp_path)
    with pytest.raises(OpenLockError, match=r"give one such as https://study\.example\.org"):
        PlayServer(home, address=address)
    home.close()


def test_nothing_latent_is_in_any_answer(server: PlayServer, caller: Caller) -> None:
    name = caller.join()
    for path in ("/", "/play.js", "/room.js", "/arm.js", "/play.css", "/icon.svg", "/brief"):
        assert caller.call(path)[0] == 200
    caller.call("/geometry/7")
    random = np.random.default_rng(0)
    while (state := caller.call("/state", name=name)[1])["stage"] == "room":
        chosen = [random.integers(15, size=3).tolist(), *solving(server.people, name)]
        for action in [action for actions in chosen for action in actions]:
            call = {"turn": state["turn"], "action": int(action), "reaction": 5}
            state = caller.call("/act", call, name)[1].get("next") or state
            caller.call("/act", {**call, "turn": 0}, name)  # refused, and answered too
    text = "\n".join(caller.answers)
    latent = [*bundled_schemas(), *room_facts()["layouts"], "schema", "layout", "condition"]
    latent += ["L0", "L1", "L2", "L3", "common", "effect", "cause", "transfer"]
    found = [word for word in latent if re.search(rf"\b{word}", text, re.IGNORECASE)]
    assert not found
    # The search would find them: they are on file.
    kept = (server.people.store.folder / "experiment.json").read_text(encoding="utf-8")
    assert all(word in kept for word in ("CC3", "L0", "schema"))
    # And nothing but these names is ever told of a room.
    assert set(state) == {"stage", "turn", "positions", "trials", "ended"}
    rooms = [json.loads(a.rpartition("\n")[2]) for a in caller.answers if '"room":' in a]
    told = {key for said in rooms for key in (said.get("next") or said.get("now") or said)["room"]}
    left = {"solutions_left", "attempts_left", "actions_left"}
    assert told == {"over", "observation", "trial", "attempt", *left}


def test_the_page_loads_nothing_from_elsewhere_and_says_so(caller: Caller) -> None:
    for path in ("/", "/play.js", "/room.js", "/arm.js", "/play.css", "/icon.svg"):
        text = caller.call(path)[1]
        elsewhere = set(re.findall(r"https?://[\w.]+", text)) - {"http://www.w3.org"}
        assert not elsewhere
        assert not re.search(r"(src|href)=\"(?!/\w|#)", text)
        headers = caller.headers
        assert headers["X-Content-Type-Options"] == "nosniff"
        assert headers["Referrer-Policy"] == "no-referrer"
        assert "Server" not in headers
        policy = headers["Content-Security-Policy"]
        assert "default-src 'none'" in policy
        assert "unsafe" not in policy
        assert "frame-ancestors 'none'" in policy


def test_it_listens_on_loopback_and_keeps_session_ids_to_itself(
    server: PlayServer, caller: Caller
) -> None:
    assert server.host == "127.0.0.1"
    assert server.loopback
    name = caller.join()
    caller.call("/act", {"turn": 0, "action": 1}, name)
    server.people.keep()
    for path in server.people.store.folder.rglob("*"):
        assert path.is_dir() or name.encode() not in path.read_bytes()


def test_a_connection_that_sends_rubbish_or_nothing_is_no_harm(
    server: PlayServer, caller: Caller
) -> None:
    idle = socket.create_connection(("127.0.0.1", server.port))
    for rubbish in (b"\0\0\0\r\n\r\n", b"POST /join HTTP/1.1\r\n\r\n", b"GET / HTTP/9.9\r\n\r\n"):
        with socket.create_connection(("127.0.0.1", server.port), timeout=HANGS) as connection:
            connection.sendall(rubbish)
            assert connection.recv(100)
    smuggled = (
        b"GET /brief HTTP/1.1\r\nHost: localhost:%d\r\nContent-Length: 5\r\n\r\n" % server.port
    )
    with socket.create_connection(("127.0.0.1", server.port), timeout=HANGS) as connection:
        connection.sendall(smuggled + b"POST /join HTTP/1.1\r\nContent-Length: 2\r\n\r\n{}")
        received = b"".join(iter(lambda: connection.recv(4096), b""))
    assert received.count(b"HTTP/1.1 ") == 1
    assert server.people.number == 0
    assert caller.call("/brief")[0] == 200
    idle.close()


JOIN = b"POST /join HTTP/1.1\r\nHost: localhost:PORT\r\n"
ODD = {
    "both ends": JOIN + b"Transfer-Encoding: chunked\r\nContent-Length: 2\r\n\r\n{}",
    "chunked": JOIN + b"Transfer-Encoding: chunked\r\n\r\n2\r\n{}\r\n0\r\n\r\n",
    "chunked get": b"GET /brief HTTP/1.1\r\nHost: localhost:PORT\r\nTransfer-Encoding: x\r\n\r\n",
    "two lengths": JOIN + b"Content-Length: 2\r\nContent-Length: 30\r\n\r\n{}",
    "two hosts": JOIN + b"Host: evil.example\r\nContent-Length: 2\r\n\r\n{}",
    "space before colon": JOIN + b"Content-Length : 2\r\n\r\n{}",
    "no header": JOIN + b"nothing\r\nContent-Length: 2\r\n\r\n{}",
    "long number": JOIN + b"Content-Length: " + b"2" * 5000 + b"\r\n\r\n{}",
    "zeros": JOIN + b"Content-Length: " + b"0" * 5000 + b"2\r\n\r\n{}",
    "negative": JOIN + b"Content-Length: -2\r\n\r\n{}",
    "plus": JOIN + b"Content-Length: +2\r\n\r\n{}",
    "list": JOIN + b"Content-Length: 2, 3\r\n\r\n{}",
    "none": JOIN + b"\r\n{}",
    "too long": JOIN + b"Content-Length: 1025\r\n\r\n" + b" " * 1025,
    "no JSON": JOIN + b"Content-Length: 2\r\n\r\n{[",
    "deep": JOIN + b"Content-Length: 1000\r\n\r\n" + b"[" * 1000,
    "no UTF-8": JOIN + b"Content-Length: 2\r\n\r\n\xff\xfe",
    "no object": JOIN + b"Content-Length: 3\r\n\r\nNaN",
}


@pytest.mark.parametrize("sent", ODD.values(), ids=ODD)
def test_a_request_whose_end_is_in_doubt_is_refused_and_is_the_last(
    server: PlayServer, sent: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    received = exchange(server, sent)
    assert received.startswith(b"HTTP/1.1 400 ")
    assert received.count(b"HTTP/1.1 ") == 1
    assert b"connection: close" in received.lower()
    assert server.people.number == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "head",
    [
        b"Content-Length: 2, 2\r\n",  # one length, and RFC 9110 (8.6) lets a server take it as such
        b"Content-Length: 2\r\nContent-Length: 2\r\n",
        b"X: a\r\n Content-Length: 9\r\nContent-Length: 2\r\n",  # a fold is a space (RFC 9112, 5.2)
    ],
)
def test_a_request_whose_end_is_certain_is_answered_once(server: PlayServer, head: bytes) -> None:
    received = exchange(server, JOIN + head + b"Connection: close\r\n\r\n{}")
    assert received.startswith(b"HTTP/1.1 200 ")
    assert received.count(b"HTTP/1.1 ") == 1
    assert server.people.number == 1


def test_a_request_that_breaks_off_does_nothing(
    server: PlayServer, caller: Caller, capfd: pytest.CaptureFixture[str]
) -> None:
    with socket.create_connection(("127.0.0.1", server.port), timeout=HANGS) as connection:
        connection.sendall(JOIN.replace(b"PORT", b"%d" % server.port))
        connection.sendall(b"Content-Length: 9\r\n\r\n{}")
        connection.shutdown(socket.SHUT_WR)
        assert b"200 OK" not in b"".join(iter(lambda: connection.recv(4096), b""))
    assert caller.call("/brief")[0] == 200
    assert server.people.number == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize("sent", [b"", JOIN, JOIN + b"Content-Length: 9\r\n\r\n{}"])
def test_a_connection_from_which_nothing_more_comes_is_closed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: bytes
) -> None:
    for limit in ("IDLE", "DEADLINE"):
        monkeypatch.setattr(f"causal_openlock.play.connections.{limit}", 0.2)
    with in_a_thread(PlayServer(people(tmp_path))) as server:
        assert exchange(server, sent) == b""
        assert server.people.number == 0


@pytest.mark.parametrize("head", [JOIN, JOIN + b"Content-Length: 2000\r\n\r\n"])
def test_a_request_that_comes_byte_by_byte_is_closed_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, head: bytes
) -> None:
    monkeypatch.setattr("causal_openlock.play.connections.DEADLINE", 0.2)
    with in_a_thread(PlayServer(people(tmp_path))) as server:
        with socket.create_connection(("127.0.0.1", server.port)) as slow:
            slow.sendall(head.replace(b"PORT", b"%d" % server.port))
            slow.settimeout(0.001)

            def is_closed() -> bool:
                slow.sendall(b"X")
                with suppress(TimeoutError):
                    return slow.recv(1) == b""
                return False

            with suppress(ConnectionError):
                until(is_closed)
        assert Caller(server.port).call("/brief")[0] == 200


@pytest.mark.parametrize("begun", [b"", b"X", JOIN + b"Content-Length: 9\r\n\r\n{"])
def test_connections_that_send_little_keep_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, begun: bytes
) -> None:
    for where in ("connections", "server"):
        monkeypatch.setattr(f"causal_openlock.play.{where}.MOST_CONNECTIONS", 8)
    with in_a_thread(PlayServer(people(tmp_path, practice=False))) as server:
        before = Caller(server.port)
        name = before.join()
        with ExitStack() as opened:
            for _ in range(7):
                slow = opened.enter_context(socket.create_connection(("127.0.0.1", server.port)))
                slow.sendall(begun.replace(b"PORT", b"%d" % server.port))
            # One who was there keeps their connection; others find a place.
            assert before.call("/act", {"turn": 0, "action": 1}, name)[0] == 200
            callers = [Caller(server.port) for _ in range(5)]
            for turn, caller in enumerate(callers, start=1):
                assert caller.call("/act", {"turn": turn, "action": 1}, name)[0] == 200
            assert before.call("/act", {"turn": 6, "action": 1}, name)[0] == 200


def test_ctrl_c_waits_for_nobody(tmp_path: Path) -> None:
    with serving(tmp_path, "--condition", "CC4") as server:
        idle = socket.create_connection((server.host, server.port))
        half = socket.create_connection((server.host, server.port))
        half.sendall(JOIN.replace(b"PORT", b"%d" % server.port) + b"Content-Length: 9\r\n\r\n{}")
        assert Caller(server.port).call("/brief")[0] == 200
        assert server.stop() == ""
        idle.close()
        half.close()


@pytest.mark.skipif(not socket.has_dualstack_ipv6(), reason="there is no IPv6 here")
def test_it_listens_on_ipv6_too(tmp_path: Path) -> None:
    with in_a_thread(PlayServer(people(tmp_path), "::1")) as server:
        assert server.url == f"http://[::1]:{server.port}/"
        assert server.loopback
        assert Caller(server.port, "::1").call("/brief")[0] == 200
        foreign = {"Host": f"evil.example:{server.port}"}
        assert Caller(server.port, "::1").call("/brief", headers=foreign)[0] == 403


@pytest.mark.parametrize(
    "origin",
    ["http://[", "http://[::1", "//", "null", "", "http://", "http://localhost:x@a", "\xe4", "a b"],
)
def test_an_origin_that_is_none_is_another_site(
    server: PlayServer, caller: Caller, origin: str, capfd: pytest.CaptureFixture[str]
) -> None:
    assert caller.call("/join", {}, None, {"Origin": origin})[0] == 403
    assert caller.call("/brief", None, None, {"Origin": origin})[0] == 403
    assert server.people.number == 0
    assert capfd.readouterr().err == ""


@pytest.mark.parametrize(
    "body",
    [
        *(b'{"turn": NaN, "action": 1}', b'{"turn": 0, "action": 1e999}', b'{"turn": -0.0}'),
        *(b'{"turn": true, "action": 1}', b'{"turn": "0", "action": 1}', b'{"turn": [0]}'),
        b'{"turn": 0, "action": 1, "reaction": Infinity}',
        b'{"turn": 0, "action": ' + b"9" * 900 + b"}",
    ],
)
def test_numbers_that_are_none_are_refused(
    server: PlayServer, caller: Caller, body: bytes, capfd: pytest.CaptureFixture[str]
) -> None:
    name = caller.join()
    before = log(server)
    assert caller.call("/act", body, name)[0] == 400
    assert log(server) == before
    assert capfd.readouterr().err == ""


def test_old_and_long_requests_are_answered_without_a_traceback(
    server: PlayServer, capfd: pytest.CaptureFixture[str]
) -> None:
    for sent in (
        b"GET /brief\r\n",
        b"GET /brief HTTP/1.0\r\n\r\n",
        b"GET /brief HTTP/1.1\r\nX: " + b"x" * 70_000 + b"\r\n\r\n",
        b"GET /brief HTTP/1.1\r\n" + b"X: x\r\n" * 200 + b"\r\n",
        b"GET /" + b"x" * 70_000 + b" HTTP/1.1\r\n\r\n",
        b"TRACE / HTTP/1.1\r\n\r\n",
    ):
        with (
            socket.create_connection(("127.0.0.1", server.port), timeout=5) as connection,
            suppress(ConnectionError),  # it may close before it has read all
        ):
            connection.sendall(sent)
            connection.shutdown(socket.SHUT_WR)
            received = b"".join(iter(lambda: connection.recv(4096), b""))
            assert b"200 OK" not in received
    assert capfd.readouterr().err == ""


def test_a_server_that_is_killed_goes_on_where_it_was(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    acted: dict[str, list[int]] = {}
    states: dict[str, Any] = {}

    def click(caller: Caller, names: list[str], many: int) -> None:
        for _ in range(many):
            for name in names:
                turn = states[name]["turn"] if name in states else 0
                action = (7 * turn + len(name) + names.index(name)) % 15
                status, said = caller.call("/act", {"turn": turn, "action": action}, name)
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
        server.stop()
    rows = read_reactions(folder).to_pandas()
    by_person = [rows[rows["subject"] == k]["action"].tolist() for k in range(3)]
    assert by_person == [acted[name] for name in names]
    record = Store(folder).record()[0].to_pandas()
    assert record.groupby("subject").size().to_dict() == {0: 30, 1: 30, 2: 30}
    third = record[record["subject"] == 2]["actions"]
    assert [action for attempt in third for action in attempt] == acted[names[2]][:90]


def test_the_record_is_written_while_people_play(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("causal_openlock.play.server.KEEP_EVERY", 1.0)
    with in_a_thread(PlayServer(people(tmp_path, practice=False))) as server:
        caller = Caller(server.port)
        name = caller.join()
        for turn in range(90):
            caller.call("/act", {"turn": turn, "action": 1}, name)
        until(lambda: list((tmp_path / "cells").glob("*.parquet")))
        until(lambda: json.loads((tmp_path / "experiment.json").read_text())["cells"])
        assert Store(tmp_path).record()[0].num_rows == 30


def test_mistakes_on_the_command_line_are_one_sentence(tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        for words, says in [
            (["--port", port], "choose another with --host or --port"),
            (["--condition", "CC5"], "did you mean"),
            (["--protocol", "humen"], "did you mean human"),
            (["--host", "no.such.host.invalid"], "cannot listen on no.such.host.invalid"),
        ]:
            # None comes to serve, if taken for no mistake: the port is taken.
            where = () if "--port" in words else ("--port", port)
            done = at_once("play", "--no-browser", *words, *where, "--out", tmp_path / "out")
            assert (done.status, done.stderr.count("\n")) == (2, 1), done.stderr
            assert says in done.stderr
