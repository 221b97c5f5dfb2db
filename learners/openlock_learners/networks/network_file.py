"""A trained policy as a file: its weights and how they were trained, and nothing that could run.

The file is NumPy's own ``.npz``: one array of numbers for each of the network's weights, and one
text in JSON, ``about``, with the sizes of the network and the meta-training that it went through.

A file may come from anybody. So its sizes are compared with limits, then the bytes that follow from
them with those that each array takes, and only then is anything of it unpacked.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
import torch
from pydantic import Field
from torch import Tensor

from causal_openlock.errors import LearnerError, in_short
from causal_openlock.files.atomic import replacing
from causal_openlock.files.validation import StrictModel
from openlock_learners.networks.recurrent_policy import LeverPolicy, Sizes, empty_policy

MOST_BYTES = 1 << 27
"""Most bytes that a file of a network may have."""
HEADER, MOST_ABOUT = 1 << 14, 1 << 20
"""Most bytes before the numbers of an array, and of the description."""
BUNDLED = Path(__file__).parents[1] / "checkpoints" / "rl2.npz"
"""The checkpoint that comes with the package."""
STORED_NAMES = {
    "weight_ih": "input_weight",
    "weight_hh": "hidden_weight",
    "bias_ih": "input_bias",
    "bias_hh": "hidden_bias",
}
"""Names in files of the weights of a ``GRUCell``; all weights are stored as ``[in, out]``."""


class About(StrictModel, extra="ignore"):
    """Fields of a file's description that are used; others are ignored."""

    format: Literal[1]
    sizes: Sizes
    actions: Annotated[int, Field(ge=0)] = 0


def write_network(path: Path | str, network: LeverPolicy, about: dict[str, Any]) -> None:
    """Write a network, whole or not at all, with anything else about it, as plain data."""
    about = {"format": 1, "sizes": network.sizes.model_dump(), **about}
    weights: Any = {
        stored_name(name): _as_stored(part).numpy() for name, part in network.state_dict().items()
    }
    with replacing(path) as file:
        np.savez_compressed(file, about=np.array(json.dumps(about)), **weights)


def read_network(path: Path | str) -> tuple[LeverPolicy, dict[str, Any]]:
    """Read a network and its description.

    Raises:
        LearnerError: If there is no such file, or it holds something else.
    """
    try:
        with _archive(path) as archive:
            about = _about(archive)
            network = empty_policy(About.model_validate(about).sizes)
            expected = network.state_dict()
            if {*archive} != {"about", *map(stored_name, expected)}:
                raise ValueError("it does not hold the weights of a network of its sizes")
            weights = {name: _weights(archive, name, part) for name, part in expected.items()}
    except FileNotFoundError:
        raise LearnerError(
            f"there is no checkpoint {path}; make it with causal-openlock train, or "
            "leave the parameter checkpoint out"
        ) from None
    except Exception as error:  # a file from anywhere can be wrong in any way
        raise LearnerError(
            f"{path} is not a checkpoint of rl2 ({in_short(error)}); make one with "
            "causal-openlock train"
        ) from None
    network.load_state_dict(weights, assign=True)
    return network, about


def trained_actions(path: Path | str) -> int:
    """Number of actions that a network was trained with, by its file.

    0 if the file does not say or is none; :func:`read_network` names what is wrong with it.
    """
    try:
        with _archive(path) as archive:
            return About.model_validate(_about(archive)).actions
    except Exception:
        return 0


def stored_name(name: str) -> str:
    """Name in files of a weight.

    >>> stored_name("room.weight_ih"), stored_name("moves.bias")
    ('room.input_weight', 'moves.bias')
    """
    layer, _, weight = name.partition(".")
    return f"{layer}.{STORED_NAMES.get(weight, weight)}"


def _as_stored(weight: Tensor) -> Tensor:
    """``[in, out]`` of ``[out, in]`` weights, ``[1, out]`` of biases."""
    return weight.t() if weight.dim() == 2 else weight[None]


def _archive(path: Path | str) -> Any:
    """NumPy's archive of arrays, none of which is unpacked yet."""
    if Path(path).exists() and not Path(path).is_file():
        raise ValueError("it is not a file")
    return np.load(path, allow_pickle=False)


def _unpacked(archive: Any, name: str, most: int) -> Any:
    """An array; one that would have more bytes than ``most`` is not unpacked."""
    if archive.zip.getinfo(f"{name}.npy").file_size > most:
        raise ValueError(f"it does not fit its own sizes at {name}")
    return archive[name]


def _about(archive: Any) -> Any:
    return json.loads(str(_unpacked(archive, "about", MOST_ABOUT)).encode("ascii"))


def _weights(archive: Any, name: str, expected: Tensor) -> Tensor:
    """A weight of the network, if it has the shape of the expected one and is finite."""
    name = stored_name(name)
    weights = _unpacked(archive, name, 4 * expected.numel() + HEADER)
    if weights.shape != _as_stored(expected).shape or weights.dtype != np.float32:
        raise ValueError(f"it does not fit its own sizes at {name}")
    if not np.isfinite(weights).all():
        raise ValueError(f"not all numbers in {name} are finite")
    return torch.from_numpy(weights).t().reshape(expected.shape).contiguous()
