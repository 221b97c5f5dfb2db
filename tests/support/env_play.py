"""Acting in environments, one attempt or some actions at a time."""

from __future__ import annotations

from typing import Any

import gymnasium

from causal_openlock.envs import OpenLockEnv

EPISODES = ("attempt", "trial")
# What the console of an environment shows.
CONSOLE = ("solutions_left", "solutions_found", "attempts_left", "actions_left")


def trial7(**arguments: Any) -> OpenLockEnv:
    """CC4 in trial7, at the start of a trial."""
    env = OpenLockEnv("CC4", "trial7", **arguments)
    env.reset(seed=0)
    return env


def act(env: gymnasium.Env[Any, Any], actions: tuple[int, ...]) -> tuple[Any, ...]:
    """What the last of these actions leads to."""
    for action in actions:
        result = env.step(action)
    return result


def attempt(env: gymnasium.Env[Any, Any], actions: tuple[int, ...]) -> tuple[Any, ...]:
    """A reset, these actions, and what the last of them leads to."""
    env.reset()
    return act(env, actions)


def left(info: dict[str, Any]) -> tuple[int, int]:
    """Solutions and attempts left."""
    return info["console"]["solutions_left"], info["console"]["attempts_left"]
