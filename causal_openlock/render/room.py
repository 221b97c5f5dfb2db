"""A room after actions, as a picture file, and as a few lines of text."""

from __future__ import annotations

from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from causal_openlock.files.atomic import replacing, write_text
from causal_openlock.physics.geometry import Pose
from causal_openlock.physics.room import PhysicalRoom
from causal_openlock.render import STILLS, path_of_picture
from causal_openlock.render.paint import Panel, draw, room_svg
from causal_openlock.render.scene import Look, bits_of
from causal_openlock.world.room import Room, position_coordinates


def look_after(room: Room, actions: Sequence[int] = (), part: float = 1.0) -> Look:
    """Look of a room after actions from the start of an attempt, none of which fails.

    Only a ``part`` of the last movement is carried out, 0 to 1.
    """
    physical = PhysicalRoom(room.fsm, room.layout)
    pose, pressed = physical.pose(), False
    for action in actions:
        poses: list[Pose] = [physical.pose()]
        physical.watch = poses.append
        physical.act(action)
        pose = poses[round((len(poses) - 1) * part)]
        pressed = part < 1.0 and action == 2 * room.positions
    return Look.of_pose(pose, room.active.tolist(), pressed)


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
    from PIL import Image

    with replacing(path) as file:
        Image.fromarray(draw(look, size, panel)).save(file, "png")


def room_text(observation: ArrayLike, positions: int = 7) -> str:
    """A room in a few lines of plain text, each lever in its place; arguments as for a picture.

    A lever is its position's index and its bar: ``3[#]`` is grey and pushed, ``3[ ]`` grey and
    pulled; inactive levers have round brackets. The door is on the right.
    """
    bits = bits_of(observation, positions)
    cells = _text_cells(positions)
    right = max(column for column, _ in cells) + 8
    canvas = [[" "] * (right + 40) for _ in range(max(row for _, row in cells) + 1)]
    for place, (column, row) in enumerate(cells):
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


@cache
def _text_cells(positions: int) -> list[tuple[int, int]]:
    """Column and row of each lever's text; characters are about twice as high as wide."""
    cells: Any = position_coordinates(positions) * [3.0, -1.0]
    cells = np.rint(cells).astype(int)
    cells -= cells.min(axis=0)
    return [(int(column), int(row)) for column, row in cells]
