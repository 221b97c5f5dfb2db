"""Stable-Baselines3 as a learner: it does what it does alone, and leaves everything else alone."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import pytest
import torch

from causal_openlock.comparison.comparing import play as play_experiment
from causal_openlock.comparison.results import Results
from causal_openlock.contract.checks import GlobalRandomness
from causal_openlock.contract.one_subject import OneSubjectLearner
from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import LearnerError
from causal_openlock.experiment.condition import Condition, Trials
from causal_openlock.experiment.making import learner as spec_of
from causal_openlock.experiment.making import make_experiment
from causal_openlock.experiment.protocol import Protocol
from causal_openlock.experiment.session import Session
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Layout
from openlock_learners.sb3 import StableBaselines, StableBaselinesParameters
from support.waiting import HANGS

pytestmark = pytest.mark.slow

sb3 = pytest.importorskip("stable_baselines3")
sb3_contrib = pytest.importorskip("sb3_contrib")

CC3 = find_schema("CC3")
ONE_ROOM = Condition("room", (Trials(CC3, (Layout.of(CC3, "trial1"),)),))
PROTOCOL = Protocol("t", attempt_limit=30, stop_when_solved=False, baseline_trials=1)
QUICK = {
    "PPO": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
    "DQN": {"learning_starts": 10, "batch_size": 8, "buffer_size": 100, "train_freq": 1},
    "RecurrentPPO": {"n_steps": 16, "batch_size": 8, "n_epochs": 2},
}


def session_of(subjects=1):
    return Session(ONE_ROOM, PROTOCOL, subjects, reward="basic", learner="t")


def begun(subjects=1, **parameters):
    """A learner in its session."""
    session, learner = session_of(subjects=subjects), create("sb3", parameters)
    learner.begin(session.brief)
    return learner, session


def play(learner, session):
    """What the first subject does."""
    done = []
    while not session.over:
        actions = learner.act(session.view)
        done.append(int(actions[0]))
        learner.learn(session.step(actions))
    return done


class Watched(OpenLockEnv):
    """Notes what is done in it."""

    def __init__(self, **settings):
        super().__init__(**settings)
        self.done = []

    def step(self, action):
        self.done.append(int(action))
        return super().step(action)


def alone(algorithm, seed, steps, total, episode):
    """What the library does by itself, in our environment."""
    room = Watched(schema="CC3", layout="trial1", reward="basic", episode=episode)
    library = sb3 if hasattr(sb3, algorithm) else sb3_contrib
    policy = "MlpLstmPolicy" if algorithm.startswith("Recurrent") else "MlpPolicy"
    model = getattr(library, algorithm)(policy, room, seed=seed, device="cpu", **QUICK[algorithm])
    before = GlobalRandomness.now()
    model.learn(total)
    before.restore()
    return room.done[:steps]


@pytest.mark.parametrize(
    ("algorithm", "episode"),
    [("PPO", "trial"), ("DQN", "attempt"), ("DQN", "trial"), ("RecurrentPPO", "attempt")],
)
def test_it_does_what_the_library_does_by_itself(algorithm, episode):
    learner, session = begun(algorithm=algorithm, settings=QUICK[algorithm], episode=episode)
    (seeded,) = session_of().brief.generators
    done = play(learner, session)
    most = session.brief.trials * 30 * 3
    assert done == alone(algorithm, int(seeded.integers(2**31 - 1)), len(done), most, episode)
    assert len(done) > 80
    # It has learned on the way, or there would be little to compare.
    assert learner.updates_made() > 4


def test_threads_and_models_end_with_the_learner():
    before = {*threading.enumerate()}
    learner, session = begun(subjects=2, settings=QUICK["PPO"])
    learner.act(session.view)
    threads = {*threading.enumerate()} - before
    assert len(threads) == 2
    del learner
    assert not any(thread.is_alive() for thread in threads)


ENDS_EARLY = """
from test_sb3 import begun
learner, session = begun(subjects=3, algorithm="A2C")
for _ in range(20):
    learner.learn(session.step(learner.act(session.view)))
"""


def test_a_program_can_end_while_its_models_wait():
    done = subprocess.run(
        [sys.executable, "-c", ENDS_EARLY],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        capture_output=True,
        text=True,
        timeout=HANGS,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")


class Ran:
    """Unpickled, it leaves a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return Path.touch, (self.path,)


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """The file of a model that prefers one action, with a pickle among its data."""
    folder = tmp_path_factory.mktemp("trained")
    room = OpenLockEnv(schema="CC3", layout="trial1")
    before = GlobalRandomness.now()
    model = sb3.PPO("MlpPolicy", room, device="cpu", seed=1)
    before.restore()
    with torch.no_grad():
        model.policy.action_net.bias[3] = 50.0
    model.planted = Ran(folder / "it ran")
    model.save(folder / "ppo.zip")
    return folder / "ppo.zip"


