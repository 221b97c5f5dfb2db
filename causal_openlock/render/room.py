"""A room as it is perceived: a picture after the paper's Figure 2a, or a few lines of text.

Both show one observation and nothing else: which levers are pushed, which are grey, whether the
door is locked, whether it is open. The arm is drawn at rest.

A picture is put together from pieces. Each lever, the door and the lock change pixels of their
own, so the pixels that a piece in some state changes are found once, from a drawing four times as
large, and after that a picture is a copy of the empty room with a few of these writes on top.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache
from itertools import pairwise
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from causal_openlock.reference import room_facts
from causal_openlock.room import PAPER_POSITIONS, position_coordinates

if TYPE_CHECKING:
    from PIL.ImageDraw import ImageDraw as Draw

Bytes = NDArray[np.uint8]
Point = tuple[float, float]

OVERSAMPLING = 4
BAR_LENGTH, BAR_WIDTH = 2.0, 0.2
LOCK_RADIUS = 0.15
JOINT_RADIUS = 0.09
LINE = 0.025
OPEN_DEGREES = 60.0
MARGIN = 0.3
OUTLINE = (0, 0, 0)


class Frame(NamedTuple):
    """What part of the plane a picture shows, in arm links, and at how many pixels per link."""

    left: float
    top: float
    scale: float
    width: int
    height: int

    def pixel(self, point: ArrayLike) -> Point:
        """Column and row of a point of the room."""
        x, y = np.asarray(point, dtype=float).tolist()
        return (x - self.left) * self.scale, (self.top - y) * self.scale


def draw_room(observation: ArrayLike, positions: int = 7, size: int = 600) -> Bytes:
    """A picture of a room.

    A lever's bar lies across its track. Pulled, it rests on the end toward the arm; pushed, it has
    slid to the outer end. Active levers are grey, inactive ones light. A closed door is a vertical
    bar on the right, with a black circle at its lower end while it is locked; an open one has
    swung outward.

    Args:
        observation: ``[2P + 2]`` bits: levers pushed, levers grey, door locked, door open.
        positions: P, 7 to 12.
        size: Height of the picture in pixels; it is about a quarter wider.

    Returns:
        ``[size, width, 3]`` red, green, blue; a new array each time.

    Raises:
        ValueError: If the observation has another length.
        LayoutError: If no room has so many positions.
    """
    bits = _bits(observation, positions)
    picture = _empty_room(positions, size).copy()
    flat = picture.reshape(-1, 3)
    for place in range(positions):
        where, colour = _piece(positions, size, place, bits[place], bits[positions + place])
        flat[where] = colour
    where, colour = _piece(positions, size, "door", bits[-1], bits[-2])
    flat[where] = colour
    return picture


def frame(positions: int, size: int) -> Frame:
    """Where things are in the pictures of :func:`draw_room`."""
    reach = float(np.abs(position_coordinates(positions)).max()) + 0.5
    half = max(reach, 3.5) + MARGIN
    _, lower_end = _door(positions, opened=True)
    right = max(lower_end[0], _button(positions)[0] + 0.4) + MARGIN
    scale = size / (2 * half)
    return Frame(-half, half, scale, round((half + right) * scale), size)


def lever_centre(positions: int, place: int, pushed: bool) -> Point:
    """Centre of a lever's bar, in arm links, y up."""
    x, y = position_coordinates(positions)[place].tolist()
    shift = room_facts()["track"]["visible_outside_bar"] * pushed / math.hypot(x, y)
    return x * (1 + shift), y * (1 + shift)


def _bits(observation: ArrayLike, positions: int) -> list[int]:
    bits = np.asarray(observation)
    if bits.shape != (2 * positions + 2,):
        raise ValueError(
            f"a room of {positions} positions is seen as {2 * positions + 2} bits, and this "
            f"observation has the shape {bits.shape}; pass positions="
        )
    return [int(bit) for bit in bits]


