"""NumPy archives (``.npz``) from untrusted sources.

An ``.npz`` file is a ZIP archive of arrays, each with a header that states its size. A few bytes
can claim to be gigabytes, in that header or by compression. So sizes are checked before memory is
allocated: those of the archive against a limit, and those of an array against the bytes that are
there. Nothing is unpickled.
"""

from __future__ import annotations

import io
import math
import warnings
import zipfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from causal_openlock.errors import OpenLockError

HEADER = 1 << 14
"""Most bytes before the numbers of an array."""
_HOW = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)


class ArchiveError(OpenLockError):
    """A file is no archive of arrays, or is damaged."""


class Archive:
    """An open archive of arrays.

    Args:
        file: The ZIP file.
        most: Most bytes that all arrays may have together.

    Attributes:
        sizes: Bytes of each array by its name, its header included.
    """

    def __init__(self, file: zipfile.ZipFile, most: int) -> None:
        self._file = file
        held = file.infolist()
        self.sizes = {about.filename.removesuffix(".npy"): about.file_size for about in held}
        if len(self.sizes) < len(held) or any(about.compress_type not in _HOW for about in held):
            raise ArchiveError("it is packed in an unknown way")
        if sum(self.sizes.values()) > most:
            raise ArchiveError(f"it would be larger than {most:,} bytes")

    def read(self, name: str) -> NDArray[Any]:
        """An array by its name.

        Raises:
            ArchiveError: If it is missing or damaged.
        """
        if name not in self.sizes:
            raise ArchiveError(f"it holds no {name}")
        with reading(), self._file.open(f"{name}.npy") as file:
            content = file.read(self.sizes[name] + 1)  # to the end, where its checksum is compared
            if len(content) != self.sizes[name]:
                raise ArchiveError(f"{name} is cut off")
            return _array(content)


@contextmanager
def open_archive(path: Path | str, most: int | None = None) -> Iterator[Archive]:
    """Open an archive of arrays.

    Args:
        path: The file.
        most: Most bytes that its arrays may have; by default as many as the file.

    Raises:
        ArchiveError: If it is no archive, or has more bytes.
        OSError: If there is no such file, or it cannot be opened.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise ArchiveError("it is no file")
    with path.open("rb") as file:
        limit = path.stat().st_size if most is None else most
        with reading():
            archive = Archive(zipfile.ZipFile(file), limit)
        yield archive


@contextmanager
def reading() -> Iterator[None]:
    """Turn any exception in reading a file into a short :class:`ArchiveError`."""
    try:
        yield
    except OpenLockError:
        raise
    # Reading an arbitrary file can raise anything.
    except Exception as error:
        text = " ".join(str(error).split())[:120]
        raise ArchiveError(f"{type(error).__name__}: {text}" if text else "it is cut off") from None


def _array(content: bytes) -> NDArray[Any]:
    """An array from the bytes of an ``.npy`` file."""
    file = io.BytesIO(content[:HEADER])
    version = npy.read_magic(file)
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in read:
        raise ArchiveError("it holds an array of another format")
    with warnings.catch_warnings(action="ignore"):  # about headers written by Python 2
        shape, by_columns, kind = read[version](file)
    if kind.hasobject or kind.subdtype or not kind.itemsize:
        raise ArchiveError("it holds values that are not numbers")
    if any(type(size) is not int or size < 0 for size in shape):
        raise ArchiveError("it holds an array without a valid shape")
    if file.tell() + math.prod(shape) * kind.itemsize != len(content):
        raise ArchiveError("it holds an array of another size than its header states")
    array: NDArray[Any] = np.ndarray(
        shape, kind, content, file.tell(), order="F" if by_columns else "C"
    )
    return array.copy(order="K")
