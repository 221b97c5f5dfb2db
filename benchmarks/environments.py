"""Environments against Gymnasium's CartPole, made the same way and played at random.

Actions are drawn before the clock starts; resets are inside the time. In a vector environment a
room whose episode has ended is reset by the next step, and this step counts like any other, for
CartPole as for ours: an attempt of three actions is four steps. Seconds are the processor's.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from measure import Measurement, Row, in_turns, stopwatch

import causal_openlock

PEER = "CartPole-v1"
ROOM: dict[str, Any] = {"schema": "CC4", "layout": "trial7"}
MANY = 16_384
CASES: tuple[tuple[int, dict[str, str]], ...] = (
    (MANY, {}),
    (MANY, {"reward": "paper"}),
    (MANY, {"layout": "random"}),
    (MANY, {"episode": "trial"}),
    (MANY, {"schema": "noisy_CC3", "layout": "trial1"}),
    (1024, {}),
    (64, {}),
)


def environments(turns: int) -> Iterator[Row]:
    """One room through ``gymnasium.make``, and many through ``gymnasium.make_vec``."""
    peer = _one(gymnasium.make(PEER), 20_000)
    for episode in ("attempt", "trial"):
        ours = _one(gymnasium.make(causal_openlock.ENV_ID, **ROOM, episode=episode), 60_000)
        yield in_turns(f"one room, episode={episode}", "steps/s", ours, PEER, peer, turns)
    for many, options in CASES:
        # Rooms in step begin a new trial every 120 steps: that often, or a multiple of it.
        steps = 120 * max(2, min(40, 4096 // many))
        peer = _many(PEER, many, steps // 6)
        ours = _many(causal_openlock.ENV_ID, many, steps, **{**ROOM, **options})
        case = ", ".join([f"{many:,} rooms", *(f"{key}={options[key]}" for key in options)])
        yield in_turns(case, "steps/s", ours, PEER, peer, turns)


def _one(environment: gymnasium.Env[Any, Any], steps: int) -> Measurement:
    space: Any = environment.action_space
    actions = np.random.default_rng(0).integers(space.n, size=steps).tolist()

    def measure() -> float:
        environment.reset(seed=0)
        with stopwatch() as seconds:
            for action in actions:
                _, _, terminated, truncated, _ = environment.step(action)
                if terminated or truncated:
                    environment.reset()
            return steps / seconds()

    measure()  # once to warm up
    return measure


def _many(name: str, many: int, steps: int, **options: Any) -> Measurement:
    environment = gymnasium.make_vec(
        name, num_envs=many, vectorization_mode="vector_entry_point", **options
    )
    space: Any = environment.single_action_space
    # A prime number of batches, so that attempts of four steps do not repeat in step with them.
    actions = np.random.default_rng(0).integers(space.n, size=(31, many))

    def measure() -> float:
        environment.reset(seed=0)
        with stopwatch() as seconds:
            for step in range(steps):
                environment.step(actions[step % len(actions)])
            return many * steps / seconds()

    measure()
    return measure
