"""People: turns, the log, coming back after a crash, and the record."""

import errno
import itertools
import json
import os

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from causal_openlock import Results
from causal_openlock.errors import StoreError
from causal_openlock.experiment.beside_record import read_reactions
from causal_openlock.experiment.condition import find_condition
from causal_openlock.experiment.protocol import PROTOCOLS
from causal_openlock.experiment.session import Session
from causal_openlock.play.game import Refused
from causal_openlock.play.people import dealt
from causal_openlock.storage.store import Store
from support.play_clients import people, walk_through


def entries_of(folder):
    """What the lines of a log say."""
    lines = (folder / "log.jsonl").read_text(encoding="utf-8").splitlines()
    return [json.loads(line) for line in lines]


def test_the_record_of_a_person_is_that_of_a_learner_who_does_the_same(tmp_path):
    home = people(
        tmp_path, "CC3-CC4", practice=False, seed=5, clock=itertools.count(1000.0).__next__
    )
    name = home.join()
    done = walk_through(home, name)
    assert home.view(name)["stage"] == "end"
    assert (home.number, home.finished) == (1, 1)
    assert [room["left"] for room in home.view(name)["ended"]] == [0] * 7
    assert [room["found"] for room in home.view(name)["ended"]] == [2] * 6 + [3]
    home.close()
    record, description = Store(tmp_path).record()
    assert not description.missing
    condition = find_condition("CC3-CC4")
    session = Session(
        condition, PROTOCOLS["human"], [0], seed=5, learner="person", experiment="people"
    )
    for action in done:
        session.step([action])
    untimed = record.drop_columns(["wall_time"])
    assert untimed.to_pylist() == session.record().drop_columns(["wall_time"]).to_pylist()
    assert record.schema.names == session.record().schema.names
    # The clock has ticked once at joining and once for each action.
    assert record["wall_time"].to_pylist() == [3.0 * k for k in range(1, record.num_rows + 1)]


def test_reaction_times_also_hold_a_trial_that_is_not_over(tmp_path):
    home = people(tmp_path, "CC3", practice=False, clock=itertools.count().__next__)
    name = home.join()
    walk_through(home, name, trials=1)
    for turn, (action, reaction) in enumerate([(7, 250), (14, None), (9, 12_345), (3, 1)], start=6):
        home.take(name, turn, action=action, reaction=reaction)
    home.keep()
    home.close()
    assert set(Store(tmp_path).record()[0]["trial"].to_pylist()) == {1}
    rows = read_reactions(tmp_path).to_pylist()[6:]
    assert [row["reaction"] for row in rows] == [0.25, None, 12.345, 0.001]
    told = [(row["attempt"], row["moment"], row["action"]) for row in rows]
    assert told == [(1, 1, 7), (1, 2, 14), (1, 3, 9), (2, 1, 3)]
    assert [row["time"] for row in rows] == [7.0, 8.0, 9.0, 10.0]
    again = people(tmp_path, "CC3", practice=False)
    assert again.view(name)["room"]["attempt"] == 2
    again.close()


def test_who_is_shown_a_room_can_only_watch_and_is_not_asked_about_it(tmp_path):
    options = {"practice": False, "ask": True, "seed": 5}
    home = people(tmp_path, "shown-CC3-CC4", **options)
    name = home.join()
    opened = 0
    while (state := home.view(name))["stage"] == "room" and "shown" in state["room"]:
        with pytest.raises(Refused):
            home.take(name, state["turn"], action=(state["room"]["shown"] + 1) % 15)
        said = home.take(name, state["turn"], action=state["room"]["shown"])
        opened += said["new_solution"]
    assert opened == 6 * 2
    assert (state["stage"], state["room"]["trial"]) == ("room", 7)
    assert [room["shown"] for room in state["ended"]] == [True] * 6
    home.close()
    again = people(tmp_path, "shown-CC3-CC4", **options)
    assert again.view(name) == state
    walk_through(again, name)
    assert again.view(name)["stage"] == "question"
    assert not again.view(name)["ended"][6]["shown"]
    again.take(name, again.view(name)["turn"], edges=[])
    again.close()
    results = Results.read(tmp_path)
    assert results.trials["phase"].tolist() == ["test"]
    assert results.structure_recovery["shd"].tolist() == [6]
    assert read_reactions(tmp_path)["reaction"].to_pylist()[: 6 * 2 * 3] == [None] * 36


