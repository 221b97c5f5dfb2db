"""All bodies of a room in one space, and a still picture of where they are.

The same calls in the same order lead to bitwise the same state: nothing here depends on time, on
chance, or on anything that happened in another world.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import pymunk

from causal_openlock.physics.arm import Arm
from causal_openlock.physics.door import Door
from causal_openlock.physics.geometry import Point, RoomGeometry
from causal_openlock.physics.levers import Lever

STEP = 1 / 120
"""Units of time in a step of the simulation."""
ITERATIONS = 30


@dataclass(frozen=True)
class Pose:
    """Where everything that moves is at one moment; all else is in the room's geometry.

    Attributes:
        joints: The arm's base, its four joints and its free end: six points.
        levers: How far the lever at each position has slid: 0 pulled, 1 pushed.
        door: Angle of the door in radians: 0 closed.
        locked: Whether the door's lock indicator is there.
    """

    joints: tuple[Point, ...]
    levers: tuple[float, ...]
    door: float
    locked: bool


class World:
    """A room's bodies: the arm in the posture in which it begins, all levers pulled, all locked.

    Args:
        geometry: Where everything is.
        active: Positions of the levers that can move.

    Attributes:
        space: The space that they live in.
        arm: The arm.
        levers: The lever at each position.
        door: The door.
        indicator: Whether the door is shown as locked.
        steps: Steps simulated so far.
    """

    def __init__(self, geometry: RoomGeometry, active: Collection[int]) -> None:
        self.geometry = geometry
        self.space = pymunk.Space()
        self.space.iterations = ITERATIONS
        self.space.collision_slop = 0.005  # lengths here are a hundred times those of a screen
        self.arm = Arm(self.space, geometry)
        self.levers = tuple(
            Lever(self.space, track, place in active) for place, track in enumerate(geometry.tracks)
        )
        self.door = Door(self.space, geometry)
        self.indicator = True
        self.steps = 0

    def step(self) -> None:
        """Let :data:`STEP` pass."""
        self.space.step(STEP)
        self.steps += 1

    def pose(self) -> Pose:
        """Where everything is now."""
        return Pose(
            joints=self.arm.joints(),
            levers=tuple(lever.displacement for lever in self.levers),
            door=self.door.angle,
            locked=self.indicator,
        )
