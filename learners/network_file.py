"""A trained network as a file: its weights and how it came about, and nothing that could run.

The file is NumPy's own ``.npz``: one array of numbers for each of the network's weights, and one
text in JSON, ``about``, with the sizes of the network and the meta-training that it went through.
"""

from __future__ import annotations

import json
import zipfile
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import torch

from causal_openlock.errors import LearnerError
from causal_openlock.files import replacing
from learners.memories import Memory, Sizes, make_memory

FORMAT = 1
BUNDLED = Path(__file__).parent / "checkpoints" / "rl2.npz"
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
        with np.load(path, allow_pickle=False) as file:
            about = json.loads(str(file["about"]))
            if about["format"] != FORMAT:
                raise LearnerError(
                    f"{path} has format {about['format']} and this version reads {FORMAT}; train "
                    "it anew"
                )
            network = make_memory(
                Sizes(**about["sizes"]), about["positions"], [np.random.default_rng(0)] * copies
            )
            weights = {name: file[name] for name in network.state_dict()}
    except FileNotFoundError:
        raise LearnerError(
            f"there is no checkpoint {path}; make it with python -m learners.meta_training, or "
            "leave the parameter checkpoint out"
        ) from None
    except (OSError, ValueError, KeyError, TypeError, EOFError, zipfile.BadZipFile) as error:
        raise LearnerError(
            f"{path} is no checkpoint of rl2 ({type(error).__name__}: {error}); make one with "
            "python -m learners.meta_training"
        ) from None
    for name, tensor in network.state_dict().items():
        if weights[name].shape != tensor.shape[1:]:
            raise LearnerError(f"{path} does not fit its own sizes at {name}; train it anew")
        tensor.copy_(torch.from_numpy(weights[name]).expand_as(tensor))
    return network, about