# -- geometry -------------------------------------------------------------------------------------


def _stretch(positions: int) -> float:
    """How much farther out than in the paper the levers of a room stand."""
    return positions / len(PAPER_POSITIONS)


def _door(positions: int, opened: bool) -> tuple[Point, Point]:
    """The hinge and the lower end of the door."""
    x, top = room_facts()["door"]["hinge"]
    length = top - room_facts()["door"]["lock_indicator"][1]
    angle = math.radians(OPEN_DEGREES * opened)
    x *= _stretch(positions)
    return (x, top), (x + length * math.sin(angle), top - length * math.cos(angle))


def _button(positions: int) -> Point:
    facts = room_facts()
    x, y = facts["button"]["centre"]
    return x + facts["door"]["hinge"][0] * (_stretch(positions) - 1), y


def _bar(start: ArrayLike, end: ArrayLike, width: float) -> NDArray[np.float64]:
    """``[4, 2]`` corners of a bar between two points."""
    start, end = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
    along = (end - start) / np.hypot(*(end - start))
    side = width / 2 * np.array([-along[1], along[0]])
    return np.stack([start + side, end + side, end - side, start - side])


# -- drawing --------------------------------------------------------------------------------------


class _Pen:
    """Draws in the room's own coordinates onto a picture that is shrunk in the end."""

    def __init__(self, positions: int, size: int) -> None:
        from PIL import Image, ImageDraw

        self.frame = frame(positions, size * OVERSAMPLING)
        target = frame(positions, size)
        shape = (target.width * OVERSAMPLING, target.height * OVERSAMPLING)
        self.image = Image.new("RGB", shape, _rgb("background"))
        self.on: Draw = ImageDraw.Draw(self.image)
        self.line = max(OVERSAMPLING, round(LINE * self.frame.scale))

    def bar(self, corners: NDArray[np.float64], fill: tuple[int, int, int]) -> None:
        points = [self.frame.pixel(corner) for corner in corners]
        self.on.polygon(points, fill=fill)
        closed = [*points, points[0], points[1]]
        self.on.line(closed, fill=OUTLINE, width=self.line, joint="curve")

    def circle(self, centre: ArrayLike, radius: float, fill: tuple[int, int, int]) -> None:
        x, y = self.frame.pixel(centre)
        r = radius * self.frame.scale
        outline = OUTLINE if fill != OUTLINE else None
        self.on.ellipse((x - r, y - r, x + r, y + r), fill, outline, self.line // 2)

    def shrunk(self) -> Bytes:
        return np.asarray(self.image.reduce(OVERSAMPLING), dtype=np.uint8)


def _rgb(name: str) -> tuple[int, int, int]:
    red, green, blue = room_facts()["rgb"][name]
    return red, green, blue


@lru_cache(maxsize=16)
def _empty_room(positions: int, size: int) -> Bytes:
    """The arm and the button, which no observation changes."""
    pen = _Pen(positions, size)
    facts = room_facts()
    grey, width = _rgb("active_lever_arm_door"), facts["arm"]["width"]
    joints = facts["arm"]["joints"]
    for start, end in pairwise(joints):
        pen.bar(_bar(start, end, width), grey)
    for joint in joints[:-1]:
        pen.circle(joint, JOINT_RADIUS, _rgb("joint_and_hinge"))
    pen.circle(joints[-1], 1.4 * JOINT_RADIUS, grey)
    x, y = _button(positions)
    half = facts["button"]["side"] / 2
    pen.bar(_bar((x - half, y), (x + half, y), 2 * half), _rgb("button"))
    return pen.shrunk()


@lru_cache(maxsize=1024)
def _piece(
    positions: int, size: int, what: int | str, first: int, second: int
) -> tuple[NDArray[np.intp], Bytes]:
    """Which pixels a lever (pushed, grey) or the door (open, locked) changes, and to what."""
    pen = _Pen(positions, size)
    if isinstance(what, int):
        _draw_lever(pen, positions, what, bool(first), bool(second))
    else:
        _draw_door(pen, positions, bool(first), bool(second))
    drawn = pen.shrunk().reshape(-1, 3)
    where = np.flatnonzero((drawn != np.array(_rgb("background"))).any(axis=1))
    return where, drawn[where]


def _draw_lever(pen: _Pen, positions: int, place: int, pushed: bool, grey: bool) -> None:
    rest = np.array(lever_centre(positions, place, pushed=False))
    outward = rest / np.hypot(*rest)
    across = BAR_LENGTH / 2 * np.array([-outward[1], outward[0]])
    track = room_facts()["track"]
    inner = rest - outward * BAR_WIDTH / 2
    outer = rest + outward * (BAR_WIDTH / 2 + track["visible_outside_bar"])
    colour = _rgb("active_lever_arm_door" if grey else "inactive_lever")
    middle = (inner + outer) / 2
    for start, end in ((inner, middle), (middle, outer)):
        pen.bar(_bar(start, end, track["width"]), colour)
    centre = np.array(lever_centre(positions, place, pushed))
    pen.bar(_bar(centre - across, centre + across, BAR_WIDTH), colour)


def _draw_door(pen: _Pen, positions: int, opened: bool, locked: bool) -> None:
    hinge, end = _door(positions, opened)
    pen.bar(_bar(hinge, end, room_facts()["door"]["thickness"]), _rgb("active_lever_arm_door"))
    pen.circle(hinge, 1.2 * JOINT_RADIUS, _rgb("joint_and_hinge"))
    if locked:
        pen.circle(_door(positions, opened=False)[1], LOCK_RADIUS, OUTLINE)


# -- text -----------------------------------------------------------------------------------------


def room_text(observation: ArrayLike, positions: int = 7) -> str:
    """A room in a few lines of plain text, each lever where it stands.

    A lever is its position's index and its bar: ``3[#]`` is grey and pushed, ``3[ ]`` grey and
    pulled; inactive levers have round brackets. The door is on the right.

    Args:
        observation: As in :func:`draw_room`.
        positions: P, 7 to 12.

    Raises:
        ValueError: If the observation has another length.
    """
    bits = _bits(observation, positions)
    canvas: dict[tuple[int, int], str] = {}

    def write(row: int, column: int, text: str) -> None:
        canvas.update({(row, column + offset): letter for offset, letter in enumerate(text)})

    for place, (column, row) in enumerate(_text_cells(positions)):
        pushed, grey = bits[place], bits[positions + place]
        mark = "#" if pushed else " "
        write(row, column, f"{place:2}" + (f"[{mark}]" if grey else f"({mark})"))
    rows = [row for row, _ in canvas]
    middle = (min(rows) + max(rows)) // 2
    right = max(column for _, column in canvas) + 4
    lock = "locked" if bits[-2] else "unlocked"
    shape = (
        ("o__", "   ", f"    door open, {lock}")
        if bits[-1]
        else ("o", "|", f"|  door closed, {lock}")
    )
    for offset, text in enumerate(shape):
        write(middle - 1 + offset, right, text)
    lines = []
    for row in range(min(rows), max(rows) + 1):
        columns = [column for at, column in canvas if at == row]
        width = max(columns, default=-1) + 1
        lines.append("".join(canvas.get((row, column), " ") for column in range(width)).rstrip())
    legend = "[ ] grey  ( ) inactive  # pushed"
    return "\n".join([*lines, legend]) + "\n"


@cache
def _text_cells(positions: int) -> list[tuple[int, int]]:
    """Column and row of each lever's text; characters are about twice as high as wide."""
    cells: Any = position_coordinates(positions) * [3.0, -1.0]
    cells = np.rint(cells).astype(int)
    cells -= cells.min(axis=0)
    return [(int(column), int(row)) for column, row in cells]
