"""Shapes as pixels, smooth at any size.

How much of a pixel a shape covers follows from its distance to the shape's border, which for
a bar with rounded corners is a short formula. So nothing is drawn larger and shrunk, and a shape
costs as much as the pixels around it.

Most of a picture is the same as in the one before. A lever, the door and the lock change pixels of
their own, so what each of them changes is painted once for each state and kept; a picture is a copy
of the empty room with a few of these pieces on top. An arm that is not at rest is above them and
is painted each time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from causal_openlock.render.scene import (
    Frame,
    Look,
    Shape,
    arm,
    button,
    colour,
    door,
    frame,
    lever,
    resting,
    resting_arm,
)

Bytes = NDArray[np.uint8]
Piece = tuple[NDArray[np.int32], Bytes]

STEPS = 256
"""Resolution of the places of levers and the door: parts of a track, or of a radian."""
THINNEST = 0.8
"""The least width of an outline, in pixels."""


def room_pixels(look: Look, size: int) -> Bytes:
    """A new ``[size, width, 3]`` picture of a room, ``size`` pixels high: red, green, blue."""
    positions, shown = look.positions, frame(look.positions, size)
    picture = _empty_room(positions, size, look.pressed).copy()
    flat = picture.reshape(-1, 3)
    parts: list[tuple[Any, ...]] = [
        (lever, place, round(slid * STEPS) / STEPS, grey)
        for place, (slid, grey) in enumerate(zip(look.levers, look.grey, strict=True))
    ]
    parts.append((door, round(look.door * STEPS) / STEPS, look.locked))
    at_rest = look.joints == resting(positions)
    if at_rest:
        parts.append((resting_arm,))
    for part, *state in parts:
        where, colours = _piece(positions, size, part, *state)
        flat[where] = colours
    if not at_rest:
        paint(picture, arm(look.joints), shown)
    return picture


def paint(picture: Bytes, shapes: Iterable[Shape], shown: Frame) -> None:
    """Paint shapes onto a picture, each above those before it."""
    for shape in shapes:
        _paint(picture, shape, shown)


def _paint(picture: Bytes, shape: Shape, shown: Frame) -> None:
    scale = shown.scale
    line = max(shape.line * scale, THINNEST) / 2 if shape.line else 0.0
    # The pixels around it: those that it can cover a part of.
    x, y = (shape.x - shown.left) * scale, (shown.top - shape.y) * scale
    length, width = shape.length * scale, shape.width * scale
    cos, sin = math.cos(shape.angle), math.sin(shape.angle)
    wide = abs(cos) * length + abs(sin) * width + line + 1
    high = abs(sin) * length + abs(cos) * width + line + 1
    left, right = max(0, math.floor(x - wide)), min(shown.width, math.ceil(x + wide))
    top, bottom = max(0, math.floor(y - high)), min(shown.height, math.ceil(y + high))
    if left >= right or top >= bottom:
        return
    dx = np.arange(left, right, dtype=np.float32) + np.float32(0.5 - x)
    dy = (np.arange(top, bottom, dtype=np.float32) + np.float32(y * -1 + 0.5))[:, None]
    # Distance to the border, negative inside; rows go down where y goes up.
    corner = shape.corner * scale
    u = np.abs(dx * np.float32(cos) - dy * np.float32(sin)) - np.float32(length - corner)
    v = np.abs(dx * np.float32(sin) + dy * np.float32(cos)) - np.float32(width - corner)
    away = np.minimum(np.maximum(u, v), 0)
    away += np.sqrt(np.maximum(u, 0) ** 2 + np.maximum(v, 0) ** 2)
    away -= np.float32(corner)
    whole = np.clip(np.float32(0.5 + line) - away, 0, 1)[..., None]
    inner = np.clip(np.float32(0.5 - line) - away, 0, 1)[..., None] if line else whole
    under = picture[top:bottom, left:right]
    # The outline is black and adds nothing.
    under[:] = under * (1 - whole) + np.array(shape.fill, np.float32) * inner + np.float32(0.5)


@lru_cache(maxsize=16)
def _empty_room(positions: int, size: int, pressed: bool) -> Bytes:
    picture = _blank(frame(positions, size))
    paint(picture, [button(positions, pressed)], frame(positions, size))
    return picture


@lru_cache(maxsize=768)
def _piece(positions: int, size: int, part: Callable[..., list[Shape]], *state: Any) -> Piece:
    """Pixels of an empty picture that a part of the room changes, and their colours."""
    shown = frame(positions, size)
    picture = _blank(shown)
    paint(picture, part(positions, *state), shown)
    flat = picture.reshape(-1, 3)
    where = np.flatnonzero((flat != np.array(colour("background"))).any(axis=1))
    return where.astype(np.int32), flat[where]


def _blank(shown: Frame) -> Bytes:
    return np.full((shown.height, shown.width, 3), colour("background"), np.uint8)
