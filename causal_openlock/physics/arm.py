"""The arm: five links on pivots, each joint with a motor that turns it at a wanted speed.

A motor's torque is limited. A free arm follows its motors exactly; an arm that presses against a
lock pushes with what its motors have, and no more.
"""

from __future__ import annotations

from collections.abc import Sequence

import pymunk

from causal_openlock.physics.geometry import Point, RoomGeometry
from causal_openlock.physics.kinematics import Angles

ARM, LEVER, DOOR = 1, 2, 4
"""What a shape is, as bits: what collides with what, and of which type a collision is."""

LINK_MASS = 0.2
TORQUE = 250.0
"""The most that a motor turns with, in the paper's room."""
GRIP = 100.0
"""The most that the arm's hold on something bears."""
STIFF = 0.6**60
"""What a joint leaves of an error after one unit of time (pymunk's ``error_bias``)."""


class Arm:
    """The arm's bodies, in the posture in which a room begins.

    Args:
        space: Where they live.
        geometry: The room.
    """

    def __init__(self, space: pymunk.Space, geometry: RoomGeometry) -> None:
        self._space = space
        self._half = geometry.link / 2
        self._grip: pymunk.PivotJoint | None = None
        self.links: list[pymunk.Body] = []
        self._motors: list[pymunk.SimpleMotor] = []
        ends = (-self._half, 0.0), (self._half, 0.0)
        moment = pymunk.moment_for_segment(LINK_MASS, *ends, geometry.half_width)
        heading = 0.0
        before, joint = space.static_body, pymunk.Vec2d(0.0, 0.0)
        for angle in geometry.rest:
            heading += angle
            link = pymunk.Body(LINK_MASS, moment)
            link.angle = heading
            link.position = joint + pymunk.Vec2d(self._half, 0.0).rotated(heading)
            shape = pymunk.Segment(link, *ends, geometry.half_width)
            # Its links lie one above another, as those of any planar arm, and pass each other.
            shape.filter = pymunk.ShapeFilter(categories=ARM, mask=LEVER | DOOR)
            shape.collision_type = ARM
            pivot = pymunk.PivotJoint(before, link, joint)
            pivot.collide_bodies = False
            pivot.error_bias = STIFF
            motor = pymunk.SimpleMotor(before, link, 0.0)
            motor.max_force = TORQUE * geometry.stretch**2
            space.add(link, shape, pivot, motor)
            self.links.append(link)
            self._motors.append(motor)
            before, joint = link, link.local_to_world(ends[1])

    @property
    def angles(self) -> Angles:
        """The joint angles; they count whole turns."""
        a, b, c, d, e = [link.angle for link in self.links]
        return a, b - a, c - b, d - c, e - d

    @property
    def tip(self) -> Point:
        """The free end."""
        x, y = self.links[-1].local_to_world((self._half, 0.0))
        return x, y

    def joints(self) -> tuple[Point, ...]:
        """Six points: the base, the four joints, the free end."""
        starts = [link.local_to_world((-self._half, 0.0)) for link in self.links]
        return (*((x, y) for x, y in starts), self.tip)

    def drive(self, speeds: Sequence[float]) -> None:
        """Set the speed that each motor turns its joint at, in radians per unit of time."""
        for motor, speed in zip(self._motors, speeds, strict=True):
            motor.rate = -speed  # pymunk counts the other way round

    def grip(self, body: pymunk.Body) -> None:
        """Hold on to a body with the free end, where it is."""
        self.release()
        self._grip = pymunk.PivotJoint(self.links[-1], body, self.tip)
        self._grip.max_force = GRIP
        self._grip.collide_bodies = False  # what is held is held together, not pushed apart
        self._space.add(self._grip)

    def release(self) -> None:
        """Let go."""
        if self._grip is not None:
            self._space.remove(self._grip)
            self._grip = None
