"""State dicts as files of data, not of code.

A pickle can run any program when it is read, and results folders are shared. So a state is written
as arrays in an uncompressed ``.npz`` archive, with an outline in JSON that refers to them. Reading
makes only plain values, NumPy arrays and tensors.

An ``.npz`` file is a ZIP archive of arrays, each with a header that states its size. A few bytes
can claim to be gigabytes, in that header or by compression. So sizes are checked before memory is
allocated: those of the archive against a limit, and those of an array against the bytes that are
there. Checksums are verified, and nothing is unpickled.

>>> from tempfile import NamedTemporaryFile
>>> with NamedTemporaryFile() as file:
...     write_state(file, {"weights": np.ones(2), "steps": (3, None)})
...     file.flush()
...     read_state(file.name)
{'weights': array([1., 1.]), 'steps': (3, None)}
"""

from __future__ import annotations

import io
import json
import math
import sys
import warnings
import zipfile
from collections import OrderedDict
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.lib import format as npy
from numpy.typing import NDArray

from causal_openlock.errors import OpenLockError

PLAIN = (type(None), bool, int, float, str)
OUTLINE = "outline"
HEADER = 1 << 14
"""Most bytes before the numbers of an array."""


class StateError(OpenLockError):
    """A state is not plain data, or a file is not an archive of arrays, or is damaged."""


class Transient(bytes):
    """Bytes that only this process can use, so that they must not be saved.

    Attributes:
        reason: Why not.
    """

    reason = ""


def write_state(file: BinaryIO, state: Any) -> None:
    """Write nested dicts, lists and tuples of plain values, arrays and tensors.

    Raises:
        StateError: If it contains anything else; then nothing is written.
    """
    arrays: dict[str, NDArray[Any]] = {}
    outline = json.dumps(_outlined(state, arrays, "state"))
    np.savez(file, **{OUTLINE: np.frombuffer(outline.encode(), np.uint8)}, **arrays)  # type: ignore[arg-type]


def read_state(path: Path | str) -> Any:
    """Read what :func:`write_state` wrote; tensors are on the CPU.

    Raises:
        StateError: If the file is damaged, or no such file.
        FileNotFoundError: If it is not there.
    """
    with open_archive(path) as arrays:
        return _restored(json.loads(arrays.read(OUTLINE).tobytes()), arrays)


def _outlined(value: Any, arrays: dict[str, NDArray[Any]], at: str) -> Any:
    """A value as JSON, its arrays collected; other types become lists that begin with a tag."""

    def kept(kind: str, array: NDArray[Any]) -> list[str]:
        name = f"a{len(arrays)}"
        arrays[name] = array
        return [kind, name]

    # Exact types, as a subclass would be read back as its base.
    if type(value) in PLAIN:
        return value
    if type(value) in (dict, OrderedDict):
        pairs = [
            [_outlined(key, arrays, at), _outlined(part, arrays, f"{at}.{key}")]
            for key, part in value.items()
        ]
        return ["dict", pairs]
    if type(value) in (list, tuple):
        parts = [_outlined(part, arrays, f"{at}.{index}") for index, part in enumerate(value)]
        return [type(value).__name__, parts]
    if isinstance(value, Transient):
        raise StateError(value.reason)
    if type(value) is bytes:
        return kept("bytes", np.frombuffer(value, np.uint8))
    if type(value) is np.ndarray and not value.dtype.hasobject:
        return kept("array", value)
    if isinstance(value, np.generic) and not value.dtype.hasobject:
        return kept("number", np.asarray(value))
    # Without torch there are no tensors, so it need not be imported.
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(value, torch.Tensor):
        try:
            return kept("tensor", value.detach().cpu().numpy())
        except (TypeError, RuntimeError):  # a dtype that NumPy does not have
            _refuse(value.dtype, at)
    _refuse(type(value).__name__, at)


def _refuse(what: Any, at: str) -> NoReturn:
    raise StateError(
        f"it holds {what} at {at}, and only numbers, texts, NumPy arrays and tensors, in dicts, "
        "lists and tuples, can be kept"
    )


