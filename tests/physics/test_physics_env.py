"""``OpenLockEnv(physics=True)``: the same room to a learner, played by an arm."""

from itertools import pairwise

import numpy as np
import pytest
from gymnasium.error import ResetNeeded

from causal_openlock.envs import OpenLockEnv
from support.env_play import DOOR, EPISODES, L0, L1, SOLUTIONS, WHITE, act, trial7

each_episode = pytest.mark.parametrize("episode", EPISODES)


def same_but_for_physics(result, symbolic):
    """The physical room answers as the symbolic one does, and adds the key ``physics``."""
    *values, info = result
    *others, expected = symbolic
    np.testing.assert_array_equal(values[0], others[0])
    assert values[0].dtype == others[0].dtype
    assert values[1:] == others[1:]
    assert {key: type(value) for key, value in info["physics"].items()} == {
        "finished": bool,
        "steps": int,
        "unfinished": int,
    }
    assert info.keys() - {"physics"} == expected.keys()
    for key, value in expected.items():
        assert np.array_equal(info[key], value)


@each_episode
@pytest.mark.parametrize("schema", ["CC4", "noisy_CC3", "two_keys"])
def test_a_learner_sees_and_earns_the_same_with_and_without_bodies(schema, episode):
    # In a room that leaves something to chance too: equal seeds, equal luck.
    arguments = {"reward": "paper", "episode": episode, "attempt_limit": 3}
    symbolic = OpenLockEnv(schema, **arguments)
    physical = OpenLockEnv(schema, **arguments, physics=True)
    seen, info = symbolic.reset(seed=4)
    same_but_for_physics(physical.reset(seed=4), (seen, info))
    generator = np.random.default_rng(4)
    moved = 0
    for _ in range(60):
        grey = np.flatnonzero(seen[7:14])
        action = int(generator.choice([*grey, *grey, *grey, *(7 + grey), WHITE, DOOR, DOOR]))
        result, expected = physical.step(action), symbolic.step(action)
        same_but_for_physics(result, expected)
        assert result[4]["physics"]["finished"]
        moved += (expected[0] != seen).any()
        seen = expected[0]
        if expected[2] or expected[3]:
            seen, info = symbolic.reset()
            same_but_for_physics(physical.reset(), (seen, info))
    assert moved > 5


def test_a_movement_that_is_not_finished_is_told_counted_and_not_paid():
    env = trial7(physics=True, reward="basic")
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
    env.step(L0)
    env.physical_room.budget = 20
    assert env.step(L1)[1] == 0.0  # it would have unlocked the door
    env.physical_room.budget = 600
    assert env.step(L1)[1] == 10.0


@each_episode
def test_bodies_are_put_back_with_the_room(episode):
    env = trial7(physics=True, episode=episode)
    before = env.physical_room.pose()
    assert act(env, SOLUTIONS[0])[4]["physics"]["steps"] > 0
    if episode == "attempt":
        assert env.physical_room.pose().door > 0.5
        env.reset()
    assert env.physical_room.pose() == before


def test_every_step_of_a_movement_can_be_watched():
    env = trial7(physics=True)
    poses = []
    env.physical_room.watch = poses.append
    env.reset(options={"new_trial": True})
    steps = env.step(L0)[4]["physics"]["steps"]
    assert len(poses) == steps
    assert poses[-1] == env.physical_room.pose()
    assert poses[0].levers[L0] < 0.01
    assert poses[-1].levers[L0] > 0.98
    jumps = [np.abs(np.subtract(a.joints, b.joints)).max() for a, b in pairwise(poses)]
    assert max(jumps) < 0.2  # a film of it moves, and does not jump
    env.physical_room.watch = None
    env.step(L1)
    assert len(poses) == steps


def test_before_a_reset_there_are_no_bodies():
    with pytest.raises(ResetNeeded):
        _ = OpenLockEnv("CC3", physics=True).physical_room
