"""A cell that is killed continues inside itself, with whatever state its learner has.

What happens to whole folders is tested in ``tests/storage/test_folder_machine.py``.
"""

import os
import pickle
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.contract.registry import create
from causal_openlock.errors import LearnerError, OpenLockError, ProtocolError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.files import seal as seal_module
from causal_openlock.files.seal import STATE, seal
from causal_openlock.files.state import read_state, write_state
from causal_openlock.running import runner, worker
from causal_openlock.running.checkpoint import Checkpoint
from causal_openlock.running.status import status_of
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.storage.running_files import reported_progress
from causal_openlock.storage.store import Store
from openlock_learners.random import RandomLearner
from support.checkpoints import same
from support.session_play import HUMAN, Curious, named

pytestmark = pytest.mark.slow

SMALL = "batch_size: 8, hidden_units: 16, hidden_layers: 2, replay_size: 40, target_period: 7"
TEXT = """\
name: interrupted
seed: 5
subjects: 3
protocol: short
conditions: [{condition}]
learners: [{learner}]
protocols: {{short: {{attempt_limit: 8, training_trials: 1, baseline_trials: 2}}}}
"""
LEARNERS = {
    "random": "random",
    "ddqn": f"{{learner: ddqn, parameters: {{{SMALL}}}}}",
    "semi_markov_ddqn": f"{{learner: semi_markov_ddqn, parameters: {{{SMALL}}}}}",
    "recurrent": "{learner: recurrent, parameters: {batch_size: 2, hidden_units: 8, burn_in: 3, "
    "unroll: 6, replay_size: 40}}",
    "bayes": "bayes",
    "ideal": "ideal",
}
AFTER_EVERY_STEP = Watching(checkpoint_every=0)


def cell_of(folder, learner="random", condition="noisy_CC3-CE4"):
    text = TEXT.format(learner=LEARNERS.get(learner, learner), condition=condition)
    (folder / "experiment.yaml").write_text(text)
    (cell,) = read_experiment(folder / "experiment.yaml").cells()
    return cell


def contents(cell, folder):
    store = Store(folder)
    return store.read(store.path(cell), cell.identity).drop_columns(["wall_time"])


def undisturbed(cell, folder):
    play_cell(cell, str(folder / "undisturbed"), Watching())
    return contents(cell, folder / "undisturbed")


def file_of(cell, folder, suffix):
    return Store(folder).path(cell).with_suffix(suffix)


def suffixes(folder):
    return sorted(path.suffix for path in (folder / "cells").iterdir())


class Killed(BaseException):
    """Stands for the end of a process."""


def syncs(cell, folder, end=0, watching=AFTER_EVERY_STEP):
    """Play a cell, until so many files were flushed; returns how many were, and what is said.

    Each checkpoint flushes two files: that of attempts first.
    """
    taken, said = [0], None

    def sync(descriptor):
        taken[0] += 1
        if taken[0] == end:
            raise Killed

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", sync)
        if end:
            with pytest.raises(Killed):
                play_cell(cell, str(folder), watching)
        else:
            said = play_cell(cell, str(folder), watching)
    return taken[0], said


@pytest.mark.parametrize("learner", [*LEARNERS])
def test_a_killed_cell_continues_at_its_last_checkpoint(learner, tmp_path):
    cell = cell_of(tmp_path, learner)
    whole, _ = syncs(cell, tmp_path / "whole")
    assert whole > 25
    for end in (15, 9):  # between the two files of the 8th checkpoint, and of the 5th after it
        syncs(cell, tmp_path / "killed", end)
        assert suffixes(tmp_path / "killed") == [".attempts", ".checkpoint"]
    assert syncs(cell, tmp_path / "killed") == (whole - 14 - 8, [])
    assert contents(cell, tmp_path / "killed").equals(undisturbed(cell, tmp_path))
    assert suffixes(tmp_path / "killed") == [".parquet"]


def cut(content):
    return content[: len(content) // 2]


def flip(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize("suffix", [".checkpoint", ".attempts"])
@pytest.mark.parametrize("damage", [cut, flip, lambda content: b"", None])
def test_a_damaged_checkpoint_is_named_and_its_cell_begins_again(suffix, damage, tmp_path):
    cell = cell_of(tmp_path)
    whole, _ = syncs(cell, tmp_path / "whole")
    syncs(cell, tmp_path / "out", 25)
    path = file_of(cell, tmp_path / "out", suffix)
    path.write_bytes(damage(path.read_bytes())) if damage else path.unlink()
    taken, said = syncs(cell, tmp_path / "out")
    assert taken == whole
    if (suffix, damage) == (".checkpoint", None):  # then there is none
        assert said == []
    else:
        assert str(path) in said[0]
        assert len(said) == 1
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "whole"))


