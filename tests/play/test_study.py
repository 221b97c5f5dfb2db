"""What a study needs: people agree, are recruited, are asked about rooms, and can be forgotten."""

import shutil
from dataclasses import replace

import pytest

from causal_openlock import Results
from causal_openlock.contract.registry import create
from causal_openlock.errors import StoreError
from causal_openlock.experiment.beside_record import read_answers
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.declare import PERSON, Experiment
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.play.forgetting import forget_person
from causal_openlock.play.game import Refused
from causal_openlock.play.people import dealt
from causal_openlock.storage.store import Store
from support.command import at_once
from support.made_up_experiments import spec
from support.play_clients import people, walk_through

WORDS = ("status", "report", "bundle")


def room_of(home, name):
    truth = home.game(name).session.truth
    return truth.rooms[int(truth.room[0])]


def true_edges(room):
    place = {**dict(zip(room.schema.levers, room.layout.places, strict=True)), "door": 7}
    return [(place[cause], place[effect]) for cause, effect in room.schema.graph.edges]


def solve_and_answer(home, name, rooms=99):
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
        home.take(name, view["turn"], edges=true_edges(room))


def content_of(folder):
    """All bytes of all files of a folder."""
    return b"".join(path.read_bytes() for path in folder.rglob("*") if path.is_file())


def test_people_are_asked_after_each_room_and_what_they_say_is_scored(tmp_path):
    home = people(tmp_path, "CC3-CE4", practice=False, ask=True, seed=2)
    name = home.join()
    solve_and_answer(home, name, 2)
    grey = sorted(room_of(home, name).layout.places)
    walk_through(home, name, 1)
    turn = home.view(name)["turn"]
    white = next(place for place in range(7) if place not in grey)
    impossible = (white, 7), (grey[0], grey[0]), (grey[0], white), (grey[0], 8), (7, grey[0])
    for edges in ([edge] for edge in impossible):
        with pytest.raises(Refused):
            home.take(name, turn, edges=edges)
    with pytest.raises(Refused):
        home.take(name, turn, action=grey[0])
    home.close()
    again = people(tmp_path, "CC3-CE4", practice=False, ask=False, seed=2)  # who joined is asked on
    again.take(name, turn, edges=[])
    solve_and_answer(again, name)
    assert again.view(name)["stage"] == "end"
    again.close()
    assert {*read_answers(tmp_path)["visit"].to_pylist()} == {1, 2, 3, 4, 5, 6, 7}
    table = Results.read(tmp_path).structure_recovery
    assert table["shd"].tolist() == [0, 0, 4, 0, 0, 0, 0]
    assert table["f1"].tolist() == [1.0, 1.0, 0.0, 1.0, 1.0, 1.0, 1.0]


def test_nobody_joins_without_agreeing_to_the_text_that_is_shown_now(tmp_path):
    home = people(tmp_path, consent="# Yes\n*Really*", recruiting=["PID", "STUDY"])
    with pytest.raises(Refused):
        home.join()
    assert home.number == 0
    first = home.consent_mark
    home.join(agreed=first, recruited={"PID": "abc123", "OTHER": "secret"})
    home.close()
    (text,) = tmp_path.glob("consent_*.md")
    assert text.read_text() == "# Yes\n*Really*"
    assert text.stem == f"consent_{first}"
    assert (tmp_path / "recruited.csv").read_text() == "join,PID\n0,abc123\n"
    log = (tmp_path / "log.jsonl").read_text()
    assert first in log
    assert "abc123" not in log
    again = people(tmp_path, consent="another text", recruiting=["PID"])
    with pytest.raises(Refused):
        again.join(agreed=first, recruited={"PID": "b"})
    again.join(agreed=again.consent_mark, recruited={"PID": "b"})
    again.close()


