"""Environments against Gymnasium's CartPole, made the same way and played at random.

Actions are drawn before the clock starts; resets are inside the time. In a vector environment a
room whose episode has ended is reset by the next step, and this step counts like any other, for
CartPole as for ours: an attempt of three actions is four steps.
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
        yield Row(
            "single",
            f"one room, episode={episode}",
            "steps/s",
            *_compared(ours, cartpole, repeats),
            target=Target("at least", 4) if episode == "attempt" else None,
        )


def vector(repeats: int) -> Iterator[Row]:
    """Many environments at once through ``gymnasium.make_vec``, observations included."""
    for many, options in CASES:
        # About as long for each size. Rooms in step begin a new trial every 120 steps.
        steps = 120 * max(2, min(40, 4 * MANY // (many * 16)))
        cartpole = _many(PEER, many, steps // 6)
        ours = _many(causal_openlock.ENV_ID, many, steps, **{**ROOM, **options})
        said = ", ".join([f"{many:,} rooms", *(f"{k}={v}" for k, v in options.items())])
        yield Row(
            "vector",
            said,
            "steps/s",
            *_compared(ours, cartpole, repeats),
            target=Target("at least", 8) if (many, options) == CASES[0] else None,
        )


def _compared(ours: Measurement, peer: Measurement, repeats: int) -> Any:
    mine, others = in_turns(ours, peer, repeats)
    return mine, PEER, others


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
    actions = np.random.default_rng(0).integers(space.n, size=(64, many))

    def measure() -> float:
        environment.reset(seed=0)
        with stopwatch() as seconds:
            for step in range(steps):
                environment.step(actions[step % len(actions)])
            return many * steps / seconds()

    return measure