@pytest.mark.parametrize(
    ("change", "named"),
    [
        (lambda kept: kept["made_with"].update(identity="another"), "another cell"),
        (lambda kept: kept["made_with"].update(numpy="0.1"), "numpy 0.1"),
        (lambda kept: kept.update(learner={}), ".checkpoint"),
        (lambda kept: kept.update(session={}), ".checkpoint"),
        (lambda kept: kept.update(rows=10**6), ".attempts"),
    ],
)
def test_a_checkpoint_of_something_else_is_not_used(change, named, tmp_path):
    cell = cell_of(tmp_path)
    whole, _ = syncs(cell, tmp_path / "whole")
    syncs(cell, tmp_path / "out", 25)
    path = file_of(cell, tmp_path / "out", ".checkpoint")
    kept = read_state(path)
    change(kept)
    with path.open("wb") as file:
        write_state(file, kept)
    taken, (said,) = syncs(cell, tmp_path / "out")
    assert taken == whole
    assert named in said
    assert contents(cell, tmp_path / "out").equals(contents(cell, tmp_path / "whole"))


def test_checkpoints_are_kept_for_cells_of_the_experiment_alone(tmp_path):
    cell, another = cell_of(tmp_path, "ddqn"), cell_of(tmp_path)
    experiment = read_experiment(tmp_path / "experiment.yaml")
    store = Store(tmp_path / "out")
    store.open(experiment)
    store.close()
    for one in (cell, another):
        syncs(one, store.folder, 5)
    store.open(experiment)
    store.close()
    assert {path.stem for path in store.cells.iterdir()} == {store.path(another).stem}
    runner.run(experiment, store.folder, workers=0)
    for suffix in (".checkpoint", ".attempts", ".progress"):
        file_of(another, store.folder, suffix).write_bytes(b"left")
    runner.run(experiment, store.folder, workers=0)
    assert suffixes(store.folder) == [".parquet"]


# -- time and progress ----------------------------------------------------------------------------


def test_wall_time_counts_the_time_played(tmp_path, monkeypatch):
    now = [0.0]

    def clock():
        now[0] += 0.001
        return now[0]

    monkeypatch.setattr(time, "perf_counter", clock)
    cell = cell_of(tmp_path)
    syncs(cell, tmp_path, 41)
    now[0] += 1e6
    play_cell(cell, str(tmp_path), Watching())
    store = Store(tmp_path)
    record = store.read(store.path(cell)).to_pandas()
    gaps = record.groupby("subject").wall_time.diff().dropna()
    assert (gaps >= 0).all()
    assert gaps.max() < 1e5


def test_checkpoints_take_a_fiftieth_of_the_time_at_most(tmp_path, monkeypatch):
    now, taken = [0.0], []
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    session = Session(named("CC3"), HUMAN, 1)
    kept = Checkpoint(tmp_path / "cell.parquet", {"identity": "a"}, every=60)

    def save(*_):
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


def test_a_clock_that_is_set_back_changes_nothing(tmp_path, monkeypatch):
    cell = cell_of(tmp_path)
    store = Store(tmp_path / "out")
    store.open(read_experiment(tmp_path / "experiment.yaml"))
    syncs(cell, store.folder, 41)
    file_of(cell, store.folder, ".progress").write_text("0.5 3.0")
    then = time.time()
    monkeypatch.setattr(time, "time", lambda: then - 86400)
    progress = status_of(store).progress
    assert [one.cell.identity for one in progress.playing] == [cell.identity]
    assert progress.left >= 0
    assert not play_cell(cell, str(store.folder), Watching())
    assert contents(cell, store.folder).equals(undisturbed(cell, tmp_path))
    for impossible in ("nan 3", "0.5 nan", "2.0 3", "0.5 -1", "0.5 1e300"):
        file_of(cell, store.folder, ".progress").write_text(impossible)
        assert reported_progress(store.path(cell)) is None


class Watched(OneSubjectLearner):
    """Notes what its worker has reported so far."""

    record, shares = Path(), []

    def act(self, observation):
        if found := reported_progress(Watched.record):
            Watched.shares.append(found[1])
        return int(self.generator.integers(self.brief.actions))


def test_progress_inside_a_cell_is_reported(tmp_path, monkeypatch):
    monkeypatch.setattr(worker, "REPORT_EVERY", 0.0)
    cell = cell_of(tmp_path, "test_checkpoint:Watched")
    (tmp_path / "cells").mkdir()
    Watched.record = Store(tmp_path).path(cell)
    play_cell(cell, str(tmp_path), Watching())
    assert Watched.shares == sorted(Watched.shares)
    assert set(Watched.shares) == {0.0, 0.5}  # two trials
    assert reported_progress(Watched.record) is None


