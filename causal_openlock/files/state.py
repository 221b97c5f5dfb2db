"""State dicts as files of data, not of code.

A pickle can run any program when it is read, and results folders are shared. So a state is written
as arrays in an uncompressed ``.npz`` archive, with an outline in JSON that refers to them. Reading
makes only plain values, NumPy arrays and tensors, and verifies the archive's checksums
(:mod:`causal_openlock.files.npz`).

>>> from tempfile import NamedTemporaryFile
>>> with NamedTemporaryFile() as file:
...     write_state(file, {"weights": np.ones(2), "steps": (3, None)})
...     file.flush()
...     read_state(file.name)
{'weights': array([1., 1.]), 'steps': (3, None)}
"""

from __future__ import annotations

import json
import sys
from collections import OrderedDict
from pathlib import Path
from typing import Any, BinaryIO, NoReturn

import numpy as np
from numpy.typing import NDArray

from causal_openlock.errors import OpenLockError
from causal_openlock.files.npz import Archive, ArchiveError, open_archive, reading

PLAIN = (type(None), bool, int, float, str)
OUTLINE = "outline"


class StateError(OpenLockError):
    """A state cannot be saved as plain data, or a file holds none."""


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
    try:
        with open_archive(path) as arrays, reading():
            return _restored(json.loads(arrays.read(OUTLINE).tobytes()), arrays)
    except ArchiveError as error:
        raise StateError(str(error)) from None


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
