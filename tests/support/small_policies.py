"""Small networks with a memory, shared by the tests."""

from __future__ import annotations

import numpy as np
import torch

from openlock_learners.networks.recurrent_policy import RecurrentPolicy, Sizes

TINY = Sizes(lever=5, room=6, reader=7)
WIDTH = 16 + 15 + 2 + 4
"""What is perceived in a room of seven positions."""


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def random_inputs(*shape: int, seed: int = 0) -> torch.Tensor:
    """``[*shape, WIDTH]`` of zeros and ones."""
    return torch.from_numpy(rng(seed).integers(0, 2, size=(*shape, WIDTH)).astype(float))


def weights_of(network: RecurrentPolicy, index: int) -> torch.Tensor:
    return torch.cat([p.detach()[index].flatten() for p in network.parameters()])
