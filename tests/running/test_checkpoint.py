"""A cell that is killed continues inside itself, with whatever state its learner has.

What happens to whole folders is tested in ``tests/storage/test_folder_machine.py``.
"""

import os
import random
import time
from pathlib import Path

import numpy as np
import pytest

from causal_openlock import compare, open_results
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.errors import LearnerError, OpenLockError
from causal_openlock.experiment.file import read_experiment
from causal_openlock.experiment.session import Session
from causal_openlock.files.seal import STATE
from causal_openlock.running import runner, worker
from causal_openlock.running.checkpoint import Checkpoint
from causal_openlock.running.worker import Watching, play_cell
from causal_openlock.storage.beside_cell import reported_progress
from causal_openlock.storage.store import Store
from causal_openlock.storage.versions import versions
from openlock_learners.random import RandomLearner
from support.session_play import HUMAN, named

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
    "sb3": "{learner: sb3, parameters: {algorithm: DQN, settings: {learning_starts: 4}}}",
}
AFTER_EVERY_STEP = Watching(checkpoint_every=0)


def cell_of(folder, learner="random", condition="noisy_CC3-CE4"):
    text = TEXT.format(learner=LEARNERS.get(learner, learner), condition=condition)
    (folder / "experiment.yaml").write_text(text)
    (cell,) = read_experiment(folder / "experiment.yaml").cells()
    return cell


def contents(cell, folder):
    store = Store(folder)
    return store.read(store.path(cell)).drop_columns(["wall_time"])


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
    """Play a cell, until so many files were flushed; returns how many were, and what is said."""
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
    for end in (7, 5):
        syncs(cell, tmp_path / "killed", end)
    taken, said = syncs(cell, tmp_path / "killed")
    assert (taken, said) == (whole - 6 - 4, [])
    assert contents(cell, tmp_path / "killed").equals(undisturbed(cell, tmp_path))
    assert suffixes(tmp_path / "killed") == [".parquet"]


