"""A room as pixels, SVG or text, and next to it the console: what a subject is shown and did.

Pixels are painted by Pillow, twice as large as they are needed, and averaged. In an SVG each
part is a group with a name (``lever_UPPER``, ``door``, ``arm``, ``button``, ``console``), so that a
figure can be changed in any editor. Equal rooms give equal pictures.

The console is as high as the picture of the room. Its lengths are in 1/7.6 of that height, and all
of its lines are set in one size.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from textwrap import wrap
from typing import NamedTuple
from xml.sax.saxutils import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image, ImageDraw, ImageFont

from causal_openlock.files.atomic import replacing, write_text
from causal_openlock.render import STILLS, path_of_picture
from causal_openlock.render.scene import (
    OUTLINE,
    Colour,
    Frame,
    Look,
    Shape,
    bits_of,
    colour,
    frame,
)
from causal_openlock.world.room import position_coordinates

Bytes = NDArray[np.uint8]

LARGER = 2  # times that a picture is painted larger before its pixels are averaged
THINNEST = 0.8  # width of an outline, in pixels
UNIT, INCHES = 100, 3.3  # an SVG's units in an arm link, and its height
WIDTH, HEIGHT, PADDING = 5.1, 7.6, 0.28  # of the console
ROW, TEXT = 0.335, 0.225  # height of its lines and of their type
ROWS, LETTERS = int((HEIGHT - 2 * PADDING) / ROW), 34  # lines, and letters in a line
MOST_SOLUTIONS = 5
BACKGROUND, INK, FAINT, DONE = (246, 246, 246), (30, 30, 30), (105, 105, 105), (0, 120, 62)


# -- the console ----------------------------------------------------------------------------------


class Line(NamedTuple):
    """A line of the console."""

    text: str
    colour: Colour = INK
    bold: bool = False


@dataclass(frozen=True)
class ShownAction:
    """An action of the attempt in progress."""

    name: str  #: such as ``push UPPER``
    outcome: str = ""  #: what came of it, in words; empty while it is carried out
    good: bool = False  #: whether that was progress

    @classmethod
    def of(cls, name: str, before: ArrayLike, after: ArrayLike, new: bool = False) -> ShownAction:
        """An action that led from one observation to another, and perhaps to a new solution."""
        was, now = np.asarray(before), np.asarray(after)
        if now[-1] and not was[-1]:
            return cls(name, f"the door opens: {'a new solution' if new else 'nothing new'}", new)
        if now[-2] != was[-2]:
            return cls(name, f"the door {'locks again' if now[-2] else 'unlocks'}", not now[-2])
        return cls(name, "the lever moves" if (was != now).any() else "nothing moves")


@dataclass(frozen=True)
class Panel:
    """Content of the console next to a room."""

    #: for each solution how it was found, such as ``LEFT, UPPER, door``; empty for each that is not
    #: found yet. ``None`` for found ones without a description
    solutions: tuple[str | None, ...]
    #: attempts left in the trial, the present one included; ``None`` once it is solved and over
    attempts_left: int | None
    actions_left: int  #: in the attempt
    heading: str = ""  #: who plays what
    lines: tuple[str, ...] = ()  #: more about it
    #: what was done in this attempt; ``None`` leaves it out
    actions: tuple[ShownAction, ...] | None = None
    remark: str = ""  #: a last line

    def text(self) -> list[Line]:
        """Its lines, from the top down: of many solutions and actions the last ones."""
        found = [how for how in self.solutions if how != ""]
        boxes = [Line(f"☑ {how or ''}", DONE) for how in found[1 - MOST_SOLUTIONS :]]
        missing = len(self.solutions) - len(found)
        boxes += [Line("☐")] * min(MOST_SOLUTIONS - len(boxes), missing)
        attempts = "–" if self.attempts_left is None else self.attempts_left
        above = [
            *([Line(self.heading, bold=True)] if self.heading else []),
            *(Line(line, FAINT) for line in self.lines),
            *([Line("")] if self.heading else []),
            Line(f"Solutions found: {len(found)} of {len(self.solutions)}", bold=True),
            *boxes,
            Line(""),
            Line(f"Attempts left: {attempts}, actions left: {self.actions_left}", bold=True),
        ]
        actions: list[Line] = []
        for number, action in enumerate(self.actions or (), 1):
            actions.append(Line(f"{number}  {action.name}", bold=not action.outcome))
            actions.append(Line(f"    {action.outcome or '...'}", DONE if action.good else FAINT))
        if self.actions is not None:
            above += [Line(""), Line("This attempt", bold=True)]
        above, below = _wrapped(above), _wrapped([Line(self.remark, bold=True)])
        space = max(0, ROWS - len(above) - len(below))
        actions = actions[max(0, len(actions) - space // 2 * 2) :]
        return [*above, *actions, *[Line("")] * (space - len(actions)), *below]


def _wrapped(lines: Iterable[Line]) -> list[Line]:
    return [line._replace(text=part) for line in lines for part in wrap(line.text, LETTERS) or [""]]


# -- pixels ---------------------------------------------------------------------------------------


def draw(look: Look, size: int, panel: Panel | None = None) -> Bytes:
    """A new ``[size, width, 3]`` picture of a room, with the console next to it if there is one."""
    left, top, scale, width, _ = frame(look.positions, size)
    shown = Frame(left, top, LARGER * scale, LARGER * width, LARGER * size)
    picture = Image.new("RGB", (shown.width, shown.height), colour("background"))
    on = ImageDraw.Draw(picture)
    for shapes in look.shapes().values():
        for shape in shapes:
            _paint(on, shape, shown)
    room = np.asarray(picture.reduce(LARGER))
    return room.copy() if panel is None else np.hstack([room, _console(panel, size)])


def _paint(on: ImageDraw.ImageDraw, shape: Shape, shown: Frame) -> None:
    """Paint a shape a little larger in the colour of its outline, and on it a smaller one."""
    line = max(shape.line, THINNEST * LARGER / shown.scale) / 2 if shape.line else 0.0
    cos, sin = math.cos(shape.angle), math.sin(shape.angle)

    def pixel(along: float, across: float) -> tuple[float, float]:
        point = shape.x + along * cos - across * sin, shape.y + along * sin + across * cos
        column, row = shown.pixel(point)
        return column - 0.5, row - 0.5  # Pillow counts from the middle of a pixel

    for fill, more in ((OUTLINE, line), (shape.fill, -line)):
        length, width = shape.length + more, shape.width + more
        if shape.corner:  # round ends: a disc at each
            length, radius = length - width, width * shown.scale - 0.5
            for x, y in (pixel(-length, 0.0), pixel(length, 0.0)):
                on.ellipse((x - radius, y - radius, x + radius, y + radius), fill)
        if length > 0:
            signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
            on.polygon([pixel(u * length, v * width) for u, v in signs], fill)


@lru_cache(maxsize=8)
def _console(panel: Panel, size: int) -> Bytes:
    """``[size, width, 3]`` a panel as pixels; not to be written to."""
    from matplotlib import get_data_path

    scale = size / HEIGHT
    picture = Image.new("RGB", (round(WIDTH * scale), size), BACKGROUND)
    on, folder = ImageDraw.Draw(picture), f"{get_data_path()}/fonts/ttf"
    for row, (text, ink, bold) in enumerate(panel.text(), 1):
        font = f"{folder}/DejaVuSans{'-Bold' * bold}.ttf"
        type_ = ImageFont.truetype(font, max(1, round(TEXT * scale)))
        place = PADDING * scale, (PADDING + row * ROW - 0.1) * scale
        on.text(place, text, ink, type_, anchor="ls")
    return np.asarray(picture)


# -- SVG ------------------------------------------------------------------------------------------


def room_svg(look: Look, panel: Panel | None = None, title: str = "An OpenLock room") -> str:
    """A room as an SVG file, with a console if there is one; the title is its description."""
    shown = frame(look.positions, UNIT)
    high = UNIT * UNIT / shown.scale  # of the room, in the SVG's units
    wide = high * shown.width / shown.height
    unit = high / HEIGHT  # of the console
    whole = wide + (WIDTH * unit if panel else 0.0)
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {_n(whole)} {_n(high)}" '
        f'width="{_n(INCHES * whole / high)}in" height="{_n(INCHES)}in" role="img">',
        f"<title>{escape(title)}</title>",
        f'<rect width="{_n(whole)}" height="{_n(high)}" fill="{_hex(colour("background"))}"/>',
    ]
    for part, shapes in look.shapes().items():
        lines += _group(part, [_shape(shape, shown) for shape in shapes])
    if panel is not None:
        body = [
            f'<rect x="{_n(wide)}" width="{_n(WIDTH * unit)}" height="{_n(high)}" '
            f'fill="{_hex(BACKGROUND)}"/>'
        ]
        for row, (text, ink, bold) in enumerate(panel.text(), 1):
            weight = ' font-weight="bold"' if bold else ""
            if text:
                body.append(
                    f'<text x="{_n(wide + PADDING * unit)}" '
                    f'y="{_n((PADDING + row * ROW - 0.1) * unit)}" '
                    f'font-family="DejaVu Sans, Verdana, sans-serif" font-size="{_n(TEXT * unit)}"'
                    f'{weight} fill="{_hex(ink)}" xml:space="preserve">{escape(text)}</text>'
                )
        lines += _group("console", body)
    return "\n".join([*lines, "</svg>", ""])


def _group(name: str, body: list[str]) -> list[str]:
    return [f'<g id="{name}">', *(f"  {line}" for line in body), "</g>"]


def _shape(shape: Shape, shown: Frame) -> str:
    x, y = (shape.x - shown.left) * UNIT, (shown.top - shape.y) * UNIT
    length, width = shape.length * UNIT, shape.width * UNIT
    style = f'fill="{_hex(shape.fill)}"'
    if shape.line:
        style += f' stroke="{_hex(OUTLINE)}" stroke-width="{_n(shape.line * UNIT)}"'
    if shape.corner == shape.length:
        return f'<circle cx="{_n(x)}" cy="{_n(y)}" r="{_n(length)}" {style}/>'
    rounded = f' rx="{_n(shape.corner * UNIT)}"' if shape.corner else ""
    turned = -math.degrees(shape.angle)
    turn = f' transform="rotate({_n(turned)} {_n(x)} {_n(y)})"' if turned else ""
    return (
        f'<rect x="{_n(x - length)}" y="{_n(y - width)}" width="{_n(2 * length)}" '
        f'height="{_n(2 * width)}"{rounded}{turn} {style}/>'
    )


def _n(number: float) -> str:
    """A number, short and never ``-0``."""
    return f"{round(number, 2) + 0.0:.2f}".rstrip("0").rstrip(".")


def _hex(rgb: Colour) -> str:
    return "#{:02x}{:02x}{:02x}".format(*rgb)


# -- files, and text ------------------------------------------------------------------------------


def save_still(
    look: Look, path: Path | str, size: int = 600, panel: Panel | None = None, title: str = ""
) -> None:
    """Write a picture of a room, PNG or SVG by the suffix; the file is replaced in one step.

    Raises:
        OpenLockError: If the suffix is another or the file cannot be written.
    """
    path = path_of_picture(path, STILLS, "a picture of a room")
    if path.suffix.lower() == ".svg":
        write_text(path, room_svg(look, panel, title or "An OpenLock room"))
        return
    with replacing(path) as file:
        Image.fromarray(draw(look, size, panel)).save(file, "png")


def room_text(observation: ArrayLike, positions: int = 7) -> str:
    """A room in a few lines of plain text, each lever in its place; arguments as for a picture.

    A lever is its position's index and its bar: ``3[#]`` is grey and pushed, ``3[ ]`` grey and
    pulled; inactive levers have round brackets. The door is on the right.
    """
    bits = bits_of(observation, positions)
    # Column and row of each lever; characters are about twice as high as wide.
    cells = np.rint(position_coordinates(positions) * [3.0, -1.0]).astype(int)
    right, lowest = (cells.max(axis=0) - cells.min(axis=0) + [8, 0]).tolist()
    canvas = [[" "] * (right + 40) for _ in range(lowest + 1)]
    for place, (column, row) in enumerate((cells - cells.min(axis=0)).tolist()):
        pushed, grey = bits[place], bits[positions + place]
        mark = "#" if pushed else " "
        canvas[row][column : column + 5] = f"{place:2}" + (f"[{mark}]" if grey else f"({mark})")
    lock = "locked" if bits[-2] else "unlocked"
    door = ["o", "|", f"|  door closed, {lock}"]
    if bits[-1]:
        door = ["o__", "", f"    door open, {lock}"]
    for row, text in enumerate(door, (len(canvas) - 1) // 2 - 1):
        canvas[row][right : right + len(text)] = text
    lines = ["".join(letters).rstrip() for letters in canvas]
    return "\n".join([*lines, "[ ] grey  ( ) inactive  # pushed", ""])
