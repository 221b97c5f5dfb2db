"""One action as a whole movement of the arm.

A movement is made of *phases*: swing round to where the lever is, reach out to it, take hold and
press it along its track, let go and draw back. Each phase is a path of joint angles, one for each
step of the simulation, and the motors are driven as velocity servos: at the speed of the path,
plus a correction for how far the arm lags behind it. After the last point of a path the
arm gets some time to settle there; a movement that does not get through all its phases within its
budget is broken off where it is and says so.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import chain, repeat

from causal_openlock.physics.geometry import DOOR_SWING, Point, Pose, along, wrap
from causal_openlock.physics.kinematics import Angles, reaching
from causal_openlock.physics.world import STEP, Lever, World

BUDGET = 600  # steps that a movement may take; it takes about 120, and 250 at most
CORRECTION = 10.0  # speed of a joint for each radian that it is away from its path
# Average speeds: radians of the joint that has the longest way in a swing, and lengths of the arm's
# end along a line and while it moves a lever, in a unit of time.
JOINT_SPEED, TIP_SPEED, PRESS_SPEED = 4.0, 3.0, 2.0
TOLERANCE = 0.03  # radians of any joint from the end of a path that count as arrival
DOOR_TIME = 40 * STEP  # in which the door is pushed open
PRESS = 0.08  # how far the arm presses on where nothing gives way
STALL = 8  # steps after which what has not moved at all is given up as locked
MOVED = 0.03  # least movement that counts: part of the track, or radians
SEATED = 0.05  # of a lever from the end of its track after a push, as part of the track
GRAZE = 0.1  # how far beyond its swinging radius the arm's end may be when a swing begins
AJAR = math.radians(5)  # of the door from its stop after a push

Path = list[Angles]
Watch = Callable[[Pose], None]  # called with the pose after every step of the simulation


@dataclass(frozen=True)
class Movement:
    """Outcome of a movement."""

    #: whether the arm reached its target, moved what was not locked to its end, and drew back
    finished: bool
    steps: int  #: of the simulation that it took


class OutOfTimeError(Exception):
    """The budget of a movement is spent."""


class Controller:
    """Moves the arm of a world; ``changed`` is called when a lever has passed its middle."""

    def __init__(self, world: World, changed: Callable[[], None]) -> None:
        self.world, self._changed = world, changed
        self._arm, self._geometry = world.arm, world.geometry

    def carry_out(self, action: int, budget: int, watch: Watch | None) -> Movement:
        """Push the lever at a position outward, pull it inward, or push the door: an action."""
        began, finished = self.world.steps, True
        self._last_step, self._watch = began + budget, watch
        pull, place = divmod(action, len(self.world.levers))
        try:
            if pull == 2:
                self._move_door()
            else:
                self._move_lever(self.world.levers[place], place, 1.0 - pull)
        except OutOfTimeError:
            finished = False
            self._arm.release()
        return Movement(finished, self.world.steps - began)

    def _move_lever(self, lever: Lever, place: int, goal: float) -> None:
        self._face(lever.track.start)
        began, was_pushed = lever.displacement, lever.pushed
        self._reach(self._geometry.at_lever(place, began))
        self._arm.grip(lever.body)
        way = (goal - began) * lever.track.travel
        if abs(goal - began) <= SEATED:  # it is there already: press against its stop
            way = PRESS if goal else -PRESS
        start, link = self._arm.tip, self._geometry.link
        path = straight(start, along(start, lever.track.outward, way), link, PRESS_SPEED)
        for number, _ in enumerate(self._follow(path)):
            now = lever.displacement
            if lever.pushed != was_pushed:
                was_pushed = not was_pushed
                lever.latch()
                self._changed()
            if abs(goal - now) <= SEATED and number >= len(path):
                break
            if lever.locked and number >= STALL and abs(now - began) < MOVED:
                break
        self._arm.release()
        self._withdraw()

    def _move_door(self) -> None:
        door, geometry = self.world.door, self._geometry
        self._face(geometry.at_door(0.0))
        self._reach(geometry.at_door(0.0))
        began = door.angle
        points = (geometry.at_door(part * DOOR_SWING) for part in _parts(DOOR_TIME))
        path = [reaching(point, geometry.link) for point in points]
        for number, _ in enumerate(self._follow(path)):
            if DOOR_SWING - door.angle <= AJAR and number >= len(path):
                break
            if door.locked and number >= STALL and abs(door.angle - began) < MOVED:
                break
        self._withdraw()

    # -- phases ---------------------------------------------------------------------------------

    def _face(self, target: Point) -> None:
        """Swing round until the arm's end is straight between the base and a point."""
        if math.hypot(*self._arm.tip) > self._geometry.ready + GRAZE:
            self._withdraw()  # the movement before was broken off
        end = reaching(self._clear(target), self._geometry.link)
        self._settle(swing(self._arm.angles, end))

    def _reach(self, target: Point) -> None:
        """Bring the arm's end to a point along a line."""
        self._settle(straight(self._arm.tip, target, self._geometry.link))

    def _withdraw(self) -> None:
        """Draw the arm's end straight back to where the arm can swing round."""
        self._reach(self._clear(self._arm.tip))

    def _clear(self, point: Point) -> Point:
        """Where the arm's end is clear of all levers, in the direction of a point."""
        part = self._geometry.ready / math.hypot(*point)
        return point[0] * part, point[1] * part

    def _settle(self, path: Path) -> None:
        """Follow a path, and wait at its end until the arm is there."""
        end = path[-1]
        for number, angles in enumerate(self._follow(path)):
            if number >= len(path) - 1 and _apart(angles, end) <= TOLERANCE:
                return

    def _follow(self, path: Path) -> Iterator[Angles]:
        """Follow a path and hold the arm at its end; yields its joint angles after each step.

        Raises:
            OutOfTimeError: When the budget of the movement is spent.
        """
        arm, world = self._arm, self.world
        angles = before = arm.angles
        for to in chain(path, repeat(path[-1])):
            if world.steps >= self._last_step:
                raise OutOfTimeError
            # Angles that are whole turns apart are the same place; the arm goes the short way.
            to = (before[0] + wrap(to[0] - before[0]), *to[1:])
            arm.drive(
                [
                    (next_ - now) / STEP + (now - measured) * CORRECTION
                    for next_, now, measured in zip(to, before, angles, strict=True)
                ]
            )
            world.step()
            if self._watch is not None:
                self._watch(world.pose())
            angles, before = arm.angles, to
            yield angles