def test_a_trained_model_plays_by_its_weights_and_nothing_is_unpickled(trained):
    learner, session = begun(model=str(trained), learns=False)
    assert {*play(learner, session)} == {3}
    assert learner.updates_made() is None
    assert not [*trained.parent.glob("it ran")]
    sb3.PPO.load(trained)  # as the library reads it
    assert [*trained.parent.glob("it ran")]


def test_a_trained_model_goes_on_learning(trained):
    learner, session = begun(model=str(trained), settings=QUICK["PPO"])
    assert play(learner, session)[0] == 3
    assert learner.updates_made() > 4


def test_a_trained_model_that_does_not_fit_is_refused(trained, tmp_path):
    shape = {"policy_kwargs": {"net_arch": [8]}}
    assert "for the weights" in refused(model=str(trained), policy="MultiInputPolicy")
    assert "for the weights" in refused(model=str(trained), settings=shape)
    (tmp_path / "no.zip").write_text("no")
    assert "not a model" in refused(model=str(tmp_path / "no.zip"))
    with (tmp_path / "huge.zip").open("wb") as file:
        file.truncate(1 << 40)
    assert "128 MiB" in refused(model=str(tmp_path / "huge.zip"))
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(LearnerError, match="128 MiB"):
        StableBaselines.artifact_hash(StableBaselinesParameters(model=str(tmp_path / "pipe")))


def test_the_report_has_what_it_was_trained_with(trained):
    given = spec_of("sb3", label="given", model=str(trained), prior_attempts=6700)
    unknown = spec_of("sb3", label="unknown", model=str(trained))
    made = make_experiment(["CC3"], [given, unknown, "sb3"])
    assert [spec.origin.prior_attempts for spec in made.learners] == [6700, None, 0]
    assert made.learners[0].origin.artifact_hash


class Late(OneSubjectLearner):
    """A learner of a user's own that never comes to learn."""

    def act(self, observation):
        return 14

    def updates_made(self):
        return 0


class InTime(Late):
    def updates_made(self):
        return 3


def test_who_never_learns_is_named_before_and_after(tmp_path):
    short = Protocol("short", attempt_limit=5, stop_when_solved=True, baseline_trials=1)
    quick = spec_of("sb3", label="quick", settings={"n_steps": 5, "batch_size": 5})
    learners = ["sb3", quick, Late, InTime]
    told = []
    made = make_experiment(["CC3"], learners, subjects=1, protocol=short)
    play_experiment(made, tmp_path, warn=told.append, workers=0)
    results = Results.read(tmp_path)
    assert "sb3 first learns after 2,048 actions" in told[0]
    assert "at most 15" in told[0]
    named = [warning for warning in results.warnings if "never learned" in warning]
    assert [name.partition(":")[0] for name in named] == ["sb3", "Late"]


def test_settings_of_a_file_become_what_the_library_takes():
    settings = {"train_freq": [1, "episode"], "policy_kwargs": {"activation_fn": "ReLU"}}
    learner, _ = begun(algorithm="DQN", settings={**QUICK["DQN"], **settings})
    model = learner._players[0].model
    assert (model.train_freq.frequency, model.train_freq.unit.value) == (1, "episode")
    assert "ReLU" in str(model.policy)
    assert "ReLU" in refused(settings={"policy_kwargs": {"activation_fn": "Relu"}})


def refused(**parameters):
    with pytest.raises(LearnerError) as error:
        begun(**parameters)
    return str(error.value)


@pytest.mark.parametrize(
    ("module", "algorithm"), [("stable_baselines3", "PPO"), ("sb3_contrib", "RecurrentPPO")]
)
def test_a_library_that_is_not_installed_is_named(module, algorithm, monkeypatch):
    monkeypatch.setitem(sys.modules, module, None)
    assert "pip install 'causal-openlock[sb3]'" in refused(algorithm=algorithm)


def test_wrong_settings_are_named():
    assert "PPO?" in refused(algorithm="PPPO")
    assert "n_step" in refused(settings={"n_step": 4})
    assert "SAC" in refused(algorithm="SAC")


def test_a_failure_while_it_learns_is_told_and_does_not_hang():
    learner, session = begun(algorithm="DQN", settings=QUICK["DQN"])

    def fails(*_, **__):
        raise RuntimeError("no such luck")

    learner._players[0].model.train = fails
    with pytest.raises(LearnerError, match=r"failed while it learned \(RuntimeError: no such luck"):
        play(learner, session)