def test_who_comes_again_with_an_identifier_goes_on_where_they_stopped(tmp_path):
    options = {"practice": False, "recruiting": ["PID", "SESSION"], "consent": "Yes"}
    home = people(tmp_path, **options)
    mark = home.consent_mark
    first = home.join(mark, {"PID": "ann", "SESSION": "1"})
    other = home.join(mark, {"PID": "ben"})
    for given in ({}, {"SESSION": "1"}, {"PID": " "}):
        with pytest.raises(Refused, match="PID"):
            home.join(mark, given)
    walk_through(home, first, 2)
    with pytest.raises(Refused):
        home.join("", {"PID": "ann"})  # without agreeing in the other browser
    again = home.join(mark, {"PID": " ann ", "SESSION": "2"})
    assert home.identifiers(first) == {"PID": "ann", "SESSION": "2"}
    assert home.identifiers(other) == {"PID": "ben", "SESSION": ""}
    assert home.join(mark, {"PID": "ann"}, again) == again  # a call that is repeated
    home.join(mark, {"PID": "eve", "SESSION": "3"}, again)  # in a session that is not hers
    assert home.identifiers(first) == {"PID": "ann", "SESSION": "2"}
    assert home.number == 2
    home.take(again, home.view(again)["turn"], action=1, reaction=5)
    assert home.view(again) == home.view(first)  # both windows know of it
    before = home.view(first)
    home.close()
    home = people(tmp_path, **options)
    assert [home.view(name) for name in (first, again)] == [before] * 2
    for action in (0, 0):  # the attempt is over
        home.take(again, home.view(again)["turn"], action=action, reaction=5)
    walk_through(home, again)
    assert home.view(home.join(mark, {"PID": "ann"})) == home.view(first)
    assert home.view(first)["stage"] == "end"
    assert home.view(other)["room"]["trial"] == 1
    home.close()
    assert len(Results.read(tmp_path).trials) == 5
    assert "ann" not in (tmp_path / "log.jsonl").read_text()
    for name in (first, again):  # nor is a session id anywhere
        assert name.encode() not in content_of(tmp_path)


def test_a_full_folder_takes_nobody_else(tmp_path, monkeypatch):
    monkeypatch.setattr("causal_openlock.play.people.MOST_PEOPLE", 1)
    home = people(tmp_path)
    home.join()
    with pytest.raises(Refused, match="As many have joined as can") as refused:
        home.join()
    assert (refused.value.status, home.number) == (429, 1)
    home.close()


def test_identifiers_that_services_send_are_taken(tmp_path):
    sent = ["5f2e9c0b1d4a", "ann@example.org", "a+b=c", "[ann]", " ann ", "x" * 300, "R~!*'()"]
    sent += ["名前", "{ann}-1", "=cmd()", "-x"]
    home = people(tmp_path, practice=False, recruiting=["PID"])
    for identifier in sent:
        home.join(recruited={"PID": identifier})
    home.close()
    assert "\n8,{ann}-1\n9,'=cmd()\n" in (tmp_path / "recruited.csv").read_text()
    home = people(tmp_path, practice=False, recruiting=["PID"])
    for identifier in sent:
        home.join(recruited={"PID": identifier.strip()})
    assert home.number == len(sent)
    home.close()


def test_what_a_killed_server_left_in_the_log_is_told_of(tmp_path):
    home = people(tmp_path / "played", command="causal-openlock play --out played")
    shutil.copytree(home.store.folder, tmp_path / "killed")
    assert "nobody finished a trial" in at_once("report", "killed", cwd=tmp_path).stderr
    name = home.join()
    for turn in range(2):
        home.take(name, turn, action=2)  # in the practice room
    home.take(name, 2)
    told = []
    for _ in range(2):
        walk_through(home, name, 1)
        shutil.copytree(home.store.folder, tmp_path / "killed", dirs_exist_ok=True)
        home.keep()
        told.append({word: at_once(word, "killed", cwd=tmp_path) for word in WORDS})
    assert [[ended.status for ended in said.values()] for said in told] == [[0, 2, 2], [0, 0, 2]]
    assert told[0]["status"].stdout.startswith("0 people have finished a trial\n")
    assert told[1]["status"].stdout.startswith("1 person has finished a trial\n")
    for said in (ended for each in told for ended in each.values()):
        text = " ".join(f"{said.stdout}{said.stderr}".split())
        assert "the log of killed has 6 actions of people that no table has" in text
        assert text.partition("stop it: ")[2].startswith("causal-openlock play --out played")
    assert "has 6 actions" in " ".join(Results.read(tmp_path / "killed").warnings)
    home.close()
    assert Results.read(tmp_path / "played").experiment.warned == ()


