"""A trained network as a file: its weights and how it came about, and nothing that could run.

The file is NumPy's own ``.npz``: one array of numbers for each of the network's weights, and one
text in JSON, ``about``, with the sizes of the network and the meta-training that it went through.

A file may be from anybody. So its sizes are compared with limits, then the shapes that follow from
them with what the file says to hold, and only then is anything of it unpacked.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any, NoReturn

import numpy as np
import torch

from causal_openlock.errors import LearnerError
from causal_openlock.files.atomic import replacing
from causal_openlock.files.npz import HEADER, Archive, ArchiveError, open_archive, reading
from causal_openlock.world.room import PAPER_POSITIONS
from causal_openlock.world.schema import MAX_LEVERS
from learners.networks.memories import OWN, SHARED, Memory, Sizes, make_memory

FORMAT = 1
MOST_UNITS = 1024
"""The largest size that a network may have."""
MOST_BYTES = 1 << 27
"""Most bytes that a network may have, packed or not."""
_MOST_TOLD = 1 << 20
BUNDLED = Path(__file__).parents[1] / "checkpoints" / "rl2.npz"
"""The checkpoint that comes with the package."""


def write_network(path: Path | str, network: Memory, positions: int, about: dict[str, Any]) -> None:
    """Write a single network.

    Args:
        path: Where to; the file is complete or not there.
        network: The network, N = 1.
        positions: Levers of the rooms that it was trained in.
        about: What else is to be known of it, as plain data.
    """
    told = {"format": FORMAT, "sizes": asdict(network.sizes), "positions": positions, **about}
    weights = {name: tensor[0].numpy() for name, tensor in network.state_dict().items()}
    with replacing(path) as file:
        np.savez_compressed(file, about=np.array(json.dumps(told)), **weights)


def read_network(path: Path | str, copies: int = 1) -> tuple[Memory, dict[str, Any]]:
    """Read a network.

    Args:
        path: The file.
        copies: How many networks of the same weights to make, N.

    Returns:
        The networks, and what was written about them.

    Raises:
        LearnerError: If there is no such file, or it holds something else.
    """
    try:
        with open_archive(path, MOST_BYTES) as archive, reading():
            about = _about(archive)
            sizes, positions = Sizes(**about["sizes"]), about["positions"]
            expected = shapes(sizes, positions)
            if archive.sizes.keys() != {"about", *expected}:
                _refuse("it does not hold the weights of a network of its sizes")
            weights = {name: _weights(archive, name, shape) for name, shape in expected.items()}
    except FileNotFoundError:
        raise LearnerError(
            f"there is no checkpoint {path}; make it with python -m learners.meta.training, or "
            "leave the parameter checkpoint out"
        ) from None
    except (ArchiveError, OSError) as error:
        said = error.strerror if isinstance(error, OSError) else error
        raise LearnerError(
            f"{path} is no checkpoint of rl2 ({said}); make one with python -m "
            "learners.meta.training"
        ) from None
    network = make_memory(sizes, positions, [np.random.default_rng(0)] * copies)
    for name, tensor in network.state_dict().items():
        tensor.copy_(torch.from_numpy(weights[name]).expand_as(tensor))
    return network, about


def _about(archive: Archive) -> dict[str, Any]:
    """What the file says of its network, if a network can be so."""
    if archive.sizes.get("about", 0) > _MOST_TOLD:
        _refuse("what it says of itself is too long")
    about = json.loads(str(archive.read("about")))
    if about["format"] != FORMAT:
        _refuse(f"it has format {str(about['format'])[:20]!r} and this version reads {FORMAT}")
    kind, *units = (about["sizes"][name] for name in ("kind", "lever", "room", "reader"))
    if kind not in ("levers", "flat"):
        _refuse("its network is of no known kind")
    if any(type(size) is not int or not 1 <= size <= MOST_UNITS for size in units):
        _refuse(f"the sizes of a network are 1 to {MOST_UNITS}")
    positions = about["positions"]
    if type(positions) is not int or not len(PAPER_POSITIONS) <= positions <= MAX_LEVERS:
        _refuse("there are no rooms as those that it was trained in")
    return about


def _weights(archive: Archive, name: str, shape: tuple[int, ...]) -> Any:
    # Unpacked only if it is as large as it must be.
    least = 4 * math.prod(shape)
    if not least < archive.sizes[name] <= least + HEADER:
        _refuse(f"it does not fit its own sizes at {name}")
    held = archive.read(name)
    if held.shape != shape or held.dtype != np.float32:
        _refuse(f"it does not fit its own sizes at {name}")
    if not np.isfinite(held).all():
        _refuse(f"not all numbers in {name} are finite")
    return held


def _refuse(why: str) -> NoReturn:
    raise ArchiveError(why)


def shapes(sizes: Sizes, positions: int) -> dict[str, tuple[int, ...]]:
    """The shapes of a network's weights, by name, without making it."""
    lever, room, reader = sizes.lever, sizes.room, sizes.reader
    if sizes.kind == "flat":
        cells = {"room": (OWN * positions + SHARED, room)}
        layers = {
            "reads": (room, 2 * reader),
            "moves": (reader, 2 * positions + 1),
            "value": (reader, 1),
        }
    else:
        cells = {"room": (SHARED + 3 * lever, room), "lever": (OWN + SHARED + room, lever)}
        layers = {
            "reads_lever": (lever, reader),
            "reads_room": (room + 2 * lever, 2 * reader),
            "moves": (reader, 2),
            "door_and_value": (reader, 2),
        }
    found: dict[str, tuple[int, ...]] = {}
    for name, (inputs, hidden) in cells.items():
        found[f"{name}.input_weight"] = inputs, 3 * hidden
        found[f"{name}.hidden_weight"] = hidden, 3 * hidden
        found[f"{name}.input_bias"] = found[f"{name}.hidden_bias"] = 1, 3 * hidden
    for name, (inputs, outputs) in layers.items():
        found[f"{name}.weight"], found[f"{name}.bias"] = (inputs, outputs), (1, outputs)
    return found
