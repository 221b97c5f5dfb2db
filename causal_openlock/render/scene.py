"""Parts of a picture of a room, before it is pixels or SVG.

The room is drawn after the paper's Figure 2a. Everything in it is a :class:`Shape`, a bar with
more or less rounded ends: a disc is a bar that is all ends, the button one that is as long as it
is wide. Where things are comes from :class:`~causal_openlock.physics.geometry.RoomGeometry`, which
the simulated room is also built from; a :class:`Look` says where the parts that move are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from causal_openlock.physics.geometry import BAR_WIDTH, DOOR_SWING, Point, Pose, RoomGeometry, along
from causal_openlock.physics.kinematics import joint_points
from causal_openlock.world.facts import room_facts
from causal_openlock.world.room import Room, position_names

Colour = tuple[int, int, int]

LINE = 0.025
JOINT_RADIUS = 0.1
LOCK_RADIUS = 0.15
MARGIN = 0.3
OUTLINE: Colour = (0, 0, 0)


class Frame(NamedTuple):
    """Part of the plane that a picture shows, in arm links, and its pixels per link."""

    left: float
    top: float
    scale: float
    width: int
    height: int

    def pixel(self, point: Point) -> Point:
        """Column and row of a point of the room."""
        return (point[0] - self.left) * self.scale, (self.top - point[1]) * self.scale


@cache
def frame(positions: int, size: int) -> Frame:
    """Frame of a picture of a room, ``size`` pixels high and about a quarter wider.

    Raises:
        ExperimentError: If no room has this number of positions.
    """
    geometry = RoomGeometry.of(positions)
    half = max(abs(x) for track in geometry.tracks for x in track.end) + BAR_WIDTH / 2 + MARGIN
    right = max(geometry.door_end(DOOR_SWING)[0], button(positions).x + 0.4) + MARGIN
    scale = size / (2 * half)
    return Frame(-half, half, scale, round((half + right) * scale), size)


class Shape(NamedTuple):
    """A bar, perhaps turned and rounded; lengths in arm links, y up."""

    x: float  #: its centre, with ``y``
    y: float
    length: float  #: half of its length
    width: float  #: half of its width
    angle: float  #: direction of its length, in radians
    corner: float  #: radius of its corners
    fill: Colour
    line: float = LINE  #: width of its black outline, half inside and half outside; 0 for none


def rod(start: Point, end: Point, width: float, fill: Colour, rounded: bool = False) -> Shape:
    """A bar between two points; rounded ends reach beyond them by half the width."""
    half = width / 2
    length = math.dist(start, end) / 2 + half * rounded
    angle = math.atan2(end[1] - start[1], end[0] - start[0])
    x, y = (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    return Shape(x, y, length, half, angle, half * rounded, fill)


def disc(centre: Point, radius: float, fill: Colour, line: float = LINE / 2) -> Shape:
    """A disc."""
    return Shape(centre[0], centre[1], radius, radius, 0.0, radius, fill, line)


@cache
def colour(name: str) -> Colour:
    """A colour of the figure by its name in ``room.yaml``."""
    red, green, blue = room_facts()["rgb"][name]
    return red, green, blue


@dataclass(frozen=True)
class Look(Pose):
    """Look of a room at one moment: the pose of what moves, and the colours."""

    grey: tuple[bool, ...]  #: whether the lever at each position is grey, which active ones are
    pressed: bool = False  #: whether the green button is held down

    @property
    def positions(self) -> int:
        """Number of positions, P."""
        return len(self.levers)

    @classmethod
    def of_observation(cls, observation: ArrayLike, positions: int) -> Look:
        """A symbolic room: nothing is between two states, and the arm is at rest.

        Raises:
            ValueError: If the observation does not have ``2P + 2`` bits.
        """
        bits, geometry = bits_of(observation, positions), RoomGeometry.of(positions)
        return cls(
            joints=joint_points(geometry.rest, geometry.link),
            levers=tuple(map(float, bits[:positions])),
            grey=tuple(map(bool, bits[positions:-2])),
            door=DOOR_SWING * bits[-1],
            locked=bool(bits[-2]),
        )

    @classmethod
    def of_pose(cls, pose: Pose, grey: Sequence[bool], pressed: bool = False) -> Look:
        """A physical room, as its bodies are."""
        return cls(**vars(pose), grey=tuple(grey), pressed=pressed)

    def shapes(self) -> dict[str, list[Shape]]:
        """Everything that is drawn, part by part, each part above those before it."""
        parts = {"button": [button(self.positions, self.pressed)]}
        for place, name in enumerate(position_names(self.positions)):
            bar = lever(self.positions, place, self.levers[place], self.grey[place])
            parts[f"lever_{name}"] = bar
        door_and_lock = door(self.positions, self.door, self.locked)
        return {**parts, "door": door_and_lock, "arm": arm(self.joints)}


def bits_of(observation: ArrayLike, positions: int) -> list[int]:
    """An observation as a list, its length checked."""
    bits = np.asarray(observation)
    if bits.shape != (2 * positions + 2,):
        raise ValueError(
            f"a room of {positions} positions is seen as {2 * positions + 2} bits, and this "
            f"observation has the shape {bits.shape}; pass positions="
        )
    return [int(bit) for bit in bits]


def button(positions: int, pressed: bool = False) -> Shape:
    """The green button next to the door's hinge, darker while it is pressed."""
    x, y = RoomGeometry.of(positions).button
    half = room_facts()["button"]["side"] / 2
    return Shape(x, y, half, half, 0.0, 0.0, colour("button_pressed" if pressed else "button"))