def test_what_one_person_did_is_deleted_and_others_go_on(tmp_path):
    options = {"practice": False, "ask": True, "recruiting": ["PID"]}
    home = people(tmp_path, "CC3", "CE3", **options)
    names = [home.join(recruited={"PID": f"person{number}"}) for number in range(4)]
    window = home.join(recruited={"PID": "person1"})
    for name in names:
        solve_and_answer(home, name, 2)
    before = {name: home.view(name) for name in names}
    home.close()
    kept = {path.name: path.read_bytes() for path in tmp_path.rglob("*.parquet")}
    which, subject = dealt(home.experiment, 1)
    condition = home.experiment.conditions[which].name
    (gone,) = {name for name in kept if name.startswith(f"person_{condition}_{subject}-")}
    ended = at_once("forget", tmp_path, subject, "-c", condition)
    assert (ended.status, ended.stderr) == (0, "")
    assert "3 files" in ended.stdout
    there = {path.name: path.read_bytes() for path in tmp_path.rglob("*.parquet")}
    assert there == {name: held for name, held in kept.items() if name != gone}
    for trace in (b"person1", gone.encode()):
        assert trace not in content_of(tmp_path)
    assert b"person2" in content_of(tmp_path)
    again = people(tmp_path, "CC3", "CE3", **options)
    assert (again.number, again.finished) == (4, 0)
    for name in (names[0], *names[2:]):
        assert again.view(name) == before[name]
    for name in (names[1], window):
        with pytest.raises(Refused):
            again.view(name)
    solve_and_answer(again, names[2])
    again.join(recruited={"PID": "person1"})
    assert again.number == 5
    again.close()
    assert len(Results.read(tmp_path).trials) == 2 + 5 + 2
    which = "say which condition"
    for chosen, named in ((condition, f"person {subject} in"), (None, which), ("", which)):
        with pytest.raises(StoreError, match=named):
            forget_person(tmp_path, subject, chosen)


@pytest.mark.parametrize("changed", range(4))
def test_the_same_command_deletes_what_a_killed_one_has_left(tmp_path, changed):
    """The person's files, the list and the identifiers are changed in turn, and the log last."""
    folder, before = tmp_path / "people", tmp_path / "before"
    home = people(folder, practice=False, recruiting=["PID"])
    names = [home.join(recruited={"PID": f"pid{number}"}) for number in range(2)]
    for name in names:
        walk_through(home, name, 1)
    home.close()
    (file,) = (path.name for path in (folder / "cells").glob("*_0-0_*"))
    shutil.copytree(folder, before)
    forget_person(folder, 0)
    done = [file, "experiment.json", "recruited.csv"][:changed]
    for path in [path for path in before.rglob("*") if path.is_file() and path.name not in done]:
        shutil.copy(path, folder / path.relative_to(before))
    forget_person(folder, 0)
    assert file not in {path.name for path in folder.rglob("*")}
    for trace, there in ((b"pid0", False), (file.encode(), False), (b"pid1", True)):
        assert (trace in content_of(folder)) == there


def test_what_was_imported_of_a_person_is_deleted_of_this_condition_alone(tmp_path):
    ce3 = find_condition("CE3")
    labels = "a", "a_b"  # a_b_CE3_0-0 is of a in b_CE3, or of a_b in CE3
    specs = tuple(replace(spec(label, subjects=1), learner=PERSON) for label in labels)
    experiment = Experiment(
        name="in", cell_size=1, conditions=(ce3, replace(ce3, name="b_CE3")), learners=specs
    )
    store, paths = Store(tmp_path), {}
    store.open(experiment)
    for cell in experiment.cells():
        where = {"learner": cell.spec.name, "experiment": "in"}
        session = Session(cell.condition, PROTOCOLS["human"], [0], **where)
        store.write(cell, session.play(create("win_stay")))
        paths[cell.spec.name, cell.condition.name] = store.path(cell)
    store.declare(experiment, [cell.file_name for cell in experiment.cells()])
    store.close()
    for name in ("bundle.zip", "subjects.csv", "consent_0.md", "fit-bayes"):
        (tmp_path / name).touch()
    said = at_once("forget", tmp_path, 0, "--condition", "CE3")
    assert said.status == 0
    assert said.stderr.endswith(": bundle.zip, fit-bayes, subjects.csv\n")  # made of all data
    left = {("a", "b_CE3"), ("a_b", "b_CE3")}
    assert {key for key, path in paths.items() if path.exists()} == left
    assert len(Store(tmp_path).experiment().files) == 2
    with pytest.raises(StoreError, match="person 0 in CE3"):
        forget_person(tmp_path, 0, "CE3")


def test_identifiers_without_their_person_are_dropped(tmp_path):
    home = people(tmp_path, recruiting=["PID"])
    for name in ("first", "lost"):
        home.join(recruited={"PID": name})
    home.close()
    log = tmp_path / "log.jsonl"  # a power cut can take the end of one log and not of the other
    log.write_bytes(b"".join(log.read_bytes().splitlines(keepends=True)[:-1]))
    cells = tmp_path / "cells"
    cells.mkdir(exist_ok=True)
    (cells / ".person_CC3_0-0.parquet.x.partial").write_text("of a killed server")
    home = people(tmp_path, recruiting=["PID"])
    home.join(recruited={"PID": "next"})
    home.close()
    assert (tmp_path / "recruited.csv").read_text() == "join,PID\n0,first\n1,next\n"
    assert not [*tmp_path.rglob("*.partial")]
