"""What a study needs: people are asked about rooms, agree, are recruited, and can be forgotten."""

from __future__ import annotations

from pathlib import Path

import pytest

from causal_openlock import Results
from causal_openlock.errors import StoreError
from causal_openlock.experiment.answers import read_answers
from causal_openlock.play.forgetting import forget_person
from causal_openlock.play.refusals import (
    HasBegun,
    HasFinished,
    NotAgreed,
    NotIdentified,
    OutOfTurn,
    UnknownPerson,
)
from causal_openlock.storage import store
from support.command import at_once
from support.play_clients import asked, people, solving, walk_through
from support.waiting import until


def room_of(home, name: str):
    truth = home._find(name).game.session.truth
    return truth.rooms[int(truth.room[0])]


def true_edges(room) -> list[list[int]]:
    place = {**dict(zip(room.schema.levers, room.layout.places, strict=True)), "door": 7}
    return [[place[cause], place[effect]] for cause, effect in room.schema.graph.edges]


def answered(home, name: str, rooms: int = 99) -> None:
    """Solve rooms, and say the truth of each."""
    for _ in range(rooms):
        if home.view(name)["stage"] == "end":
            return
        room = room_of(home, name)
        walk_through(home, name, 1)
        view = home.view(name)
        assert view["stage"] == "question"
        assert view["levers"] == sorted(room.layout.places)
        assert "room" not in view
        home.answer(name, view["turn"], true_edges(room))


