"""Films as GIF and MP4, written frame by frame, so that memory does not grow with the length.

Pillow encodes the frames of a GIF. All of them share one palette: the colours that a room is drawn
with, and the shades on the way from each of these to black and to white, which smooth borders are
made of. Of each frame only the part is kept that differs from the frame before. An MP4 is made by
the ffmpeg that imageio-ffmpeg brings or finds.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import cache
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np
from PIL import Image, ImageChops
from PIL.GifImagePlugin import getdata, getheader

from causal_openlock.errors import OpenLockError
from causal_openlock.render.paint import BACKGROUND, DONE, FAINT, INK, Bytes
from causal_openlock.render.scene import Colour, colour

APART = 8
"""The least distance between two colours of the palette in red, green or blue. Pillow looks colours
up in a grid of steps of 4; what is farther apart keeps its exact value."""
LONGEST = 0xFFFF


def write_gif(file: BinaryIO, pictures: Iterable[tuple[Bytes, int]], fps: int) -> None:
    """Write a film of pictures, each with its number of frames; it repeats for ever."""
    shown: Image.Image | None = None
    part, corner = Image.new("P", (1, 1)), (0, 0)
    frames = written = 0

    def flush() -> int:
        """Write the part that is waiting, now that it is known how long it is shown."""
        # Rounded from the beginning of the film, so that errors do not add up.
        time = min(max(2, round(100 * frames / fps) - written), LONGEST)
        file.writelines(getdata(part, corner, duration=10 * time, disposal=1))
        return written + time

    for picture, many in pictures:
        image = Image.fromarray(picture).quantize(palette=_palette(), dither=Image.Dither.NONE)
        if shown is None:
            file.writelines(getheader(image, info={"loop": 0})[0])
            part = image
        elif changed := ImageChops.subtract_modulo(image, shown).getbbox():
            written = flush()
            part, corner = image.crop(changed), changed[:2]
        shown = image
        frames += many
    flush()
    file.write(b";")


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


def load_ffmpeg() -> Any:
    """The module ``imageio_ffmpeg``, where it has an ffmpeg.

    Raises:
        OpenLockError: If there is none.
    """
    try:
        module = import_module("imageio_ffmpeg")
        module.get_ffmpeg_exe()
    except (ImportError, RuntimeError):
        raise OpenLockError(
            "an .mp4 needs ffmpeg, which is not installed; run pip install "
            "'causal-openlock[film]', or choose a .gif"
        ) from None
    return module


def write_mp4(file: BinaryIO, pictures: Iterable[tuple[Bytes, int]], fps: int) -> None:
    """Write a film of pictures, each with its number of frames.

    Raises:
        OpenLockError: If ffmpeg does not make it.
    """
    ffmpeg = load_ffmpeg()
    frames = 0
    with TemporaryDirectory(prefix="causal_openlock_") as folder:
        path = Path(folder) / "film.mp4"
        film: Any = None
        try:
            for picture, many in pictures:
                # The usual coding of colours has half the resolution, and so needs even sizes.
                height, width = picture.shape[:2]
                even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
                if film is None:
                    film = ffmpeg.write_frames(
                        str(path),
                        even.shape[1::-1],
                        fps=fps,
                        codec="libx264",
                        quality=None,
                        macro_block_size=1,
                        ffmpeg_log_level="error",
                        output_params=["-crf", "18", "-movflags", "+faststart"],
                    )
                    next(film)  # it waits for pictures now
                for _ in range(many):
                    film.send(even.tobytes())
                frames += many
            film.close()
            # imageio-ffmpeg does not report whether ffmpeg succeeded; the film shows it.
            if ffmpeg.count_frames_and_secs(path)[0] != frames:
                raise RuntimeError
        except (OSError, RuntimeError) as error:
            raise OpenLockError(
                f"ffmpeg ({ffmpeg.get_ffmpeg_exe()}) cannot make the film, for the reason that it "
                "has printed; choose a .gif, or install another ffmpeg"
            ) from error
        finally:
            if film is not None:
                film.close()
        file.write(path.read_bytes())
