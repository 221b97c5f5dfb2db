"""A cell that is killed continues inside itself, with whatever state its learner has.

What happens to whole folders is tested in ``tests/storage/test_folder_machine.py``.
"""

import io
import os
import pickle
import random
import time
from pathlib import Path

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.errors import OpenLockError, Stopped
from causal_openlock.files.seal import STATE, sealed, unsealed
from causal_openlock.running import runner, worker
from causal_openlock.running.checkpoint import Checkpoint
from causal_openlock.running.worker import Watching
from causal_openlock.storage.store import Store
from openlock_learners.random import RandomLearner

pytestmark = pytest.mark.slow

SMALL = {"batch_size": 8, "hidden_units": 16, "hidden_layers": 2, "target_period": 7}
LEARNERS = {
    "random": "random",
    "ddqn": ol.learner("ddqn", replay_size=40, **SMALL),
    "global": "test_checkpoint:Global",
}


def declared(learner="random", condition="noisy_CC3-CE4"):
    """An experiment of one cell."""
    protocol = {"attempt_limit": 8, "training_trials": 1, "baseline_trials": 2}
    return ol.make_experiment(
        [condition], [LEARNERS.get(learner, learner)], subjects=3, seed=5, protocol=protocol
    )


def play(experiment, folder, checkpoint_every=0.0, **options):
    """Play a cell in this process; returns what is said."""
    said = []
    watching = Watching(checkpoint_every, **options)
    runner.run(experiment, folder, workers=0, watching=watching, warn=said.append)
    return said


def contents(folder):
    return Store(folder).record()[0].drop_columns(["wall_time"])


def undisturbed(experiment, folder):
    play(experiment, folder / "undisturbed", 60.0)
    return contents(folder / "undisturbed")


def suffixes(folder):
    return sorted(path.suffix for path in (folder / "cells").iterdir())


class Killed(Stopped):
    """Stands for the end of a process."""


def syncs(experiment, folder, end=0, **options):
    """Play a cell to its end, or until the ``end``-th file is flushed; how many were, what is said.

    The first ones of a folder are its experiment's and its code's, and the others are checkpoints
    and the record.
    """
    taken, said = [0], None

    def sync(descriptor):
        taken[0] += 1
        if taken[0] == end:
            raise Killed(9)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "fsync", sync)
        if end:
            with pytest.raises(Killed):
                play(experiment, folder, **options)
        else:
            said = play(experiment, folder, **options)
    return taken[0], said


@pytest.mark.parametrize("learner", ["random", "global"])
def test_a_killed_cell_continues_at_its_last_checkpoint(learner, tmp_path):
    experiment = declared(learner)
    whole, _ = syncs(experiment, tmp_path / "whole")
    for end in (7, 5):
        syncs(experiment, tmp_path / "killed", end)
    taken, said = syncs(experiment, tmp_path / "killed")
    assert taken == whole - 6 - 4
    assert not said or learner == "global"
    assert contents(tmp_path / "killed").equals(undisturbed(experiment, tmp_path))
    assert suffixes(tmp_path / "killed") == [".parquet"]


def made_with(**other):
    """Change what a checkpoint says that it was made with."""

    def change(content):
        file = io.BytesIO(unsealed(content))
        return sealed(pickle.dumps({**pickle.load(file), **other}) + file.read())

    return change


@pytest.mark.parametrize(
    ("change", "why"),
    [
        (lambda content: content[:-9], "it is damaged"),
        (lambda content: content[:99] + bytes([content[99] ^ 1]) + content[100:], "it is damaged"),
        (lambda content: b"", "it is damaged"),
        (made_with(identity="0"), "identity 0"),
        (made_with(numpy="0.1"), "numpy 0.1"),
    ],
)
def test_a_checkpoint_that_does_not_fit_is_named_and_its_cell_begins_again(change, why, tmp_path):
    experiment = declared()
    syncs(experiment, tmp_path / "out", 25)
    (path,) = (tmp_path / "out" / "cells").glob("*.checkpoint")
    path.write_bytes(change(path.read_bytes()))
    (said,) = play(experiment, tmp_path / "out")
    assert str(path) in said
    assert why in said
    assert contents(tmp_path / "out").equals(undisturbed(experiment, tmp_path))