def test_practice_comes_first_and_leaves_nothing_in_the_record(tmp_path):
    home = people(tmp_path, "CC3")
    name = home.join()
    assert home.view(name)["stage"] == "practice"
    assert home.take(name, 0, action=2)["moved"]
    assert home.take(name, 1, action=14)["new_solution"]
    with pytest.raises(Refused):  # the practice room is done with
        home.take(name, 2, action=2)
    assert home.take(name, 2)["stage"] == "room"
    with pytest.raises(Refused):
        home.take(name, 3)
    home.close()
    again = people(tmp_path, "CC3", practice=False)  # who joined with practice has had it
    assert again.view(name)["turn"] == 3
    again.close()
    with pytest.raises(StoreError, match="no cell yet"):
        Store(tmp_path).record()


ACTIONS = st.one_of(st.none(), st.integers(0, 16))  # with None, the practice room is left
CALLS = st.lists(st.tuples(st.integers(-1, 1), ACTIONS), max_size=30)


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(calls=CALLS)
def test_only_the_call_for_this_turn_changes_anything_and_the_log_restores_it(tmp_path, calls):
    folder = tmp_path / os.urandom(8).hex()
    home = people(folder, "CC3")
    name = home.join()
    for offset, action in calls:
        before, size = home.view(name), (folder / "log.jsonl").stat().st_size
        turn = abs(before["turn"] + offset)
        practice = before["stage"] == "practice"
        possible = practice if action is None else action < 15 and not before["room"]["over"]
        if turn == before["turn"] and possible:
            home.take(name, turn, action=action)
            assert home.view(name)["turn"] == before["turn"] + 1
            continue
        with pytest.raises(Refused) as refused:
            home.take(name, turn, action=action)
        assert refused.value.now == before == home.view(name)
        assert (folder / "log.jsonl").stat().st_size == size
    now = home.view(name)
    home.close()
    again = people(folder, "CC3")
    assert again.view(name) == now
    again.close()


def test_people_are_dealt_evenly_among_conditions(tmp_path):
    home = people(tmp_path, "CC3", "CE3", "CC4", practice=False)
    home.close()
    people_dealt = [dealt(home.experiment, number) for number in range(12)]
    blocks = [tuple(people_dealt[3 * block : 3 * block + 3]) for block in range(4)]
    for block, those in enumerate(blocks):
        assert sorted(those) == [(condition, block) for condition in range(3)]
    assert len({tuple(condition for condition, _ in those) for those in blocks}) > 1


def test_a_last_line_cut_short_is_dropped_and_other_damage_is_named(tmp_path):
    home = people(tmp_path, practice=False)
    name = home.join()
    home.take(name, 0, action=3)
    path = tmp_path / "log.jsonl"
    whole = path.read_bytes()
    home.take(name, 1, action=4)
    longer = path.read_bytes()
    home.close()
    for cut in (*range(len(whole), len(longer), 9), len(longer) - 1):
        path.write_bytes(longer[:cut])
        again = people(tmp_path, practice=False)
        assert again.view(name)["turn"] == 1
        again.take(name, 1, action=5)  # and what follows begins a line of its own
        again.close()
        assert [entry.get("action") for entry in entries_of(tmp_path)] == [None, None, 3, 5]
    lines = longer.splitlines(keepends=True)
    for damaged in (longer.replace(b'"action":3', b'"action":x'), b"".join(lines[:2] + lines[3:])):
        path.write_bytes(damaged)
        with pytest.raises(StoreError, match=r"log\.jsonl:3: "):
            people(tmp_path, practice=False)
        assert path.read_bytes() == damaged
    path.write_bytes(longer)
    people(tmp_path, practice=False).close()  # the folder is free
    assert path.read_bytes() == longer


