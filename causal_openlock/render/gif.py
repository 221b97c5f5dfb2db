"""Films as GIF, written frame by frame, so that memory does not grow with the length.

Pillow encodes the frames. All of them share one palette: the colours that a room is drawn with, and
the shades on the way from each of these to black and to white, which smooth borders are made of. Of
each frame only the part is kept that differs from the frame before.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from types import TracebackType
from typing import BinaryIO

import numpy as np
from PIL import Image, ImageChops
from PIL.GifImagePlugin import getdata, getheader

from causal_openlock.render.panel import BACKGROUND, DONE, FAINT, INK
from causal_openlock.render.raster import Bytes
from causal_openlock.render.scene import Colour, colour

APART = 8
"""The least distance between two colours of the palette in red, green or blue. Pillow looks colours
up in a grid of steps of 4; what is farther apart keeps its exact value."""
LONGEST = 0xFFFF


class GifWriter:
    """Writes a film that repeats for ever.

    Args:
        file: What to write to.
    """

    def __init__(self, file: BinaryIO) -> None:
        self._file = file
        self._shown: Image.Image | None = None
        self._waiting: tuple[Image.Image, tuple[int, int]] | None = None
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
        image = Image.fromarray(picture).quantize(palette=_palette(), dither=Image.Dither.NONE)
        if self._shown is None:
            self._file.writelines(getheader(image, info={"loop": 0})[0])
            self._waiting = image, (0, 0)
        elif changed := ImageChops.subtract_modulo(image, self._shown).getbbox():
            self._flush()
            self._waiting = image.crop(changed), changed[:2]
        self._shown = image
        self._seconds += seconds

    def _flush(self) -> None:
        """Write the frame that is waiting, now that it is known how long it is shown."""
        if self._waiting is None:
            return
        # Rounded from the beginning of the film, so that errors do not add up.
        time = min(max(2, round(100 * self._seconds) - self._written), LONGEST)
        self._written += time
        self._file.writelines(getdata(*self._waiting, duration=10 * time, disposal=1))


@cache
def _palette() -> Image.Image:
    """An image with the palette of all films; the most important colours come first."""
    chosen: list[Colour] = []
    for one in _colours():
        if not any(np.abs(np.subtract(one, other)).max() < APART for other in chosen):
            chosen.append(one)
    image = Image.new("P", (1, 1))
    image.putpalette([part for one in chosen for part in one])
    return image


def _colours() -> Iterator[Colour]:
    black, white = (0, 0, 0), (255, 255, 255)
    names = "active_lever_arm_door", "inactive_lever", "joint_and_hinge", "button", "button_pressed"
    fills = [colour(name) for name in names]
    yield from (white, black, BACKGROUND, INK, FAINT, DONE, *fills)
    ramps = [(black, white, 32), (DONE, white, 16), *((black, fill, 14) for fill in fills)]
    ramps += [(ink, BACKGROUND, 16) for ink in (INK, FAINT, DONE)]
    ramps.append((fills[0], fills[2], 6))
    for start, end, steps in ramps:
        for part in np.linspace(0, 1, steps).tolist():
            red, green, blue = (
                round(a * (1 - part) + b * part) for a, b in zip(start, end, strict=True)
            )
            yield red, green, blue