# -- time and progress ----------------------------------------------------------------------------


def test_wall_time_counts_the_time_played(tmp_path, monkeypatch):
    now = [0.0]

    def clock():
        now[0] += 0.001
        return now[0]

    monkeypatch.setattr(time, "perf_counter", clock)
    experiment = declared()
    syncs(experiment, tmp_path / "out", 41)
    now[0] += 1e6
    play(experiment, tmp_path / "out")
    record = Store(tmp_path / "out").record()[0].to_pandas()
    gaps = record.groupby("subject").wall_time.diff().dropna()
    assert (gaps >= 0).all()
    assert gaps.max() < 1e5


def test_checkpoints_take_a_fiftieth_of_the_time_at_most(tmp_path, monkeypatch):
    now, taken = [0.0], []
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    session, learner = worker.made(declared().cells()[0])
    session.begin(learner)
    kept = Checkpoint(tmp_path / "cell.parquet", {"identity": "a"}, every=60)

    def save(*_):
        taken.append(now[0])
        now[0] += 5 if len(taken) > 2 else 0.1

    monkeypatch.setattr("causal_openlock.running.checkpoint.write_bytes", save)
    while now[0] < 1000:
        kept.keep(session, learner)
        now[0] += 1
    gaps = np.diff(taken)
    assert taken[0] == pytest.approx(60, abs=1)
    assert gaps[0] == pytest.approx(60, abs=2)
    assert min(gaps[2:]) >= 5 / 0.02


def test_progress_inside_a_cell_is_reported(tmp_path, monkeypatch):
    shares = []
    monkeypatch.setattr(worker, "REPORT_EVERY", 0.0)
    monkeypatch.setattr(worker, "report_progress", lambda path, share, _: shares.append(share))
    play(declared(), tmp_path / "out")
    assert shares == sorted(shares)
    assert set(shares) == {0.0, 0.5, 1.0}  # two trials


# -- players, which are pickled -------------------------------------------------------------------


class Draws(OneSubjectLearner):
    """Draws its actions."""

    def act(self, observation):
        return int(self.generator.integers(self.brief.actions))


class Runs:
    """Runs a program when it is unpickled."""

    def __reduce__(self):
        return Path.write_text, (Path(os.environ["MARK"]), "it ran")


class Trapped(Draws):
    """Holds something that runs a program when it is unpickled."""

    def begin(self):
        self.trap = Runs()


def test_a_checkpoint_is_unpickled_for_the_user_who_wrote_it_alone(tmp_path, monkeypatch):
    monkeypatch.setenv("MARK", str(tmp_path / "mark"))
    experiment = declared("test_checkpoint:Trapped")
    for reader, runs in (("other", False), ("own", True)):
        monkeypatch.setenv(STATE, str(tmp_path / "key of own"))
        syncs(experiment, tmp_path / reader, 25)
        monkeypatch.setenv(STATE, str(tmp_path / f"key of {reader}"))
        said = play(experiment, tmp_path / reader)
        assert (tmp_path / "mark").exists() == runs
        assert ["by this user" in sentence for sentence in said] == [True] * (not runs)
        assert contents(tmp_path / reader).equals(undisturbed(experiment, tmp_path))
    key = tmp_path / "key of own" / "seal.key"
    assert (key.stat().st_mode & 0o777, key.stat().st_size) == (0o600, 32)
    assert (tmp_path / "key of other" / "seal.key").read_bytes() != key.read_bytes()


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
    (warning,) = play(declared("test_checkpoint:Draws"), tmp_path / "out")
    assert f"cannot be stored in {folder}" in warning
    assert STATE in warning
    assert suffixes(tmp_path / "out") == [".parquet"]


