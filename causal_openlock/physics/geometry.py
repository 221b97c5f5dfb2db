"""Where everything in a physical room is, as plain numbers.

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
from functools import cache, cached_property
from itertools import pairwise

from causal_openlock.world.reference import room_facts
from causal_openlock.world.room import PAPER_POSITIONS, position_coordinates

Point = tuple[float, float]
Corners = tuple[Point, Point, Point, Point]

BAR_LENGTH, BAR_WIDTH = 2.0, 0.2
DOOR_SWING = math.radians(60)
"""How far the arm pushes the door."""
DOOR_OPEN = DOOR_SWING / 2
"""From which angle on the door counts as open."""
PUSHED = 0.5
"""From which displacement on a lever counts as pushed."""

HANDLE = 1.0
"""How far below the hinge the arm pushes the door: at its middle."""
GAP = 0.03
"""Between the arm's end and what it is about to touch."""
CLEARANCE = 0.3
"""How far the arm stays away from all levers while it swings round."""


@dataclass(frozen=True)
class Track:
    """The track of one lever.

    Attributes:
        start: Centre of the bar when the lever is pulled.
        outward: Unit vector along which it is pushed.
        travel: How far it can slide.
    """

    start: Point
    outward: Point
    travel: float

    @property
    def radius(self) -> float:
        """How far from the arm's base the bar's centre is when the lever is pulled."""
        return math.hypot(*self.start)

    @property
    def end(self) -> Point:
        """Centre of the bar when the lever is pushed."""
        return self.centre(1.0)

    def centre(self, displacement: float) -> Point:
        """Centre of the bar."""
        return along(self.start, self.outward, displacement * self.travel)

    def displacement(self, centre: Point) -> float:
        """How far a bar whose centre is there has slid, 0 to 1."""
        x, y = centre[0] - self.start[0], centre[1] - self.start[1]
        return (x * self.outward[0] + y * self.outward[1]) / self.travel

    def bar(self, displacement: float) -> Corners:
        """The corners of the bar."""
        across = (-self.outward[1], self.outward[0])
        centre = self.centre(displacement)
        half = BAR_LENGTH / 2
        return bar(along(centre, across, -half), along(centre, across, half), BAR_WIDTH)

    def line(self) -> tuple[Point, Point]:
        """Where the visible track begins and ends: the bar's inner edge and its outermost one."""
        half = BAR_WIDTH / 2
        return along(self.start, self.outward, -half), along(self.end, self.outward, half)


@dataclass(frozen=True)
class RoomGeometry:
    """Where everything in a room of some size is.

    Attributes:
        positions: Number of levers, 7 to 12.
    """

    positions: int

    @classmethod
    @cache
    def of(cls, positions: int) -> RoomGeometry:
        """The geometry of a room; the same object for the same size.

        Raises:
            LayoutError: If no room has so many positions.
        """
        position_coordinates(positions)
        return cls(positions)

    @cached_property
    def stretch(self) -> float:
        """How much larger the circle of levers is than the paper's, and so the arm."""
        return self.positions / len(PAPER_POSITIONS)

    # -- levers ---------------------------------------------------------------------------------

    @cached_property
    def tracks(self) -> tuple[Track, ...]:
        """The track at each position."""
        travel = room_facts()["track"]["visible_outside_bar"]
        tracks = []
        for x, y in position_coordinates(self.positions).tolist():
            radius = math.hypot(x, y)
            tracks.append(Track((x, y), (x / radius, y / radius), travel))
        return tuple(tracks)

    # -- arm ------------------------------------------------------------------------------------

    @cached_property
    def link(self) -> float:
        """Length of each of the arm's links."""
        return self.stretch * float(room_facts()["arm"]["link_length"])

    @cached_property
    def half_width(self) -> float:
        """Half the width of a link, whose ends are round."""
        return float(room_facts()["arm"]["width"]) / 2

    @cached_property
    def rest(self) -> tuple[float, ...]:
        """The joint angles in which the arm begins, each relative to the link before."""
        heading, angles = 0.0, []
        for (x, y), (next_x, next_y) in pairwise(room_facts()["arm"]["joints"]):
            direction = math.atan2(next_y - y, next_x - x)
            angles.append(wrap(direction - heading))
            heading = direction
        return tuple(angles)

    @cached_property
    def ready(self) -> float:
        """How far the arm's end is from its base while it swings round, clear of all levers."""
        nearest = min(track.radius for track in self.tracks)
        return nearest - BAR_WIDTH / 2 - self.half_width - CLEARANCE

    def touching(self, place: int, displacement: float) -> Point:
        """Where the arm's end is when it touches a lever from within."""
        track = self.tracks[place]
        back = BAR_WIDTH / 2 + self.half_width + GAP
        return along(track.centre(displacement), track.outward, -back)

    # -- door -----------------------------------------------------------------------------------

    @cached_property
    def hinge(self) -> Point:
        """The door's hinge, its upper end."""
        x, y = room_facts()["door"]["hinge"]
        return x * self.stretch, y

    @cached_property
    def door_length(self) -> float:
        """From the hinge to the lower end."""
        facts = room_facts()["door"]
        return float(facts["hinge"][1] - facts["lock_indicator"][1])

    @cached_property
    def door_thickness(self) -> float:
        """Thickness of the door."""
        return float(room_facts()["door"]["thickness"])

    @property
    def lock(self) -> Point:
        """The door's lock: its lower end when it is closed."""
        return self.door_end(0.0)

    def door_end(self, angle: float) -> Point:
        """The door's free end."""
        return along(self.hinge, (math.sin(angle), -math.cos(angle)), self.door_length)

    def at_door(self, angle: float) -> Point:
        """Where the arm's end is when it touches the door from within."""
        down, outward = (math.sin(angle), -math.cos(angle)), (math.cos(angle), math.sin(angle))
        back = self.door_thickness / 2 + self.half_width + GAP
        return along(along(self.hinge, down, HANDLE), outward, -back)

    @cached_property
    def size(self) -> float:
        """No part of anything in the room is ever farther than this from the arm's base."""
        doors = (math.hypot(*self.door_end(angle)) for angle in (0.0, DOOR_SWING, math.pi / 2))
        levers = (math.hypot(*corner) for track in self.tracks for corner in track.bar(1.0))
        return max(5 * self.link, *doors, *levers) + self.half_width


def along(start: Point, direction: Point, distance: float) -> Point:
    """The point that many lengths from another in some direction, a unit vector."""
    return start[0] + distance * direction[0], start[1] + distance * direction[1]


def bar(start: Point, end: Point, width: float) -> Corners:
    """The corners of a bar between two points."""
    length = math.dist(start, end)
    side = ((start[1] - end[1]) / length, (end[0] - start[0]) / length)
    half = width / 2
    return (
        along(start, side, half),
        along(end, side, half),
        along(end, side, -half),
        along(start, side, -half),
    )


def wrap(angle: float) -> float:
    """The same angle in (-pi, pi]."""
    return math.pi - (math.pi - angle) % (2 * math.pi)
