"""Rewards that are functions of one's own: paid alike everywhere, known by their code."""

import numpy as np
import pytest

import causal_openlock as ol
from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.storage.store import Store
from causal_openlock.world.rewards import OwnReward
from support.cc4_in_trial7 import DOOR, L0, L1, L2, WHITE
from support.command import at_once, modules_of

pytestmark = pytest.mark.slow


def every_field(events):
    """A digit for each field of the events."""
    return sum(getattr(events, name) * 2.0**power for power, name in enumerate(vars(events)))


def test_a_function_pays_the_same_in_one_room_and_in_many():
    arguments = ("CC4", "trial7", f"{__name__}:every_field", "trial")
    single, many = OpenLockEnv(*arguments), OpenLockVectorEnv(1, *arguments)
    single.reset(seed=0)
    many.reset(seed=0)
    paid = set()
    for action in np.random.default_rng(0).choice([L0, L1, L2, DOOR, DOOR, WHITE], 80):
        _, reward, *_ = single.step(int(action))
        assert many.step(np.array([action]))[1] == reward
        paid.add(reward)
    assert len(paid) > 10


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
  - {learner: bayes, reward: "mine_pays:pay", subjects: 1}
protocols: {short: {attempt_limit: 4, baseline_trials: 1}}
"""


def test_results_are_read_without_the_code_of_a_reward(tmp_path, monkeypatch):
    folder = tmp_path / "study"
    folder.mkdir()
    (folder / "mine.yaml").write_text(TEXT)
    (folder / "mine_pays.py").write_text(CODE)
    with modules_of(folder):
        done = at_once("compare", "study/mine.yaml", "-o", "out", cwd=tmp_path)
    assert done.status == 0, done.stderr
    record, experiment = Store(tmp_path / "out").record()
    paid = record.to_pandas().groupby("learner", observed=True)["reward"].max()
    assert (paid["oracle"], paid["weights"]) == (7, 15)
    assert isinstance(experiment.learners[1].reward, OwnReward)
    # Results need no code, and run none.
    (folder / "mine_pays.py").unlink()
    (tmp_path / "mine_pays.py").write_text("raise SystemExit('this was run')\n")
    monkeypatch.syspath_prepend(tmp_path)
    results = ol.open_results(tmp_path / "out")
    assert results.summary is not None
    assert len(results.attempts) == len(record)
