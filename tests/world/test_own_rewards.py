"""Rewards that are functions of one's own: paid alike everywhere, known by their code."""

import sys
from dataclasses import replace

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.contract.registry import create
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.experiment.declare import PROTOCOLS, find_condition
from causal_openlock.experiment.session import Session
from causal_openlock.storage.store import Store
from causal_openlock.world.reward_code import OwnReward, _loaded
from causal_openlock.world.rewards import find_reward
from support.command import at_once, modules_of

pytestmark = pytest.mark.slow


def eager(events):
    """Heeds all that there is to heed."""
    paid = 40.0 * events.opens / (1 + events.found) - 0.1 * events.found - 0.3 * events.repeated
    return paid + 2 * events.new + 0.01 * events.first


def test_a_function_pays_the_same_wherever_it_is_asked():
    """In a session, in one room and in many rooms, whatever was found and done before."""
    reward = find_reward(f"{__name__}:eager")
    short = replace(PROTOCOLS["human"], attempt_limit=8, baseline_trials=1)
    condition = find_condition("CC4")
    session = Session(condition, short, 6, seed=3, reward=reward, learner="random")
    truth, learner = session.truth, create("random")
    session.begin(learner)
    rooms = [truth.rooms[index] for index in truth.room]
    arguments = [("CC4", room.layout, reward, "trial") for room in rooms]
    singles = [OpenLockEnv(*each, attempt_limit=8) for each in arguments]
    batches = [OpenLockVectorEnv(1, *each, attempt_limit=8) for each in arguments]
    for env in (*singles, *batches):
        env.reset(seed=0)
    good = [room.action_of(room.schema.solutions[0]) for room in rooms]
    while not session.over:
        playing = session.view.playing
        moment = 3 - session.view.console.actions_left
        action = learner.act(session.view)
        # Every other subject opens the door in every attempt, the same way each time.
        for subject in range(0, 6, 2):
            action[subject] = good[subject][moment[subject]]
        step = session.step(action)
        for subject in np.flatnonzero(playing):
            _, paid, *_ = singles[subject].step(int(action[subject]))
            batch = batches[subject].step(action[subject : subject + 1])[1]
            assert paid == pytest.approx(step.reward[subject])
            assert batch[0] == pytest.approx(step.reward[subject])
    earned = session.record()["reward"].to_numpy()
    assert earned.max() > 40
    assert len(np.unique(earned.round(6))) > 3


CODE = "def pay(events):\n    return 7.0 * events.opens - 1.0 * events.repeated\n"
TEXT = """\
name: mine
subjects: 2
protocol: short
conditions: [CC3]
reward: {preset: basic, open: 5.0}
learners:
  - {learner: oracle, name: weights}
  - {learner: oracle, reward: "mine_pays:pay"}
  - {learner: bayes, reward: "mine_pays:pay", subjects: 1, parameters: {particles: 40}}
protocols: {short: {attempt_limit: 4, baseline_trials: 1}}
"""


def test_results_are_read_without_the_code_of_a_reward(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "mine.yaml").write_text(TEXT)
    (folder / "mine_pays.py").write_text(CODE)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with modules_of(folder):
        done = at_once("compare", "study/mine.yaml", "-o", "out", cwd=tmp_path)
    assert done.status == 0, done.stderr
    record, experiment = Store(tmp_path / "out").record()
    paid = record.to_pandas().groupby("learner", observed=True)["reward"].max()
    assert (paid["oracle"], paid["weights"]) == (7, 15)
    assert isinstance(experiment.learners[1].reward, OwnReward)
    # Results need no code, and run none.
    _loaded.cache_clear()
    (folder / "mine_pays.py").unlink()
    (tmp_path / "mine_pays.py").write_text("raise SystemExit('this was run')\n")
    monkeypatch.syspath_prepend(tmp_path)
    results = ol.open_results(tmp_path / "out")
    assert results.summary is not None
    assert len(results.attempts) == len(record)