def _restored(outline: Any, arrays: Archive) -> Any:
    if not isinstance(outline, list):
        return outline
    kind, held = outline
    if kind == "dict":
        return {_restored(key, arrays): _restored(part, arrays) for key, part in held}
    if kind in ("list", "tuple"):
        parts = [_restored(part, arrays) for part in held]
        return parts if kind == "list" else tuple(parts)
    array = arrays.read(held)
    if kind == "bytes":
        return array.tobytes()
    if kind == "number":
        return array[()]
    if kind == "tensor":
        import torch

        return torch.from_numpy(array)
    return array


# -- archives of arrays ---------------------------------------------------------------------------


class Archive:
    """An open archive of arrays, from :func:`open_archive`.

    Attributes:
        sizes: Bytes of each array by its name, its header included.
    """

    def __init__(self, file: zipfile.ZipFile, most: int) -> None:
        self._file = file
        held, known = file.infolist(), (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
        self.sizes = {about.filename.removesuffix(".npy"): about.file_size for about in held}
        if len(self.sizes) < len(held) or any(about.compress_type not in known for about in held):
            raise StateError("it is packed in an unknown way")
        if sum(self.sizes.values()) > most:
            raise StateError(f"it would be larger than {most:,} bytes")

    def read(self, name: str) -> NDArray[Any]:
        """An array by its name.

        Raises:
            StateError: If it is missing or damaged.
        """
        if name not in self.sizes:
            raise StateError(f"it holds no {name}")
        with self._file.open(f"{name}.npy") as file:
            content = file.read(self.sizes[name] + 1)  # to the end, where its checksum is compared
            if len(content) != self.sizes[name]:
                raise StateError(f"{name} is cut off")
            return _array(content)


@contextmanager
def open_archive(path: Path | str, most: int | None = None) -> Iterator[Archive]:
    """Open an archive of arrays; any exception in reading it becomes a short :class:`StateError`.

    Args:
        path: The file.
        most: Most bytes that its arrays may have together; by default as many as the file.

    Raises:
        OSError: If there is no such file, or it cannot be opened.
    """
    path = Path(path)
    if path.exists() and not path.is_file():
        raise StateError("it is not a file")
    with path.open("rb") as file:
        try:
            yield Archive(zipfile.ZipFile(file), path.stat().st_size if most is None else most)
        except OpenLockError:
            raise
        # Reading an arbitrary file can raise anything.
        except Exception as error:
            text = " ".join(str(error).split())[:120]
            reason = f"{type(error).__name__}: {text}" if text else "it is cut off"
            raise StateError(reason) from None


def _array(content: bytes) -> NDArray[Any]:
    """An array from the bytes of an ``.npy`` file."""
    file = io.BytesIO(content[:HEADER])
    version = npy.read_magic(file)
    read = {(1, 0): npy.read_array_header_1_0, (2, 0): npy.read_array_header_2_0}
    if version not in read:
        raise StateError("it holds an array of another format")
    with warnings.catch_warnings(action="ignore"):  # about headers written by Python 2
        shape, by_columns, kind = read[version](file)
    if kind.hasobject or kind.subdtype or not kind.itemsize:
        raise StateError("it holds values that are not numbers")
    if any(type(size) is not int or size < 0 for size in shape):
        raise StateError("it holds an array without a valid shape")
    if file.tell() + math.prod(shape) * kind.itemsize != len(content):
        raise StateError("it holds an array of another size than its header states")
    array: NDArray[Any] = np.ndarray(
        shape, kind, content, file.tell(), order="F" if by_columns else "C"
    )
    if kind.kind == "U":  # NumPy makes texts of any number, and compiled code ends at such a text
        points = array.reshape(-1).view(np.dtype("u4").newbyteorder(kind.byteorder))
        if ((points > sys.maxunicode) | ((points >= 0xD800) & (points < 0xE000))).any():
            raise StateError("it holds a text that is not Unicode")
    return array.copy(order="K")
