"""``OpenLockEnv(physics=True)``: the same room to a learner, played by an arm."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium.error import ResetNeeded
from gymnasium.utils.env_checker import check_env

import causal_openlock
from causal_openlock.envs import OpenLockEnv
from causal_openlock.errors import OpenLockError
from causal_openlock.physics.world import Pose
from support.cc4_in_trial7 import DOOR, L0, L1, SOLUTIONS, WHITE
from support.env_play import EPISODES, act, trial7


def same(info: dict[str, Any], symbolic: dict[str, Any]) -> None:
    """The physical room's info is the symbolic one's and the key ``physics``."""
    assert info.keys() - {"physics"} == symbolic.keys()
    for key, value in symbolic.items():
        if key == "outcome":
            np.testing.assert_array_equal(info[key], value)
        else:
            assert info[key] == value
    told = info["physics"]
    assert {key: type(value) for key, value in told.items()} == {
        "finished": bool,
        "steps": int,
        "unfinished": int,
    }


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("schema", ["CC4", "noisy_CC3", "two_keys"])
def test_a_learner_sees_and_earns_the_same_with_and_without_bodies(
    schema: str, episode: Any
) -> None:
    # In a room that leaves something to chance too: equal seeds, equal luck.
    arguments: dict[str, Any] = {"reward": "paper", "episode": episode, "attempt_limit": 3}
    symbolic = OpenLockEnv(schema, **arguments)
    physical = OpenLockEnv(schema, **arguments, physics=True)
    seen, info = symbolic.reset(seed=4)
    same(physical.reset(seed=4)[1], info)
    generator = np.random.default_rng(4)
    moved = 0
    for _ in range(60):
        grey = np.flatnonzero(seen[7:14])
        action = int(generator.choice([*grey, *grey, *grey, *(7 + grey), WHITE, DOOR, DOOR]))
        result, expected = physical.step(action), symbolic.step(action)
        np.testing.assert_array_equal(result[0], expected[0])
        assert result[0].dtype == expected[0].dtype
        assert result[1:4] == expected[1:4]
        same(result[4], expected[4])
        assert result[4]["physics"]["finished"]
        moved += (expected[0] != seen).any()
        seen = expected[0]
        if expected[2] or expected[3]:
            seen, info = symbolic.reset()
            again, physical_info = physical.reset()
            np.testing.assert_array_equal(again, seen)
            same(physical_info, info)
    assert moved > 5


def test_gymnasium_finds_nothing_to_say() -> None:
    made = gymnasium.make(causal_openlock.ENV_ID, physics=True, render_mode="rgb_array")
    check_env(made.unwrapped)


def test_a_movement_that_is_not_finished_is_told_and_counted() -> None:
    env = trial7(physics=True)
    env.physical_room.budget = 30
    seen, _, _, _, info = env.step(L0)
    assert info["physics"] == {"finished": False, "steps": 30, "unfinished": 1}
    assert not seen[L0]  # what is seen is where the lever is, whatever the tables say
    assert info["console"]["actions_left"] == 2
    env.physical_room.budget = 600
    seen, _, _, _, info = env.step(L0)
    assert seen[L0]
    assert (info["physics"]["finished"], info["physics"]["unfinished"]) == (True, 1)
    assert env.reset()[1]["physics"] == {"finished": True, "steps": 0, "unfinished": 1}


def test_what_was_not_reached_is_not_paid() -> None:
    env = trial7(physics=True, reward="basic")
    env.step(L0)
    env.physical_room.budget = 20
    assert env.step(L1)[1] == 0.0  # it would have unlocked the door
    env.physical_room.budget = 600
    assert env.step(L1)[1] == 10.0


@pytest.mark.parametrize("episode", EPISODES)
def test_bodies_are_put_back_with_the_room(episode: Any) -> None:
    env = trial7(physics=True, episode=episode)
    before = env.physical_room.pose()
    result = act(env, SOLUTIONS[0])
    assert result[4]["physics"]["steps"] > 0
    if episode == "attempt":
        assert env.physical_room.pose().door > 0.5
        env.reset()
    assert env.physical_room.pose() == before


def test_every_step_of_a_movement_can_be_watched() -> None:
    env = trial7(physics=True)
    poses: list[Pose] = []
    env.watch(poses.append)
    steps = env.step(L0)[4]["physics"]["steps"]
    assert len(poses) == steps
    assert poses[-1] == env.physical_room.pose()
    levers = [pose.levers[L0] for pose in poses]
    assert levers[0] < 0.01
    assert levers[-1] > 0.98
    jumps = [np.abs(np.subtract(a.joints, b.joints)).max() for a, b in pairwise(poses)]
    assert max(jumps) < 0.2  # a film of it moves, and does not jump
    env.watch(None)
    env.step(L1)
    assert len(poses) == steps


def test_a_room_without_bodies_says_so() -> None:
    env = trial7()
    for ask in (lambda: env.physical_room, lambda: env.watch(None)):
        with pytest.raises(OpenLockError, match="physics=True"):
            ask()
    with pytest.raises(ResetNeeded):
        _ = OpenLockEnv("CC3", physics=True).physical_room


def test_pymunk_is_loaded_only_for_rooms_with_bodies() -> None:
    code = "import sys; from causal_openlock.envs import OpenLockEnv; OpenLockEnv().reset(); "
    code += "assert 'pymunk' not in sys.modules; OpenLockEnv(physics=True).reset(); "
    code += "assert 'pymunk' in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
