"""What is no action is refused, and so is a step outside an episode."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.error import InvalidAction, ResetNeeded

from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from support.cc4_in_trial7 import L0, L1, NOTHING, WHITE
from support.env_play import EPISODES, act, trial7


@pytest.mark.parametrize("episode", EPISODES)
@pytest.mark.parametrize("action", [-1, 15, 10**20, 1.0, np.float64(2), None, "3", [1]])
def test_what_is_no_action_is_refused_and_changes_nothing(episode: Any, action: Any) -> None:
    env = trial7(episode=episode)
    env.step(L0)
    with pytest.raises(InvalidAction, match="an action is an integer from 0 to 14"):
        env.step(action)
    seen, *_, info = env.step(L1)
    assert np.flatnonzero(seen[:7]).tolist() == [L1, L0]
    assert info["console"]["actions_left"] == 1


def test_any_kind_of_integer_is_an_action() -> None:
    for kind in (int, np.int8, np.uint8, np.int64, np.uint64, np.array):
        assert trial7().step(kind(L0))[0][L0] == 1


@pytest.mark.parametrize("episode", EPISODES)
def test_a_step_outside_an_episode_asks_for_a_reset(episode: Any) -> None:
    env = OpenLockEnv("CC4", "trial7", episode=episode, attempt_limit=1)
    with pytest.raises(ResetNeeded):
        env.step(0)
    env.reset(seed=0)
    act(env, NOTHING)
    for _ in range(2):
        with pytest.raises(ResetNeeded):
            env.step(0)
    env.reset()
    env.step(0)
    with pytest.raises(ResetNeeded):
        OpenLockEnv(render_mode="ansi").render()
    with pytest.raises(ResetNeeded):
        OpenLockVectorEnv(2).step(np.zeros(2, dtype=int))


@pytest.mark.parametrize(
    "actions",
    [
        np.zeros(2),
        np.zeros(3, dtype=int),
        np.zeros((2, 1), dtype=int),
        np.zeros(2, dtype=bool),
        0,
        None,
        [0, None],
        [0, 15],
        [-1, 0],
        np.array([0, 2**63], dtype=np.uint64),
    ],
)
def test_many_rooms_refuse_what_are_no_actions(actions: Any) -> None:
    env = OpenLockVectorEnv(2, "CC4", "trial7")
    env.reset(seed=0)
    with pytest.raises(InvalidAction):
        env.step(actions)
    seen, *_ = env.step(np.array([L0, WHITE]))
    assert seen[:, L0].tolist() == [1, 0]
