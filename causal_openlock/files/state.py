"""State dicts as files of data, not of code.

A pickle can run any program when it is read, and a results folder is something people pass on. So
a state is written as arrays in an uncompressed ``.npz`` archive, together with a text in JSON that
says how they hang together; reading one makes nothing but plain values, NumPy arrays and tensors.
The archive's checksums tell a file that does not read back as what was written
(:mod:`causal_openlock.files.archive`).

>>> with open("learner.state", "wb") as file:
...     write_state(file, {"weights": np.ones(2), "steps": (3, None)})
>>> read_state("learner.state")
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
from causal_openlock.files.archive import Archive, ArchiveError, open_archive, reading

PLAIN = (type(None), bool, int, float, str)
OUTLINE = "outline"


class StateError(OpenLockError):
    """A state that cannot be kept as plain data, or a file that holds none."""


class Passing(bytes):
    """Bytes that mean something to this process alone, so that no file is to hold them.

    Attributes:
        why: Why that is so.
    """

    why = ""


def write_state(file: BinaryIO, state: Any) -> None:
    """Write nested dicts, lists and tuples of plain values, arrays and tensors.

    Raises:
        StateError: If there is anything else in it; nothing is written then.
    """
    arrays: dict[str, NDArray[Any]] = {}
    outline = json.dumps(_outlined(state, arrays, "state"))
    np.savez(file, **{OUTLINE: np.frombuffer(outline.encode(), np.uint8)}, **arrays)  # type: ignore[arg-type]


def read_state(path: Path | str) -> Any:
    """What :func:`write_state` wrote; tensors are on the CPU, wherever they were.

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
    """A value in JSON; its arrays are put aside. A list stands for what JSON cannot say."""

    def kept(kind: str, array: NDArray[Any]) -> list[str]:
        name = f"a{len(arrays)}"
        arrays[name] = array
        return [kind, name]

    # Exact types: what is a subclass would come back as something else.
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
    if isinstance(value, Passing):
        raise StateError(value.why)
    if type(value) is bytes:
        return kept("bytes", np.frombuffer(value, np.uint8))
    if type(value) is np.ndarray and not value.dtype.hasobject:
        return kept("array", value)
    if isinstance(value, np.generic) and not value.dtype.hasobject:
        return kept("number", np.asarray(value))
    # Where no tensor can be, torch need not be loaded.
    torch = sys.modules.get("torch")
    if torch is not None and isinstance(value, torch.Tensor):
        try:
            return kept("tensor", value.detach().cpu().numpy())
        except (TypeError, RuntimeError):  # a kind of tensor that NumPy does not know
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
