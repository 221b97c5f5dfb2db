"""A cell that is killed goes on where it was, and ends as if it had never been killed."""

from __future__ import annotations

import io
import json
import os
import pickle
import signal
import struct
import subprocess
import sys
import time
import tracemalloc
import zipfile
import zlib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pytest
import torch

from causal_openlock.contract.learner import Learner, Step, View
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, OpenLockError, ProtocolError
from causal_openlock.experiment.building import Changes
from causal_openlock.experiment.experiment import Cell, Experiment
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.files import seal as seal_module
from causal_openlock.files.atomic import sweep
from causal_openlock.files.seal import STATE, seal
from causal_openlock.files.state import StateError, read_state, write_state
from causal_openlock.running import checkpoint, runner, worker
from causal_openlock.running.checkpoint import Checkpoint
from causal_openlock.running.status import status_of
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.schemas.fsm import IntArray
from causal_openlock.storage.running_files import reported_progress
from causal_openlock.storage.store import Store
from openlock_learners.random import RandomLearner
from support.checkpoints import same
from support.command import at_once
from support.processes import prepared, start_prepared
from support.session_play import HUMAN, Curious, named
from support.waiting import until

pytestmark = pytest.mark.slow

SMALL = "batch_size: 8, hidden_units: 16, hidden_layers: 2, replay_size: 40, target_period: 7"
TEXT = f"""\
name: interrupted
seed: 5
subjects: 3
protocol: short
conditions: [CC3-CE4, noisy_CC3]
learners:
  - random
  - {{learner: ddqn, parameters: {{{SMALL}}}}}
  - {{learner: ddqn, name: prioritised, parameters: {{{SMALL}, prioritised: true}}}}
  - {{learner: semi_markov_ddqn, parameters: {{{SMALL}}}}}
  - learner: recurrent
    parameters: {{batch_size: 2, hidden_units: 8, burn_in: 3, unroll: 6, replay_size: 40}}
  - bayes
  - ideal
protocols:
  short: {{attempt_limit: 12, training_trials: 2, baseline_trials: 3}}
"""
AFTER_EVERY_STEP = Watching(checkpoint_every=0)


def experiment_of(text: str, folder: Path) -> Experiment:
    path = folder / "experiment.yaml"
    path.write_text(text, encoding="utf-8")
    return read_experiment(path)


@pytest.fixture
def experiment(tmp_path: Path) -> Experiment:
    return experiment_of(TEXT, tmp_path)


def cell_of(experiment: Experiment, learner: str, condition: str = "CC3-CE4") -> Cell:
    return next(
        cell
        for cell in experiment.cells()
        if (cell.spec.name, cell.condition.name) == (learner, condition)
    )


def contents(cell: Cell, folder: Path) -> pa.Table:
    store = Store(folder)
    return store.read(store.path(cell), cell.identity).drop_columns(["wall_time"])


def files_beside(folder: Path) -> list[str]:
    return sorted(path.suffix for path in (folder / "cells").iterdir())


