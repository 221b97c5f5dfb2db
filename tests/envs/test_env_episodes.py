"""Episodes of one room, be they attempts or trials: how they begin, go on and end."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from causal_openlock.envs import OpenLockEnv, OpenLockVectorEnv
from causal_openlock.schemas.finding import bundled_schemas
from causal_openlock.world.room import Room
from support.cc4_in_trial7 import DOOR, L0, L1, L2, L3, NOTHING, SOLUTIONS, WHITE
from support.env_play import CONSOLE, EPISODES, act, attempt, left, trial7

SCHEMAS = bundled_schemas()


# -- attempts -------------------------------------------------------------------------------------


def test_an_attempt_terminates_when_the_door_opens_or_its_actions_are_spent() -> None:
    env = trial7(action_limit=5)
    flags = [env.step(action)[2:4] for action in SOLUTIONS[0]]
    assert flags == [(False, False), (False, False), (True, False)]
    env.reset()
    flags = [env.step(WHITE)[2:4] for _ in range(5)]
    assert flags == [(False, False)] * 4 + [(True, False)]


def test_the_last_observation_of_an_attempt_is_the_room_as_it_was_left() -> None:
    seen, *_ = attempt(trial7(), SOLUTIONS[0])
    assert np.flatnonzero(seen[:7]).tolist() == [L1, L0]
    assert seen[-2:].tolist() == [0, 1]


def test_reset_begins_the_next_attempt_in_the_same_room_and_the_console_counts() -> None:
    env = OpenLockEnv("CC4", "random", reveal=True)
    seen, info = env.reset(seed=3)
    rooms = {info["latent"]["layout"]}
    for number in range(29):
        assert left(info) == (3, 30 - number)
        assert info["console"]["actions_left"] == 3
        *_, info = act(env, (14, 14, 14))
        assert left(info) == (3, 30 - number), "the attempt counts as used once the next begins"
        assert info["console"]["actions_left"] == 0
        again, info = env.reset()
        rooms.add(info["latent"]["layout"])
        assert (again == seen).all()
    assert len(rooms) == 1


def test_a_new_solution_counts_and_a_repeated_one_does_not() -> None:
    env = trial7(reveal=True)
    *_, info = attempt(env, SOLUTIONS[1])
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 30, 0), strict=True))
    assert info["latent"]["found"] == (1,)
    *_, info = attempt(env, SOLUTIONS[1])
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 29, 0), strict=True))
    *_, info = attempt(env, SOLUTIONS[0])
    assert info["console"] == dict(zip(CONSOLE, (1, 2, 28, 0), strict=True))


def test_once_everything_is_found_reset_begins_a_new_trial() -> None:
    env = OpenLockEnv("CC4", "random", reveal=True)
    layouts = []
    for seed in range(5):
        _, info = env.reset(seed=seed)
        layouts.append(info["latent"]["layout"])
        room = Room.of(SCHEMAS["CC4"], dict(layouts[-1]))
        for count, levers in enumerate(SCHEMAS["CC4"].solutions, start=1):
            *_, info = act(env, tuple(room.action_of(levers)))
            # Once it is solved and over, no attempt is left.
            assert left(info) == (3 - count, 31 - count if count < 3 else 0)
            _, info = env.reset()
        assert left(info) == (3, 30)
        layouts.append(info["latent"]["layout"])
    assert len(set(layouts)) > 5, "a new trial draws another layout"


def test_once_the_attempts_are_spent_reset_begins_a_new_trial() -> None:
    env = OpenLockEnv("CC4", "random", attempt_limit=2, reveal=True)
    _, info = env.reset(seed=1)
    first = info["latent"]["layout"]
    layouts = set()
    for _ in range(10):
        act(env, NOTHING)
        assert left(env.reset()[1])[1] == 1
        act(env, NOTHING)
        _, info = env.reset()
        assert left(info) == (3, 2)
        layouts.add(info["latent"]["layout"])
    assert layouts != {first}


def test_a_reset_in_mid_attempt_spends_the_attempt() -> None:
    env = trial7(attempt_limit=3)
    env.step(L0)
    assert left(env.reset()[1]) == (3, 2)
    assert left(env.reset()[1]) == (3, 2), "nothing was done, so nothing is spent"
    act(env, NOTHING)
    assert left(env.reset()[1]) == (3, 1), "an attempt that is over is not spent again"
    env.step(L0)
    assert left(env.reset()[1]) == (3, 3), "that was the last one"


@pytest.mark.parametrize("episode", EPISODES)
def test_a_seed_and_the_option_new_trial_begin_a_new_trial(episode: Any) -> None:
    for arguments in ({"seed": 5}, {"options": {"new_trial": True}}):
        env = trial7(episode=episode, reveal=True)
        act(env, SOLUTIONS[0])
        if episode == "attempt":
            env.reset()
        env.step(L0)
        seen, info = env.reset(**arguments)  # type: ignore[arg-type]
        assert left(info) == (3, 30)
        assert info["latent"]["found"] == ()
        assert not seen[:7].any()
    env = trial7()
    act(env, NOTHING)
    assert left(env.reset(options={"new_trial": False})[1]) == (3, 29)
    env = trial7()
    act(env, NOTHING)
    assert left(env.reset(options={})[1]) == (3, 29)


# -- trials ---------------------------------------------------------------------------------------


def test_after_an_attempt_a_trial_goes_on_in_the_room_put_back() -> None:
    env = trial7(episode="trial")
    start, _ = env.reset(seed=0)
    env.step(L0)
    _, _, _, _, info = env.step(L1)
    assert "outcome" not in info
    seen, reward, terminated, truncated, info = env.step(DOOR)
    assert (reward, terminated, truncated) == (50, False, False)
    assert (seen == start).all()
    assert info["console"] == dict(zip(CONSOLE, (2, 1, 29, 3), strict=True))
    assert info["outcome"][[L0, L1, L2, L3]].tolist() == [1, 1, 0, 0]
    assert info["outcome"][-2:].tolist() == [0, 1]
    seen, *_ = env.step(L0)
    assert np.flatnonzero(seen[:7]).tolist() == [L0]


def test_a_trial_terminates_when_everything_is_found() -> None:
    env = trial7(episode="trial")
    ends = [act(env, solution)[2:4] for solution in (SOLUTIONS[0], SOLUTIONS[0], SOLUTIONS[2])]
    assert ends == [(False, False)] * 3
    seen, _, terminated, truncated, info = act(env, SOLUTIONS[1])
    assert (terminated, truncated) == (True, False)
    assert left(info)[0] == 0
    assert info["outcome"][-1] == 1
    assert not seen[:7].any()
    assert left(env.reset()[1]) == (3, 30)


def test_a_trial_is_truncated_when_its_attempts_are_spent() -> None:
    env = trial7(episode="trial", attempt_limit=3)
    assert [act(env, NOTHING)[2:4] for _ in range(3)] == [(False, False)] * 2 + [(False, True)]
    # The last attempt may still find the last solution, and then nothing is cut short.
    env.reset()
    ends = [act(env, solution)[2:4] for solution in SOLUTIONS]
    assert ends == [(False, False)] * 2 + [(True, False)]


def test_a_repeat_does_not_reach_over_the_end_of_an_attempt() -> None:
    env = trial7(episode="trial", reward="negative_repeat")
    assert [env.step(WHITE)[1] for _ in range(6)] == [0, -0.25, -0.25, 0, -0.25, -0.25]


@pytest.mark.parametrize("episode", EPISODES)
def test_no_attempt_is_left_once_a_trial_is_over(episode: Any) -> None:
    env = trial7(episode=episode, attempt_limit=2)
    counts = []
    for _ in range(3):  # the third attempt is the first of a new trial
        if episode == "attempt" or len(counts) in (0, 2):
            env.reset()
        *_, info = act(env, NOTHING)
        counts.append(left(info)[1])
    # Between attempts a whole trial shows the next one, which counts.
    assert counts == ([2, 0, 2] if episode == "attempt" else [1, 0, 1])
    env = trial7(episode=episode)
    rooms = OpenLockVectorEnv(1, "CC4", "trial7", "basic", episode)
    rooms.reset(seed=0)
    for number, solution in enumerate(SOLUTIONS):
        if number and episode == "attempt":
            env.reset()
        if number:
            rooms.step(np.zeros(1, dtype=np.int64)) if episode == "attempt" else None
        *_, info = act(env, solution)
        for action in solution:
            *_, batch = rooms.step(np.array([action]))
    assert left(info) == (0, 0)
    assert [batch["console"][name].tolist() for name in ("solutions_left", "attempts_left")] == [
        [0],
        [0],
    ]
