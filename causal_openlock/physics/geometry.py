"""Geometry of a physical room, as plain numbers.

Lengths are in links of the paper's arm, the arm's base is at (0, 0), y points up, angles are in
radians, counter-clockwise. In a room of more than seven levers the circle of levers is larger, and
the arm grows with it; bars, tracks and the door keep their size.

A lever is a bar across its *track*, which leads outward along the radius. How far it has slid is
its *displacement*: 0 pulled, 1 pushed. The door hangs on its hinge; its angle is 0 closed and grows
as it swings outward.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import pairwise

from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import PAPER_POSITIONS, position_coordinates

Point = tuple[float, float]

BAR_LENGTH, BAR_WIDTH = 2.0, 0.2
DOOR_SWING = math.radians(60)  # angle to which the arm pushes the door
DOOR_OPEN = DOOR_SWING / 2  # angle from which the door counts as open
PUSHED = 0.5  # displacement from which a lever counts as pushed
HANDLE = 1.0  # distance below the hinge at which the arm pushes the door: its middle
GAP = 0.03  # between the arm's end and the part that it is about to touch
CLEARANCE = 0.3  # distance that the arm keeps from all levers while it swings round


@dataclass(frozen=True)
class Track:
    """The track of one lever."""

    start: Point  #: centre of the bar when the lever is pulled
    outward: Point  #: unit vector along which it is pushed
    travel: float  #: how far it can slide

    @property
    def end(self) -> Point:
        """Centre of the bar when the lever is pushed."""
        return self.centre(1.0)

    def centre(self, displacement: float) -> Point:
        """Centre of the bar."""
        return along(self.start, self.outward, displacement * self.travel)

    def displacement(self, centre: Point) -> float:
        """Displacement of a bar whose centre is at a point, 0 to 1."""
        x, y = centre[0] - self.start[0], centre[1] - self.start[1]
        return (x * self.outward[0] + y * self.outward[1]) / self.travel

    def ends(self, displacement: float) -> tuple[Point, Point]:
        """The middle of either end of the bar."""
        across, centre = (-self.outward[1], self.outward[0]), self.centre(displacement)
        return along(centre, across, -BAR_LENGTH / 2), along(centre, across, BAR_LENGTH / 2)

    def bar(self, displacement: float) -> list[Point]:
        """The corners of the bar."""
        (start, end), half = self.ends(displacement), BAR_WIDTH / 2
        return [
            along(point, self.outward, distance)
            for point, distance in ((start, -half), (end, -half), (end, half), (start, half))
        ]

    def line(self) -> tuple[Point, Point]:
        """Ends of the visible track: the bar's inner edge and its outermost one."""
        half = BAR_WIDTH / 2
        return along(self.start, self.outward, -half), along(self.end, self.outward, half)


@dataclass(frozen=True, eq=False)
class RoomGeometry:
    """Geometry of a room of some size."""

    stretch: float  #: how much larger the circle of levers is than the paper's, and so the arm
    tracks: tuple[Track, ...]  #: at each position
    link: float  #: length of each of the arm's links
    half_width: float  #: half the width of a link, whose ends are round
    #: joint angles in which the arm begins, each relative to the one before
    rest: tuple[float, ...]
    #: how far the arm's end is from its base while it swings round, clear of all levers
    ready: float
    hinge: Point  #: the door's hinge, its upper end
    door_length: float  #: from the hinge to the lower end
    door_thickness: float
    button: Point  #: centre of the green button next to the door

    @classmethod
    @cache
    def of(cls, positions: int) -> RoomGeometry:
        """The geometry of a room of 7 to 12 levers; the same object for the same number.

        Raises:
            ExperimentError: If no room has this number of positions.
        """
        facts = room_facts()
        arm, door, travel = facts["arm"], facts["door"], facts["track"]["visible_outside_bar"]
        tracks, nearest = [], math.inf
        for x, y in position_coordinates(positions).tolist():
            radius = math.hypot(x, y)
            tracks.append(Track((x, y), (x / radius, y / radius), travel))
            nearest = min(nearest, radius)
        stretch = positions / len(PAPER_POSITIONS)
        half_width = float(arm["width"]) / 2
        steps = [(x - x0, y - y0) for (x0, y0), (x, y) in pairwise(arm["joints"])]
        headings = [math.atan2(y, x) for x, y in steps]
        hinge_x, hinge_y = door["hinge"]
        x, y = facts["button"]["centre"]
        return cls(
            stretch=stretch,
            tracks=tuple(tracks),
            link=stretch * float(arm["link_length"]),
            half_width=half_width,
            rest=tuple(wrap(now - before) for before, now in pairwise([0.0, *headings])),
            ready=nearest - BAR_WIDTH / 2 - half_width - CLEARANCE,
            hinge=(hinge_x * stretch, hinge_y),
            door_length=float(hinge_y - door["lock_indicator"][1]),
            door_thickness=float(door["thickness"]),
            button=(x + hinge_x * (stretch - 1), y),
        )

    @property
    def lock(self) -> Point:
        """The door's lock: its lower end when it is closed."""
        return self.door_end(0.0)

    def door_end(self, angle: float) -> Point:
        """The door's free end."""
        return along(self.hinge, (math.sin(angle), -math.cos(angle)), self.door_length)

    def at_lever(self, place: int, displacement: float) -> Point:
        """Point of the arm's end when it touches a lever from within."""
        track = self.tracks[place]
        back = BAR_WIDTH / 2 + self.half_width + GAP
        return along(track.centre(displacement), track.outward, -back)

    def at_door(self, angle: float) -> Point:
        """Point of the arm's end when it touches the door from within."""
        down, outward = (math.sin(angle), -math.cos(angle)), (math.cos(angle), math.sin(angle))
        back = self.door_thickness / 2 + self.half_width + GAP
        return along(along(self.hinge, down, HANDLE), outward, -back)


@dataclass(frozen=True)
class Pose:
    """Pose of everything that moves at one moment; all else is in the room's geometry."""

    joints: tuple[Point, ...]  #: the arm's base, its four joints and its free end: six points
    levers: tuple[float, ...]  #: how far the lever at each position has slid: 0 pulled, 1 pushed
    door: float  #: angle of the door in radians: 0 closed
    locked: bool  #: whether the door's lock indicator is there


def along(start: Point, direction: Point, distance: float) -> Point:
    """The point at a distance from another in some direction, a unit vector."""
    return start[0] + distance * direction[0], start[1] + distance * direction[1]


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
