"""The door: it swings outward on its hinge, and a lock at its free end keeps it closed."""

from __future__ import annotations

import math

import pymunk

from causal_openlock.physics.arm import ARM, DOOR
from causal_openlock.physics.geometry import DOOR_OPEN, DOOR_SWING, RoomGeometry

DOOR_MASS = 0.5
HINGE_FRICTION = 5.0
"""The torque with which the hinge brakes, so that the door stays where the arm leaves it."""


class Door:
    """The door, closed and locked.

    Args:
        space: Where it lives.
        geometry: The room.
    """

    def __init__(self, space: pymunk.Space, geometry: RoomGeometry) -> None:
        length, walls = geometry.door_length, space.static_body
        ends = (0.0, 0.0), (0.0, -length)
        radius = geometry.door_thickness / 2
        self.body = pymunk.Body(DOOR_MASS, DOOR_MASS * length**2 / 3)
        self.body.position = geometry.hinge
        shape = pymunk.Segment(self.body, *ends, radius)
        shape.filter = pymunk.ShapeFilter(categories=DOOR, mask=ARM)
        shape.collision_type = DOOR
        shape.friction = 0.0
        hinge = pymunk.PivotJoint(walls, self.body, geometry.hinge)
        stop = pymunk.RotaryLimitJoint(walls, self.body, 0.0, DOOR_SWING)
        brake = pymunk.SimpleMotor(walls, self.body, 0.0)
        brake.max_force = HINGE_FRICTION
        self._bolt = pymunk.PivotJoint(walls, self.body, geometry.lock)
        space.add(self.body, shape, hinge, stop, brake, self._bolt)

    @property
    def angle(self) -> float:
        """How far it has swung: 0 closed."""
        return self.body.angle

    @property
    def opened(self) -> bool:
        """Whether it counts as open."""
        return self.angle > DOOR_OPEN

    @property
    def locked(self) -> bool:
        """Whether the bolt holds."""
        return self._bolt.max_force > 0.0

    def lock(self, locked: bool) -> None:
        """Bolt it, or draw the bolt. A door that is open stays open."""
        self._bolt.max_force = math.inf if locked and not self.opened else 0.0
