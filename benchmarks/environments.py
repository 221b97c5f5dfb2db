"""Environments against Gymnasium's CartPole, made the same way and played at random.

Actions are drawn before the clock starts; resets are inside the time. In a vector environment a
room whose episode has ended is reset by the next step, and this step counts like any other, for
CartPole as for ours: an attempt of three actions is four steps.

What limits many rooms: for each, a step returns 35 bytes and stores a row, a reward and an
observation that it looks up; checking the actions, ends of attempts and Python come on top.
Stochastic rooms need a random number each, which NumPy takes a large part of the step to draw.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from measure import Measurement, Row, Target, in_turns, stopwatch

import causal_openlock

PEER = "CartPole-v1"
ROOM = {"schema": "CC4", "layout": "trial7"}
MANY = 16_384
# The first has a target: what environments do if nothing else is said.
CASES: tuple[tuple[int, dict[str, str]], ...] = (
    (MANY, {}),
    (MANY, {"reward": "paper"}),
    (MANY, {"layout": "random"}),
    (MANY, {"episode": "trial"}),
    (MANY, {"schema": "noisy_CC3", "layout": "trial1"}),
    (1024, {}),
    (64, {}),
)


def single(repeats: int) -> Iterator[Row]:
    """One environment through ``gymnasium.make``."""
    cartpole = _one(PEER, 20_000)
    for episode in ("attempt", "trial"):
        ours = _one(causal_openlock.ENV_ID, 60_000, **ROOM, episode=episode)
        mine, others = in_turns(ours, cartpole, repeats)
        target = Target("at least", 4) if episode == "attempt" else None
        said = f"one room, episode={episode}"
        yield Row("single", said, "steps/s", mine, PEER, others, target)


def vector(repeats: int) -> Iterator[Row]:
    """Many environments at once through ``gymnasium.make_vec``, observations included."""
    for case, (many, options) in enumerate(CASES):
        # Rooms in step begin a new trial every 120 steps: that often, or a multiple of it.
        steps = 120 * max(2, min(40, 4096 // many))
        cartpole = _many(PEER, many, steps // 6)
        ours = _many(causal_openlock.ENV_ID, many, steps, **{**ROOM, **options})
        mine, others = in_turns(ours, cartpole, repeats)
        target = Target("at least", 8) if case == 0 else None
        said = ", ".join([f"{many:,} rooms", *(f"{k}={v}" for k, v in options.items())])
        yield Row("vector", said, "steps/s", mine, PEER, others, target)


def _one(name: str, steps: int, **options: Any) -> Measurement:
    environment = gymnasium.make(name, **options)
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

    return measure
