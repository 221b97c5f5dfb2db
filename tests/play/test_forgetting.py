"""Forgetting: one person's data, all of it, and nobody else's, however often it is interrupted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

from causal_openlock.cli import app
from causal_openlock.contract.registry import create
from causal_openlock.errors import StoreError
from causal_openlock.experiment.experiment import Experiment
from causal_openlock.experiment.protocol import PROTOCOLS, Condition
from causal_openlock.experiment.session import Session
from causal_openlock.files import atomic
from causal_openlock.play import log, people
from causal_openlock.play.forgetting import forget_person
from causal_openlock.play.log import Log
from causal_openlock.play.participant import DATA
from causal_openlock.play.person import LEARNER
from causal_openlock.play.recruiting import RECRUITED
from causal_openlock.schemas.finding import find_schema
from causal_openlock.storage.store import Store
from support import play_clients
from support.made_up_experiments import spec
from support.play_clients import walk_through


class Killed(BaseException):
    """What stands for the end of the process."""


def imported(folder: Path, *labels: str) -> dict[tuple[str, str], Path]:
    """A folder without a log: person 0 of these labels in CE3 and in b_CE3; their cells."""
    ce3 = Condition.named("CE3", find_schema)
    conditions = (ce3, replace(ce3, name="b_CE3"))
    specs = tuple(replace(spec(label, subjects=1), learner=LEARNER) for label in labels)
    experiment = Experiment("in", "In", 0, 1, conditions, specs)
    store = Store(folder)
    store.open(experiment)
    paths = {}
    for cell in experiment.cells():
        label, condition = cell.spec.name, cell.condition
        session = Session(condition, PROTOCOLS["human"], [0], learner=label, experiment="in")
        store.write(cell, session.play(create("win_stay")))
        paths[label, condition.name] = store.path(cell)
    store.declare(experiment, experiment.cells())
    store.close()
    return paths


def test_only_the_person_of_this_condition_is_deleted(tmp_path: Path) -> None:
    paths = imported(tmp_path, "a", "a_b")  # a_b_CE3_0-0 is of either
    for name in ("bundle.zip", "subjects.csv", "consent_0.md"):
        (tmp_path / name).touch()
    (tmp_path / "fit-bayes").mkdir()
    said = CliRunner().invoke(app, ["forget", str(tmp_path), "0", "--condition", "CE3"])
    assert said.exit_code == 0
    assert "regenerate or delete them: bundle.zip, fit-bayes, subjects.csv\n" in said.stderr
    assert "also delete whatever was made of the folder elsewhere" in said.stdout
    assert {key for key, path in paths.items() if path.exists()} == {
        ("a", "b_CE3"),
        ("a_b", "b_CE3"),
    }
    assert len(Store(tmp_path).experiment().files) == 2
    forget_person(tmp_path, 0, "b_CE3")
    assert not any(path.exists() for path in paths.values())


def test_what_was_imported_is_gone_after_the_second_try(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    paths = imported(tmp_path, "person")
    gone = paths["person", "CE3"]
    for owner, name in ((Path, "unlink"), (Store, "list_files")):
        with monkeypatch.context() as patch:
            patch.setattr(owner, name, killed)
            with pytest.raises(Killed):
                forget_person(tmp_path, 0, "CE3")
    forget_person(tmp_path, 0, "CE3")
    assert not gone.exists()
    assert gone.name not in (tmp_path / "experiment.json").read_text()
    with pytest.raises(StoreError, match="has no person 0 in CE3"):
        forget_person(tmp_path, 0, "CE3")
    assert paths["person", "b_CE3"].exists()


def killed(*_: Any, **__: Any) -> None:
    raise Killed


@pytest.mark.parametrize("moment", ["list", "files", "first log", "second log"])
def test_what_was_played_is_gone_after_the_second_try(
    moment: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = play_clients.people(tmp_path, practice=False, recruiting=["PID"])
    for number in range(2):
        walk_through(home, home.join(recruited={"PID": f"pid{number}"}), 1)
    cell = home._order[0].cell  # type: ignore[union-attr]
    home.close()
    rewrite = Log.rewrite
    rewritten: list[Log] = []

    def rewritten_until(self: Log, entries: Any) -> None:
        if rewritten or moment == "first log":
            raise Killed
        rewritten.append(self)
        rewrite(self, entries)

    with monkeypatch.context() as patch:
        match moment:
            case "list":
                patch.setattr(people.People, "_declare", killed)
            case "files":
                patch.setattr(people, "delete_files", killed)
            case _:
                patch.setattr(Log, "rewrite", rewritten_until)
        patch.setattr(people.People, "keep", lambda self: None)  # a killed process keeps nothing
        with pytest.raises(Killed):
            forget_person(tmp_path, cell.first_subject, "CC3")
    forget_person(tmp_path, cell.first_subject, "CC3")
    everything = [path for path in tmp_path.rglob("*") if path.is_file()]
    content = b"".join(path.read_bytes() for path in everything)
    assert cell.file_name not in {path.name for path in everything}
    assert b"pid0" not in content
    assert cell.file_name.encode() not in content
    assert b"pid1" in content


def test_what_a_killed_server_was_writing_is_swept(tmp_path: Path) -> None:
    play_clients.people(tmp_path).close()
    for folder in DATA:
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / ".person_CC3_0-0.parquet.x.partial").write_text("what somebody said")
    play_clients.people(tmp_path).close()
    assert not [*tmp_path.rglob(atomic.PARTIAL)]


def test_nobody_is_called_as_somebody_who_could_not_join(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    home = play_clients.people(tmp_path, recruiting=["PID"])
    append = Log.append

    def full(self: Log, entry: Any) -> None:
        if self.path.name == log_name:
            raise StoreError("the disk is full")
        append(self, entry)

    for log_name in ("log.jsonl", RECRUITED):  # noqa: B007 - `full` reads it
        with monkeypatch.context() as patch:
            patch.setattr(log.Log, "append", full)
            with pytest.raises(StoreError):
                home.join(recruited={"PID": "lost"})
    home.join(recruited={"PID": "there"})
    home.close()
    # A power cut can take the end of one log and leave that of the other.
    called = Log(tmp_path / RECRUITED)
    assert [one["PID"] for one in called.entries] == ["there"]
    (number,) = [one["join"] for one in called.entries]
    assert number == 1
    called.append({"join": 2, "PID": "cut"})
    called.close()
    home = play_clients.people(tmp_path, recruiting=["PID"])
    home.join(recruited={"PID": "next"})
    home.close()
    told = Log(tmp_path / RECRUITED)
    told.close()
    assert [(one["join"], one["PID"]) for one in told.entries] == [(1, "there"), (2, "next")]
