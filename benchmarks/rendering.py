"""Pictures of rooms, as ``render()`` gives them and as a film needs them.

Every frame is another one than that before it: a symbolic room after another action, a physical one
with the arm a step of a film farther on.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import gymnasium
import numpy as np
from measure import Measurement, Row, Target, in_turns, stopwatch

import causal_openlock
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.physics.world import Pose
from causal_openlock.render.panel import draw
from causal_openlock.render.scene import Look
from causal_openlock.schemas.finding import find_schema
from causal_openlock.world.room import Room

LEAST = 200
"""Frames of a symbolic room per second on one core."""
ROOM = {"schema": "CC4", "layout": "trial7"}


def rendering(repeats: int) -> Iterator[Row]:
    """Symbolic rooms at several sizes, with and without the console, and a physical one."""
    target = Target("at least", LEAST, on="ours")
    for size, console in ((600, False), (600, True), (1200, False)):
        mine, _ = in_turns(_symbolic(size, console), None, repeats)
        said = f"symbolic, {size} pixels high{', with console' * console}"
        yield Row("rendering", said, "frames/s", mine, target=target)
    mine, _ = in_turns(_physical(480), None, repeats)
    yield Row("rendering", "physical, arm under way, 480 pixels high", "frames/s", mine)


def _symbolic(size: int, console: bool) -> Measurement:
    env = gymnasium.make(
        causal_openlock.ENV_ID,
        render_mode="rgb_array",
        render_size=size,
        render_console=console,
        **ROOM,
    )
    grey = np.flatnonzero(env.reset(seed=0)[0][7:14])
    actions = np.random.default_rng(0).choice([*grey, *(7 + grey), 14], size=200).tolist()

    def measure() -> float:
        env.reset(seed=0)
        with stopwatch() as seconds:
            for action in actions:
                _, _, terminated, truncated, _ = env.step(action)
                env.render()
                if terminated or truncated:
                    env.reset()
            return len(actions) / seconds()

    return measure


def _physical(size: int) -> Measurement:
    room = Room.of(find_schema(ROOM["schema"]), ROOM["layout"])
    grey: Any = room.active.tolist()
    physical = PhysicalRoom(room.fsm, room.layout)
    poses: list[Pose] = []
    physical.watch = poses.append
    for action in (4, 0, 14):
        physical.act(action)
    looks = [Look.of_pose(pose, grey) for pose in poses[::5]]

    def measure() -> float:
        with stopwatch() as seconds:
            for look in looks:
                draw(look, size)
            return len(looks) / seconds()

    return measure