def cut(content):
    return content[: len(content) // 2]


def flip(content):
    middle = len(content) // 2
    return content[:middle] + bytes([content[middle] ^ 1]) + content[middle + 1 :]


@pytest.mark.parametrize("damage", [cut, flip, lambda content: b""])
def test_a_damaged_checkpoint_is_named_and_its_cell_begins_again(damage, tmp_path):
    cell = cell_of(tmp_path)
    syncs(cell, tmp_path / "out", 25)
    path = file_of(cell, tmp_path / "out", ".checkpoint")
    path.write_bytes(damage(path.read_bytes()))
    (said,) = play_cell(cell, str(tmp_path / "out"), Watching())
    assert str(path) in said
    assert contents(cell, tmp_path / "out").equals(undisturbed(cell, tmp_path))


@pytest.mark.parametrize(
    ("change", "named"),
    [({"identity": "0"}, "identity 0"), ({"numpy": "0.1"}, "numpy 0.1")],
)
def test_a_checkpoint_of_something_else_is_not_used(change, named, tmp_path):
    cell = cell_of(tmp_path)
    path = file_of(cell, tmp_path / "out", ".checkpoint")
    path.parent.mkdir(parents=True)
    session, learner = worker.made(cell)
    session.begin(learner)
    session.step(learner.act(session.view))
    made_with = {"identity": cell.identity, **versions(), **change}
    Checkpoint(path, made_with, 0).save(session, learner)
    (said,) = play_cell(cell, str(tmp_path / "out"), Watching())
    assert str(path) in said
    assert named in said
    assert contents(cell, tmp_path / "out").equals(undisturbed(cell, tmp_path))


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


# -- players, which are pickled -------------------------------------------------------------------


class Noting(OneSubjectLearner):
    """Remembers what it did."""

    def begin(self):
        self.done = []

    def act(self, observation):
        self.done.append(int(self.generator.integers(self.brief.actions)))
        return sum(self.done) % self.brief.actions


class Runs:
    """Runs a program when it is unpickled."""

    def __init__(self, mark):
        self.mark = mark

    def __reduce__(self):
        return Path.write_text, (self.mark, "it ran")


class Trapped(Noting):
    """Holds something that runs a program when it is unpickled."""

    def begin(self):
        super().begin()
        self.trap = Runs(Path(os.environ["MARK"]))


def test_a_checkpoint_is_unpickled_for_the_user_who_wrote_it_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("MARK", str(tmp_path / "mark"))
    cell = cell_of(tmp_path, "test_checkpoint:Trapped")
    for reader, runs in (("other", False), ("own", True)):
        monkeypatch.setenv(STATE, str(tmp_path / "own"))
        syncs(cell, tmp_path / reader, 25)
        monkeypatch.setenv(STATE, str(tmp_path / reader))
        said = play_cell(cell, str(tmp_path / reader), Watching())
        assert (tmp_path / "mark").exists() == runs
        assert ["by this user" in one for one in said] == [True] * (not runs)
        assert contents(cell, tmp_path / reader).equals(undisturbed(cell, tmp_path))
    key = tmp_path / "own" / "seal.key"
    assert (key.stat().st_mode & 0o777, key.stat().st_size) == (0o600, 32)
    assert (tmp_path / "other" / "seal.key").read_bytes() != key.read_bytes()


@pytest.mark.parametrize("content", [None, b"x" * 32, b""])
def test_without_a_key_there_is_no_checkpoint(tmp_path, monkeypatch, content):
    """The folder of the key is a file; others can read the key; it is cut short."""
    folder = tmp_path / "state"
    monkeypatch.setenv(STATE, str(folder))
    if content is None:
        folder.write_text("a file")
    else:
        folder.mkdir()
        (folder / "seal.key").write_bytes(content)
        (folder / "seal.key").chmod(0o644 if content else 0o600)
    cell = cell_of(tmp_path, "test_checkpoint:Noting")
    (warning,) = play_cell(cell, str(tmp_path / "out"), AFTER_EVERY_STEP)
    assert f"cannot be stored in {folder}" in warning
    assert STATE in warning
    assert suffixes(tmp_path / "out") == [".parquet"]


# -- learners without a state that can be stored --------------------------------------------------


class Odd(OneSubjectLearner):
    """Has a memory that no file can hold."""

    def begin(self):
        self.drawn = lambda: int(self.generator.integers(self.brief.actions))

    def act(self, observation):
        return self.drawn()


class OddAtOnce(RandomLearner):
    """The same, for all subjects."""

    def begin(self, brief):
        super().begin(brief)
        self.drawn = lambda: None


class Unwilling(Noting):
    """Could be stored, and says no."""

    resumable = False


@pytest.mark.parametrize(
    ("learner", "named"),
    [("Odd", "drawn"), ("OddAtOnce", "drawn"), ("Unwilling", "resumable = False")],
)
def test_a_learner_that_cannot_be_stored_is_played_and_named(learner, named, tmp_path):
    cell = cell_of(tmp_path, f"test_checkpoint:{learner}")
    taken, (said,) = syncs(cell, tmp_path / "out")
    assert taken == 1  # the record's
    assert suffixes(tmp_path / "out") == [".parquet"]
    assert contents(cell, tmp_path / "out").equals(undisturbed(cell, tmp_path))
    compared = tmp_path / "compared"
    with pytest.warns(UserWarning, match="begins again") as caught:
        compare(["CC3", "CE3"], f"test_checkpoint:{learner}", subjects=1, workers=0, out=compared)
    assert [str(warning.message) for warning in caught] == [said]
    warned = [warning for warning in open_results(compared).warnings if warning == said]
    assert (len(warned), named in said, "begins again" in said) == (1, True, True)


class Global(Noting):
    """Draws from the generators that all code shares."""

    def act(self, observation):
        return random.randrange(8) + np.random.randint(7)  # noqa: NPY002


def test_a_learner_with_global_randomness_continues(tmp_path):
    cell = cell_of(tmp_path, "test_checkpoint:Global")
    syncs(cell, tmp_path / "out", 25)
    taken, _ = syncs(cell, tmp_path / "out")
    whole, _ = syncs(cell, tmp_path / "whole")
    assert taken == whole - 24
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
    monkeypatch.setattr(runner, "find_spec", lambda name: None)
    with pytest.raises(OpenLockError, match=r"pip install 'causal-openlock\[tensorboard\]'"):
        runner.run(experiment, tmp_path / "out", watching=Watching(tensorboard="logs"))
    assert not (tmp_path / "out").exists()
