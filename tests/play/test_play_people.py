"""People: turns, the log, coming back after a crash, and the record."""

from __future__ import annotations

import errno
import json
import os
import zlib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from causal_openlock import Results
from causal_openlock.analysis.measures import attempts_to_solve
from causal_openlock.analysis.report.writing import write_report
from causal_openlock.analysis.results.reading import beside
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, StoreError
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.reactions import read_reactions
from causal_openlock.experiment.session import Session
from causal_openlock.play.person import LEARNER
from causal_openlock.play.refusals import OutOfTurn, TooManyPeople, UnknownPerson
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from support.made_up_experiments import NOBODY, condition_called, spec
from support.play_clients import people, solving, walk_through

HUMAN = PROTOCOLS["human"]


class Clock:
    """Tells a second more each time."""

    def __init__(self) -> None:
        self.now = 1000.0

    def __call__(self) -> float:
        self.now += 1.0
        return self.now


def test_a_person_walks_through_a_transfer_and_its_record_is_that_of_a_learner(
    tmp_path: Path,
) -> None:
    home = people(tmp_path, "CC3-CC4", practice=False, seed=5, clock=Clock())
    name = home.join()
    done = walk_through(home, name)
    assert home.view(name)["stage"] == "end"
    assert [room["left"] for room in home.view(name)["ended"]] == [0] * 7
    home.close()
    record, description = Store(tmp_path).record()
    assert not description.missing
    # The same actions of any learner under this label give the same record, times aside.
    condition = Condition.named("CC3-CC4", find_schema)
    session = Session(condition, HUMAN, [0], seed=5, learner="person", experiment="people")
    for action in done:
        session.step([action])
    untimed = record.drop_columns(["wall_time"])
    assert untimed.to_pylist() == session.record().drop_columns(["wall_time"]).to_pylist()
    assert record.schema.names == session.record().schema.names
    # The clock has ticked once at joining and once for each action.
    assert record["wall_time"].to_pylist() == [3.0 * k for k in range(1, record.num_rows + 1)]