def test_a_session_continues_from_its_state():
    def made():
        return Session(named("noisy_CC3"), HUMAN, 4, seed=3)

    def played(session, learner):
        for _ in session.steps(learner):
            pass
        return session.record().drop_columns(["wall_time"])

    first, learner = made(), RandomLearner()
    first.begin(learner)
    while first.progress < 0.4:
        learner.learn(first.step(learner.act(first.view)))
    states = first.state_dict(), learner.state_dict()
    second, other = made(), RandomLearner()
    second.load_state_dict(states[0])
    second.begin(other, states[1])
    assert second.progress >= 0.4
    assert played(second, other).equals(played(first, learner))
    for strange in (
        Session(named("noisy_CC3"), HUMAN, 5),
        Session(named("CC3"), HUMAN, 4),
        Session(named("noisy_CC3"), replace(HUMAN, action_limit=6), 4),
    ):
        with pytest.raises(ProtocolError, match="another session"):
            strange.load_state_dict(states[0])


# -- players, which are pickled -------------------------------------------------------------------


class Noting(OneSubjectLearner):
    """Remembers what it did."""

    def begin(self):
        self.done = []

    def act(self, observation):
        self.done.append(int(self.generator.integers(self.brief.actions)))
        return sum(self.done) % self.brief.actions


class Copying(Noting):
    """The same, and yet another."""


