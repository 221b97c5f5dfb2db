"""Small networks with a memory, shared by the tests."""

import numpy as np
import torch

from openlock_learners.networks.recurrent_policy import Sizes

TINY = Sizes(lever=5, room=6, reader=7)
WIDTH = 16 + 15 + 2 + 4
"""What is perceived in a room of seven positions."""


def rng(seed=0):
    return np.random.default_rng(seed)


def random_inputs(*shape, seed=0):
    """``[*shape, WIDTH]`` of zeros and ones."""
    return torch.from_numpy(rng(seed).integers(0, 2, size=(*shape, WIDTH)).astype(float))


def weights_of(network, index):
    return torch.cat([p.detach()[index].flatten() for p in network.parameters()])