def test_reaction_times_stand_beside_the_record(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3", practice=False, clock=Clock())
    name = home.join()
    for turn, (action, reaction) in enumerate([(0, 250), (14, None), (9, 12_345), (3, 1)]):
        home.act(name, turn, action, reaction)
    home.close()
    rows = read_reactions(tmp_path).to_pylist()
    assert [row["reaction"] for row in rows] == [0.25, None, 12.345, 0.001]
    told = [(row["attempt"], row["moment"], row["action"]) for row in rows]
    assert told == [(1, 1, 0), (1, 2, 14), (1, 3, 9), (2, 1, 3)]
    assert [row["time"] for row in rows] == [1.0, 2.0, 3.0, 4.0]


def test_a_clock_that_is_set_back_takes_no_time_away(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time_of_day = [2e9]
    monkeypatch.setattr("time.time", lambda: time_of_day[0])
    home = people(tmp_path, "CC3", practice=False)
    name = home.join()
    walk_through(home, name, trials=1)
    time_of_day[0] = 1e9
    walk_through(home, name, trials=1)
    home.close()
    home = people(tmp_path, "CC3", practice=False)
    walk_through(home, name, trials=1)
    late = home.join()
    walk_through(home, late, trials=1)
    home.close()
    for person in Store(tmp_path).record()[0].to_pandas().groupby("subject")["wall_time"]:
        times = person[1].tolist()
        assert times == sorted(times)
        assert times[0] >= 0
        assert times[-1] < 1000
    log = (tmp_path / "log.jsonl").read_text().splitlines()
    at = [json.loads(line.rpartition("\t")[0])["at"] for line in log[1:]]
    assert at == sorted(at)


def test_a_log_in_which_the_clock_was_set_back_gives_times_that_do_not(tmp_path: Path) -> None:
    home = people(
        tmp_path, "CC3", practice=False, clock=iter([0, 100, 101, 2, 3, 5, 6, 0]).__next__
    )
    name = home.join()
    for turn in range(6):
        home.act(name, turn, 7, None)
    home.close()
    assert read_reactions(tmp_path)["time"].to_pylist() == [1, 1, 2, 4, 5, 5]
    for path in tmp_path.rglob("*.parquet"):
        path.unlink()
    people(tmp_path, "CC3", practice=False).close()
    assert read_reactions(tmp_path)["time"].to_pylist() == [1, 1, 2, 4, 5, 5]


def test_a_trial_that_is_not_over_is_no_trial_of_the_record_yet(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3", practice=False)
    name = home.join()
    walk_through(home, name, trials=1)
    turn = home.view(name)["turn"]
    for action in range(3):
        home.act(name, turn + action, 7 + action, None)
    home.close()
    record, _ = Store(tmp_path).record()
    assert set(record["trial"].to_pylist()) == {1}
    assert read_reactions(tmp_path).num_rows == 6 + 3
    again = people(tmp_path, "CC3", practice=False)
    assert again.view(name)["room"]["attempt"] == 2
    again.close()


def test_who_is_shown_a_room_can_only_watch_and_is_not_asked_about_it(tmp_path: Path) -> None:
    home = people(tmp_path, "shown-CC3-CC4", practice=False, ask=True, seed=5)
    name = home.join()
    opened = []
    while (state := home.view(name))["stage"] == "room" and "shown" in state["room"]:
        with pytest.raises(OutOfTurn):
            home.act(name, state["turn"], (state["room"]["shown"] + 1) % 15, None)
        said = home.act(name, state["turn"], state["room"]["shown"], None)
        opened.append(said["new_solution"])
    assert sum(opened) == 6 * 2
    assert (state["stage"], state["room"]["trial"]) == ("room", 7)
    assert [room["shown"] for room in state["ended"]] == [True] * 6
    home.close()
    again = people(tmp_path, "shown-CC3-CC4", practice=False, ask=True, seed=5)
    assert again.view(name) == state
    walk_through(again, name)
    assert again.view(name)["stage"] == "question"
    again.answer(name, again.view(name)["turn"], [])
    again.close()
    results = Results.read(tmp_path)
    assert results.trials["phase"].tolist() == ["test"]
    assert results.structure_recovery["shd"].tolist() == [6]
    assert read_reactions(tmp_path)["reaction"].to_pylist()[: 6 * 2 * 3] == [None] * 36


def test_practice_comes_first_and_leaves_nothing_in_the_record(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3")
    name = home.join()
    assert home.view(name)["stage"] == "practice"
    assert home.act(name, 0, 2, None)["moved"]
    assert home.act(name, 1, 14, None)["new_solution"]
    with pytest.raises(OutOfTurn):  # the practice room is done with
        home.act(name, 2, 2, None)
    assert home.proceed(name, 2)["stage"] == "room"
    with pytest.raises(OutOfTurn):
        home.proceed(name, 3)
    home.close()
    assert people(tmp_path, "CC3").view(name)["turn"] == 3
    with pytest.raises(StoreError, match="no cell yet"):
        Store(tmp_path).record()


CALLS = st.lists(
    st.tuples(st.integers(-1, 1), st.integers(-1, 16), st.sampled_from(["act", "proceed"])),
    max_size=30,
)


@settings(
    max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(calls=CALLS)
def test_only_the_call_for_this_turn_changes_anything(
    tmp_path: Path, calls: list[tuple[int, int, str]]
) -> None:
    folder = tmp_path / os.urandom(8).hex()
    home = people(folder, "CC3")
    name = home.join()
    for offset, action, kind in calls:
        before, size = home.view(name), (folder / "log.jsonl").stat().st_size
        turn = before["turn"] + offset
        legal = offset == 0 and (
            before["stage"] == "practice"
            if kind == "proceed"
            else 0 <= action < 15 and not before["room"]["over"]
        )

        def call(turn: int = turn, action: int = action, kind: str = kind) -> object:
            if kind == "proceed":
                return home.proceed(name, turn)
            return home.act(name, turn, action, 5)

        if legal:
            call()
            assert home.view(name)["turn"] == before["turn"] + 1
            continue
        with pytest.raises(OutOfTurn) as refused:
            call()
        assert refused.value.now == before == home.view(name)
        assert (folder / "log.jsonl").stat().st_size == size
    now = home.view(name)
    home.close()
    again = people(folder, "CC3")
    assert again.view(name) == now
    again.close()


def test_nobody_plays_by_a_name_that_was_not_given_to_them(tmp_path: Path) -> None:
    home = people(tmp_path)
    name = home.join()
    held = (tmp_path / "log.jsonl").read_text(encoding="utf-8")
    assert name not in held
    key = json.loads(held.splitlines()[1].rpartition("\t")[0])["key"]
    for other in ("", name[:-1], name.swapcase(), key):
        with pytest.raises(UnknownPerson):
            home.view(other)
    assert len({home.join() for _ in range(20)} | {name}) == 21
    home.close()


def test_several_people_do_not_see_one_another(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3", practice=False)
    names = [home.join() for _ in range(4)]
    before = [home.view(name) for name in names]
    walk_through(home, names[1])
    home.act(names[2], 0, solving(home, names[2])[0][0], None)
    assert [home.view(names[i]) for i in (0, 3)] == [before[i] for i in (0, 3)]
    assert home.view(names[1])["stage"] == "end"
    assert home.view(names[2])["turn"] == 1
    home.close()
    record, _ = Store(tmp_path).record()
    assert set(record["subject"].to_pylist()) == {1}
    # Rooms come in an order of their own for each.
    home = people(tmp_path, "CC3", practice=False)
    orders = {tuple(home._find(name).game.session._visits["layout"][0]) for name in names}
    assert len(orders) > 1
    home.close()


def test_people_are_dealt_evenly_among_conditions(tmp_path: Path) -> None:
    home = people(tmp_path, "CC3", "CE3", "CC4", practice=False)
    names = [home.join() for _ in range(12)]
    cells = [home._find(name).cell for name in names]
    for block in range(4):
        dealt = cells[3 * block : 3 * block + 3]
        assert {cell.condition.name for cell in dealt} == {"CC3", "CE3", "CC4"}
        assert {cell.first_subject for cell in dealt} == {block}
    assert len({tuple(c.condition.name for c in cells[3 * b : 3 * b + 3]) for b in range(4)}) > 1
    home.close()


def test_a_last_line_cut_short_was_never_answered_and_is_dropped(tmp_path: Path) -> None:
    home = people(tmp_path, practice=False)
    name = home.join()
    home.act(name, 0, 3, None)
    whole = (tmp_path / "log.jsonl").read_bytes()
    home.act(name, 1, 4, None)
    longer = (tmp_path / "log.jsonl").read_bytes()
    home.close()
    for cut in (*range(len(whole), len(longer), 9), len(longer) - 1):
        (tmp_path / "log.jsonl").write_bytes(longer[:cut])
        again = people(tmp_path, practice=False)
        assert again.view(name)["turn"] == 1
        again.close()
        assert (tmp_path / "log.jsonl").read_bytes() == whole


def test_a_damaged_log_is_named_with_its_line(tmp_path: Path) -> None:
    home = people(tmp_path, practice=False)
    name = home.join()
    for turn in range(3):
        home.act(name, turn, turn, None)
    home.close()
    path = tmp_path / "log.jsonl"
    content = path.read_bytes()
    lines = content.splitlines(keepends=True)
    path.write_bytes(content.replace(b'"action":1', b'"action":2'))
    with pytest.raises(StoreError, match=r"log\.jsonl:4: this line is damaged"):
        people(tmp_path, practice=False)
    path.write_bytes(b"".join([*lines[:3], *lines[4:]]))
    with pytest.raises(StoreError, match=r"log\.jsonl:4: a turn is missing"):
        people(tmp_path, practice=False)
    if Path("/proc/self/fd").is_dir():  # and it is not held open
        assert path.resolve() not in {one.resolve() for one in Path("/proc/self/fd").iterdir()}
    path.write_bytes(content)
    people(tmp_path, practice=False).close()  # nothing was spoilt, and the folder is free


JOINED = {"join": 0, "key": "0" * 64, "at": 1.0, "practice": True}
TURN = {"of": 0, "turn": 0, "at": 2.0, "action": 1, "reaction": None}


@pytest.mark.parametrize(
    "lines",
    [
        [{}],
        [[]],
        ["text"],
        [b"NaN"],
        [b"no JSON"],
        [b"[" * 100_000],
        [b"9" * 5000],
        [{**JOINED, "join": 1}],
        [{**JOINED, "join": "0"}],
        [{**JOINED, "key": 3}],
        [{**JOINED, "at": "now"}],
        [{**JOINED, "at": float("nan")}],
        [{**JOINED, "at": 10**400}],
        [{**JOINED, "practice": 1}],
        [{"join": 0}],
        [TURN],
        [JOINED, JOINED],
        [JOINED, TURN | {"of": 1}],
        [JOINED, TURN | {"of": -1}],
        [JOINED, TURN | {"turn": 1}],
        [JOINED, TURN | {"turn": None}],
        [JOINED, TURN | {"action": 15}],
        [JOINED, TURN | {"action": -1}],
        [JOINED, TURN | {"action": 2**70}],
        [JOINED, TURN | {"reaction": float("inf")}],
        [JOINED, TURN | {"more": 1}],
        [JOINED, {key: TURN[key] for key in ("of", "turn")}],
        [JOINED | {"practice": False}, {key: TURN[key] for key in ("of", "turn", "at")}],
    ],
    ids=lambda lines: str(lines)[:80],
)
def test_a_line_that_says_what_cannot_be_is_named(tmp_path: Path, lines: list[Any]) -> None:
    people(tmp_path).close()
    path = tmp_path / "log.jsonl"
    with path.open("ab") as file:
        for line in lines:
            text = line if isinstance(line, bytes) else json.dumps(line).encode()
            file.write(b"%b\t%08x\n" % (text, zlib.crc32(text)))
    content = path.read_bytes()
    says = "this line is|a turn is missing before|this was not possible then"
    with pytest.raises(StoreError, match=rf"log\.jsonl:{len(lines) + 1}: ({says})"):
        people(tmp_path)
    assert path.read_bytes() == content


def test_what_cannot_be_put_on_file_has_not_happened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = people(tmp_path, practice=False)
    name = home.join()
    before = home.view(name)
    write = os.write

    def full(file: int, line: bytes) -> int:
        write(file, line[:10])
        raise OSError(errno.ENOSPC, "No space left on device")

    size = (tmp_path / "log.jsonl").stat().st_size
    monkeypatch.setattr(os, "write", full)
    with pytest.raises(StoreError, match="No space left"):
        home.act(name, 0, 0, None)
    with pytest.raises(StoreError, match="No space left"):
        home.join()
    monkeypatch.undo()
    assert home.view(name) == before
    assert (tmp_path / "log.jsonl").stat().st_size == size
    home.act(name, 0, 0, None)
    home.close()
    assert people(tmp_path, practice=False).view(name)["turn"] == 1


def test_a_folder_is_of_one_play_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = people(tmp_path, "CC3")
    home.join()
    with pytest.raises(StoreError, match="in use"):
        people(tmp_path, "CC3")
    home.close()
    for other in ({"seed": 1}, {}):
        with pytest.raises(StoreError, match="other conditions"):
            people(tmp_path, "CC3" if other else "CE3", **other)
    home = people(tmp_path, "CC3")
    monkeypatch.setattr("causal_openlock.play.people.MOST_PEOPLE", 1)
    with pytest.raises(TooManyPeople):
        home.join()
    home.close()


def test_a_report_shows_a_person_beside_learners(tmp_path: Path) -> None:
    home = people(tmp_path / "people", "CC4", practice=False)
    walk_through(home, home.join())
    home.close()
    path = tmp_path / "experiment.yaml"
    path.write_text("name: e\nsubjects: 3\nconditions: [CC4]\nlearners: [random]\n")
    from causal_openlock.experiment.file import read_experiment
    from causal_openlock.running import runner

    learners = runner.run(read_experiment(path), tmp_path / "learners", workers=1)
    alone, description = Store(tmp_path / "people").record()
    assert (attempts_to_solve(alone)["attempts"] == 3).all()
    write_report(alone, tmp_path / "alone", description)
    record, description = beside([Store(tmp_path / "people").record(), learners.record()])
    page = write_report(record, tmp_path / "report", description).read_text(encoding="utf-8")
    assert ">person<" in page
    assert ">random<" in page
    summary = (tmp_path / "report" / "summary.csv").read_text(encoding="utf-8")
    assert {line.split(",")[0] for line in summary.splitlines()[1:]} == {"person", "random"}


def test_results_that_contradict_each_other_stand_in_no_report(tmp_path: Path) -> None:
    def result(learner: str, condition: Condition) -> Any:
        table = pa.table({"learner": [learner], "condition": [condition.name]})
        known = {"learners": (spec(learner),), "conditions": (condition,)}
        return table, replace(NOBODY, **known)

    one = condition_called("CC4")
    other = replace(one, train=one.train[:0], test=one.train)
    assert beside([result("a", one), result("b", one)])[0].num_rows == 2
    with pytest.raises(StoreError, match="learner a"):
        beside([result("a", one), result("a", one)])
    with pytest.raises(StoreError, match="CC4 is not the same"):
        beside([result("a", one), result("b", other)])


def test_a_person_takes_part_in_no_comparison() -> None:
    person = create(LEARNER)
    with pytest.raises(LearnerError, match="causal-openlock play"):
        person.begin(None)  # type: ignore[arg-type]
