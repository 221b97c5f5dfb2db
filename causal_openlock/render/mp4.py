"""Films as MP4, by ffmpeg: one that is installed, or the one that imageio-ffmpeg brings."""

from __future__ import annotations

import shutil
import subprocess
import tempfile
from importlib import import_module
from pathlib import Path
from types import TracebackType
from typing import BinaryIO

import numpy as np

from causal_openlock.errors import OpenLockError
from causal_openlock.render.raster import Bytes

PIECE = 1 << 20


def find_ffmpeg() -> str:
    """Path of ffmpeg.

    Raises:
        OpenLockError: If there is none.
    """
    found = shutil.which("ffmpeg")
    if found:
        return found
    try:
        return str(import_module("imageio_ffmpeg").get_ffmpeg_exe())
    except (ImportError, RuntimeError):
        raise OpenLockError(
            "an .mp4 needs ffmpeg, which is not installed; install it, or run pip install "
            "'causal-openlock[film]', or choose a .gif"
        ) from None


class Mp4Writer:
    """Writes a film.

    Args:
        file: What to write to, once the film is whole.
        fps: Frames per second.
    """

    def __init__(self, file: BinaryIO, fps: int) -> None:
        self._file, self._fps = file, fps
        self._ffmpeg = find_ffmpeg()
        self._process: subprocess.Popen[bytes] | None = None

    def __enter__(self) -> Mp4Writer:
        self._folder = tempfile.TemporaryDirectory(prefix="causal_openlock_")
        self._path = Path(self._folder.name) / "film.mp4"
        self._said = (Path(self._folder.name) / "said.txt").open("w+b")
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        try:
            if kind is None:
                self._finish()
            elif self._process is not None:
                self._process.kill()
                self._process.communicate()
        finally:
            self._said.close()
            self._folder.cleanup()

    def add(self, picture: Bytes, frames: int) -> None:
        """Show a picture for some frames."""
        # The usual coding of colours has half the resolution, and so wants even sizes.
        height, width = picture.shape[:2]
        even = np.pad(picture, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
        if self._process is None:
            self._begin(even.shape[1], even.shape[0])
        assert self._process is not None
        assert self._process.stdin is not None
        content = even.tobytes()
        try:
            for _ in range(frames):
                self._process.stdin.write(content)
        except BrokenPipeError:
            self._fail()

    def _begin(self, width: int, height: int) -> None:
        into = f"-f rawvideo -pix_fmt rgb24 -s {width}x{height} -r {self._fps} -i -"
        out = "-an -c:v libx264 -crf 18 -pix_fmt yuv420p -movflags +faststart"
        command = [self._ffmpeg, "-y", "-loglevel", "error", *into.split(), *out.split()]
        self._process = subprocess.Popen(
            [*command, str(self._path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=self._said,
        )

    def _finish(self) -> None:
        if self._process is None:
            return
        assert self._process.stdin is not None
        try:
            self._process.stdin.close()
        except BrokenPipeError:
            self._fail()
        if self._process.wait() or not self._path.exists():
            self._fail()
        with self._path.open("rb") as film:
            shutil.copyfileobj(film, self._file, PIECE)

    def _fail(self) -> None:
        assert self._process is not None
        self._process.kill()
        self._process.wait()
        self._said.seek(0)
        lines = self._said.read().decode(errors="replace").split("\n")
        said = next((line.strip() for line in reversed(lines) if line.strip()), "it does not say")
        raise OpenLockError(
            f"ffmpeg ({self._ffmpeg}) cannot make the film: {said}; choose a .gif, or install "
            "another ffmpeg"
        )
