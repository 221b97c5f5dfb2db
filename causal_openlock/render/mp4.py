"""Films as MP4, made by the ffmpeg that imageio-ffmpeg brings or finds."""

from __future__ import annotations

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, BinaryIO

import numpy as np

from causal_openlock.errors import OpenLockError
from causal_openlock.render.raster import Bytes


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
    """Write a film.

    Args:
        file: What to write to, once the film is whole.
        pictures: Pictures, each with the number of frames for which it is shown.
        fps: Frames per second.

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
                # The usual coding of colours has half the resolution, and so wants even sizes.
                height, width = picture.shape[:2]
                even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
                if film is None:
                    film = _begin(ffmpeg, path, even, fps)
                for _ in range(many):
                    film.send(even.tobytes())
                frames += many
            film.close()
            # imageio-ffmpeg does not tell whether ffmpeg has succeeded; the film does.
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


def _begin(ffmpeg: Any, path: Path, picture: Bytes, fps: int) -> Any:
    """ffmpeg, waiting for pictures of the size of the first one."""
    height, width = picture.shape[:2]
    film = ffmpeg.write_frames(
        str(path),
        (width, height),
        fps=fps,
        codec="libx264",
        quality=None,
        macro_block_size=1,
        ffmpeg_log_level="error",
        output_params=["-crf", "18", "-movflags", "+faststart"],
    )
    next(film)
    return film
