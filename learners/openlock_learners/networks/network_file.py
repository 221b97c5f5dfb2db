"""A trained policy as a file: its weights and how they were trained, and nothing that could run.

The file is NumPy's own ``.npz``: one array of numbers for each of the network's weights, and one
text in JSON, ``about``, with the sizes of the network and the meta-training that it went through.
A file may come from anybody.
"""

from __future__ import annotations

import json
from io import BytesIO
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from causal_openlock.contract.parameters import Whole
from causal_openlock.errors import LearnerError, in_short
from causal_openlock.files.atomic import replacing
from causal_openlock.files.validation import StrictModel
from openlock_learners.networks.recurrent_policy import LeverPolicy, Sizes, empty_policy
from openlock_learners.trained_file import MOST_BYTES, content_of

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
    actions: Whole = 0


def write_network(path: Path | str, network: LeverPolicy, about: dict[str, Any]) -> None:
    """Write a network, whole or not at all, with anything else about it, as plain data."""
    about = {"format": 1, "sizes": network.sizes.model_dump(), **about}
    weights: Any = {
        stored_name(name): np.atleast_2d(part.numpy().T)
        for name, part in network.state_dict().items()
    }
    with replacing(path) as file:
        np.savez_compressed(file, about=np.array(json.dumps(about)), **weights)


def read_network(path: Path | str) -> tuple[LeverPolicy, dict[str, Any]]:
    """Read a network and its description.

    Raises:
        LearnerError: If there is no such file, or it holds something else.
    """
    content = content_of(path)
    try:
        archive, about = _opened(content)
        network = empty_policy(About.model_validate(about).sizes)
        weights = {name: _weights(archive, name, w) for name, w in network.state_dict().items()}
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
        return About.model_validate(_opened(content_of(path))[1]).actions
    except Exception:
        return 0


def stored_name(name: str) -> str:
    """Name in files of a weight.

    >>> stored_name("room.weight_ih"), stored_name("moves.bias")
    ('room.input_weight', 'moves.bias')
    """
    layer, _, weight = name.partition(".")
    return f"{layer}.{STORED_NAMES.get(weight, weight)}"


def _opened(content: bytes) -> tuple[Any, Any]:
    """NumPy's archive of arrays, which are unpacked when they are asked for, and ``about``."""
    archive = np.load(BytesIO(content), allow_pickle=False)
    if sum(part.file_size for part in archive.zip.infolist()) > MOST_BYTES:
        raise ValueError("its arrays are too large")
    return archive, json.loads(str(archive["about"]))


def _weights(archive: Any, name: str, expected: Tensor) -> Tensor:
    """A weight of the network, which has the shape of the expected one and is finite."""
    stored = archive[stored_name(name)]
    weights = np.ascontiguousarray(stored.T if expected.dim() == 2 else stored[0])
    if weights.shape != expected.shape or weights.dtype != np.float32:
        raise ValueError(f"it does not fit its own sizes at {stored_name(name)}")
    if not np.isfinite(weights).all():
        raise ValueError(f"not all numbers in {stored_name(name)} are finite")
    return torch.from_numpy(weights)
