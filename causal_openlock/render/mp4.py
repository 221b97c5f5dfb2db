"""Films as MP4, made by the ffmpeg that imageio-ffmpeg brings or finds."""

from __future__ import annotations

import tempfile
from collections.abc import Generator
from importlib import import_module
from pathlib import Path
from types import TracebackType
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


class Mp4Writer:
    """Writes a film.

    Args:
        file: What to write to, once the film is whole.
        fps: Frames per second.
    """

    def __init__(self, file: BinaryIO, fps: int) -> None:
        self._file, self._fps = file, fps
        self._ffmpeg = load_ffmpeg()
        self._frames = 0
        self._film: Generator[None, bytes, None] | None = None

    def __enter__(self) -> Mp4Writer:
        self._folder = tempfile.TemporaryDirectory(prefix="causal_openlock_")
        self._path = Path(self._folder.name) / "film.mp4"
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        with self._folder:
            if self._film is not None:
                self._film.close()
            if kind is None:
                self._check()
                self._file.write(self._path.read_bytes())

    def add(self, picture: Bytes, frames: int) -> None:
        """Show a picture for some frames."""
        # The usual coding of colours has half the resolution, and so wants even sizes.
        height, width = picture.shape[:2]
        even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        film = self._film or self._begin(even.shape[1], even.shape[0])
        try:
            for _ in range(frames):
                film.send(even.tobytes())
        except OSError:
            raise self._failure() from None
        self._frames += frames

    def _begin(self, width: int, height: int) -> Generator[None, bytes, None]:
        film: Generator[None, bytes, None] = self._ffmpeg.write_frames(
            str(self._path),
            (width, height),
            fps=self._fps,
            codec="libx264",
            quality=None,
            macro_block_size=1,
            ffmpeg_log_level="error",
            output_params=["-crf", "18", "-movflags", "+faststart"],
        )
        next(film)
        self._film = film
        return film

    def _check(self) -> None:
        """imageio-ffmpeg does not tell whether ffmpeg has succeeded; the film does."""
        try:
            frames, _ = self._ffmpeg.count_frames_and_secs(self._path)
        except RuntimeError:
            frames = 0
        if frames != self._frames:
            raise self._failure()

    def _failure(self) -> OpenLockError:
        return OpenLockError(
            f"ffmpeg ({self._ffmpeg.get_ffmpeg_exe()}) cannot make the film, for the reason that "
            "it has printed; choose a .gif, or install another ffmpeg"
        )
