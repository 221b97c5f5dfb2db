"""Films as GIF, written frame by frame, so that memory does not grow with the length.

All frames share one palette: what a room is drawn with, and the shades on the way from each of
these colours to black and to white, which is where smooth borders take theirs from. Of each frame
only the part is kept that differs from the frame before.
"""

from __future__ import annotations

import struct
from functools import cache
from types import TracebackType
from typing import BinaryIO

import numpy as np
from numpy.typing import NDArray

from causal_openlock.render.panel import BACKGROUND, DONE, FAINT, INK
from causal_openlock.render.raster import Bytes
from causal_openlock.render.scene import Colour, colour

BITS = 5
"""Bits of each of red, green and blue that decide to which colour of the palette one goes."""
LONGEST = 0xFFFF


class GifWriter:
    """Writes a film that repeats for ever.

    Args:
        file: What to write to.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._shown: Bytes | None = None
        self._waiting: tuple[Bytes, int, int] | None = None
        self._seconds = 0.0
        self._written = 0  # hundredths of a second

    def __enter__(self) -> GifWriter:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if kind is None:
            self._flush()
            self._file.write(b";")

    def add(self, picture: Bytes, seconds: float) -> None:
        """Show a picture for a time."""
        indices = _indices(picture)
        if self._shown is None:
            self._begin(*picture.shape[:2])
            self._waiting = indices, 0, 0
        else:
            changed = indices != self._shown
            rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
            if len(rows):
                self._flush()
                top, left = int(rows[0]), int(columns[0])
                part = indices[top : rows[-1] + 1, left : columns[-1] + 1]
                self._waiting = part, left, top
        self._shown = indices
        self._seconds += seconds

    def _begin(self, height: int, width: int) -> None:
        flags = 0x80 | 7 << 4 | 7  # a palette of 2 to the 8 colours, for all frames
        self._file.write(b"GIF89a" + struct.pack("<HHBBB", width, height, flags, 0, 0))
        self._file.write(_palette().tobytes())
        self._file.write(b"!\xff\x0bNETSCAPE2.0\x03\x01" + struct.pack("<HB", 0, 0))

    def _flush(self) -> None:
        """Write the frame that is waiting, now that it is known how long it is shown."""
        if self._waiting is None:
            return
        from PIL import Image
        from PIL.GifImagePlugin import getdata

        part, left, top = self._waiting
        # Rounded from the beginning of the film, so that errors do not add up.
        time = min(max(2, round(100 * self._seconds) - self._written), LONGEST)
        self._written += time
        image = Image.fromarray(np.ascontiguousarray(part))
        for piece in getdata(image, (left, top), duration=10 * time, disposal=1):
            self._file.write(piece)
        self._waiting = None


@cache
def _palette() -> Bytes:
    """``[256, 3]`` the colours."""
    black, white = (0, 0, 0), (255, 255, 255)
    plain = ("active_lever_arm_door", "inactive_lever", "joint_and_hinge", "button",
             "button_pressed")  # fmt: skip
    fills = [colour(name) for name in plain]
    ramps: list[tuple[Colour, Colour, int]] = [(black, white, 32), (DONE, white, 16)]
    ramps += [(black, fill, 14) for fill in fills]
    ramps += [(ink, BACKGROUND, 16) for ink in (INK, FAINT, DONE)]
    ramps += [(colour("active_lever_arm_door"), colour("joint_and_hinge"), 6)]
    colours = dict.fromkeys([white, black, BACKGROUND, INK, FAINT, DONE, *fills])
    for start, end, steps in ramps:
        for part in np.linspace(0, 1, steps):
            mixed = np.rint(np.array(start) * (1 - part) + np.array(end) * part).astype(int)
            colours.setdefault(tuple(mixed.tolist()))
    palette = np.zeros((256, 3), np.uint8)
    palette[: len(colours)] = list(colours)[:256]
    return palette


@cache
def _nearest() -> Bytes:
    """``[2^15]`` which colour of the palette is nearest to all that agree in their first bits."""
    palette = _palette().astype(np.int32)
    levels = (np.arange(1 << BITS) << (8 - BITS)) + (1 << (7 - BITS))
    cells = np.stack(np.meshgrid(levels, levels, levels, indexing="ij"), axis=-1).reshape(-1, 3)
    nearest = np.zeros(len(cells), np.uint8)
    for start in range(0, len(cells), 4096):
        apart = cells[start : start + 4096, None] - palette
        nearest[start : start + 4096] = (apart**2).sum(axis=2).argmin(axis=1)
    # The colours themselves stay what they are; the first in the palette are the most important.
    for index in range(len(palette) - 1, -1, -1):
        nearest[_cell(_palette()[index])] = index
    return nearest


def _cell(rgb: NDArray[np.uint8]) -> NDArray[np.int32]:
    high = rgb.astype(np.int32) >> (8 - BITS)
    return high[..., 0] << 2 * BITS | high[..., 1] << BITS | high[..., 2]


def _indices(picture: Bytes) -> Bytes:
    """``[height, width]`` index of each pixel's colour in the palette."""
    return _nearest()[_cell(picture)]