def lever(positions: int, place: int, slid: float, grey: bool) -> list[Shape]:
    """A lever: its track, parted into an inner and an outer end, and its bar across it."""
    track = RoomGeometry.of(positions).tracks[place]
    fill = colour("active_lever_arm_door" if grey else "inactive_lever")
    width = float(room_facts()["track"]["width"])
    inner, outer = track.line()
    middle = (inner[0] + outer[0]) / 2, (inner[1] + outer[1]) / 2
    inner = along(inner, track.outward, LINE)  # its outline is not to peep out below the bar's
    return [
        rod(inner, middle, width, fill),
        rod(middle, outer, width, fill),
        rod(*track.ends(slid), BAR_WIDTH, fill),
    ]


def door(positions: int, angle: float, locked: bool) -> list[Shape]:
    """The door on its red hinge, and the black lock where its end is when it is closed."""
    geometry = RoomGeometry.of(positions)
    grey = colour("active_lever_arm_door")
    shapes = [
        rod(geometry.hinge, geometry.door_end(angle), geometry.door_thickness, grey),
        disc(geometry.hinge, 1.2 * JOINT_RADIUS, colour("joint_and_hinge")),
    ]
    if locked:
        shapes.append(disc(geometry.lock, LOCK_RADIUS, OUTLINE, line=0.0))
    return shapes


def arm(joints: Sequence[Point]) -> list[Shape]:
    """The arm: its links, red joints, and a free end without one."""
    grey = colour("active_lever_arm_door")
    width = float(room_facts()["arm"]["width"])
    links = [rod(start, end, width, grey, rounded=True) for start, end in pairwise(joints)]
    red = [disc(joint, JOINT_RADIUS, colour("joint_and_hinge")) for joint in joints[:-1]]
    return [*links, *red, disc(joints[-1], 1.3 * JOINT_RADIUS, grey, line=LINE)]


def look_after(room: Room, actions: Sequence[int] = (), part: float = 1.0) -> Look:
    """Look of a room after actions from the start of an attempt, none of which fails.

    Only a ``part`` of the last movement is carried out, 0 to 1.
    """
    from causal_openlock.physics.room import PhysicalRoom

    physical = PhysicalRoom(room.fsm, room.layout)
    pose, pressed = physical.pose(), False
    for action in actions:
        poses: list[Pose] = [physical.pose()]
        physical.watch = poses.append
        physical.act(action)
        pose = poses[round((len(poses) - 1) * part)]
        pressed = part < 1.0 and action == 2 * room.positions
    return Look.of_pose(pose, room.active.tolist(), pressed)
