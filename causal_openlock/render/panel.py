"""The console next to a room: what a subject is shown, and in a film what it did.

A panel is laid out once, as shapes and labels, and is then painted as pixels or written as SVG. It
is as high as the picture of the room; lengths are in 1/7.6 of that height.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from causal_openlock.render.raster import Bytes, paint, room_pixels
from causal_openlock.render.scene import Colour, Frame, Look, Shape, rod

WIDTH, HEIGHT = 5.1, 7.6
PADDING = 0.28
ROW, SPACE = 0.335, 0.2
BACKGROUND: Colour = (246, 246, 246)
INK: Colour = (30, 30, 30)
FAINT: Colour = (105, 105, 105)
DONE: Colour = (0, 120, 62)
TEXT, HEADING = 0.235, 0.29
MOST_SOLUTIONS = 5


class Label(NamedTuple):
    """A line of text: where it begins, ``x``, its baseline ``y``, and the height of its type."""

    x: float
    y: float
    text: str
    height: float = TEXT
    colour: Colour = INK
    bold: bool = False


@dataclass(frozen=True)
class ShownAction:
    """An action of the attempt in progress.

    Attributes:
        name: Such as ``push UPPER``.
        outcome: What came of it, in words; empty while it is carried out.
        good: Whether that was progress.
    """

    name: str
    outcome: str = ""
    good: bool = False

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
    """Content of the console next to a room.

    Attributes:
        solutions: For each solution how it was found, such as ``LEFT, UPPER, door``; empty for
            each that is not found yet. ``None`` for found ones without a description.
        attempts_left: Attempts left in the trial, the present one included; ``None`` once it is
            solved and over.
        actions_left: Actions left in the attempt.
        heading: Who plays what.
        lines: More about it.
        actions: What was done in this attempt; ``None`` leaves it out.
        remark: A last line.
    """

    solutions: tuple[str | None, ...]
    attempts_left: int | None
    actions_left: int
    heading: str = ""
    lines: tuple[str, ...] = ()
    actions: tuple[ShownAction, ...] | None = None
    remark: str = ""

    def layout(self) -> tuple[list[Shape], list[Label]]:
        """Everything on it, from the top down; the origin is its lower left corner."""
        shapes: list[Shape] = []
        labels: list[Label] = []
        y = HEIGHT - PADDING

        def write(text: str, x: float = 0.0, **style: Any) -> None:
            labels.append(_fitted(Label(PADDING + x, y + 0.1, text, **style)))

        if self.heading:
            y -= 0.42
            write(self.heading, height=HEADING, bold=True)
            for line in self.lines:
                y -= ROW
                write(line, colour=FAINT)
            y -= SPACE
        found = [how for how in self.solutions if how != ""]
        y -= ROW
        write(f"Solutions found: {len(found)} of {len(self.solutions)}", bold=True)
        # Those found last, and a few boxes that are still empty.
        boxes = [*found, *[""] * (len(self.solutions) - len(found))]
        first = max(0, min(len(found) - MOST_SOLUTIONS + 1, len(boxes) - MOST_SOLUTIONS))
        for how in boxes[first : first + MOST_SOLUTIONS]:
            y -= ROW
            shapes += _box(y, ticked=how != "")
            if how:
                write(how, 0.42, colour=DONE)
        y -= SPACE + ROW
        left = "–" if self.attempts_left is None else self.attempts_left
        write(f"Attempts left: {left}", bold=True)
        write(f"Actions left: {self.actions_left}", WIDTH / 2 + 0.2 - PADDING, bold=True)
        if self.actions is not None:
            y -= SPACE + ROW
            write("This attempt", bold=True)
            # As many as there is room for above the last line, the latest ones.
            most = int((y - PADDING - ROW) / (2 * ROW))
            first = max(0, len(self.actions) - most)
            for number, action in enumerate(self.actions[first:], first + 1):
                y -= ROW
                write(str(number), bold=not action.outcome)
                write(action.name, 0.36, bold=not action.outcome)
                y -= ROW
                outcome = action.outcome or "..."
                write(outcome, 0.36, colour=DONE if action.good else FAINT)
        if self.remark:
            labels.append(_fitted(Label(PADDING, PADDING, self.remark, bold=True)))
        return shapes, labels


def _box(y: float, ticked: bool) -> list[Shape]:
    left, bottom, side = PADDING + 0.02, y + 0.07, 0.23
    middle, low = bottom + side / 2, (left + 0.10, bottom + 0.06)
    box = [rod((left, middle), (left + side, middle), side, (255, 255, 255))]
    for end in ((left + 0.03, bottom + 0.14), (left + 0.25, bottom + 0.28)):
        box += [rod(low, end, 0.055, DONE, rounded=True, line=0.0)] * ticked
    return box


def _fitted(label: Label) -> Label:
    """A label in smaller type if it is too long for the panel, and cut if it is much too long."""
    room = WIDTH - PADDING / 2 - label.x
    wide = _width(label)
    if wide <= room:
        return label
    label = label._replace(height=label.height * max(room / wide, 0.72))
    while _width(label) > room:
        label = label._replace(text=label.text.removesuffix("…")[:-1].rstrip() + "…")
    return label


def _width(label: Label) -> float:
    return float(font(100, label.bold).getlength(label.text)) / 100 * label.height


@cache
def font(pixels: int, bold: bool) -> Any:
    """The typeface of the panel, matplotlib's own, in some size."""
    import matplotlib as mpl
    from PIL import ImageFont

    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(f"{mpl.get_data_path()}/fonts/ttf/{name}", pixels)


def draw(look: Look, size: int, panel: Panel | None = None) -> Bytes:
    """A new ``[size, width, 3]`` picture of a room, with the console next to it if there is one."""
    room = room_pixels(look, size)
    return room if panel is None else np.hstack([room, panel_picture(panel, size)])


@lru_cache(maxsize=8)
def panel_picture(panel: Panel, size: int) -> Bytes:
    """``[size, width, 3]`` a panel as pixels; not to be written to."""
    from PIL import Image, ImageDraw

    shapes, labels = panel.layout()
    scale = size / HEIGHT
    shown = Frame(0.0, HEIGHT, scale, round(WIDTH * scale), size)
    picture = _blank(shown.width, size).copy()
    paint(picture, shapes, shown)
    image = Image.fromarray(picture)
    on = ImageDraw.Draw(image)
    for label in labels:
        x, y = shown.pixel((label.x, label.y))
        type_ = font(max(1, round(label.height * scale)), label.bold)
        on.text((x, y), label.text, label.colour, type_, anchor="ls")
    drawn = np.array(image)
    drawn.flags.writeable = False
    return drawn


@lru_cache(maxsize=4)
def _blank(width: int, height: int) -> Bytes:
    return np.full((height, width, 3), BACKGROUND, np.uint8)