def test_people_are_asked_after_each_room_and_what_they_say_is_scored(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3-CE4", practice=False, ask=True, seed=2)
    name = home.join()
    answered(home, name, 2)
    room = room_of(home, name)
    walk_through(home, name, 1)
    turn = home.view(name)["turn"]
    grey = sorted(room.layout.places)
    white = next(place for place in range(7) if place not in grey)
    for edges in ([[white, 7]], [[grey[0], grey[0]]], [[grey[0], 8]], [[7, grey[0]]], [[1]], [3]):
        with pytest.raises(OutOfTurn):
            home.answer(name, turn, edges)
    with pytest.raises(OutOfTurn):
        home.act(name, turn, grey[0], None)
    home.close()
    again = people(tmp_path, "CC3-CE4", practice=False, ask=False, seed=2)  # who joined is asked on
    again.answer(name, turn, [])
    answered(again, name)
    assert again.view(name)["stage"] == "end"
    again.close()
    told = read_answers(tmp_path)
    assert [answer.visit for answer in told] == [1, 2, 3, 4, 5, 6, 7]
    table = Results.read(tmp_path).structure_recovery
    assert table["shd"].tolist() == [0, 0, 4, 0, 0, 0, 0]
    assert table["f1"].tolist() == [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0]


def test_nobody_joins_without_agreeing_and_what_they_agreed_to_is_kept(tmp_path: Path) -> None:
    home = people(tmp_path, consent="# Yes\n*Really*", recruiting=["PID", "STUDY"])
    with pytest.raises(NotAgreed):
        home.join()
    assert home.number == 0
    home.join(agreed=home.consent_mark, recruited={"PID": "abc123", "OTHER": "secret"})
    home.close()
    (kept,) = tmp_path.glob("consent_*.md")
    assert kept.read_text() == "# Yes\n*Really*"
    assert kept.stem.removeprefix("consent_") in (tmp_path / "log.jsonl").read_text()
    told = (tmp_path / "recruited.jsonl").read_text()
    assert '"PID":"abc123"' in told
    assert "secret" not in told
    assert "abc123" not in (tmp_path / "log.jsonl").read_text()


def test_nobody_agrees_to_a_text_that_they_were_not_shown(tmp_path: Path) -> None:
    home = people(tmp_path, consent="the first text")
    shown = home.consent_mark
    home.close()
    again = people(tmp_path, consent="another text")
    with pytest.raises(NotAgreed, match="agreed to the text that is shown now"):
        again.join(agreed=shown)
    again.join(agreed=again.consent_mark)
    again.close()
    assert shown not in (tmp_path / "log.jsonl").read_text()


def test_who_is_let_in_again_goes_on_where_they_stopped(tmp_path: Path) -> None:
    options = {"practice": False, "recruiting": ["PID", "SESSION"], "consent": "Yes"}
    home = people(tmp_path, **options)
    mark = home.consent_mark
    first = home.join(mark, {"PID": "ann", "SESSION": "1"})
    other = home.join(mark, {"PID": "ben", "SESSION": "1"})
    for given in ({}, {"SESSION": "1"}, {"PID": " "}):
        with pytest.raises(NotIdentified, match="has no PID"):
            home.join(mark, given)
    walk_through(home, first, 2)
    home.act(first, home.view(first)["turn"], 0, 5)
    with pytest.raises(NotAgreed):
        home.join("", {"PID": "ann"})
    with pytest.raises(HasBegun):  # an identifier that others know opens no game
        home.join(mark, {"PID": "ann", "SESSION": "2"})
    home.readmit("ann")
    again = home.join(mark, {"PID": "ann", "SESSION": "2"})
    with pytest.raises(HasBegun):  # it lets in one
        home.join(mark, {"PID": "ann", "SESSION": "2"})
    assert again not in (first, other)
    assert home.number == 2
    assert home.view(again) == home.view(first)
    home.act(again, home.view(again)["turn"], 1, 5)
    assert home.view(again) == home.view(first)  # both windows know of it
    before = home.view(first)
    home.close()

    home = people(tmp_path, **options)
    home.readmit(" ann ")
    with pytest.raises(StoreError, match="nobody whose identifier is 'eve'"):
        home.readmit("eve")
    third = home.join(mark, {"PID": "ann"})
    assert [home.view(name) for name in (first, again, third)] == [before] * 3
    home.act(third, home.view(third)["turn"], 0, 5)  # the attempt is over
    walk_through(home, third)
    with pytest.raises(HasFinished, match="played to the end"):
        home.join(mark, {"PID": "ann"})
    assert home.view(third)["stage"] == "end"
    assert home.number == 2
    assert home.view(other)["room"]["trial"] == 1
    home.close()
    assert len(Results.read(tmp_path).trials) == 5
    assert "ann" not in (tmp_path / "log.jsonl").read_text()
    for name in (first, again, third):  # nor is a session id anywhere
        assert name not in "".join(one.read_text() for one in tmp_path.glob("*.json*"))


def test_a_call_that_is_repeated_joins_once(tmp_path: Path) -> None:
    home = people(tmp_path, practice=False, recruiting=["PID"])
    own = "a" * 32
    assert {home.join(recruited={"PID": "ann"}, name=own) for _ in range(3)} == {own}
    assert home.number == 1
    home.close()


def test_who_was_forgotten_does_not_go_on(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3", practice=False, recruiting=["PID"])
    first = home.join(recruited={"PID": "ann"})
    walk_through(home, first, 1)
    home.readmit("ann")
    keys = [first, home.join(recruited={"PID": "ann"})]
    home.keep()
    home.forget("CC3", 0)
    for name in keys:
        with pytest.raises(UnknownPerson):
            home.view(name)
    anew = home.join(recruited={"PID": "ann"})
    assert (home.number, home.view(anew)["room"]["trial"]) == (2, 1)
    home.close()
    home = people(tmp_path, "CC3", practice=False, recruiting=["PID"])
    assert home.view(anew)["room"]["trial"] == 1
    home.close()


@pytest.mark.parametrize(
    "identifier",
    [
        *(
            "5f2e9c0b1d4a7e0012345678",
            "A1B2C3D4E5F6G7",
            "ann@example.org",
            "a+b=c",
            "[ann]",
            "ann b",
        ),
        *(" ann ", "x" * 300, "R_3nP9~!*'()", "名前", "12345", "{ann}-1"),
    ],
)
def test_what_services_send_is_taken(tmp_path: Path, identifier: str) -> None:
    home = people(tmp_path, practice=False, recruiting=["PID"])
    home.join(recruited={"PID": identifier})
    with pytest.raises(HasBegun):
        home.join(recruited={"PID": identifier.strip()})
    home.close()
    home = people(tmp_path, practice=False, recruiting=["PID"])
    with pytest.raises(HasBegun):
        home.join(recruited={"PID": identifier})
    home.close()


@pytest.mark.parametrize(
    ("identifier", "why"),
    [
        ("{{%PROLIFIC_PID%}}", "stands for an identifier that was not filled in"),
        ("%PROLIFIC_PID%", "not filled in"),
        ("${e://Field/PID}", "not filled in"),
        ("PROLIFIC_PID", "not filled in"),
        ("ASSIGNMENT_ID_NOT_AVAILABLE", "not filled in"),
        ("x" * 301, "is longer than 300 characters"),
        ("a\u200bb", "characters that cannot be seen"),
    ],
)
def test_what_cannot_identify_anybody_is_named(tmp_path: Path, identifier: str, why: str) -> None:
    home = people(tmp_path, practice=False, recruiting=["PROLIFIC_PID"])
    with pytest.raises(NotIdentified, match=why) as told:
        home.join(recruited={"PROLIFIC_PID": identifier})
    assert "check the address that the service has" in told.value.advice
    home.close()
    assert home.number == 0


def test_the_description_is_read_once_however_often_it_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = people(tmp_path, practice=False)
    monkeypatch.setattr(store.Store, "experiment", lambda self: pytest.fail("it is read again"))
    walk_through(home, home.join(), 1)
    home.keep()
    walk_through(home, home.join(), 1)
    home.close()
    monkeypatch.undo()
    assert len(Results.read(tmp_path).trials) == 2


def test_what_one_person_did_is_deleted_and_others_go_on(tmp_path: Path) -> None:
    options = {"practice": False, "ask": True, "recruiting": ["PID"]}
    home = people(tmp_path, "CC3", "CE3", **options)
    names = [home.join(recruited={"PID": f"person{number}"}) for number in range(4)]
    for name in names:
        answered(home, name, 2)
    cells = [home._find(name).cell for name in names]
    before = {name: home.view(name) for name in names}
    home.close()
    kept = {path.name: path.read_bytes() for path in tmp_path.rglob("*.parquet")}
    gone = cells[1]
    ended = at_once("forget", f"{tmp_path}", f"{gone.first_subject}", "-c", gone.condition.name)
    assert (ended.status, ended.stderr) == (0, "")
    assert "3 files" in ended.stdout
    there = {path.name: path.read_bytes() for path in tmp_path.rglob("*.parquet")}
    assert there == {name: held for name, held in kept.items() if name != gone.file_name}
    everything = b"".join(path.read_bytes() for path in tmp_path.rglob("*") if path.is_file())
    assert b"person1" not in everything
    assert gone.file_name.encode() not in everything
    assert b"person2" in everything
    again = people(tmp_path, "CC3", "CE3", **options)
    assert again.number == 4
    assert [again.view(name) for name in (names[0], *names[2:])] == [
        before[name] for name in (names[0], *names[2:])
    ]
    with pytest.raises(Exception, match="no such session"):
        again.view(names[1])
    answered(again, names[2])
    fifth = again.join(recruited={"PID": "person4"})
    assert again._find(fifth).number == 4
    again.close()
    record = Results.read(tmp_path).trials
    assert len(record) == 2 + 5 + 2
    with pytest.raises(StoreError, match="has no person"):
        forget_person(tmp_path, gone.first_subject, gone.condition.name)
    with pytest.raises(StoreError, match="say which condition"):
        forget_person(tmp_path, 0)


def test_the_server_tells_of_consent_and_completion_and_takes_answers(tmp_path: Path) -> None:
    import threading
    import urllib.error

    from causal_openlock.play.server import PlayServer

    home = people(tmp_path, consent="*Yes* <script>", practice=False, ask=True, recruiting=["PID"])
    counts: list[tuple[int, int]] = []
    server = PlayServer(
        home,
        completion="https://app.prolific.com/submissions/complete?cc=C0DE",
        changed=lambda: counts.append((home.number, home.finished)),
    )
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        brief = asked(server.url, "brief")
        assert brief["consent"] == "<p><em>Yes</em> &lt;script&gt;</p>\n"
        assert brief["recruiting"] == ["PID"]
        mark = brief["consent_mark"]
        for sent, status in (
            ({"agreed": ""}, 403),
            ({"agreed": "0" * 16}, 403),  # another text, such as before a restart
            ({"agreed": True}, 400),
            ({"agreed": mark, "recruited": {"PID": "<b>"}}, 400),
        ):
            with pytest.raises(urllib.error.HTTPError) as caught:
                asked(server.url, "join", **sent)
            assert caught.value.code == status
        me = asked(server.url, "join", agreed=mark, recruited={"PID": "5f"})["id"]
        assert "C0DE" not in str([brief, asked(server.url, "state", id=me)])
        for actions in solving(home, me):
            for action in actions:
                turn = home.view(me)["turn"]
                after = asked(server.url, "act", id=me, turn=turn, action=action, reaction=5)
        levers = after["next"]["levers"]
        edges = [[levers[0], levers[1]], [levers[1], 7]]
        now = asked(server.url, "answer", id=me, turn=after["next"]["turn"], edges=edges)
        assert now["stage"] == "room"
        until(lambda: counts == [(1, 0)])
        answered(home, me)
        assert asked(server.url, "state", id=me)["completion"].endswith("?cc=C0DE")
        until(lambda: counts == [(1, 0), (1, 1)])
        with pytest.raises(urllib.error.HTTPError) as caught:
            asked(server.url, "join", agreed=mark, recruited={"PID": "5f"})
        assert caught.value.code == 410
    finally:
        server.shutdown()
        thread.join()
        server.finish()
    said = read_answers(tmp_path)[0]
    assert said.edges == {tuple(pair) for pair in edges}


@pytest.mark.parametrize(
    ("words", "what"),
    [
        (["--consent", "none.md"], "none.md cannot be read"),
        (["--recruiting", "A,B,C,D"], "--recruiting takes up to three names"),
        (["--completion", "javascript:x"], "is not an address of a page"),
    ],
)
def test_options_of_a_study_are_checked(words: list[str], what: str, tmp_path: Path) -> None:
    ended = at_once("play", "--out", f"{tmp_path}", "--no-browser", "--port", "0", *words)
    assert ended.status == 2
    assert what in ended.stderr