@pytest.fixture
def steps(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Counts the steps that sessions of this process take."""
    taken = [0]
    step = Session.step

    def counted(self: Session, action: Any) -> Any:
        taken[0] += 1
        return step(self, action)

    monkeypatch.setattr(Session, "step", counted)
    return taken


class Killed(BaseException):
    """Stands for the end of a process, where a real one would take too long."""


def interrupt(
    cell: Cell,
    folder: Path,
    saves: int,
    watching: Watching = AFTER_EVERY_STEP,
    later: int = 0,
) -> None:
    """Play a cell, and stop for good after so many checkpoints, or so many steps later."""
    with pytest.MonkeyPatch.context() as patch:
        save, left = Checkpoint.save, [saves + later]

        def counted(self: Checkpoint, session: Session, learner: Learner) -> None:
            if left[0] > later:
                save(self, session, learner)
            left[0] -= 1
            if not left[0]:
                raise Killed

        patch.setattr(Checkpoint, "save", counted)
        with pytest.raises(Killed):
            play_cell(cell, str(folder), watching)


# -- killed by the system ---------------------------------------------------------------------


def dies(cell: Cell, folder: str, syncs: int) -> None:
    """Play a cell in a process that is killed when it flushes a file for the n-th time."""
    fsync = os.fsync

    def fatal(descriptor: int) -> None:
        nonlocal syncs
        fsync(descriptor)
        syncs -= 1
        if not syncs:
            os.kill(os.getpid(), signal.SIGKILL)

    os.fsync = fatal
    torch.set_num_threads(1)
    play_cell(cell, folder, AFTER_EVERY_STEP)


@pytest.mark.parametrize(
    ("learner", "condition"),
    [
        ("random", "noisy_CC3"),
        ("ddqn", "noisy_CC3"),
        ("semi_markov_ddqn", "CC3-CE4"),
        ("recurrent", "CC3-CE4"),
        ("bayes", "CC3-CE4"),
        ("ideal", "CC3-CE4"),
    ],
)
def test_a_killed_cell_ends_as_if_it_had_not_been(
    experiment: Experiment, tmp_path: Path, steps: list[int], learner: str, condition: str
) -> None:
    cell = cell_of(experiment, learner, condition)
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    whole, steps[0] = steps[0], 0
    # Each checkpoint flushes two files. The process dies between the two files of the 20th: its
    # attempts are there, and it is not.
    killed = tmp_path / "killed"
    victim = prepared().Process(target=dies, args=(cell, str(killed), 2 * 20 - 1))
    victim.start()
    victim.join()
    assert victim.exitcode == -signal.SIGKILL
    assert ".parquet" not in files_beside(killed)

    played = play_cell(cell, str(killed), AFTER_EVERY_STEP)
    assert played == []
    assert whole > 25
    assert steps[0] == whole - 19, "it went on from the last checkpoint"
    assert contents(cell, killed).equals(contents(cell, tmp_path / "undisturbed"))
    sweep(killed / "cells")  # as the start of a comparison does
    assert files_beside(killed) == [".parquet"]


def test_a_killed_comparison_goes_on_inside_a_cell(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Over ten seconds: a process is killed, and another comparison ends its work and reports."""
    text = TEXT.replace("[CC3-CE4, noisy_CC3]", "[noisy_CC3]").replace("limit: 12", "limit: 2000")
    path = tmp_path / "long.yaml"
    path.write_text(text, encoding="utf-8")
    words = ["compare", str(path), "-l", "random", "--out", "killed"]
    victim = subprocess.Popen(
        [sys.executable, "-m", "causal_openlock", *words, "--checkpoint-every", "0"],
        cwd=tmp_path,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    cells = tmp_path / "killed" / "cells"
    # Only now and then does one of the three subjects end an attempt: some 40 bytes each.
    until(lambda: sum(path.stat().st_size for path in cells.glob("*.attempts")) >= 2000, victim)
    victim.kill()
    victim.wait()
    assert not list(cells.glob("*.parquet"))
    start_prepared(monkeypatch)
    again = at_once(*words, cwd=tmp_path, workers=True)
    assert again.status == 0, again.stderr
    assert "warning: no" not in again.stdout
    assert "checkpoint" not in again.stdout
    experiment = read_experiment(path, Changes(learners=["random"]))
    cell = cell_of(experiment, "random", "noisy_CC3")
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    assert contents(cell, tmp_path / "killed").equals(contents(cell, tmp_path / "undisturbed"))
    assert files_beside(tmp_path / "killed") == [".parquet"]


# -- interrupted at any moment ----------------------------------------------------------------


@pytest.mark.parametrize("learner", ["random", "prioritised", "recurrent"])
def test_it_may_be_interrupted_again_and_again(
    experiment: Experiment, tmp_path: Path, learner: str
) -> None:
    cell = cell_of(experiment, learner)
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    for saves in (1, 2, 30):
        interrupt(cell, tmp_path / "often", saves)
    played = play_cell(cell, str(tmp_path / "often"), AFTER_EVERY_STEP)
    assert played == []
    assert contents(cell, tmp_path / "often").equals(contents(cell, tmp_path / "undisturbed"))


def test_wall_time_counts_the_time_played(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [0.0]

    def clock() -> float:
        now[0] += 0.001
        return now[0]

    monkeypatch.setattr(checkpoint.time, "perf_counter", clock)
    cell = cell_of(experiment, "random")
    interrupt(cell, tmp_path, 40)
    now[0] += 1e6
    play_cell(cell, str(tmp_path), Watching())
    store = Store(tmp_path)
    record = store.read(store.path(cell)).to_pandas()
    gaps = record.groupby("subject").wall_time.diff().dropna()
    assert (gaps >= 0).all()
    assert gaps.max() < 1e5, "the pause is left out"


def test_a_clock_that_is_set_back_changes_nothing(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every file is then newer than now, by a day."""
    cell = cell_of(experiment, "random")
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    store = Store(tmp_path / "out")
    store.open(experiment)
    interrupt(cell, store.folder, 40)
    store.path(cell).with_suffix(".progress").write_text("0.5 3.0", encoding="utf-8")
    then = time.time()
    monkeypatch.setattr(time, "time", lambda: then - 86400)
    progress = status_of(store).progress
    assert [one.cell.identity for one in progress.playing] == [cell.identity]
    assert progress.left is not None
    assert progress.left >= 0
    assert not play_cell(cell, str(store.folder), Watching())
    assert contents(cell, store.folder).equals(contents(cell, tmp_path / "undisturbed"))
    assert status_of(store).progress.done == 1


@pytest.mark.parametrize("said", ["nan 3", "0.5 nan", "2.0 3", "0.5 -1", "0.5 inf", "0.5 1e300"])
def test_a_report_that_cannot_be_counts_as_none(
    experiment: Experiment, tmp_path: Path, said: str
) -> None:
    cell, store = cell_of(experiment, "random"), Store(tmp_path / "out")
    store.open(experiment)
    store.path(cell).with_suffix(".progress").write_text(said, encoding="utf-8")
    assert reported_progress(store.path(cell)) is None
    assert status_of(store).progress.playing == ()


def played_on(session: Session, learner: Learner) -> pa.Table:
    for _ in session.steps(learner):
        pass
    return session.record()


def test_a_session_goes_on_by_hand_from_its_state() -> None:
    def made() -> Session:
        return Session(named("noisy_CC3"), HUMAN, 4, seed=3)

    first, learner = made(), RandomLearner()
    first.begin(learner)
    while first.progress < 0.4:
        learner.learn(first.step(learner.act(first.view)))
    session_state, learner_state = first.state_dict(), learner.state_dict()
    whole = played_on(first, learner)
    second, other = made(), RandomLearner()
    second.load_state_dict(session_state)
    second.begin(other, learner_state)
    assert second.progress >= 0.4
    resumed = played_on(second, other)
    assert second.progress == 1
    assert resumed.drop_columns(["wall_time"]).equals(whole.drop_columns(["wall_time"]))


@pytest.mark.parametrize(
    "other",
    [
        Session(named("noisy_CC3"), HUMAN, 5),
        Session(named("CC3"), HUMAN, 4),
        Session(named("noisy_CC3"), replace(HUMAN, action_limit=6), 4),
    ],
    ids=["other subjects", "no luck", "longer attempts"],
)
def test_a_session_refuses_the_state_of_another(other: Session) -> None:
    state = Session(named("noisy_CC3"), HUMAN, 4).state_dict()
    with pytest.raises(ProtocolError, match="another session"):
        other.load_state_dict(state)


# -- what cannot be used ----------------------------------------------------------------------


def cut(content: bytes) -> bytes:
    return content[: len(content) // 2]


def flip(content: bytes) -> bytes:
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize("suffix", [".checkpoint", ".attempts"])
@pytest.mark.parametrize(
    "damage", [cut, flip, lambda content: b"", lambda content: b"x" * len(content), None]
)
def test_a_damaged_checkpoint_is_told_and_its_cell_begins_again(
    experiment: Experiment,
    tmp_path: Path,
    steps: list[int],
    suffix: str,
    damage: Callable[[bytes], bytes] | None,
) -> None:
    cell = cell_of(experiment, "random")
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    whole = steps[0]
    interrupt(cell, tmp_path / "out", 12)
    path = Store(tmp_path / "out").path(cell).with_suffix(suffix)
    if damage is None:
        path.unlink()
    else:
        path.write_bytes(damage(path.read_bytes()))
    steps[0] = 0
    played = play_cell(cell, str(tmp_path / "out"), Watching())
    assert steps[0] == whole
    # Without the file that says what counts there is no checkpoint.
    if (suffix, damage) == (".checkpoint", None):
        assert played == []
    else:
        (warning,) = played
        assert str(path) in warning
        assert warning.endswith("begins again")
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "undisturbed"))


def test_no_flipped_byte_passes_for_what_was_written(tmp_path: Path) -> None:
    state = {"weights": np.arange(6000.0).reshape(2, 3000), "steps": [3, None]}
    path = tmp_path / "state"
    with path.open("wb") as file:
        write_state(file, state)
    content = path.read_bytes()
    # All that says what is where, and some of the numbers.
    places = range(len(content))
    for place in {*places[:700], *places[-400:], *places[::997]}:
        path.write_bytes(content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :])
        try:
            held = read_state(path)
        except StateError:
            continue
        assert same(held, state), place


def test_a_checkpoint_of_another_cell_or_made_with_other_packages_is_not_used(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell, other = cell_of(experiment, "random"), cell_of(experiment, "random", "noisy_CC3")
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    interrupt(cell, tmp_path / "out", 12)
    store = Store(tmp_path / "out")
    for suffix in (".checkpoint", ".attempts"):
        mine = store.path(cell).with_suffix(suffix)
        store.path(other).with_suffix(suffix).write_bytes(mine.read_bytes())
    (warning,) = play_cell(other, str(tmp_path / "out"), Watching())
    assert "is of another cell" in warning
    now = worker.versions()
    monkeypatch.setattr(worker, "versions", lambda: {**now, "numpy": "9.9"})
    (warning,) = play_cell(cell, str(tmp_path / "out"), Watching())
    assert f"was made with numpy {now['numpy']}, and here it is 9.9" in warning
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "undisturbed"))


def test_a_state_that_the_learner_cannot_load_is_told_and_its_cell_begins_again(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_of(experiment, "random")
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    interrupt(cell, tmp_path / "out", 12)

    def fails(self: Learner, state: dict[str, Any]) -> None:
        raise KeyError("streams")

    monkeypatch.setattr(RandomLearner, "load_state_dict", fails)
    (warning,) = play_cell(cell, str(tmp_path / "out"), Watching())
    assert "cannot be used" in warning
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "undisturbed"))


def test_checkpoints_of_a_changed_experiment_are_swept_and_those_still_meant_are_kept(
    experiment: Experiment, tmp_path: Path
) -> None:
    folder = tmp_path / "out"
    store = Store(folder)
    store.open(experiment)
    store.close()
    ddqn, random = cell_of(experiment, "ddqn"), cell_of(experiment, "random")
    for cell in (ddqn, random):
        interrupt(cell, folder, 3)
    changed = experiment_of(TEXT.replace("units: 16", "units: 8"), tmp_path)
    store.open(changed)
    store.close()
    kept = {store.path(random).with_suffix(suffix) for suffix in (".checkpoint", ".attempts")}
    assert set(store.cells.iterdir()) == kept


def test_what_stands_beside_a_finished_cell_is_swept(
    experiment: Experiment, tmp_path: Path
) -> None:
    only = replace(experiment, learners=experiment.learners[:1])
    store = runner.run(only, tmp_path / "out", workers=1)
    for suffix in (".checkpoint", ".attempts", ".progress"):
        store.path(cell_of(only, "random")).with_suffix(suffix).write_bytes(b"left")
    runner.run(only, tmp_path / "out", workers=1)
    assert files_beside(tmp_path / "out") == [".parquet", ".parquet"]


# -- players, which are pickled -------------------------------------------------------------------


class Noting(OneSubjectLearner):
    """Remembers what it did."""

    def begin(self) -> None:
        self.done: list[int] = []

    def act(self, observation: Any) -> int:
        self.done.append(int(self.generator.integers(self.brief.actions)))
        return sum(self.done) % self.brief.actions


class Copying(Noting):
    """The same, and yet another."""


class Runs:
    """Runs a program when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self) -> Any:
        return Path.write_text, (self.mark, "it ran")


@pytest.fixture
def noting(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Cell:
    monkeypatch.setenv(STATE, str(tmp_path / "state"))
    text = TEXT[: TEXT.index("  - random")] + "  - test_checkpoint:Noting\n"
    return experiment_of(text + TEXT[TEXT.index("protocols:") :], tmp_path).cells()[0]


def forged(state: dict[str, Any], mark: Path) -> None:
    state["players"] = pickle.dumps([Runs(mark)] * 3)


def unsealed(state: dict[str, Any], mark: Path) -> None:
    forged(state, mark)
    del state["seal"]


def sealed_for_another(state: dict[str, Any], mark: Path) -> None:
    forged(state, mark)
    state["seal"] = seal(state["players"], "players of test_checkpoint:Copying")


@pytest.mark.parametrize("change", [None, forged, unsealed, sealed_for_another])
def test_players_are_unpickled_only_if_this_user_has_kept_them(
    noting: Cell, tmp_path: Path, steps: list[int], change: Callable[..., None] | None
) -> None:
    play_cell(noting, str(tmp_path / "undisturbed"), Watching())
    whole = steps[0]
    interrupt(noting, tmp_path / "out", 12)
    path = Store(tmp_path / "out").path(noting).with_suffix(".checkpoint")
    kept = read_state(path)
    if change:
        change(kept["learner"], tmp_path / "mark")
        with path.open("wb") as file:
            write_state(file, kept)
    steps[0] = 0
    played = play_cell(noting, str(tmp_path / "out"), Watching())
    if change is None:
        assert steps[0] < whole
        assert played == []
    else:
        assert steps[0] == whole
        (warning,) = played
        assert "the state of Noting was not saved by this user on this machine" in warning
        assert warning.endswith("begins again")
    assert not (tmp_path / "mark").exists()
    assert contents(noting, tmp_path / "out").equals(contents(noting, tmp_path / "undisturbed"))


def test_the_key_of_another_user_opens_nothing(
    noting: Cell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupt(noting, tmp_path / "out", 12)
    key = tmp_path / "state" / "seal.key"
    assert key.stat().st_mode & 0o777 == 0o600
    assert len(key.read_bytes()) == 32
    monkeypatch.setenv(STATE, str(tmp_path / "other"))
    (warning,) = play_cell(noting, str(tmp_path / "out"), Watching())
    assert "was not saved by this user" in warning
    assert (tmp_path / "other" / "seal.key").read_bytes() != key.read_bytes()


def no_folder(folder: Path) -> None:
    folder.write_text("a file")


def open_to_all(folder: Path) -> None:
    folder.mkdir()
    (folder / "seal.key").write_bytes(b"x" * 32)
    (folder / "seal.key").chmod(0o644)


def cut_short(folder: Path) -> None:
    folder.mkdir()
    (folder / "seal.key").touch(0o600)


@pytest.mark.parametrize("spoil", [no_folder, open_to_all, cut_short])
def test_without_a_key_players_go_on_in_their_process_and_are_not_kept(
    noting: Cell, tmp_path: Path, spoil: Callable[[Path], None]
) -> None:
    spoil(tmp_path / "state")
    (warning,) = play_cell(noting, str(tmp_path / "out"), AFTER_EVERY_STEP)
    assert "so a killed cell begins again (the key of its seal cannot be stored in" in warning
    assert files_beside(tmp_path / "out") == [".parquet"]
    one, other = create("test_checkpoint:Noting"), create("test_checkpoint:Noting")
    session = Session(noting.condition, noting.spec.protocol, 2)
    one.begin(session.brief)
    one.act(session.view)
    other.begin(session.brief)
    other.load_state_dict(pickle.loads(pickle.dumps(one.state_dict())))
    assert same(other._players[0].done, one._players[0].done)  # type: ignore[attr-defined]


def test_processes_that_come_at_once_have_one_key(tmp_path: Path) -> None:
    """Each makes one, and that of the first counts."""
    places = [tmp_path / "state" / "seal.key"] * 3
    for path in places:
        seal_module._make(path)
    assert len({seal_module._read(path) for path in places}) == 1
    assert [path.name for path in places[0].parent.iterdir()] == ["seal.key"]


# -- what is not kept -------------------------------------------------------------------------


class Forgetful(Curious):
    """Has a memory, and does not say how it is kept."""


class Refusing(Forgetful):
    """Says that its memory cannot be kept."""

    def state_dict(self) -> dict[str, Any]:
        raise LearnerError("not this one")

    def load_state_dict(self, state: dict[str, Any]) -> None:
        raise LearnerError("not this one")


class Odd(Refusing):
    """Gives a memory that no file can hold."""

    def state_dict(self) -> dict[str, Any]:
        return {"memory": {"rooms": [{1, 2}]}}


@pytest.mark.parametrize(
    ("learner", "warning"),
    [
        ("Forgetful", None),
        ("Refusing", None),
        ("Odd", "its state cannot be kept, so a killed cell begins again (it holds set at "),
    ],
)
def test_a_learner_without_state_has_no_checkpoint(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, learner: str, warning: str | None
) -> None:
    text = TEXT[: TEXT.index("  - random")] + f"  - test_checkpoint:{learner}\n"
    experiment = experiment_of(text + TEXT[TEXT.index("protocols:") :], tmp_path)
    cell = experiment.cells()[0]
    written: list[Path] = []
    replacing = checkpoint.replacing
    monkeypatch.setattr(
        checkpoint, "replacing", lambda path: written.append(path) or replacing(path)
    )
    played = play_cell(cell, str(tmp_path / "out"), AFTER_EVERY_STEP)
    if warning is None:
        assert played == []
        assert written == []
    else:
        (said,) = played
        assert f"{learner}: {warning}" in said
        assert "memory.rooms.0" in said
        assert len(written) == 1
    assert files_beside(tmp_path / "out") == [".parquet"]
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "undisturbed"))


class Brittle(RandomLearner):
    """Keeps its state, and breaks in the second trial."""

    def act(self, view: View) -> IntArray:
        return super().act(view) // (view.trial < 2)


def test_what_a_learner_did_before_it_failed_is_not_gone_on_from(
    experiment: Experiment, tmp_path: Path
) -> None:
    cell = cell_of(experiment, "random")
    broken = replace(cell, spec=replace(cell.spec, learner="test_checkpoint:Brittle"))
    with (
        np.errstate(divide="raise"),
        pytest.raises(LearnerError, match="the learner random in CC3-CE4, subjects 0-2, failed"),
    ):
        play_cell(broken, str(tmp_path / "out"), AFTER_EVERY_STEP)
    assert files_beside(tmp_path / "out") == []


def test_a_full_disk_costs_a_checkpoint_and_not_the_cell(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = cell_of(experiment, "random")
    fsync, calls = os.fsync, [0]

    def full(descriptor: int) -> None:
        calls[0] += 1
        if 20 < calls[0] < 60:
            raise OSError(28, "No space left on device")
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", full)
    interrupt(cell, tmp_path / "out", 40)
    monkeypatch.undo()
    assert calls[0] > 80
    assert play_cell(cell, str(tmp_path / "out"), Watching()) == []
    play_cell(cell, str(tmp_path / "undisturbed"), Watching())
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "undisturbed"))


def test_checkpoints_that_take_long_are_taken_seldom(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, taken = [0.0], []
    monkeypatch.setattr(checkpoint.time, "perf_counter", lambda: now[0])
    session = Session(named("CC3"), HUMAN, 1)
    kept = Checkpoint(tmp_path / "cell.parquet", {"identity": "a"}, every=60)

    def save(*arguments: Any) -> None:
        taken.append(now[0])
        now[0] += 5 if len(taken) > 2 else 0.1

    monkeypatch.setattr(kept, "save", save)
    while now[0] < 1000:
        kept.keep(session, RandomLearner())
        now[0] += 1
    gaps = np.diff(taken)
    assert taken[0] == pytest.approx(60, abs=1)
    assert gaps[0] == pytest.approx(60, abs=2)
    assert min(gaps[2:]) >= 5 / 0.02


# -- states as files --------------------------------------------------------------------------


def test_a_state_reads_back_as_what_it_was(tmp_path: Path) -> None:
    generator = np.random.default_rng(1)
    state = {
        "plain": [None, True, 3, -0.1, float("inf"), "é", 2**127, (1, (2,), [])],
        3: {"bytes": b"\x00\xff", (1, 2): {}},
        "arrays": [np.arange(3, dtype=np.uint8), np.zeros((0, 4)), np.array(2.5), np.array(["a"])],
        "number": np.float32(0.1),
        "tensors": (torch.arange(4).reshape(2, 2).T, torch.tensor(1.5), torch.tensor([True])),
        "generator": generator.bit_generator.state,
    }
    path = tmp_path / "state"
    with path.open("wb") as file:
        write_state(file, state)
    again = read_state(path)
    assert same(again, state)
    assert [type(part) for part in again["plain"]] == [type(part) for part in state["plain"]]
    assert isinstance(again["number"], np.float32)
    assert [t.dtype for t in again["tensors"]] == [t.dtype for t in state["tensors"]]
    assert [a.dtype for a in again["arrays"]] == [a.dtype for a in state["arrays"]]


class Text(str):
    """No plain text."""


@pytest.mark.parametrize(
    "value", [{1}, np.array([{}]), object(), Text("a"), torch.zeros(1, dtype=torch.bfloat16)]
)
def test_what_is_not_plain_data_is_refused_and_named(tmp_path: Path, value: Any) -> None:
    with (tmp_path / "state").open("wb") as file, pytest.raises(StateError, match=r"state\.a\.1"):
        write_state(file, {"a": [0, value]})


def test_reading_a_state_runs_no_code(tmp_path: Path) -> None:
    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return Path.touch, (tmp_path / "sprung",)

    path = tmp_path / "state"
    outline = np.frombuffer(json.dumps(["array", "a0"]).encode(), np.uint8)
    with path.open("wb") as file:
        np.savez(file, outline=outline, a0=np.array([Trap()]))
    with pytest.raises(StateError):
        read_state(path)
    assert not (tmp_path / "sprung").exists()


@pytest.mark.parametrize("packed", [False, True])
def test_a_state_takes_no_more_memory_than_its_file(tmp_path: Path, packed: bool) -> None:
    """A header that claims a terabyte; and 40 MB that are packed into 40 kB."""
    path = tmp_path / "state"
    outline = np.frombuffer(json.dumps(["array", "a0"]).encode(), np.uint8)
    with path.open("wb") as file:
        if packed:
            np.savez_compressed(file, outline=outline, a0=np.zeros(5_000_000))
        else:
            np.savez(file, outline=outline, a0=np.zeros(8, np.int8))
    if not packed:
        content = path.read_bytes()
        start = content.index(b"{'descr': '|i1', 'fortran_order': False, 'shape': (8,), }")
        header = b"{'descr': '|i1', 'fortran_order': False, 'shape': (10**12,), }".replace(
            b"10**12", b"1000000000000"
        )
        content = content[:start] + header + content[start + len(header) :]
        path.write_bytes(with_checksums(content))
    tracemalloc.start()
    try:
        with pytest.raises(StateError, match=r"another size than its header states|larger than"):
            read_state(path)
        assert tracemalloc.get_traced_memory()[1] < 1_000_000
    finally:
        tracemalloc.stop()


def with_checksums(content: bytes) -> bytes:
    """A stored archive whose checksums are right again."""
    changed = bytearray(content)
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        directory = archive.start_dir
        for about in archive.infolist():
            begin = about.header_offset
            name, extra = struct.unpack("<HH", content[begin + 26 : begin + 30])
            data = begin + 30 + name + extra
            checksum = zlib.crc32(content[data : data + about.file_size]).to_bytes(4, "little")
            changed[begin + 14 : begin + 18] = changed[directory + 16 : directory + 20] = checksum
            directory += 46 + sum(struct.unpack("<HHH", content[directory + 28 : directory + 34]))
    return bytes(changed)


# -- looking on -------------------------------------------------------------------------------


def test_progress_inside_cells_is_told(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worker, "REPORT_EVERY", 0.0)
    seen: list[Any] = []
    steps = Session.steps

    def watched(self: Session, learner: Learner) -> Iterator[Step]:
        for step in steps(self, learner):
            yield step  # the worker looks on here
            seen.append(reported_progress(Store(tmp_path).path(cell)))

    monkeypatch.setattr(Session, "steps", watched)
    (tmp_path / "cells").mkdir()
    cell = cell_of(experiment, "random")
    play_cell(cell, str(tmp_path), Watching())
    shares = [share for _, share, _ in seen]
    assert shares == sorted(shares)
    assert len(set(shares)) > 3
    assert shares[-1] == 1
    assert reported_progress(Store(tmp_path).path(cell)) is None


def curves(folder: Path) -> dict[str, list[tuple[int, float]]]:
    loader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = loader.EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(event.step, event.value) for event in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


@pytest.mark.parametrize("learner", ["random", "ddqn", "recurrent"])
def test_curves_show_what_the_record_holds_and_change_nothing(
    experiment: Experiment, tmp_path: Path, learner: str
) -> None:
    pytest.importorskip("tensorboard")
    cell = cell_of(experiment, learner, "noisy_CC3")
    logs = tmp_path / "logs"
    play_cell(cell, str(tmp_path / "watched"), Watching(tensorboard=str(logs)))
    play_cell(cell, str(tmp_path / "plain"), Watching())
    assert contents(cell, tmp_path / "watched").equals(contents(cell, tmp_path / "plain"))
    shown = curves(logs / cell.name)
    record = contents(cell, tmp_path / "plain").to_pandas()
    rewards = shown["attempts/reward"]
    assert rewards[-1][0] == len(record) // 3
    # One point for each attempt of the three subjects, here in step until one has finished.
    first = record[(record.trial == 1) & (record.attempt == 1)]
    assert rewards[0] == (1, pytest.approx(first.reward.mean()))
    trials = record.groupby(["subject", "trial"]).agg(
        attempts=("attempt", "max"), found=("solutions_found", "max"), all=("solutions", "max")
    )
    decided = shown["trials/attempts"]
    assert len(decided) == len(shown["trials/solved_share"]) > 0
    if (trials.found < trials["all"]).all():
        assert {value for _, value in decided} == {12}
    told = {tag.removeprefix("learner/") for tag in shown if tag.startswith("learner/")}
    deep = {
        "ddqn": {
            "epsilon",
            "loss",
            "max_q",
            "dead_units",
            "differing_pairs",
            "differing_transitions",
        },
        "recurrent": {"epsilon", "loss", "max_q"},
    }
    assert told == deep.get(learner, set())


def test_curves_go_on_from_a_checkpoint(experiment: Experiment, tmp_path: Path) -> None:
    pytest.importorskip("tensorboard")
    cell = cell_of(experiment, "random")
    whole, cut_short = (tmp_path / name for name in ("whole", "cut"))
    play_cell(cell, str(tmp_path / "a"), Watching(tensorboard=str(whole)))
    watching = Watching(0, str(cut_short))
    interrupt(cell, tmp_path / "b", 19, watching, later=12)
    time.sleep(1.1)  # logs are told apart by the second in which they begin
    play_cell(cell, str(tmp_path / "b"), watching)
    assert curves(cut_short / cell.name) == curves(whole / cell.name)


def test_without_tensorboard_there_is_one_sentence(
    experiment: Experiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(OpenLockError, match=r"pip install 'causal-openlock\[tensorboard\]'"):
        runner.run(experiment, tmp_path / "out", watching=Watching(tensorboard="logs"))
    assert not (tmp_path / "out").exists()
