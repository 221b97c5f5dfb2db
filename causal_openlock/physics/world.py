"""All bodies of a room in one pymunk space: the arm, the levers and the door.

The same calls in the same order lead to bitwise the same state: nothing here depends on time, on
chance, or on anything that happened in another world.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence

import pymunk

from causal_openlock.physics.geometry import (
    DOOR_OPEN,
    DOOR_SWING,
    PUSHED,
    Point,
    Pose,
    RoomGeometry,
    Track,
)
from causal_openlock.physics.kinematics import Angles

STEP = 1 / 120  # units of time in a step of the simulation
ITERATIONS = 30
ARM, LEVER, DOOR = 1, 2, 4  # the kinds of shapes, as bits: they decide what collides with what
LINK_MASS, LEVER_MASS, DOOR_MASS = 0.2, 0.5, 0.5
TORQUE = 250.0  # the largest of a motor of the arm, in the paper's room
GRIP = 100.0  # the largest force that the arm's grip bears
STIFF = 0.6**60  # the part of a joint's error left after a unit of time (pymunk's error_bias)
LATCH, LATCH_SPEED = 4.0, 2.0  # with what force and speed the latch of an unlocked lever draws it
HINGE_FRICTION = 5.0  # the hinge's brake, so that the door stays where the arm leaves it


class Arm:
    """Five links on pivots, each joint with a motor that turns it at a given speed.

    A motor's torque is limited. A free arm follows its motors exactly; an arm that presses against
    a lock pushes with what its motors have, and no more. It begins in the posture of the geometry.
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
            # The links lie one above another, as those of any planar arm, and pass each other.
            shape = _of_kind(pymunk.Segment(link, *ends, geometry.half_width), ARM, LEVER | DOOR)
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
        """Set the speed of each joint, in radians per unit of time."""
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


class Lever:
    """A bar that slides on its track, pulled and locked at first.

    An active lever is a body on a groove. Its latch pulls it into the end of the track that it is
    nearer to: weakly while it is unlocked, so that it stays where the arm leaves it, and with all
    force while it is locked. An inactive lever never moves, so it is part of the walls.
    """

    def __init__(self, space: pymunk.Space, track: Track, active: bool) -> None:
        self.track = track
        self.locked = True
        self._latch: pymunk.PivotJoint | None = None
        walls = space.static_body
        if not active:
            self.body = walls
            space.add(_of_kind(pymunk.Poly(walls, track.bar(0.0)), LEVER, ARM))
            return
        x, y = track.start
        self.body = pymunk.Body(LEVER_MASS, math.inf)  # it slides and never turns
        self.body.position = x, y
        corners = [(cx - x, cy - y) for cx, cy in track.bar(0.0)]
        shape = _of_kind(pymunk.Poly(self.body, corners), LEVER, ARM)
        groove = pymunk.GrooveJoint(walls, self.body, track.start, track.end, (0.0, 0.0))
        groove.error_bias = STIFF
        self._latch = pymunk.PivotJoint(walls, self.body, track.start, (0.0, 0.0))
        space.add(self.body, shape, groove, self._latch)

    @property
    def displacement(self) -> float:
        """Displacement of the lever: 0 pulled, 1 pushed."""
        if self._latch is None:
            return 0.0
        x, y = self.body.position
        return self.track.displacement((x, y))

    @property
    def pushed(self) -> bool:
        """Whether the lever is beyond the middle of its track."""
        return self.displacement > PUSHED

    def lock(self, locked: bool) -> None:
        """Lock the lever where it is, or unlock it."""
        if self._latch is not None and locked != self.locked:
            self.locked = locked
            self._latch.max_force = math.inf if locked else LATCH
            self._latch.max_bias = math.inf if locked else LATCH_SPEED

    def latch(self) -> None:
        """Hold it at the end of the track that it is nearer to from now on."""
        if self._latch is not None:
            self._latch.anchor_a = self.track.end if self.pushed else self.track.start


class Door:
    """The door swings outward on its hinge; a bolt at its free end keeps it closed at first."""

    def __init__(self, space: pymunk.Space, geometry: RoomGeometry) -> None:
        length, walls = geometry.door_length, space.static_body
        self.body = pymunk.Body(DOOR_MASS, DOOR_MASS * length**2 / 3)
        self.body.position = geometry.hinge
        radius = geometry.door_thickness / 2
        shape = _of_kind(pymunk.Segment(self.body, (0.0, 0.0), (0.0, -length), radius), DOOR, ARM)
        shape.friction = 0.0
        hinge = pymunk.PivotJoint(walls, self.body, geometry.hinge)
        stop = pymunk.RotaryLimitJoint(walls, self.body, 0.0, DOOR_SWING)
        brake = pymunk.SimpleMotor(walls, self.body, 0.0)
        brake.max_force = HINGE_FRICTION
        self._bolt = pymunk.PivotJoint(walls, self.body, geometry.lock)
        space.add(self.body, shape, hinge, stop, brake, self._bolt)

    @property
    def angle(self) -> float:
        """Angle of the door: 0 closed."""
        return self.body.angle

    @property
    def opened(self) -> bool:
        """Whether the door counts as open."""
        return self.angle > DOOR_OPEN

    @property
    def locked(self) -> bool:
        """Whether the bolt holds."""
        return self._bolt.max_force > 0.0

    def lock(self, locked: bool) -> None:
        """Bolt it, or draw the bolt. A door that is open stays open."""
        self._bolt.max_force = math.inf if locked and not self.opened else 0.0


def _of_kind(shape: pymunk.Shape, kind: int, collides_with: int) -> pymunk.Shape:
    shape.filter = pymunk.ShapeFilter(categories=kind, mask=collides_with)
    shape.collision_type = kind
    return shape


class World:
    """A room's bodies: the arm in the posture in which it begins, all levers pulled, all locked.

    Attributes:
        levers: The lever at each position; only the active ones can move.
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
        """Pose of all bodies now."""
        return Pose(
            joints=self.arm.joints(),
            levers=tuple(lever.displacement for lever in self.levers),
            door=self.door.angle,
            locked=self.indicator,
        )