JOINED = {"join": 0, "key": "0" * 64, "at": 1.0, "practice": True}
TURN = {"of": 0, "turn": 0, "at": 2.0, "action": 1, "reaction": None}
LEFT = {key: TURN[key] for key in ("of", "turn", "at")}
FORGOTTEN = {"join": 0, "forgotten": True}


@pytest.mark.parametrize(
    "lines",
    [
        *([{}], [[]], [b"NaN"], [b"no JSON"], [b"[" * 100_000], [b'{"join":0,"join":0}']),
        *([JOINED | {"join": 1}], [JOINED | {"join": "0"}], [JOINED, JOINED], [{"join": 0}]),
        *([JOINED | {"key": 3}], [JOINED | {"key": "0" * 63}], [JOINED | {"practice": 1}]),
        *([JOINED | {"at": "now"}], [JOINED | {"at": float("nan")}], [JOINED | {"at": 10**400}]),
        *([JOINED | {"ask": 1}], [JOINED | {"consent": "yes"}], [FORGOTTEN | {"join": 1}]),
        *([TURN], [JOINED, TURN | {"of": 1}], [JOINED, TURN | {"of": -1}], [FORGOTTEN, TURN]),
        *([JOINED, TURN | {"turn": 1}], [JOINED, TURN | {"turn": None}]),
        *([JOINED, TURN | {"action": wrong}] for wrong in (15, -1, 2**70)),
        *([JOINED, TURN | {"reaction": float("inf")}], [JOINED, TURN | {"more": 1}]),
        *([JOINED, TURN | {"edges": 3}], [JOINED, TURN | {"edges": []}]),
        [JOINED | {"practice": False}, LEFT],
        [JOINED, {"of": 1, "key": "1" * 64, "at": 2.0}],
    ],
    ids=lambda lines: str(lines)[:80],
)
def test_a_line_of_the_log_that_says_what_cannot_be_is_named(tmp_path, lines):
    people(tmp_path).close()
    path = tmp_path / "log.jsonl"
    with path.open("ab") as file:
        for line in lines:
            text = line if isinstance(line, bytes) else json.dumps(line).encode()
            file.write(text + b"\n")
    content = path.read_bytes()
    with pytest.raises(StoreError, match=rf"log\.jsonl:{len(lines) + 1}: "):
        people(tmp_path)
    assert path.read_bytes() == content


def test_what_cannot_be_put_on_file_has_not_happened(tmp_path, monkeypatch):
    home = people(tmp_path, practice=False)
    name = home.join()
    before = home.view(name)
    write = os.write

    def full(file, line):
        write(file, line[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    size = (tmp_path / "log.jsonl").stat().st_size
    monkeypatch.setattr(os, "write", full)
    for call in (lambda: home.take(name, 0, action=0), home.join):
        with pytest.raises(StoreError, match="No space left"):
            call()
    monkeypatch.undo()
    assert (home.view(name), home.number) == (before, 1)
    assert (tmp_path / "log.jsonl").stat().st_size == size
    home.take(name, 0, action=0)
    home.close()
    again = people(tmp_path, practice=False)
    assert again.view(name)["turn"] == 1
    again.close()


def test_a_folder_holds_one_play_only(tmp_path):
    home = people(tmp_path, "CC3")
    home.join()
    with pytest.raises(StoreError, match="in use"):
        people(tmp_path, "CC3")
    home.close()
    for conditions, other in ((["CC3"], {"seed": 1}), (["CE3"], {})):
        with pytest.raises(StoreError, match="other conditions"):
            people(tmp_path, *conditions, **other)