class Runs:
    """Runs a program when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.write_text, (self.mark, "it ran")


@pytest.fixture
def noting(tmp_path, monkeypatch):
    monkeypatch.setenv(STATE, str(tmp_path / "state"))
    return cell_of(tmp_path, "test_checkpoint:Noting")


def forged(state, mark):
    state["players"] = pickle.dumps([Runs(mark)] * 3)


def unsealed(state, mark):
    forged(state, mark)
    del state["seal"]


def sealed_for_another(state, mark):
    forged(state, mark)
    state["seal"] = seal(state["players"], "players of test_checkpoint:Copying")


@pytest.mark.parametrize("change", [None, forged, unsealed, sealed_for_another])
def test_players_are_unpickled_only_if_this_user_has_stored_them(noting, tmp_path, change):
    seal(b"", "")  # which makes the key
    whole, _ = syncs(noting, tmp_path / "whole")
    syncs(noting, tmp_path / "out", 25)
    path = file_of(noting, tmp_path / "out", ".checkpoint")
    kept = read_state(path)
    if change:
        change(kept["learner"], tmp_path / "mark")
        with path.open("wb") as file:
            write_state(file, kept)
    taken, said = syncs(noting, tmp_path / "out")
    if change is None:
        assert (taken, said) == (whole - 24, [])
    else:
        assert taken == whole
        assert "the state of Noting was not saved by this user on this machine" in said[0]
    assert not (tmp_path / "mark").exists()
    assert contents(noting, tmp_path / "out").equals(contents(noting, tmp_path / "whole"))


def test_the_key_of_another_user_opens_nothing(noting, tmp_path, monkeypatch):
    syncs(noting, tmp_path / "out", 25)
    key = tmp_path / "state" / "seal.key"
    assert key.stat().st_mode & 0o777 == 0o600
    assert len(key.read_bytes()) == 32
    monkeypatch.setenv(STATE, str(tmp_path / "other"))
    (warning,) = play_cell(noting, str(tmp_path / "out"), Watching())
    assert "was not saved by this user" in warning
    assert (tmp_path / "other" / "seal.key").read_bytes() != key.read_bytes()


@pytest.mark.parametrize("content", [None, b"x" * 32, b""])
def test_without_a_key_players_are_not_stored(noting, tmp_path, content):
    """The folder of the key is a file; others can read the key; it is cut short."""
    folder = tmp_path / "state"
    if content is None:
        folder.write_text("a file")
    else:
        folder.mkdir()
        (folder / "seal.key").write_bytes(content)
        (folder / "seal.key").chmod(0o644 if content else 0o600)
    (warning,) = play_cell(noting, str(tmp_path / "out"), AFTER_EVERY_STEP)
    assert f"cannot be stored in {folder}" in warning
    assert STATE in warning
    assert suffixes(tmp_path / "out") == [".parquet"]
    # Within this process they can still be copied.
    one, other = create("test_checkpoint:Noting"), create("test_checkpoint:Noting")
    session = Session(noting.condition, noting.spec.protocol, 2)
    one.begin(session.brief)
    one.act(session.view)
    other.begin(session.brief)
    other.load_state_dict(pickle.loads(pickle.dumps(one.state_dict())))
    assert same(other._players[0].done, one._players[0].done)


def test_processes_that_make_a_key_at_once_have_the_same(tmp_path):
    places = [tmp_path / "state" / "seal.key"] * 3
    for path in places:
        seal_module._make(path)
    assert len({seal_module._read(path) for path in places}) == 1
    assert [path.name for path in places[0].parent.iterdir()] == ["seal.key"]


# -- learners without a state that can be stored --------------------------------------------------


class Forgetful(Curious):
    """Has a memory, and does not say how it is stored."""


class Refusing(Curious):
    """Says that its memory cannot be stored."""

    def state_dict(self):
        raise LearnerError("not this one")

    def load_state_dict(self, state):
        raise LearnerError("not this one")


class Odd(Refusing):
    """Gives a memory that no file can hold."""

    def state_dict(self):
        return {"memory": {"rooms": [{1, 2}]}}


@pytest.mark.parametrize("learner", ["Forgetful", "Refusing", "Odd"])
def test_a_learner_without_state_has_no_checkpoint(learner, tmp_path):
    cell = cell_of(tmp_path, f"test_checkpoint:{learner}")
    taken, said = syncs(cell, tmp_path / "out")
    assert taken == 1  # the record's
    assert [" holds set at state.learner.memory.rooms.0" in one for one in said] == (
        [True] if learner == "Odd" else []
    )
    assert suffixes(tmp_path / "out") == [".parquet"]
    assert contents(cell, tmp_path / "out").equals(undisturbed(cell, tmp_path))


class Brittle(RandomLearner):
    """Stores its state, and breaks in the second trial."""

    def act(self, view):
        return super().act(view) // (view.trial < 2)


def test_a_learner_that_failed_begins_again(tmp_path):
    cell = cell_of(tmp_path, "test_checkpoint:Brittle")
    with np.errstate(divide="raise"), pytest.raises(LearnerError, match="Brittle in noisy_CC3"):
        play_cell(cell, str(tmp_path / "out"), AFTER_EVERY_STEP)
    assert suffixes(tmp_path / "out") == []


# -- curves of TensorBoard ------------------------------------------------------------------------


def curves(folder):
    loader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = loader.EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(event.step, event.value) for event in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


DEEP = {"epsilon", "loss", "max_q"}
OWN = {"random": set(), "recurrent": DEEP}
OWN["ddqn"] = {*DEEP, "dead_units", "differing_pairs", "differing_transitions"}


@pytest.mark.parametrize("learner", [*OWN])
def test_curves_show_what_the_record_holds_and_change_nothing(learner, tmp_path):
    cell = cell_of(tmp_path, learner, "noisy_CC3")
    play_cell(cell, str(tmp_path / "watched"), Watching(tensorboard=str(tmp_path / "logs")))
    assert contents(cell, tmp_path / "watched").equals(undisturbed(cell, tmp_path))
    shown = curves(tmp_path / "logs" / cell.name)
    record = contents(cell, tmp_path / "watched").to_pandas()
    # One point for each attempt of the three subjects, here in step until one has finished.
    first = record[(record.trial == 1) & (record.attempt == 1)]
    assert shown["attempts/reward"][0] == (1, pytest.approx(first.reward.mean()))
    assert shown["attempts/reward"][-1][0] == len(record) // 3
    assert len(shown["trials/attempts"]) == len(shown["trials/solved_share"]) == 2
    told = {tag.removeprefix("learner/") for tag in shown if tag.startswith("learner/")}
    assert told == OWN[learner]


def test_curves_continue_from_a_checkpoint(tmp_path):
    cell = cell_of(tmp_path)
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    play_cell(cell, str(tmp_path / "a"), Watching(tensorboard=str(whole)))
    syncs(cell, tmp_path / "b", 39, Watching(0, str(killed)))
    time.sleep(1.1)  # logs are told apart by the second in which they begin
    play_cell(cell, str(tmp_path / "b"), Watching(0, str(killed)))
    assert curves(killed / cell.name) == curves(whole / cell.name)


def test_without_tensorboard_it_says_what_to_install(tmp_path, monkeypatch):
    cell_of(tmp_path)
    experiment = read_experiment(tmp_path / "experiment.yaml")
    monkeypatch.setattr("importlib.util.find_spec", lambda name: None)
    with pytest.raises(OpenLockError, match=r"pip install 'causal-openlock\[tensorboard\]'"):
        runner.run(experiment, tmp_path / "out", watching=Watching(tensorboard="logs"))
    assert not (tmp_path / "out").exists()
