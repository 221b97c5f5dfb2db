"""Minibatches of random transitions, in double precision."""

from __future__ import annotations

import numpy as np
import torch

from openlock_learners.networks.replay_buffer import Batch


def minibatch(
    rng: np.random.Generator, agents: int, many: int, rows: int, spread: float = 3
) -> Batch:
    """Transitions between the rows of a table, with rewards of that standard deviation."""
    shape = (agents, many)
    return Batch(
        before=torch.from_numpy(rng.integers(0, rows, shape)),
        action=torch.from_numpy(rng.integers(0, 15, shape)),
        reward=torch.from_numpy(rng.normal(0, spread, shape)),
        after=torch.from_numpy(rng.integers(0, rows, shape)),
        not_done=torch.from_numpy((rng.random(shape) < 0.6).astype(float)),
        weight=torch.from_numpy(rng.uniform(0.2, 1, shape)),
        slot=torch.zeros(shape, dtype=torch.int64),
    )