# -- learners without a state that can be stored --------------------------------------------------


class Odd(Draws):
    """Has a memory that no file can hold."""

    def begin(self):
        self.drawn = lambda: None


class OddAtOnce(RandomLearner):
    """The same, for all subjects."""

    def begin(self, brief):
        super().begin(brief)
        self.drawn = lambda: None


class Unwilling(Draws):
    """Could be stored, and says no."""

    resumable = False


@pytest.mark.parametrize(
    ("learner", "named"),
    [("Odd", "drawn"), ("OddAtOnce", "drawn"), ("Unwilling", "resumable = False")],
)
def test_a_learner_that_cannot_be_stored_is_played_and_named_once(learner, named, tmp_path):
    taken, (said,) = syncs(declared(f"test_checkpoint:{learner}"), tmp_path / "out")
    assert taken == 3  # the experiment's, its code's and the record's
    assert (named in said, "begins again" in said) == (True, True)
    with pytest.warns(UserWarning, match="begins again") as caught:
        results = ol.compare(["CC3", "CE3"], f"test_checkpoint:{learner}", subjects=1, workers=0)
    assert [str(warning.message) for warning in caught] == [said]
    assert results.warnings.count(said) == 1


class Global(Draws):
    """Draws from the generators that all code shares."""

    def act(self, observation):
        return random.randrange(8) + np.random.randint(7)  # noqa: NPY002


# -- curves of TensorBoard ------------------------------------------------------------------------


def curves(folder):
    loader = pytest.importorskip("tensorboard.backend.event_processing.event_accumulator")
    events = loader.EventAccumulator(str(folder))
    events.Reload()
    return {
        tag: [(event.step, event.value) for event in events.Scalars(tag)]
        for tag in events.Tags()["scalars"]
    }


DDQN = {"epsilon", "loss", "max_q"}


@pytest.mark.parametrize(("learner", "metrics"), [("random", set()), ("ddqn", DDQN)])
def test_curves_show_what_the_record_holds_and_change_nothing(learner, metrics, tmp_path):
    experiment = declared(learner, "noisy_CC3")
    play(experiment, tmp_path / "watched", tensorboard=str(tmp_path / "logs"))
    assert contents(tmp_path / "watched").equals(undisturbed(experiment, tmp_path))
    shown = curves(tmp_path / "logs" / experiment.cells()[0].name)
    record = contents(tmp_path / "watched").to_pandas()
    # One point for each attempt of the three subjects, here in step until one has finished.
    first = record[(record.trial == 1) & (record.attempt == 1)]
    assert shown["attempts/reward"][0] == (1, pytest.approx(first.reward.mean()))
    assert shown["attempts/reward"][-1][0] == len(record) // 3
    assert len(shown["trials/attempts"]) == len(shown["trials/solved_share"]) == 2
    own = {tag.removeprefix("learner/") for tag in shown if tag.startswith("learner/")}
    assert own == metrics


def test_curves_continue_from_a_checkpoint(tmp_path):
    experiment = declared()
    whole, killed = tmp_path / "whole", tmp_path / "killed"
    play(experiment, tmp_path / "a", tensorboard=str(whole))
    syncs(experiment, tmp_path / "b", 39, tensorboard=str(killed))
    time.sleep(1.1)  # logs are told apart by the second in which they begin
    play(experiment, tmp_path / "b", tensorboard=str(killed))
    name = experiment.cells()[0].name
    assert curves(killed / name) == curves(whole / name)


def test_without_tensorboard_it_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setattr(runner, "find_spec", lambda name: None)
    with pytest.raises(OpenLockError, match=r"pip install 'causal-openlock\[tensorboard\]'"):
        play(declared(), tmp_path / "out", tensorboard="logs")
    assert not (tmp_path / "out").exists()