# -- paths ----------------------------------------------------------------------------------------


def swing(start: Sequence[float], end: Sequence[float]) -> Path:
    """Path from one posture to another, all joints together, the base the short way round."""
    ways = [to - now for now, to in zip(start, end, strict=True)]
    ways[0] = wrap(ways[0])
    parts = _parts(max(map(abs, ways)) / JOINT_SPEED)
    return [tuple(a + part * b for a, b in zip(start, ways, strict=True)) for part in parts]


def straight(start: Point, end: Point, link: float, speed: float = TIP_SPEED) -> Path:
    """Path of the arm's end along a line."""
    x, y = end[0] - start[0], end[1] - start[1]
    parts = _parts(math.hypot(x, y) / speed)
    return [reaching((start[0] + part * x, start[1] + part * y), link) for part in parts]


def _parts(time: float) -> list[float]:
    """Share of a way that is done after each step: slow at both ends, 1 in the end."""
    steps = max(4, math.ceil(time / STEP))
    times = (step / steps for step in range(1, steps + 1))
    return [time * time * (3 - 2 * time) for time in times]


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    """Largest difference between two postures in any joint."""
    base = abs(wrap(one[0] - other[0]))
    return max(base, *(abs(a - b) for a, b in zip(one[1:], other[1:], strict=True)))
