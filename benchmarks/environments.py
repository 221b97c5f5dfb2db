"""Environments against Gymnasium's CartPole, made the same way and played at random.

Actions are drawn before the clock starts; resets are inside the time. In a vector environment a
room whose episode has ended is reset by the next step, and this step counts like any other, for
CartPole as for ours: an attempt of three actions is four steps.

What limits many rooms: for each, a step returns 35 bytes and looks up a word, a reward and an
observation. One room through ``gymnasium.make`` cannot be faster than Gymnasium's two wrappers with
a fresh observation and a console, which is measured next to it (:class:`Returning`). Seconds are
those of the processor, since machines are shared.
"""

from __future__ import annotations

from collections.abc import Iterator
from time import process_time
from typing import Any

import gymnasium
import numpy as np
from gymnasium.wrappers import OrderEnforcing, PassiveEnvChecker
from measure import Measurement, Row, Target, in_turns

import causal_openlock

PEER = "CartPole-v1"
ROOM = {"schema": "CC4", "layout": "trial7"}
MANY = 16_384
# The first is asked for more: it is what environments do if nothing else is said.
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
    cartpole = _one(gymnasium.make(PEER), 20_000)
    for episode in ("attempt", "trial"):
        options: dict[str, Any] = {**ROOM, "episode": episode}
        ours = _one(gymnasium.make(causal_openlock.ENV_ID, **options), 60_000)
        mine, others = in_turns(ours, cartpole, repeats)
        target = Target("at least", 6)
        said = f"one room, episode={episode}"
        yield Row("single", said, "steps/s", mine, PEER, others, target)
    nothing = _one(OrderEnforcing(PassiveEnvChecker(Returning())), 60_000)
    mine, others = in_turns(nothing, cartpole, repeats)
    yield Row("single", "only what attempts return", "steps/s", mine, PEER, others)


def vector(repeats: int) -> Iterator[Row]:
    """Many environments at once through ``gymnasium.make_vec``, observations included."""
    for case, (many, options) in enumerate(CASES):
        # Rooms in step begin a new trial every 120 steps: that often, or a multiple of it.
        steps = 120 * max(2, min(40, 4096 // many))
        cartpole = _many(PEER, many, steps // 6)
        ours = _many(causal_openlock.ENV_ID, many, steps, **{**ROOM, **options})
        mine, others = in_turns(ours, cartpole, repeats)
        target = Target("at least", 20 if case == 0 else 8)
        said = ", ".join([f"{many:,} rooms", *(f"{k}={v}" for k, v in options.items())])
        yield Row("vector", said, "steps/s", mine, PEER, others, target)


class Returning(gymnasium.Env[Any, Any]):
    """What a room returns, and nothing else: attempts of three actions in which nothing happens."""

    observation_space = gymnasium.spaces.MultiBinary(16)
    action_space = gymnasium.spaces.Discrete(15)

    def __init__(self) -> None:
        self._seen, self._used, self._left = np.zeros(16, np.int8), 0, 3

    def reset(self, *, seed: int | None = None, options: Any = None) -> tuple[Any, dict[str, Any]]:
        """Begin an attempt."""
        self._used = 0
        return self._seen.copy(), self._info()

    def step(self, action: int) -> tuple[Any, float, bool, bool, dict[str, Any]]:
        """Count an action."""
        self._used += 1
        return self._seen.copy(), 0.0, self._used == 3, False, self._info()

    def _info(self) -> dict[str, Any]:
        return {
            "console": {
                "solutions_left": self._left,
                "solutions_found": self._left,
                "attempts_left": self._left,
                "actions_left": self._left,
            }
        }


def _one(environment: gymnasium.Env[Any, Any], steps: int) -> Measurement:
    space: Any = environment.action_space
    actions = np.random.default_rng(0).integers(space.n, size=steps).tolist()

    def measure() -> float:
        environment.reset(seed=0)
        began = process_time()
        for action in actions:
            _, _, terminated, truncated, _ = environment.step(action)
            if terminated or truncated:
                environment.reset()
        return steps / (process_time() - began)

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
        began = process_time()
        for step in range(steps):
            environment.step(actions[step % len(actions)])
        return many * steps / (process_time() - began)

    return measure
